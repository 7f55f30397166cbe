"""What a goal requires of a rotor that is struck, loaded or let go, simulated at every speed.

The rotor turns and is unbalanced. A second simulation with the same noise but without the load is subtracted, so that
what remains is the answer to the load alone.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import uniform_filter1d

from maglev_env.evaluation.requirements import MEAN_OVER, NEAR, NOISE_BAND, settling_time
from maglev_env.rig.goal import Goal, Requirement
from maglev_env.rotor import rows as r
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import control_matrices
from maglev_env.rotor.loop_quantities import PLANES, Found
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.run_up import SETTLE, waiting
from maglev_env.rotor.simulate import STATES, Spun, alike, spin
from maglev_lanes.layout import row

FOLLOWED = 3.0  # a time is followed for so many times its limit, and an impulse for as long as
STRUCK = 0.05  # s
HOVER = 0.05  # s of hovering, of which a lift-off's band of rest is made


def large_signal_quantities(
    goal: Goal, rotors: Sequence[Rotor], speeds: np.ndarray, seeds: Sequence[tuple[int, ...]], threads: int | None
) -> list[dict[str, Found]]:
    """Quantities of a goal's events, by name, of each of n rotors; inf where one touches down.

    Loads act on the centre of mass along x; a lift-off begins at standstill, below the centre along y.

    Args:
        goal: The goal.
        rotors: n of them.
        speeds: (s,), rpm.
        seeds: Of the noise, n.
        threads: Number of threads.
    """
    found: list[dict[str, Found]] = [{} for _ in rotors]
    for some in alike([waiting(rotor) for rotor in rotors]):
        own = _settled_alike(goal, [rotors[i] for i in some], speeds, [seeds[i] for i in some], threads)
        for i, one in zip(some, own, strict=True):
            found[i] = one
    return found


def _settled_alike(
    goal: Goal, rotors: Sequence[Rotor], speeds: np.ndarray, seeds: Sequence[tuple[int, ...]], threads: int | None
) -> list[dict[str, Found]]:
    """As `large_signal_quantities`, of rotors that are waited for equally long."""
    runs = [
        Run(one, float(v), (*seed, 2, j)) for one, seed in zip(rotors, seeds, strict=True) for j, v in enumerate(speeds)
    ]
    found: list[dict[str, Found]] = [{} for _ in rotors]
    peaks: dict[float, np.ndarray] = {}  # (n, 2) by speed: of the loads at every one, of the lift-off at standstill
    s = len(speeds)
    at, rate = tuple(map(float, speeds)), rotors[0].axis.control_rate
    settle = round((SETTLE + waiting(rotors[0])) * rate)
    loads = {kind: one for kind, one in goal.events.items() if kind != "lift_off"}
    if loads:
        times = {kind: STRUCK if kind == "impulse" else FOLLOWED * one.limit for kind, one in loads.items()}
        begun = spin(runs, 1, settle, threads=threads)
        again = [Run(run.rotor, run.speed_rpm, (*run.seed, 1)) for run in runs]
        alone = spin(again, round(max(times.values()) * rate), start=begun.end, threads=threads)
        for kind, one in loads.items():
            n = round(times[kind] * rate)
            spun = spin(again, n, force=_force(kind, one, n, rate), start=begun.end, threads=threads)
            moved = spun.channels[:, 0:3:2] - alone.channels[:, 0:3:2, :n]  # in x at both planes
            values = np.stack([_answer(kind, run.rotor, y, rate) for run, y in zip(runs, moved, strict=True)])
            values[_touched(spun)] = np.inf
            for i, part in enumerate(values.reshape(len(rotors), s, 2)):
                found[i][one.name] = Found(at, PLANES, part)
            largest = _current(spun).reshape(len(rotors), s, 2)
            for j, v in enumerate(at):
                peaks[v] = np.fmax(peaks.get(v, 0.0), largest[:, j])
    if "lift_off" in goal.events:
        one = goal.events["lift_off"]
        still = [Run(rotor, 0.0, (*seed, 3)) for rotor, seed in zip(rotors, seeds, strict=True)]
        n = round(FOLLOWED * one.limit * rate)
        spun = spin(still, n + round(HOVER * rate), start=_lying(still, one.size), threads=threads)
        for i, run in enumerate(still):
            values = _lifted(spun.channels[i, 1:4:2], n, one, run.rotor)
            found[i][one.name] = Found((0.0,), PLANES, np.where(_touched(spun)[i], np.inf, values)[None])
        peaks[0.0] = np.fmax(peaks.get(0.0, 0.0), _current(spun))
    for i in range(len(rotors)) if goal.events else ():
        found[i]["current_peak"] = Found(tuple(sorted(peaks)), PLANES, np.array([peaks[v][i] for v in sorted(peaks)]))
    return found


def _force(kind: str, one: Requirement, n: int, rate: float) -> np.ndarray:
    """Generalised forces (5, n): one sample of an impulse of so many N s, or a step of so many N, along x."""
    wave = np.zeros((5, n))
    wave[0, : 1 if kind == "impulse" else n] = one.size * rate if kind == "impulse" else one.size
    return wave


def _answer(kind: str, rotor: Rotor, moved: np.ndarray, rate: float) -> np.ndarray:
    """Peak (m) after an impulse, or time (s) until the rotor has come to rest, of displacements (2, n) at planes."""
    if kind == "impulse":
        return abs(moved).max(axis=1)
    return settling_time(moved, np.full(2, NEAR * rotor.axis.clearance), 1 / rate)


def _lying(runs: Sequence[Run], size: float) -> np.ndarray:
    """States (n, STATES) of rotors at rest so far below the centre (m): probes and derivatives have settled there."""
    start = np.zeros((len(runs), STATES))
    start[:, row(r.COS)] = 1.0
    start[:, row(r.Q) + 2] = -size
    for i, run in enumerate(runs):
        into, _ = control_matrices(run.rotor)
        seen = np.array([0.0, -size, 0.0, -size])
        start[i, row(r.PROBE) : row(r.PROBE) + 4] = seen
        start[i, row(r.D) : row(r.D) + 4] = -into @ seen
    return start


def _lifted(y: np.ndarray, n: int, one: Requirement, rotor: Rotor) -> np.ndarray:
    """Time (2,) s until readings (2, samples) at both planes have come to rest within n samples; the others show how
    far a rotor that hovers strays."""
    rate = rotor.axis.control_rate
    width = max(1, round(MEAN_OVER * one.limit * rate))
    smooth = uniform_filter1d(y, width, axis=-1, mode="nearest")
    least = np.maximum(NOISE_BAND * smooth[:, n:].std(axis=-1), NEAR * rotor.axis.clearance)
    return settling_time(smooth[:, :n], least, 1 / rate)


def _touched(spun: Spun) -> np.ndarray:
    return np.isfinite(spun.first_contact).any(axis=1)


def _current(spun: Spun) -> np.ndarray:
    """Largest coil current (n, 2) at each plane, A."""
    return abs(spun.channels[:, 4:8]).max(axis=-1).reshape(-1, 2, 2).max(axis=-1)
