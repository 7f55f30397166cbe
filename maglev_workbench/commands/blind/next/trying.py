"""Recordings that answers ask for, made and diagnosed again: files, table and markdown."""

import json
from collections.abc import Callable, Iterator
from concurrent.futures import as_completed
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.result_folder import locked
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_lanes.processes import fresh_pool
from maglev_lanes.threads import cores
from maglev_workbench.commands.blind.sealed_set import made_of
from maglev_workbench.console import console, progress_bar, write_json
from maglev_workbench.page import markdown_table
from sim2real.blind.answer import OPENED, diagnose
from sim2real.blind.benchmark.promise import MOST, Tried, asked, recordings_made, share_decided, try_both
from sim2real.blind.benchmark.scores import judged_with_rivals
from sim2real.blind.cases import ANSWERS, Case, open_labels, read_answer, seal_of
from sim2real.blind.judging.judging import Judgement
from sim2real.blind.judging.scoring import answer_words, truth_words

TRIED = "next"  # folder of what was tried
HEAD = ("chosen", "campaigns", "decided by one", "decided by up to two", "recordings made, mean")


def try_folder(folder: Path, processes: int | None, docs: Path | None, json_file: Path | None) -> None:
    """Try what the answers to a set ask for, write the results and print the table.

    Raises:
        ValueError: It is no set of the benchmark, or was not scored yet, after which no answer is changed.
    """
    made = made_of(folder)
    if not made.get("benchmark"):
        raise ValueError(f"{folder} is no set of the benchmark, whose rigs alone can be recorded again")
    if not (folder / OPENED).is_file():
        raise ValueError(f"{folder} is sealed: score its answers first (maglev blind score {folder})")
    seal, version = seal_of(folder), code_version(DIAGNOSING, blind=True)
    answers = {path.stem: read_answer(path, seal) for path in sorted((folder / ANSWERS).glob("*.json"))}
    cases = [case for case in open_labels(folder) if asked(case, answers[case.id])]
    with locked(folder):
        (folder / TRIED).mkdir(exist_ok=True)
        _try_each(folder, cases, made, version, processes or cores())
    found = [json.loads(_path(folder, case).read_text()) for case in cases]
    data = {"schema": "maglev-blind-next/1", "version": version, "labels_sha256": seal, "set": made, "tried": found}
    write_json(json_file, data)
    rows = [_row(how, [_of(one[how]) for one in found]) for how in ("proposed", "random")]
    if docs is not None:
        judged = [judged_with_rivals(case, answers[case.id]) for case in cases]
        each = [_line(j, one) for j, one in zip(judged, found, strict=True)]
        write_text_atomic(docs, _markdown(rows, each, data))
    grid = Table(title="maglev blind next: classes and unknowns, recorded again")
    for heading in HEAD:
        grid.add_column(heading, justify="left" if heading == "chosen" else "right")
    for cells in rows:
        grid.add_row(*cells)
    console.print(grid)
    console.print(f"data  {folder / TRIED}")


def _path(folder: Path, case: Case) -> Path:
    return folder / TRIED / f"{case.id}.json"


def _try_each(folder: Path, cases: list[Case], made: dict[str, Any], version: str, processes: int) -> None:
    todo = [case for case in cases if not _kept(_path(folder, case), version)]
    with progress_bar() as bar:
        task = bar.add_task("next", total=len(cases), completed=len(cases) - len(todo))
        for case, found in _each_tried(partial(_try_one, folder, made["seed"], made["count"]), todo, processes):
            write_json(_path(folder, case), {"id": case.id, "version": version, **found})
            bar.advance(task)


def _each_tried(
    work: Callable[[Case], dict[str, Any]], cases: list[Case], processes: int
) -> Iterator[tuple[Case, dict[str, Any]]]:
    if min(processes, len(cases)) <= 1:
        yield from ((case, work(case)) for case in cases)
        return
    with fresh_pool(min(processes, len(cases))) as pool:
        futures = {pool.submit(work, case): number for number, case in enumerate(cases)}
        yield from ((cases[futures[future]], future.result()) for future in as_completed(futures))


def _kept(path: Path, version: str) -> bool:
    return path.is_file() and json.loads(path.read_text()).get("version") == version


def _try_one(folder: Path, seed: int, count: int, case: Case) -> dict[str, Any]:
    answer = json.loads((folder / ANSWERS / f"{case.id}.json").read_text())["diagnosis"]
    return {how: asdict(tried) for how, tried in try_both(case, answer, seed, count, diagnose).items()}


def _of(data: dict[str, Any]) -> Tried:
    return Tried(tuple(data["what"]), tuple(data["verdicts"]), data["decided"])


def _row(how: str, tried: list[Tried]) -> tuple[str, ...]:
    shares = (f"{share_decided(tried, count):.0%}".replace("%", " %") for count in range(1, MOST + 1))
    spent = f"{np.mean([recordings_made(t) for t in tried]):.2f}" if tried else "–"
    return ("as proposed" if how == "proposed" else "at random", str(len(tried)), *shares, spent)


def _line(j: Judgement, found: dict[str, Any]) -> tuple[str, ...]:
    cells = (j.case.id, j.case.rig, j.case.channels, truth_words(j), answer_words(j))
    return cells + tuple(_in_words(_of(found[how])) for how in ("proposed", "random"))


def _in_words(tried: Tried) -> str:
    steps = "; ".join(f"{what}: {verdict}" for what, verdict in zip(tried.what, tried.verdicts, strict=True))
    return f"{steps or 'nothing'}{' (decided)' if tried.decided else ''}"


def _markdown(rows: list[tuple[str, ...]], each: list[tuple[str, ...]], data: dict[str, Any]) -> str:
    head = ("campaign", "rig", "channels", "truth", "answer", "as proposed", "at random")
    made = data["set"]
    return "\n".join(
        (
            "# Does the recording that a diagnosis asks for decide?",
            "",
            "Of each campaign of a known effect from the detection threshold on that was answered by a class or as",
            "unknown, up to two recordings were made on the true rig and all recordings diagnosed again, until the",
            "truth and nothing else was named: as the diagnosis proposes, and as drawn at random from the same menu.",
            "",
            markdown_table(HEAD, rows),
            "",
            markdown_table(head, each),
            "",
            f"Made by `maglev blind next` of the set of seed {made['seed']}, {made['count']} campaigns, version",
            f"{data['version']}, labels {data['labels_sha256']}.",
            "",
        )
    )
