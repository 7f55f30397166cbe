"""Scoring of rotors: run them up, identify them at standstill and at top speed, and grade the results."""

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.iso_14839 import iso_14839_2_zone, iso_14839_3_zone
from maglev_env.presented import Presented
from maglev_env.rotor.identification import MODES, Protocol, RotorIdentification, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import closed_loop_poles
from maglev_env.rotor.rotor import Rotor
from maglev_env.rotor.run_up import SPEEDS, RunUp, Seeds, checked_speeds, run_up, seeds_of
from maglev_env.rotor.simulate import shared_rate
from maglev_env.evaluation.score import ScoreTarget, score, stacked, terms

if TYPE_CHECKING:
    import xarray as xr

PROTOCOL = Protocol()
CHUNK = 64  # runs identified together, which keeps their spectra near 40 MB


_UNITS = {
    "peak_displacement": "m", "current_rms": "A", "touchdown_time": "s", "touchdown_speed": "rpm",
}  # fmt: skip


@dataclass(frozen=True, repr=False)
class RotorEvaluation(Presented):
    """n scored rotors; arrays (n,) unless stated, nan where nothing is known.

    Attributes:
        run_up: The run-up.
        id_speeds: Speeds of the identifications, (k,), rpm.
        identification: One identification for each of these speeds.
        pole_radius: Of the linearised loop at standstill and at the top speed of the run-up, (n, 2).
        peak_displacement: Largest over speeds and planes, m.
        current_rms: Largest over speeds and coils, A.
        peak_sensitivity: Largest over controllers and id_speeds.
        displacement_zone: Letter of ISO 14839-2; "" where unknown.
        sensitivity_zone: Letter of ISO 14839-3; "" where unknown.
        touchdown_time: Time of the first contact at touchdown_speed, or the end of the identification where only its
            injection caused one, s.
        touchdown_speed: Lowest speed with a contact, rpm.
        terms: Score terms, each of the worst mode, controller, plane or speed.
        score: 0 to 1.
        feasible: Stable at both speeds and without touchdown.
    """

    run_up: RunUp
    id_speeds: np.ndarray
    identification: tuple[RotorIdentification, ...]
    pole_radius: np.ndarray
    peak_displacement: np.ndarray
    current_rms: np.ndarray
    peak_sensitivity: np.ndarray
    displacement_zone: np.ndarray
    sensitivity_zone: np.ndarray
    touchdown_time: np.ndarray
    touchdown_speed: np.ndarray
    terms: dict[str, np.ndarray]
    score: np.ndarray
    feasible: np.ndarray

    rows = "rotor"

    def __str__(self) -> str:
        best = int(np.argmax(self.score))
        return (
            f"Evaluation of {len(self.score)} rotors, {int(self.feasible.sum())} feasible; best number {best}: score "
            f"{self.score[best]:.3f}, peak {1e6 * self.peak_displacement[best]:.3g} µm, peak |S| "
            f"{self.peak_sensitivity[best]:.3g}"
        )

    def to_xarray(self) -> "xr.Dataset":
        """Every array by rotor; units are in the attributes, and terms of the score begin with `term_`."""
        import xarray as xr

        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays |= {f"term_{name}": values for name, values in self.terms.items()}
        dims = (self.rows, "end_of_speeds")
        variables = {
            name: (dims[: values.ndim], values, {"units": _UNITS[name]} if name in _UNITS else {})
            for name, values in arrays.items()
            if isinstance(values, np.ndarray) and name != "id_speeds"
        }
        return xr.Dataset(variables, {self.rows: np.arange(len(self.score))}, {"rows": self.rows})

    def identified(self, name: str) -> np.ndarray:
        """A field of the identifications, (n, k, 2) for stiffness for example."""
        return _stacked(self.identification, name)


def rotor_target(rotor: Rotor, id_speeds: Sequence[float], protocol: Protocol = PROTOCOL) -> ScoreTarget:
    """Score target from a rotor's own gains without noise.

    Stiffness and damping are (k, 2) by id_speeds (rpm) and mode; the other values are those of the rotor's axis.

    Raises:
        ValueError: The gains do not levitate the rotor at these speeds.
    """
    return _target(pickle.dumps((rotor, tuple(map(float, id_speeds)), protocol)))


