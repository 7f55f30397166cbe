"""Opening a sealed set: it is scored and written as JSON, page and markdown, for `open` and `run`."""

from pathlib import Path

from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.result_folder import locked
from maglev_workbench.commands.blind.open.figures import save_reliability
from maglev_workbench.commands.blind.open.report import blind_json, blind_markdown, blind_page
from maglev_workbench.commands.blind.open.tables import HEAD, cells
from maglev_workbench.commands.blind.sealed_set import made_of
from maglev_workbench.console import console, progress_bar, write_json
from maglev_workbench.page import write_page
from sim2real.blind.answer import OPENED
from sim2real.blind.cases import open_labels
from sim2real.blind.judging.opening import Opened, open_set
from sim2real.blind.judging.regret import CASES


def open_folder(folder: Path, docs: Path | None, json_file: Path | None) -> None:
    """Check the seal, score every answer, write the results into the folder and the files, and print them."""
    made = made_of(folder)
    if made.get("benchmark"):
        raise ValueError(f"{folder} is a set of the benchmark: score it with maglev blind score {folder}")
    cases = min(CASES, sum(case.kind == "single" and (case.size or 0) >= 10 for case in open_labels(folder)))
    with locked(folder), progress_bar() as bar:
        task = bar.add_task("gains on the twin", total=cases)
        opened = open_set(folder, lambda n: bar.advance(task, n))
    data = blind_json(opened, made)
    write_json(folder / OPENED, data)
    write_page(folder / "blind.html", blind_page(opened, made), [folder / OPENED])
    write_json(json_file, data)
    if docs is not None:
        picture = docs.with_suffix(".png")
        save_reliability(picture, opened.reliability)
        write_text_atomic(docs, blind_markdown(opened, made, picture.name))
    show(opened)
    console.print(f"labels {opened.labels_sha256}: as sealed\ndata  {folder / OPENED}\npage  {folder / 'blind.html'}")


def show(opened: Opened) -> None:
    """Print the table of the targets."""
    grid = Table(title=f"maglev blind: {len(opened.judged)} sealed campaigns, {opened.failed} without an answer")
    for heading in HEAD:
        if heading != "ambitious":  # left out because a terminal is narrow; the page has it
            grid.add_column(heading, justify="left" if heading in ("figure", "verdict") else "right")
    for row in opened.rows:
        grid.add_row(*(cell for heading, cell in zip(HEAD, cells(row), strict=True) if heading != "ambitious"))
    console.print(grid)
