"""The documentation does what it says: links lead somewhere, its Python runs, its commands are understood."""

import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer

import maglev_workbench
from maglev_workbench.cli import app

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
MAGLEV = typer.main.get_command(app)
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def blocks(language):
    """(page, code) of every block of a language."""
    found = [(page, code) for page in PAGES for name, code in FENCED.findall(page.read_text()) if name == language]
    return [pytest.param(page, code, id=page.name) for page, code in found]


def anchors(page):
    """What headings are called in links, on code hosts as on the site."""
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", page.read_text()), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", FENCED.sub("", page.read_text())):
        if re.match(r"\w+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.exists(), f"{page.name}: {link}"
        assert not anchor or anchor in anchors(target), f"{page.name}: {link}"


@pytest.mark.slow
@pytest.mark.parametrize(("page", "code"), blocks("python"))
def test_python_runs_as_printed(page, code, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    exec(compile(code, str(page), "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize(("page", "code"), blocks("sh"))
def test_commands_are_understood(page, code):
    """Names of commands and options are known, and values have their types; nothing is run."""
    for line in code.replace("\\\n", " ").splitlines():
        for part in re.split(r"&&|\|", line):
            words = shlex.split(part, comments=True)
            if words[:1] == ["maglev"]:
                understood(words[1:])


def understood(words):
    command, context = MAGLEV, None
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        context = command.make_context("maglev", [], parent=context, resilient_parsing=True)
        assert words[0] in command.commands, f"there is no command {words[0]}"
        command, words = command.commands[words[0]], words[1:]
    if not {"--help", "--version", "--install-completion"} & set(words):
        command.make_context(command.name, words, parent=context)


def test_the_page_of_commands_has_every_help(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    from site_hooks import helps

    text = "\n".join(helps())
    assert all(f"## maglev {name}\n" in text for name in ("sweep", "export", "selfsense levitate", "blind run"))


def test_every_public_name_is_in_the_reference():
    text = (ROOT / "docs" / "reference" / "python.md").read_text()
    listed = set(re.findall(r"^(?:::: [\w.]+\.|### )(\w+)$", text, re.MULTILINE))
    assert listed == set(dir(maglev_workbench)) - {"__version__"}


def test_every_page_is_in_the_site():
    named = set(re.findall(r": ([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE))
    assert named == {str(page.relative_to(ROOT / "docs")) for page in (ROOT / "docs").rglob("*.md")}


@pytest.mark.slow
@pytest.mark.skipif(not (find_spec("mkdocs") and find_spec("mkdocstrings")), reason='needs pip install ".[docs]"')
def test_the_site_is_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    made = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300)
    assert made.returncode == 0, made.stdout + made.stderr
    assert (tmp_path / "site" / "reference" / "commands" / "index.html").stat().st_size > 30_000