@lru_cache(maxsize=256)
def _target(pickled: bytes) -> ScoreTarget:  # a rotor holds mappings and has no hash
    rotor, id_speeds, protocol = pickle.loads(pickled)
    axis = replace(rotor.axis, adc_bits=0, dac_bits=0, noise=replace(rotor.axis.noise, displacement=0.0))
    quiet = replace(rotor, axis=axis)
    found = identify_runs([Run(quiet, speed) for speed in id_speeds], protocol, threads=1)
    radius = max(_pole_radius(rotor, speed) for speed in id_speeds)
    if radius >= 1 or np.isnan(found.stiffness).any():
        raise ValueError(
            f"rotor {rotor.name}: [gains] do not hold it up at {', '.join(f'{s:g}' for s in id_speeds)} rpm "
            f"(pole radius {radius:.4f}); change them or the speeds"
        )
    t = axis.target
    return ScoreTarget(found.stiffness, found.damping, t.peak_sensitivity, axis.clearance, t.current_limit, axis.gap)


def identified_speeds(rotor: Rotor, speeds: np.ndarray, protocol: Protocol = PROTOCOL) -> np.ndarray:
    """Speeds (k,) rpm, sorted, at which a rotor that runs at speeds (s,) is identified: standstill and near the top."""
    top = float(speeds[abs(speeds).argmax()])
    return np.unique([0.0, protocol.of(rotor.axis.control_rate).clear_speed(top)])


def evaluate_rotors(
    rotors: Sequence[Rotor],
    speeds: np.ndarray = SPEEDS,
    id_speeds: Sequence[float] | None = None,
    protocol: Protocol = PROTOCOL,
    seed: Seeds = 0,
    threads: int | None = None,
    target: ScoreTarget | None = None,
) -> RotorEvaluation:
    """Run up, identify and score rotors under their own gains. The controllers of all must act in the same way.

    Args:
        rotors: The rotors.
        speeds: Speeds of the run-up, rpm.
        id_speeds: Speeds of the identifications, rpm, clear of the protocol's lines (`Protocol.clear`); by default
            standstill and the next clear speed at or below the top speed.
        protocol: The identification experiment.
        seed: One for all, or one for each rotor; a rotor's result depends on its seed alone.
        threads: Number of threads; results do not depend on it.
        target: By default each rotor's own `rotor_target`; when gains are compared, give that of the preset gains.

    Raises:
        ValueError: No rotors, controllers of two kinds, speeds that are not finite, id_speeds that are not clear of the
            lines, a target for other id_speeds, or as `run_up` and `rotor_target`.
    """
    if not rotors:
        raise ValueError("rotors: give at least one")
    if len({tuple(rotor.gains) for rotor in rotors}) > 1:
        raise ValueError("rotors: their controllers must all act on translation and tilt, or all on a and b")
    speeds = checked_speeds("speeds", speeds)
    top = speeds[abs(speeds).argmax()]
    protocol = protocol.of(shared_rate(rotors))
    at = identified_speeds(rotors[0], speeds, protocol) if id_speeds is None else checked_speeds("id_speeds", id_speeds)
    for one in at:
        protocol.check_clear(one)
    if target is not None and np.shape(target.stiffness) != (at.size, len(MODES)):
        raise ValueError(f"target: its stiffness is not one per speed and mode; make it for {at.tolist()} rpm")
    seeds = seeds_of(seed, len(rotors))
    if target is None:
        target = stacked([rotor_target(rotor, at.tolist(), protocol) for rotor in rotors])
        levels: dict[str, Any] = {name: getattr(target, name)[:, None, None] for name in _LEVELS}
        target = replace(target, **levels)
    up = run_up(rotors, speeds, [(*s, 0) for s in seeds], threads)
    runs = [Run(r, v, (*s, 1, j)) for r, s in zip(rotors, seeds, strict=True) for j, v in enumerate(map(float, at))]
    identified = _identified(runs, at.size, protocol, threads)
    radius = np.array([[_pole_radius(rotor, v) for v in (0.0, top)] for rotor in rotors])
    return _scored(rotors, up, at, identified, radius, target, protocol)


