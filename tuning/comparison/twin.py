"""The same tuner on three simulators of one rig: nominal, corrected by a diagnosis, and the true twin."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import asdict, dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.recordings.files import write_text_atomic
from maglev_env.recordings.result_folder import claim, locked
from maglev_lanes.code_version import code_version
from maglev_lanes.processes import fresh_pool
from maglev_lanes.threads import cores
from sim2real.blind.judging.worth import AGAIN, PRESET, SIMULATORS, CaseWorth, Recommended, TwinCase, recommended
from tuning.search.optuna_search import OptunaTuner
from tuning.tuner import Trials

METHOD = "gp"  # needs the fewest experiments, which are expensive on a real rig
CANDIDATES, REPEATS = 3, 5  # best-scored gains, and their repetitions with fresh noise
SHARE = 4  # at most the budget divided by this is used for repetitions
SPEC = "worth.json"
_TUNING, _SCORING = 0, 1  # noise of the tuning, and noise of the final scores


@dataclass(frozen=True)
class Tuned:
    """Recommended point (k,) of the box, its promised score, number of experiments and how many of them failed."""

    point: np.ndarray
    promised: float
    tried: int
    failed: int


def tuned(case: TwinCase, simulator: str, budget: int, seed: int) -> Tuned:
    """Tune one case with `budget` experiments on one of SIMULATORS, one at a time, the first with the preset gains.

    Where the budget allows, the last experiments repeat the best-scored gains, and the best mean is recommended, which
    excludes lucky scores. Seed and noise are the same for every simulator.
    """
    candidates = min(CANDIDATES, budget // (SHARE * REPEATS))
    candidates = candidates if candidates > 1 else 0
    searched = budget - candidates * REPEATS
    noise = _seeds(case, seed, _TUNING, budget)
    tuner = OptunaTuner(len(case.box.names), seed, METHOD, case.start)
    parts = []
    for i in range(searched):
        points = tuner.ask(1)
        score, failed = case.scores(simulator, points, noise[i : i + 1])
        tuner.tell(Trials(points, score, np.empty((1, 0)), ({},), failed))
        parts.append((points, score, failed))
    points, score, failed = map(np.concatenate, zip(*parts, strict=True))
    best = np.argsort(-score, kind="stable")[: max(candidates, 1)]
    if not candidates:
        return Tuned(points[best[0]], float(score[best[0]]), budget, int(failed.sum()))
    again, failed_again = case.scores(simulator, np.repeat(points[best], REPEATS, axis=0), noise[searched:])
    means = again.reshape(candidates, REPEATS).mean(axis=1)
    chosen = int(np.argmax(means))
    return Tuned(points[best[chosen]], float(means[chosen]), budget, int(failed.sum() + failed_again.sum()))


def case_worth(case: TwinCase, budgets: Mapping[str, int], seed: int) -> CaseWorth:
    """Tune on each of SIMULATORS with its budget, and score each recommendation on the twin under the same noise."""
    fresh = _seeds(case, seed, _SCORING, AGAIN)
    chosen = {PRESET: Tuned(case.start, nan, 0, 0)} | {n: tuned(case, n, budgets[n], seed) for n in SIMULATORS}
    by = {n: recommended(case, t.point, t.promised, t.tried, t.failed, fresh) for n, t in chosen.items()}
    return CaseWorth(case.id, case.rig.name, case.channels, case.size, case.truth, case.answer, case.right, by)


def compare_simulators(
    cases: Sequence[TwinCase],
    folder: Path,
    budgets: Mapping[str, int],
    seed: int,
    made_by: Mapping[str, Any],
    processes: int | None = None,
    progress: Callable[[int], None] = lambda n: None,
) -> tuple[list[CaseWorth], int]:
    """`case_worth` of every case; each is stored in the folder as soon as it is finished.

    Args:
        cases: The cases.
        folder: Folder of the results.
        budgets: Number of experiments by simulator.
        seed: Seed of tuning and noise.
        made_by: What else the results depend on, as JSON data.
        processes: By default all cores; results do not depend on it.
        progress: Called with numbers of cases done.

    Returns:
        The results, and how many of them existed already.

    Raises:
        ValueError: The folder holds results made in another way.
        BlockingIOError: Another process works there.
    """
    if not all(n >= 1 for n in budgets.values()):
        raise ValueError(f"budgets of {', '.join(map(str, budgets.values()))}: give at least one experiment")
    spec = {
        "schema": "maglev-twin-cases/1",
        "version": code_version(blind=True),
        "method": METHOD,
        "budgets": dict(budgets),
        "seed": seed,
        **made_by,
    }
    with locked(folder):
        claim(folder / SPEC, spec, "comparison of simulators")
        done = {case.id: read for case in cases if (read := _read(folder / f"{case.id}.json")) is not None}
        reused = len(done)
        progress(reused)
        todo = [case for case in cases if case.id not in done]
        for found in _outcomes(todo, budgets, seed, processes or cores()):
            write_text_atomic(folder / f"{found.id}.json", json.dumps(_data(found), indent=1, allow_nan=False) + "\n")
            done[found.id] = found
            progress(1)
    return [done[case.id] for case in cases], reused


def _outcomes(cases: Sequence[TwinCase], budgets: Mapping[str, int], seed: int, processes: int) -> Iterator[CaseWorth]:
    if min(processes, len(cases)) <= 1:
        yield from (case_worth(case, budgets, seed) for case in cases)
        return
    with fresh_pool(min(processes, len(cases))) as pool:
        for future in as_completed([pool.submit(case_worth, case, budgets, seed) for case in cases]):
            yield future.result()


def _seeds(case: TwinCase, seed: int, purpose: int, count: int) -> list[int]:
    """Seeds of noise, reproducible for a case and a purpose."""
    rng = np.random.default_rng((seed, purpose, *case.id.encode()))
    return rng.integers(2**63, size=count).tolist()


def _data(found: CaseWorth) -> dict[str, Any]:
    data = asdict(found)
    for one in data["by"].values():
        one |= {key: None for key, value in one.items() if isinstance(value, float) and not isfinite(value)}
    return data


def _read(path: Path) -> CaseWorth | None:
    """A stored case; None when there is none or the file is damaged."""
    try:
        data = json.loads(path.read_text())
        by = {n: Recommended(**{k: nan if v is None else v for k, v in r.items()}) for n, r in data["by"].items()}
        return CaseWorth(**{**data, "by": by})
    except (FileNotFoundError, ValueError, TypeError, KeyError, AttributeError):
        return None
