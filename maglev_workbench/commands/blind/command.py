"""`maglev blind`: a sealed set generated, answered, and opened into a page, JSON and markdown."""

import json
import os
from pathlib import Path

from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_lanes.schedule import Workers, workers
from maglev_workbench.commands.blind.figures import save_reliability
from maglev_workbench.commands.blind.report import blind_json, blind_markdown, blind_page
from maglev_workbench.commands.blind.tables import HEAD, cells
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page
from sim2real.blind.answer import OPENED, Answered, answer_all
from sim2real.blind.cases import ANSWERS, CAMPAIGNS, LABELS, SEAL, open_labels, seal_of
from sim2real.blind.generate import generate as generate_set
from sim2real.blind.opening import Opened, open_set
from sim2real.blind.regret import CASES

SET = "set.json"  # how the set was made: nothing of its truth


def generate(out: Path, count: int, seed: int, processes: int | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.blind.cli.generate`."""
    require_folder(json_file, "--json")
    write_json(json_file, _generate(out, count, seed, processes))


def answer(folder: Path, processes: int | None, scheduler: str | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.blind.cli.answer`."""
    require_folder(json_file, "--json")
    with workers(scheduler, processes) as spread:
        found = _answer(folder, processes, spread)
    counts = {"answered": found.new, "reused": found.reused, "failed": found.failed}
    write_json(json_file, {"schema": "maglev-blind-answers/1", "version": code_version(DIAGNOSING), **counts})


def open_folder(folder: Path, docs: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.blind.cli.open_`."""
    require_folder(json_file, "--json")
    require_folder(docs, "--docs")
    made = _set_of(folder)
    cases = min(CASES, sum(case.kind == "single" and (case.size or 0) >= 10 for case in open_labels(folder)))
    with progress_bar() as bar:
        task = bar.add_task("gains on the twin", total=cases)
        opened = open_set(folder, lambda n: bar.advance(task, n))
    data = blind_json(opened, made)
    write_json(folder / OPENED, data)
    write_page(folder / "blind.html", blind_page(opened, made))
    write_json(json_file, data)
    if docs is not None:
        picture = docs.with_suffix(".png")
        save_reliability(picture, opened.reliability)
        write_text_atomic(docs, blind_markdown(opened, made, picture.name))
    _show(opened)
    console.print(f"labels {opened.labels_sha256}: as sealed\ndata  {folder / OPENED}\npage  {folder / 'blind.html'}")


def run(
    out: Path,
    count: int,
    seed: int,
    processes: int | None,
    scheduler: str | None,
    docs: Path | None,
    json_file: Path | None,
) -> None:
    """See `maglev_workbench.commands.blind.cli.run`."""
    require_folder(json_file, "--json")
    require_folder(docs, "--docs")
    if (out / SET).exists():
        made = _set_of(out)
        if (made["count"], made["seed"]) != (count, seed):
            raise ValueError(f"{out} holds {made['count']} campaigns of seed {made['seed']}; choose another --out")
        console.print(f"{count} campaigns of seed {seed} are there; SHA-256 of their labels\n{seal_of(out)}")
    else:
        _generate(out, count, seed, processes)
    with workers(scheduler) as spread:
        _answer(out, processes, spread)
    open_folder(out, docs, json_file)


def _generate(out: Path, count: int, seed: int, processes: int | None) -> dict:
    if out.exists() and any(out.iterdir()):
        raise ValueError(f"{out} is not empty; choose another --out or delete it")
    out.mkdir(parents=True, exist_ok=True)
    with progress_bar() as bar:
        bar.add_task(f"generate {count} campaigns", total=None)
        seal = generate_set(out / CAMPAIGNS, count, seed, processes or os.cpu_count() or 1, labels=out / LABELS)
    console.print(f"SHA-256 of the labels\n{seal}")
    write_text_atomic(out / SEAL, f"{seal}  {LABELS}\n")
    data = {"schema": "maglev-blind-set/1", "count": count, "seed": seed, "version": code_version(DIAGNOSING)}
    write_json(out / SET, data)
    return {**data, "labels_sha256": seal}


def _answer(folder: Path, processes: int | None, spread: Workers | None) -> Answered:
    _set_of(folder)
    with progress_bar() as bar:
        task = bar.add_task("diagnose", total=len(list((folder / CAMPAIGNS).glob("*/campaign.toml"))))
        try:
            found = answer_all(folder, processes, lambda n: bar.advance(task, n), workers=spread)
        except KeyboardInterrupt:
            console.print(f"stopped; what is answered is in {folder / ANSWERS}: run the same command again to go on")
            raise
    console.print(f"{found.new} answered, {found.reused} reused, {found.failed} of both failed")
    return found


def _set_of(folder: Path) -> dict:
    path = folder / SET
    if not path.is_file():
        raise ValueError(f"{folder} holds no whole sealed set: make one there first (maglev blind generate)")
    return json.loads(path.read_text())


def _show(opened: Opened) -> None:
    grid = Table(title=f"maglev blind: {len(opened.judged)} sealed campaigns, {opened.failed} without an answer")
    for heading in HEAD:
        if heading != "ambitious":  # a terminal is narrow; the page has it
            grid.add_column(heading, justify="left" if heading in ("figure", "verdict") else "right")
    for row in opened.rows:
        grid.add_row(*(cell for heading, cell in zip(HEAD, cells(row), strict=True) if heading != "ambitious"))
    console.print(grid)
