"""Answer a sealed set: every campaign is diagnosed alone and without the labels, in processes or on other machines.

An interrupted run can be resumed.
"""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, Protocol

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.formats.json_data import plain
from maglev_lanes.code_version import DIAGNOSING, code_version
from maglev_lanes.processes import fresh_pool
from maglev_lanes.threads import cores
from sim2real.blind.cases import ANSWER_SCHEMA, ANSWERS, CAMPAIGNS, parse_diagnosis, seal_of

OPENED = "blind.json"  # written when the set is opened; from then on the truth is known

# From the folder of a campaign to a diagnosis (schema maglev-diagnosis/1) as JSON data.
Diagnose = Callable[[Path], dict]


class Workers(Protocol):
    """Machines that share the work and have no common file system."""

    def each(
        self, function: Callable[[Any], dict], items: Iterable[Any], died: Callable[[float], dict] | None = None
    ) -> Iterator[tuple[int, dict]]:
        """Results (index, function(item)) as they arrive.

        Args:
            function: What to do with an item.
            items: The items.
            died: Gives the result, from the seconds spent, of an item that ends every process in which it runs.
        """


@dataclass(frozen=True)
class Answered:
    """Number of campaigns answered now, answered before, and failed among both.

    `again` counts those of the new answers that replace one by another version of the code.
    """

    new: int
    reused: int
    failed: int
    again: int


def diagnose(campaign: Path) -> dict:
    """The package's own diagnosis of a campaign folder, as JSON data, with the evidence from which a judge learns."""
    import sim2real
    from sim2real.judgement.evidence_json import evidence_to_json

    found = sim2real.diagnose(campaign)
    evidence = None if found.evidence is None else evidence_to_json(found.evidence)
    return {**plain(found.to_json()), "evidence": evidence}


def answer_all(
    folder: Path,
    processes: int | None = None,
    progress: Callable[[int], None] | None = None,
    diagnose: Diagnose = diagnose,
    workers: Workers | None = None,
    into: str = ANSWERS,
    version: str | None = None,
) -> Answered:
    """Answer every campaign of the sealed set in `folder`; each answer is written as a whole file.

    Answers by this version of the code to this set are kept; others are given again, and state the versions of those
    that they replace. A diagnosis that fails, or that ends its process, is kept as an error and counts as a wrong
    answer.

    Args:
        folder: The sealed set.
        processes: Number of processes, each with single-threaded linear algebra; by default all cores. 1 works in
            this process.
        progress: Called with the number of campaigns done.
        diagnose: Diagnoses a campaign folder.
        workers: Used instead of processes; the files of a campaign are sent to them.
        into: Name of the folder of the answers in `folder`.
        version: Of the code that diagnoses; None: that of the package's own diagnosis, of which `sim2real.blind` is no
            part.

    Raises:
        ValueError: There is nothing to answer, or the set was opened already, after which an answer proves nothing.
    """
    seal, made_by = seal_of(folder), version or code_version(DIAGNOSING)
    campaigns = sorted(path.parent for path in (folder / CAMPAIGNS).glob("*/campaign.toml"))
    if not campaigns:
        raise ValueError(f"{folder / CAMPAIGNS} holds no campaigns")
    answers = folder / into
    answers.mkdir(exist_ok=True)
    todo = [c for c in campaigns if not _reusable(answers / f"{c.name}.json", seal, made_by)]
    if todo and (folder / OPENED).exists():
        raise ValueError(f"{folder} was opened already: an answer now proves nothing; generate a set of another seed")
    advance = progress or (lambda n: None)
    advance(len(campaigns) - len(todo))
    here = workers is None
    outcomes = _outcomes(todo, processes or cores(), diagnose) if here else _sent(todo, workers, diagnose)
    again = 0
    for campaign, outcome in outcomes:
        data = {"schema": ANSWER_SCHEMA, "version": made_by, "labels_sha256": seal, **outcome}
        if replaced := _replaced(answers / f"{campaign.name}.json", seal):
            data["replaces"] = replaced
            again += 1
        write_text_atomic(answers / f"{campaign.name}.json", json.dumps(data, indent=1, allow_nan=False) + "\n")
        advance(1)
    failed = sum("error" in json.loads((answers / f"{c.name}.json").read_text()) for c in campaigns)
    return Answered(len(todo), len(campaigns) - len(todo), failed, again)


def _reusable(path: Path, seal: str, made_by: str) -> bool:
    return _given(path, seal).get("version") == made_by


def _replaced(path: Path, seal: str) -> list[str]:
    """Versions of the code that answered this campaign before, from the first on."""
    data = _given(path, seal)
    return [*data.get("replaces", ()), str(data.get("version"))] if data else []


def _given(path: Path, seal: str) -> dict:
    """An answer to this set as it was written; empty where there is none."""
    try:
        data = json.loads(path.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return {}
    return data if isinstance(data, dict) and data.get("labels_sha256") == seal else {}


def _answer(campaign: Path, diagnose: Diagnose) -> dict:
    """The time taken, and the diagnosis or the reason why there is none."""
    started = perf_counter()
    try:
        data = json.loads(json.dumps(diagnose(campaign), allow_nan=False))
        parse_diagnosis(data, 0.0, "")  # finds an answer that cannot be scored before the seal is broken
        outcome: dict = {"diagnosis": data}
    except Exception as error:  # any failure of a diagnosis is a wrong answer and must not end the check
        outcome = {"error": f"{type(error).__name__}: {error}"}
    return {"seconds": perf_counter() - started, **outcome}


def _outcomes(campaigns: Sequence[Path], processes: int, diagnose: Diagnose) -> Iterator[tuple[Path, dict]]:
    """(campaign, outcome) as they arrive."""
    if min(processes, len(campaigns)) <= 1:
        for campaign in campaigns:
            yield campaign, _answer(campaign, diagnose)
        return
    lost = []
    with fresh_pool(min(processes, len(campaigns))) as pool:
        futures = {pool.submit(_answer, campaign, diagnose): campaign for campaign in campaigns}
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except BrokenProcessPool:
                lost.append(futures[future])
    # A process that dies takes its neighbours with it, so each lost campaign gets a process of its own.
    for campaign in sorted(lost):
        started = perf_counter()
        with fresh_pool(1) as pool:
            try:
                yield campaign, pool.submit(_answer, campaign, diagnose).result()
            except BrokenProcessPool:
                yield campaign, _died(perf_counter() - started)


def _sent(campaigns: Sequence[Path], workers: Workers, diagnose: Diagnose) -> Iterator[tuple[Path, dict]]:
    """(campaign, outcome) as the workers return them."""
    files = ((c.name, {p.name: p.read_bytes() for p in c.iterdir() if p.is_file()}) for c in campaigns)
    for i, outcome in workers.each(partial(_answer_sent, diagnose), files, _died):
        yield campaigns[i], outcome


def _answer_sent(diagnose: Diagnose, campaign: tuple[str, dict[str, bytes]]) -> dict:
    """Runs on a worker: the answer to a campaign that was sent as its name and its files."""
    name, files = campaign
    with TemporaryDirectory(prefix="maglev-") as temporary:
        folder = Path(temporary) / name
        folder.mkdir()
        for file, data in files.items():
            (folder / file).write_bytes(data)
        return _answer(folder, diagnose)


def _died(seconds: float) -> dict:
    return {"seconds": seconds, "error": "its process died"}
