"""What the site has beyond the pages: the help of every command, scripts, and names of files outside docs/."""

import re
from pathlib import Path
from typing import Any

import typer

ROOT = Path(__file__).parents[1]
COMMANDS = "<!-- the help of every command -->"
SCRIPT = re.compile(r"<!-- (examples/\w+\.py) -->")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Put the help of all commands, or a script, where a page asks for it, and unlink what is not on the site.

    Raises:
        FileNotFoundError: There is no such script, or a link out of docs/ leads nowhere.
    """
    folder = ROOT / "docs" / Path(page.file.src_uri).parent

    def name(link: re.Match[str]) -> str:
        target = (folder / link[2]).resolve()
        if target.is_relative_to(ROOT / "docs"):
            return link[0]
        if not target.exists():
            raise FileNotFoundError(f"{page.file.src_uri}: {link[0]} leads to {target}, which does not exist")
        return f"{link[1]} (`{target.relative_to(ROOT)}`)"

    markdown = re.sub(r"\[([^\]]*)\]\((\.\./[^)#]*)\)", name, markdown)
    markdown = SCRIPT.sub(lambda script: f"```python\n{(ROOT / script[1]).read_text()}```", markdown)
    return markdown.replace(COMMANDS, "\n".join(helps())) if COMMANDS in markdown else markdown


def helps() -> list[str]:
    """A section with the help of every command, as a terminal of 80 columns shows it."""
    from maglev_workbench.cli import app

    return list(_sections(typer.main.get_command(app), "maglev", None))


def _sections(command: Any, name: str, parent: Any) -> Any:
    asked = {"parent": parent, "resilient_parsing": True, "terminal_width": 80}
    context = command.make_context(name.rpartition(" ")[2], [], **asked)
    yield f"\n## {name}\n\n```text\n{command.get_help(context)}\n```"
    for part, below in getattr(command, "commands", {}).items():
        yield from _sections(below, f"{name} {part}", context)
