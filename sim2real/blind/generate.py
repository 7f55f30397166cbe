"""Sealed sets of campaigns: a plan of cases, each drawn and sized separately, and the labels in a separate file."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import isnan
from pathlib import Path

import numpy as np

from sim2real.blind.excitation import FUNDAMENTAL, draw_drive, draw_grid
from sim2real.blind.forms import Forms
from sim2real.blind.menu import EFFECTS, KINDS, SPINNING, UNKNOWN, known_on
from sim2real.blind.rigs import PID, RIGS
from sim2real.blind.sealing import sealed, unfinished
from sim2real.blind.sizing import Sized, sized
from sim2real.blind.threshold import Detector
from sim2real.blind.twin import LoopFailed, Truth, simulate
from sim2real.blind.write import CHANNELS, Written, write_campaign

PERIODS = 9  # the first one is the transient from rest
SHARES = {"none": 1 / 6, "pair": 1 / 6, "unknown": 1 / 6}  # the other cases are single effects
SIZES = (0.5, 100.0)  # multiples of the threshold, log-uniform
PAIR_SIZES = (3.0, 100.0)
SAME_BLOCK = 0.15  # share of the pairs whose effects are in one block
SPUN = 0.15  # share of the campaigns that rotate without an effect of rotation, so that a speed reveals nothing
OFFSET = 0.05  # of the gap
ATTEMPTS = 30


@dataclass(frozen=True)
class Case:
    """One campaign to be made: its number in the set, rig, channel set, kind, and the names of its effects."""

    number: int
    rig: str
    channels: str
    kind: str
    effects: tuple[str, ...]


def plan(count: int, seed: int) -> list[Case]:
    """`count` cases in shuffled order: kinds by their shares; effects, rigs and channel sets in turn."""
    rng = np.random.default_rng([seed, 0])
    numbers = {kind: round(count * share) for kind, share in SHARES.items()}
    kinds = [kind for kind, n in numbers.items() for _ in range(n)]
    kinds += ["single"] * (count - len(kinds))
    singles = _in_turn(rng, [(rig, name) for rig in RIGS for name in known_on(rig)])
    unknowns = _in_turn(rng, [(rig, name) for rig in RIGS for name in UNKNOWN])
    rigs = _in_turn(rng, list(RIGS))
    channels = {kind: _in_turn(rng, list(CHANNELS)) for kind in (*SHARES, "single")}
    cases = []
    for kind in kinds:
        if kind in ("single", "unknown"):
            rig, name = next(singles if kind == "single" else unknowns)
            effects: tuple[str, ...] = (name,)
        else:
            rig = next(rigs)
            effects = _pair(rng, rig) if kind == "pair" else ()
        cases.append((rig, next(channels[kind]), kind, effects))
    order = rng.permutation(count)
    return [Case(n, *cases[at]) for n, at in enumerate(order, 1)]


def _in_turn(rng: np.random.Generator, items: list) -> Iterator:
    while True:
        for at in rng.permutation(len(items)):
            yield items[at]


def _pair(rng: np.random.Generator, rig: str) -> tuple[str, ...]:
    names, same = known_on(rig), rng.random() < SAME_BLOCK
    while True:
        first, second = (names[at] for at in rng.choice(len(names), 2, replace=False))
        if (EFFECTS[first].block == EFFECTS[second].block) == same:
            return first, second


def make(case: Case, seed: int, forms: Forms) -> tuple[list[Written], dict]:
    """The recordings of a case and its label.

    Raises:
        RuntimeError: No draw of the case levitates.
    """
    rig = RIGS[case.rig]
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, case.number, attempt])
        deviations = {name: float(t * rng.standard_normal()) for name, t in rig.tolerance.items()}
        spins = any(name in SPINNING for name in case.effects) or rng.random() < SPUN
        speed = float(rng.integers(2400, 3601)) if spins else 0.0
        truth = Truth(case.rig, deviations, {}, forms, speed)
        recordings = _experiments(case, truth, rng)
        fit = [(r.gains, r.drive) for r in recordings if r.role == "fit"]
        detector = Detector(truth, fit, PERIODS - 1, "current" in CHANNELS[case.channels])
        low, high = PAIR_SIZES if case.kind == "pair" else SIZES
        wanted = [float(np.exp(rng.uniform(np.log(low), np.log(high)))) for _ in case.effects]
        try:
            found = [sized(name, size, detector, rng) for name, size in zip(case.effects, wanted, strict=True)]
            if case.kind == "pair" and min(f.multiple for f in found) < 0.9 * low:
                if attempt % 3 == 2:  # an effect cannot become this large here, so draw another pair
                    case = replace(case, effects=_pair(rng, case.rig))
                continue
            done = _recorded(truth, found, recordings, rng)
        except LoopFailed:
            continue
        return done, _label(case, truth, found, seed)
    raise RuntimeError(f"case {case.number} ({', '.join(case.effects)} on {case.rig}) never stood in {ATTEMPTS} draws")


def _experiments(case: Case, truth: Truth, rng: np.random.Generator) -> list[Written]:
    rig = RIGS[case.rig]
    samples = round(rig.parameters["control_rate"] / FUNDAMENTAL)
    grid = draw_grid(rng, "force" in CHANNELS[case.channels])
    first, second, third = (draw_drive(rng, grid, rig.force_peak, rig.injection_peak, samples) for _ in range(3))
    other = replace(rig.gains, kp=0.8 * rig.gains.kp, kd=1.2 * rig.gains.kd)
    either: PID = (rig.gains, other)[rng.integers(2)]
    slow = truth.speed_rpm * (0.6 if rng.random() < 0.5 else 1.0)
    shifted = replace(first, reference=OFFSET * rig.parameters["gap"])
    speed = truth.speed_rpm
    return [
        Written("base", "fit", rig.gains, first, speed, {}),
        Written("phases", "fit", rig.gains, second, speed, {}),
        Written("half", "fit", rig.gains, first.scaled(0.5), slow, {}),
        Written("gains", "fit", other, first, speed, {}),
        Written("offset", "fit", rig.gains, shifted, speed, {}),
        Written("holdout", "holdout", either, third, speed, {}),
    ]


def _recorded(truth: Truth, found: list[Sized], recordings: list[Written], rng: np.random.Generator) -> list[Written]:
    disturbed = replace(truth, effects={f.name: f.values for f in found})
    done = []
    for r in recordings:
        noise, phase = (int(n) for n in rng.integers(2**62, size=2))
        own = replace(disturbed, speed_rpm=r.speed_rpm, start=phase / 2**62)
        done.append(replace(r, channels=simulate(own, r.gains, r.drive, PERIODS, noise)))
    return done


def _label(case: Case, truth: Truth, found: list[Sized], seed: int) -> dict:
    return {
        "id": _identity(case.number),
        "rig": case.rig,
        "channels": case.channels,
        "kind": case.kind,
        "effects": {f.name: f.values for f in found},
        "sizes": [f.multiple for f in found],
        "thresholds": [None if isnan(f.threshold) else f.threshold for f in found],
        "blocks": [KINDS[f.name].block for f in found],
        "speed_rpm": truth.speed_rpm,
        "truth": truth.parameters,
        "deviations": dict(truth.deviations),
        "forms": truth.forms,
        "holdout": "holdout",
        "seed": seed,
    }


def _identity(number: int) -> str:
    return f"c{number:04d}"


def _produce(case: Case, folder: Path, seed: int, forms: Forms) -> dict:
    recordings, label = make(case, seed, forms)
    shutil.rmtree(folder / label["id"], ignore_errors=True)  # of an interrupted run
    write_campaign(folder / label["id"], RIGS[case.rig], case.channels, recordings)
    return label


def generate(
    folder: str | Path,
    count: int,
    seed: int,
    processes: int = 1,
    forms: Forms = "sealed",
    labels: str | Path | None = None,
    advance: Callable[[], object] = lambda: None,
) -> str:
    """Write campaigns into a new folder and their labels beside it.

    The same seed gives the same bytes for any number of processes; what was interrupted goes on where it was.

    Args:
        folder: New or empty folder.
        count: Number of campaigns.
        seed: Seed of the set.
        processes: Number of processes.
        forms: Which forms realise the effects.
        labels: File of the labels; by default FOLDER-labels.json, outside the folder, so that nobody who diagnoses the
            folder sees them.
        advance: Called after each campaign.

    Returns:
        SHA-256 of the label file.

    Raises:
        ValueError: The folder is not empty, the labels exist, a value does not fit, or another set was begun there.
    """
    folder = Path(folder)
    labels = folder.with_name(f"{folder.name}-labels.json") if labels is None else Path(labels)
    if count < 1 or processes < 1:
        raise ValueError(f"count = {count} and processes = {processes} must be at least 1")
    if forms not in ("sealed", "development"):
        raise ValueError(f'forms = {forms!r}; use "sealed" or "development"')
    if folder.exists() and any(folder.iterdir()) and not unfinished(labels).exists():
        raise ValueError(f"{folder} is not empty; name a new folder")
    if labels.exists():
        raise ValueError(f"{labels} exists; move it away or name another file")
    return sealed(_produce, plan(count, seed), processes, labels, advance, folder=folder, seed=seed, forms=forms)