_LEVELS = ("peak_sensitivity", "clearance", "current_limit", "gap")


def _identified(
    runs: Sequence[Run], k: int, protocol: Protocol, threads: int | None
) -> tuple[RotorIdentification, ...]:
    """Identifications of runs, k for each rotor in turn, grouped by their number among the k."""
    parts = [identify_runs(runs[i : i + CHUNK], protocol, threads) for i in range(0, len(runs), CHUNK)]
    first, second = (np.concatenate([part.sensitivity[c] for part in parts]) for c in range(2))
    names = [f.name for f in fields(RotorIdentification) if f.name not in ("sensitivity", "frequency")]
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return tuple(
        RotorIdentification(
            frequency=parts[0].frequency,
            sensitivity=(first[j::k], second[j::k]),
            **{n: v[j::k] for n, v in columns.items()},
        )
        for j in range(k)
    )


def _stacked(identified: tuple[RotorIdentification, ...], name: str) -> np.ndarray:
    return np.stack([getattr(one, name) for one in identified], axis=1)


def _pole_radius(rotor: Rotor, speed_rpm: float) -> float:
    return float(np.abs(closed_loop_poles(rotor, speed_rpm * np.pi / 30)).max())


def _scored(
    rotors: Sequence[Rotor],
    up: RunUp,
    at: np.ndarray,
    identified: tuple[RotorIdentification, ...],
    radius: np.ndarray,
    target: ScoreTarget,
    protocol: Protocol,
) -> RotorEvaluation:
    stiffness, damping, sensitivity = (_stacked(identified, n) for n in ("stiffness", "damping", "peak_sensitivity"))
    peak, current = up.peak.max(axis=(1, 2)), up.coil_rms.max(axis=(1, 2))
    # Every term falls when its quantity gets worse, so the least over modes and speeds is that of the worst.
    every = terms(target, stiffness, damping, sensitivity, peak[:, None, None], current[:, None, None])
    worst = {name: values.min(axis=(1, 2)) for name, values in every.items()}
    peak_sensitivity = sensitivity.max(axis=(1, 2))
    length = np.array([protocol.settling(rotor) + protocol.periods for rotor in rotors]) / protocol.fundamental
    time, speed = _touchdown(up, at, sensitivity, length)
    feasible = np.isnan(time) & (radius < 1).all(axis=1)
    clearance = [rotor.axis.clearance for rotor in rotors]
    return RotorEvaluation(
        run_up=up,
        id_speeds=at,
        identification=identified,
        pole_radius=radius,
        peak_displacement=peak,
        current_rms=current,
        peak_sensitivity=peak_sensitivity,
        displacement_zone=np.array([iso_14839_2_zone(p, c) for p, c in zip(peak, clearance, strict=True)]),
        sensitivity_zone=np.array(["" if np.isnan(s) else iso_14839_3_zone(s) for s in peak_sensitivity]),
        touchdown_time=time,
        touchdown_speed=speed,
        terms=worst,
        score=np.where(feasible, score(worst), 0.0),
        feasible=feasible,
    )


def _touchdown(up: RunUp, at: np.ndarray, sensitivity: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) s and speed (n,) rpm of the touchdown, nan without one; length: of the identifications, (n,), s."""
    order = np.argsort(abs(up.speed_rpm), kind="stable")
    lowest = order[up.touched_down[:, order].argmax(axis=1)]
    time = np.fmin.reduce(up.first_contact, axis=2)[np.arange(len(lowest)), lowest]
    lost = np.isnan(sensitivity).any(axis=2)
    alone = np.isnan(time) & np.any(lost, axis=1)
    speed = np.where(np.isnan(time), np.nan, up.speed_rpm[lowest])
    return np.where(alone, length, time), np.where(alone, at[lost.argmax(axis=1)], speed)
