"""A simulated recording of the benchmark: a rig with true parameters and effects, under a drive."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil, sqrt

import numpy as np

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.drives import Drive
from sim2real.blind.benchmark.integrate import run
from sim2real.blind.benchmark.rigs import BenchRig

_DIVISORS = (
    *(at.DRIFT_TIME, at.KNEE, at.WIDTH, at.PITCH, at.SLIP, at.SLOW, at.SAG_LENGTH, at.CREEP_TIME, at.SAG_TIME),
    at.UNEVEN_PITCH,
)


class LoopFailed(Exception):
    """The rotor touched its stops."""


@dataclass(frozen=True)
class Controller:
    """One controller: values of the form "pid", or the same gains made a transfer function by trapezoids.

    Attributes:
        pid: kp, ki, kd and td.
        form: "pid" or "transfer_function".
        step: Control period, s.
    """

    pid: Mapping[str, float]
    form: str
    step: float

    def coefficients(self) -> tuple[np.ndarray, np.ndarray]:
        """(numerator, denominator) in powers of 1/z, three each."""
        kp, ki, kd, td = (self.pid[name] for name in ("kp", "ki", "kd", "td"))
        if self.form == "pid":  # newest sample in the integral, backward difference
            pole, integral, rate = td / (td + self.step), np.array([ki * self.step, 0.0]), kd / (td + self.step)
        else:  # trapezoids
            pole = (2 * td - self.step) / (2 * td + self.step)
            integral, rate = np.full(2, 0.5 * ki * self.step), 2 * kd / (2 * td + self.step)
        falling, leaky = np.array([1.0, -1.0]), np.array([1.0, -pole])
        denominator = np.convolve(falling, leaky)
        numerator = kp * denominator + np.convolve(integral, leaky) + rate * np.convolve(falling, falling)
        return numerator, denominator

    def toml(self) -> str:
        """As an inline table of a recording."""
        if self.form == "pid":
            return '{ form = "pid", ' + ", ".join(f"{k} = {v!r}" for k, v in self.pid.items()) + " }"
        over, under = (", ".join(repr(float(v)) for v in c) for c in self.coefficients())
        return f"{{ numerator = [{over}], denominator = [{under}] }}"


@dataclass(frozen=True)
class Truth:
    """A rig as it is: the nominal one, relative deviations within the tolerances, and values of effects by index."""

    rig: BenchRig
    deviations: Mapping[str, float] = field(default_factory=dict)
    effects: Mapping[int, float] = field(default_factory=dict)

    def values(self, speed: float, angle: float) -> np.ndarray:
        """The array `p` of the loop at a speed (rad/s) and an angle at the begin (rad)."""
        r, off = self.rig.parameters, self.deviations
        p = np.zeros(at.VALUES)
        law = at.PAIR if self.rig.family != "ball" else at.EXPONENTIAL if "force_length" in r else at.POWER
        constant = r.get("force_constant") or self.rig.gain * r["gap"] ** 2 / (4 * r["bias_current"])
        p[at.LAW], p[at.BIAS], p[at.GAP], p[at.CONSTANT] = law, r["bias_current"], r["gap"], constant
        p[at.LENGTH], p[at.EXPONENT] = r.get("force_length", 1.0), r.get("force_exponent", 2.0)
        p[at.MAGNETIC_OFFSET], p[at.GRAVITY] = r.get("gap_offset", 0.0), r["gravity"]
        p[at.MASS] = r["mass"] * (1 + off.get("mass", 0.0))
        p[at.SUPPORT] = r.get("support_stiffness", 0.0) * (1 + off.get("support_stiffness", 0.0))
        p[at.SUPPORT_DAMPING] = r.get("support_damping", 0.0)
        p[at.GAIN], p[at.STIFFENING] = off.get("actuator_gain", 0.0), off.get("negative_stiffness", 0.0)
        p[at.SCALE] = off.get("probe_gain", 0.0)
        p[at.AMPLIFIER], p[at.PROBE] = r["amplifier_time_constant"], r["sensor_time_constant"]
        p[at.INDUCTANCE], p[at.RESISTANCE] = r["coil_inductance"], r["coil_resistance"]
        p[at.RATE], p[at.COMMAND_RANGE] = r["control_rate"], r["voltage_range"] * r["amplifier_gain"]
        p[at.READ_STEP], p[at.COMMAND_STEP] = self.rig.counts["displacement"], self.rig.counts["command"]
        p[at.SPEED], p[at.ANGLE] = speed, angle
        for index, value in self.effects.items():
            p[index] += value
        for index in _DIVISORS:
            p[index] = p[index] or 1.0
        return p


@dataclass(frozen=True)
class Recording:
    """An experiment.

    Attributes:
        name: Of its file, without the suffix.
        role: "fit" or "holdout".
        controller: In force.
        drive: What excites it.
        speed: rad/s.
        angle: At the begin, rad.
        offset: Steady set point on every axis, m.
        beside: A second drive, elsewhere or on other lines.
    """

    name: str
    role: str
    controller: Controller
    drive: Drive
    speed: float = 0.0
    angle: float = 0.0
    offset: float = 0.0
    beside: Drive | None = None

    @property
    def drives(self) -> tuple[Drive, ...]:
        """Its drives."""
        return (self.drive,) if self.beside is None else (self.drive, self.beside)

    def channels(self, axes: int) -> dict[str, np.ndarray]:
        """The channels force, injection and reference (n, axes)."""
        each = [drive.channels(axes) for drive in self.drives]
        found = {name: sum(one[name] for one in each) for name in each[0]}
        return {**found, "reference": found["reference"] + self.offset}


STEPS = 20  # Runge-Kutta steps in a control period; differences of two simulations need fewer
FEW_STEPS = 6
# A bench is at rest before it is recorded, also where an offset or a load has moved it: for so many times the inverse
# of the loop's bandwidth, eight time constants of the slowest pole (see `rigs`).
LEAD = 70.0


def simulate(
    truth: Truth, recording: Recording, seed: int | None, drops: int = 0, steps: int = STEPS
) -> dict[str, np.ndarray]:
    """Channels (samples, axes) of a recording.

    Args:
        truth: The rig.
        recording: The experiment.
        seed: Of all noise; None: without noise and rounding.
        drops: Seed of which commands are lost.
        steps: Runge-Kutta steps in a control period.

    Raises:
        LoopFailed: The rotor touched its stops.
    """
    rig, driven = truth.rig, recording.channels(truth.rig.axes)
    shape = driven["force"].shape
    rng = np.random.default_rng(seed)
    noise = np.zeros(shape) if seed is None else rig.noise["displacement"] * rng.standard_normal(shape)
    found = _run(truth, recording, driven, noise, drops, seed is not None, steps)
    if seed is not None:
        found["current"] = found["current"] + rig.noise["current"] * rng.standard_normal(shape)
        driven["force"] = driven["force"] + rig.noise.get("force", 0.0) * rng.standard_normal(shape)
    return {**found, **driven}


def smoothed(truth: Truth, recording: Recording, seed: int, drops: int, steps: int) -> dict[str, np.ndarray]:
    """Mean of displacement, command and current (samples, axes) over one noise in the loop and its opposite.

    Noise moves a loop to and fro across what is not smooth, which makes this act less, or otherwise, in the mean. What
    is linear in the noise cancels, so that few draws give the mean. Rounding is noise of the same variance.

    Args:
        truth: The rig.
        recording: The experiment.
        seed: Of the noise of reading and command.
        drops: Seed of which commands are lost.
        steps: Runge-Kutta steps in a control period.

    Raises:
        LoopFailed: The rotor touched its stops.
    """
    rig, driven = truth.rig, recording.channels(truth.rig.axes)
    rng, shape = np.random.default_rng([seed, 2]), driven["force"].shape
    noise = np.hypot(rig.noise["displacement"], rig.counts["displacement"] / sqrt(12)) * rng.standard_normal(shape)
    rounded = rig.counts["command"] / sqrt(12) * rng.standard_normal(shape)
    pair = []
    for sign in (1.0, -1.0):
        moved = {**driven, "injection": driven["injection"] + sign * rounded}
        pair.append(_run(truth, recording, moved, sign * noise, drops, False, steps))
    return {name: 0.5 * (pair[0][name] + pair[1][name]) for name in pair[0]}


def _run(
    truth: Truth,
    recording: Recording,
    driven: Mapping[str, np.ndarray],
    noise: np.ndarray,
    drops: int,
    quantised: bool,
    steps: int,
) -> dict[str, np.ndarray]:
    p = truth.values(recording.speed, recording.angle)
    lead = ceil(LEAD / truth.rig.bandwidth * p[at.RATE])
    lost = np.random.default_rng([drops, 1]).random(noise.shape[0]) < p[at.DROPS]
    b, c = recording.controller.coefficients()
    inputs = (driven["reference"], driven["injection"], driven["force"], noise)
    before = (recording.offset, 0.0, 0.0, 0.0)
    rested = [np.pad(x, ((lead, 0), (0, 0)), constant_values=v) for x, v in zip(inputs, before, strict=True)]
    *channels, stood = run(p, b, c, *rested, np.pad(lost, (lead, 0)), quantised, steps, lead)
    if not stood:
        raise LoopFailed(recording.name)
    return dict(zip(("displacement", "command", "current"), (x[lead:] for x in channels), strict=True))
