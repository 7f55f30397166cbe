"""Making and answering a sealed set, for `generate`, `answer` and `run`."""

import json
from functools import partial
from pathlib import Path

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.result_folder import is_empty, locked
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_lanes.schedule import Workers
from maglev_lanes.threads import cores
from maglev_workbench.console import console, progress_bar, write_json
from maglev_workbench.options import require_folder
from sim2real.blind.answer import Answered, Diagnose, answer_all, diagnose
from sim2real.blind.cases import ANSWERS, CAMPAIGNS, LABELS, SEAL

SET = "set.json"  # says how the set was made; it contains no labels
METHODS = ("diagnose", "nothing", "refit")  # what answers a set; all but the first are foils of the benchmark
BEGUN = "begun.json"  # the same, of a set that is not complete yet


def generate(
    out: Path, count: int, seed: int, processes: int | None, benchmark: bool = False, oracle: bool = True
) -> dict:
    """Make a sealed set: campaigns, labels, their seal, and a description of how it was made; goes on where it was.

    Args:
        out: an empty folder, or one that does not exist yet.
        count: number of campaigns.
        seed: of the whole set.
        processes: None: as many as there are cores.
        benchmark: the benchmark's generator instead of the twin.
        oracle: whether the benchmark's labels say what no method could tell.

    Returns:
        The description, as in set.json.

    Raises:
        ValueError: The folder is not empty, or another set was begun there.
        BlockingIOError: Another process works there.
    """
    # Here because they take long to import.
    from sim2real.blind import generate as generator
    from sim2real.blind.benchmark import generate as benchmark_generator

    require_folder(out)
    with locked(out):
        data = {"schema": "maglev-blind-set/1", "count": count, "seed": seed, "benchmark": benchmark}
        data |= {"version": code_version(DIAGNOSING, blind=True)}  # the generator is part of it
        if not (out / BEGUN).is_file():
            if not is_empty(out):
                raise ValueError(f"{out} is not empty; choose another --out or delete it")
            write_json(out / BEGUN, {**data, "oracle": oracle})
        elif json.loads((out / BEGUN).read_text()) != {**data, "oracle": oracle}:
            raise ValueError(f"{out}: another set, or one by another version of the code, was begun there; delete it")
        with progress_bar() as bar:
            task = bar.add_task("generate", total=count)
            common = {"folder": out / CAMPAIGNS, "labels": out / LABELS, "count": count, "seed": seed}
            common |= {"processes": processes or cores(), "advance": partial(bar.advance, task)}
            try:
                if benchmark:
                    seal = benchmark_generator.generate(oracle=oracle, **common)
                else:
                    seal = generator.generate(**common)
            except KeyboardInterrupt:
                console.print(f"stopped; finished campaigns are in {out}: run the same command again to continue")
                raise
        console.print(f"SHA-256 of the labels\n{seal}")
        write_text_atomic(out / SEAL, f"{seal}  {LABELS}\n")
        write_json(out / SET, data)
        (out / BEGUN).unlink()
    return {**data, "labels_sha256": seal}


def _by(method: str) -> Diagnose:
    """What answers one campaign."""
    if method == "diagnose":
        return diagnose
    from sim2real.blind.benchmark import foils  # here because it takes long to import

    return {"nothing": foils.nothing, "refit": foils.refit}[method]


def version_of(method: str) -> str:
    """Version of the code that answers: a foil is part of the benchmark's."""
    return code_version(DIAGNOSING, blind=method != "diagnose")


def answer(folder: Path, processes: int | None, spread: Workers | None, method: str = "diagnose") -> Answered:
    """Answer every campaign of a set that has no answer by this method yet, on workers if there are any."""
    made_of(folder)
    with locked(folder), progress_bar() as bar:
        into = ANSWERS if method == "diagnose" else f"{ANSWERS}-{method}"
        task = bar.add_task(method, total=len(list((folder / CAMPAIGNS).glob("*/campaign.toml"))))
        try:
            advance, version = partial(bar.advance, task), version_of(method)
            found = answer_all(folder, processes, advance, _by(method), spread, into, version)
        except KeyboardInterrupt:
            console.print(f"stopped; finished answers are in {folder / into}: run the same command again to continue")
            raise
    again = f" ({found.again} of them again: those there were of another version of the code)" if found.again else ""
    console.print(f"{found.new} answered{again}, {found.reused} reused, {found.failed} of both failed")
    return found


def made_of(folder: Path) -> dict:
    """How a set was made.

    Raises:
        ValueError: The folder contains no complete set.
    """
    path = folder / SET
    if not path.is_file():
        raise ValueError(f"{folder} holds no whole sealed set: make one there first (maglev blind generate)")
    return json.loads(path.read_text())
