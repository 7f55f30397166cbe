"""`maglev coverage`: how often the intervals of `maglev estimate` hold the truth, by condition."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import DocsOption, JsonOption, SeedOption, friendly, require_folder

app = typer.Typer()


@app.command(epilog="Example: maglev coverage linear large --draws 200 --docs coverage.md")
@friendly
def coverage(
    condition: Annotated[
        list[str] | None,
        typer.Argument(metavar="CONDITION", help="Conditions by name, or repeating, or unrepeated (default: all)."),
    ] = None,
    draws: Annotated[int, typer.Option(min=20, max=100_000, help="Experiments of each condition.")] = 200,
    processes: Annotated[
        int, typer.Option(min=1, max=256, help="Processes that share the draws; results do not change.")
    ] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder of the counts; an interrupted study resumes there.")] = None,
    docs: DocsOption = None,
    seed: SeedOption = 0,
    json_file: JsonOption = None,
) -> None:
    """Count how often the 95 % intervals of the estimate hold the truth, on simulated experiments of many kinds.

    Conditions such as hmb_free_steps are recordings that never repeat (all of them: unrepeated), of rigs that are known
    to their tolerances. A second of one core makes about one draw, or two of an experiment that repeats. --docs keeps
    the part of the page that is not counted.
    """
    from maglev_env.recordings.files import write_text_atomic
    from maglev_workbench.commands.coverage.conditions import CONDITIONS, named
    from maglev_workbench.console import console, progress_bar, write_json

    chosen = named(condition or [])
    if out is not None:
        require_folder(out)
    from maglev_workbench.commands.coverage.kept import kept
    from maglev_workbench.commands.coverage.report import coverage_json, coverage_markdown, coverage_table
    from maglev_workbench.commands.coverage.study import coverage as counted

    found = {}
    with progress_bar() as bar:
        task = bar.add_task("", total=draws * len(chosen))
        for name in chosen:
            bar.update(task, description=name)
            count = partial(counted, CONDITIONS[name], draws, seed, lambda: bar.advance(task), processes)
            found[name] = count() if out is None else kept(out, name, draws, seed, count)
            bar.update(task, completed=draws * len(found))
    console.print(coverage_table(found))
    write_json(json_file, coverage_json(found, seed))
    if docs is not None:
        before = docs.read_text() if docs.exists() else ""
        write_text_atomic(docs, coverage_markdown(found, draws, seed, before))
