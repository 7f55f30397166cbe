"""`maglev reproduce`: repeats the dissertation's experiments; results as tables, a page, JSON and markdown."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import DocsOption, JsonOption, SeedOption, friendly, require_folder

PAGE = "reproduce.html"
app = typer.Typer()


@app.command(epilog="Example: maglev reproduce pedestal axial --out reproduced --json reproduced.json")
@friendly
def reproduce(
    item: Annotated[
        list[str] | None, typer.Argument(metavar="ITEM", help="Experiments by name, e.g. pedestal (default: all).")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the page.")] = Path("reproduce"),
    docs: DocsOption = None,
    seed: SeedOption = 0,
    json_file: JsonOption = None,
) -> None:
    """Repeat the dissertation's experiments: its figures, ours, the differences and their reasons.

    One takes seconds, all of them some minutes.
    """
    from maglev_workbench.commands.reproduce import registry

    registry.require_known(item or ())
    from maglev_env.recordings.files import write_text_atomic
    from maglev_workbench.commands.reproduce.report import reproduce_json, reproduce_markdown, reproduce_page, summary
    from maglev_workbench.commands.reproduce.terminal import show
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page

    items = registry.chosen(item or ())
    require_folder(out)
    outcomes = []
    with progress_bar() as bar:
        task = bar.add_task("", total=len(items))
        for one in items:
            bar.update(task, description=one.name)
            outcomes.append(one.run(seed))
            bar.advance(task)
    done = list(zip(items, outcomes, strict=True))  # nothing is written before the last item has finished
    for one, outcome in done:
        show(one, outcome)
    out.mkdir(parents=True, exist_ok=True)
    write_page(out / PAGE, reproduce_page(done, seed), [json_file])
    write_json(json_file, reproduce_json(done, seed))
    if docs is not None:
        write_text_atomic(docs, reproduce_markdown(done, seed))
    console.print(f"{summary(done)}\npage  {out / PAGE}")
