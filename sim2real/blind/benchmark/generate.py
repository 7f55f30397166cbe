"""Sealed sets of the benchmark: a plan of cases, each drawn and sized alone, and the labels in a separate file."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path

import numpy as np

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.detect import Detector, threshold
from sim2real.blind.benchmark.drives import BOTH, draw_drive
from sim2real.blind.benchmark.kinds import KINDS, OUTSIDE, VOCABULARY, Kind, known_on
from sim2real.blind.benchmark.oracle import rivals
from sim2real.blind.benchmark.rigs import TURNS, BenchRig, draw_rig, log_uniform
from sim2real.blind.benchmark.simulate import Controller, LoopFailed, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.blind.sealing import sealed

SHARES = {"none": 1 / 6, "pair": 1 / 6, "unknown": 1 / 4}  # the other cases are single effects
SIZES, PAIR_SIZES = (0.5, 100.0), (3.0, 100.0)  # multiples of the threshold, log-uniform
SPUN = 0.2  # share of the campaigns that turn without an effect of rotation
ATTEMPTS = 40
RECIPES = (  # drives of two fit recordings and of the holdout
    ("multisine", "multisine", "multisine"),
    ("multisine", "steps", "multisine"),
    ("multisine", "chirp", "noise"),
    ("noise", "steps", "chirp"),
    ("chirp", "noise", "multisine"),
)
NAMES = {value: name.lower() for name, value in vars(at).items() if isinstance(value, int)}  # of the loop's values


@dataclass(frozen=True)
class Case:
    """One campaign to be made: number in the set, family of rigs, channel set, kind, and names of its effects."""

    number: int
    family: str
    channels: str
    kind: str
    effects: tuple[str, ...]


@dataclass(frozen=True)
class Made:
    """A case as drawn: its true rig without effects, its experiments, its detector, and its sized effects."""

    case: Case
    truth: Truth
    recordings: list[Recording]
    detector: Detector
    found: dict[str, tuple[dict[int, float], float, float]]  # name: values, multiple of the threshold, threshold


def plan(count: int, seed: int) -> list[Case]:
    """`count` cases in shuffled order: kinds by their shares; effects, rigs and channel sets in turn."""
    rng = np.random.default_rng([seed, 0])
    kinds = [kind for kind, share in SHARES.items() for _ in range(round(count * share))]
    kinds += ["single"] * (count - len(kinds))
    pools = {"single": _in_turn(rng, list(VOCABULARY)), "unknown": _in_turn(rng, list(OUTSIDE))}
    families, cases = _in_turn(rng, list(TURNS)), []
    channels = {kind: _in_turn(rng, ["full", "no_force", "displacement"]) for kind in (*SHARES, "single")}
    for kind in kinds:
        family, effects = next(families), ()
        if kind in pools:
            effects = (next(pools[kind]),)
            while family not in KINDS[effects[0]].families:
                family = next(families)
        elif kind == "pair":
            effects = _pair(rng, family)
        cases.append((family, next(channels[kind]), kind, effects))
    return [Case(n, *cases[at_]) for n, at_ in enumerate(rng.permutation(count), 1)]


def _in_turn(rng: np.random.Generator, items: list) -> Iterator:
    while True:
        for index in rng.permutation(len(items)):
            yield items[index]


def _pair(rng: np.random.Generator, family: str) -> tuple[str, ...]:
    names = known_on(family)
    first, second = (names[index] for index in rng.choice(len(names), 2, replace=False))
    return first, second


def make(case: Case, seed: int) -> Made:
    """Draw a case until its loop stands with its effects at their sizes.

    Raises:
        RuntimeError: No draw of the case levitates.
    """
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, case.number, attempt])
        if case.kind == "pair" and attempt % 3 == 2:  # an effect may not become large enough on this rig
            case = replace(case, effects=_pair(rng, case.family))
        rig = draw_rig(case.family, rng)
        truth = Truth(rig, {name: float(t * rng.standard_normal()) for name, t in rig.tolerance.items()})
        try:
            recordings = _experiments(case, rig, rng)
            detector = Detector(truth, recordings, case.channels != "displacement", seed)
            found = {name: _sized(KINDS[name], case, detector, rng) for name in case.effects}
            if case.kind == "pair" and min(f[1] for f in found.values()) < PAIR_SIZES[0]:
                continue
            made = Made(case, truth, recordings, detector, found)
            for r in recordings:
                simulate(disturbed(made), r, 0, steps=6)
        except LoopFailed:
            continue
        return made
    raise RuntimeError(f"case {case.number} ({', '.join(case.effects)} on {case.family}) never stood")


def disturbed(made: Made) -> Truth:
    """The true rig with its effects."""
    values: dict[int, float] = {}
    for own, _, _ in made.found.values():
        for index, value in own.items():
            values[index] = values.get(index, 0.0) + value
    return replace(made.truth, effects=values)


def _sized(
    kind: Kind, case: Case, detector: Detector, rng: np.random.Generator
) -> tuple[dict[int, float], float, float]:
    rig = detector.truth.rig
    others = {index: float(value) for index, value in kind.others(rig, rng).items()}
    sign = float(rng.choice([-1.0, 1.0])) if kind.signed else 1.0
    wanted = log_uniform(rng, *(PAIR_SIZES if case.kind == "pair" else SIZES))
    least, most = threshold(detector, kind, sign, others)
    size = min(wanted * least, most)
    if size < 0.2 * least:
        raise LoopFailed("the effect hardly shows on this rig")
    return {i: float(v) for i, v in kind.values(rig, sign * size, others).items()}, size / least, least


def _experiments(case: Case, rig: BenchRig, rng: np.random.Generator) -> list[Recording]:
    shapes = RECIPES[rng.integers(len(RECIPES))]
    spins = any(KINDS[name].spins for name in case.effects)
    spins |= case.family != "ball" and rng.random() < SPUN
    speed = 2 * pi / 60 * float(rng.uniform(2400, 4800)) if spins else 0.0
    form = str(rng.choice(["pid", "transfer_function"]))
    softer = {**rig.pid, "kp": 0.9 * rig.pid["kp"], "kd": 1.15 * rig.pid["kd"]}
    found = []
    for number, (shape, role) in enumerate(zip(shapes, ("fit", "fit", "holdout"), strict=True)):
        level = 0.05 if shape == "steps" else log_uniform(rng, 0.01, 0.03)
        drive = draw_drive(shape, rig, case.channels != "no_force", level, rng)
        if number == 1 and drive.direction == found[0].drive.direction == BOTH:
            drive = replace(drive, direction=90.0)  # else nothing tells what couples the axes from what differs
        pid = softer if number == 1 and rng.random() < 0.5 else rig.pid
        own = speed * (0.6 if number == 1 and rng.random() < 0.5 else 1.0)
        controller = Controller(pid, form, 1 / rig.parameters["control_rate"])
        found.append(Recording(f"record{number + 1}", role, controller, drive, own, float(rng.uniform(0, 2 * pi))))
    return found


def label(made: Made, seed: int, oracle: bool = True) -> dict:
    """What is sealed of a case; oracle: whether what no method could tell from it is found."""
    case, found = made.case, made.found
    known = {n: values for n, (values, _, _) in found.items()}
    return {
        "id": f"c{case.number:04d}",
        "rig": case.family,
        "channels": case.channels,
        "kind": case.kind,
        "effects": {n: {NAMES[index]: v for index, v in values.items()} for n, (values, _, _) in found.items()},
        "sizes": [float(multiple) for _, multiple, _ in found.values()],
        "thresholds": [float(least) for _, _, least in found.values()],
        "blocks": [KINDS[name].block for name in found],
        "deviations": dict(made.truth.deviations),
        "recordings": [f"{r.role}: {r.drive.shape} at {r.drive.at}" for r in made.recordings],
        "oracle": {"rivals": rivals(made.detector, known, seed) if oracle else []},
        "seed": seed,
    }


def recorded(made: Made, seed: int) -> list[Recorded]:
    """The recordings of a case, with noise and rounding."""
    rng = np.random.default_rng([seed, made.case.number, ATTEMPTS])
    found = []
    for r in made.recordings:
        noise, drops = (int(n) for n in rng.integers(2**62, size=2))
        stored = made.case.channels == "displacement" or r.drive.shape in ("multisine", "steps") or rng.random() < 0.5
        found.append(Recorded(r, stored, simulate(disturbed(made), r, noise, drops)))
    return found


def _produce(case: Case, folder: Path, seed: int, oracle: bool) -> dict:
    made = make(case, seed)
    found = label(made, seed, oracle)
    shutil.rmtree(folder / found["id"], ignore_errors=True)  # of an interrupted run
    write_campaign(folder / found["id"], made.truth.rig, case.channels, recorded(made, seed))
    return found


def generate(
    folder: Path,
    count: int,
    seed: int,
    processes: int,
    labels: Path,
    oracle: bool = True,
    advance: Callable[[], object] = lambda: None,
) -> str:
    """Write campaigns into a new folder and their labels into a file; the same seed gives the same bytes.

    What was interrupted goes on where it was.

    Args:
        folder: New or empty folder.
        count: Number of campaigns.
        seed: Seed of the set.
        processes: Number of processes; results do not change.
        labels: File of the labels.
        oracle: Whether what no method could tell is found, which takes most of the time.
        advance: Called after each campaign.

    Returns:
        SHA-256 of the label file.

    Raises:
        ValueError: A set of other cases was begun there.
    """
    cases = plan(count, seed)
    return sealed(_produce, cases, processes, labels, advance, folder=folder, seed=seed, oracle=oracle)
