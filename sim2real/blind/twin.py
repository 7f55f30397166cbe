"""The twin itself: from a truth, gains and a drive to what would have been recorded."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from sim2real.blind.excitation import Drive
from sim2real.blind.forms import BURST, Effects, Forms, machine
from sim2real.blind.rigs import PID, RIGS
from sim2real.blind.stepping import OK, TOUCHDOWN, step_record

SUBSTEPS = 10
TONAL = ("runout", "pickup", "unbalance", "foreign_vibration")
HARMONICS = (1, 2, 3)


class LoopFailed(ValueError):
    """The rotor touched down, or a converter clipped."""


@dataclass(frozen=True)
class Truth:
    """The true system.

    Attributes:
        rig: Name of the rig.
        deviations: Relative deviation of each parameter from nominal.
        effects: Its effects.
        forms: Forms that realise the effects.
        speed_rpm: Speed of rotation, rpm.
        start: Time that tones have run when a recording starts, as a share of a minute.
    """

    rig: str
    deviations: Mapping[str, float] = field(default_factory=dict)
    effects: Effects = field(default_factory=dict)
    forms: Forms = "sealed"
    speed_rpm: float = 0.0
    start: float = 0.0

    @property
    def parameters(self) -> dict[str, float]:
        """True parameters, SI, and the probe gain of the data sheet as probe_nominal."""
        p = dict(RIGS[self.rig].parameters)
        nominal = p["probe_gain"]
        for name, relative in self.deviations.items():
            p[name] *= 1 + relative
        return {**p, "probe_nominal": nominal}


def simulate(
    truth: Truth,
    gains: PID,
    drive: Drive,
    periods: int,
    seed: int | tuple[int, ...] | None,
    substeps: int = SUBSTEPS,
) -> dict[str, np.ndarray]:
    """Simulate a recording from rest.

    Args:
        truth: The true system.
        gains: PID gains.
        drive: Excitation.
        periods: Number of periods.
        seed: Seed of the noise and of random effects; None gives neither noise nor quantisation.
        substeps: Runge-Kutta steps per control sample.

    Returns:
        Channels (periods * samples_per_period,): displacement, command, current, force, injection, reference.

    Raises:
        LoopFailed: The rotor touches down or a converter clips.
    """
    p, noise = truth.parameters, RIGS[truth.rig].noise
    samples = periods * drive.force.size
    rng = np.random.default_rng(0 if seed is None else seed)
    draws = rng.standard_normal((3, samples)) if seed is not None else np.zeros((3, samples))
    misread, push = _tones(truth, samples, p["control_rate"])
    lost = truth.effects.get("dropped_samples", {}).get("probability", 0.0)
    held = _dropped(rng.random(samples), lost, BURST if truth.forms == "sealed" else 0.0)
    out = np.empty((3, samples))
    loop = np.array([gains.kp, gains.ki, gains.kd, gains.td, gains.ti])
    waves = (drive.force, drive.injection, drive.reference, draws[0] * noise["displacement"], misread, push, held)
    status = step_record(machine(p, truth.effects, truth.forms), loop, *waves, substeps, seed is not None, out)
    if status != OK:
        raise LoopFailed("the rotor touched down" if status == TOUCHDOWN else "a converter clipped")
    return {
        "displacement": out[0],
        "command": out[1],
        "current": out[2] + draws[1] * noise["current"],
        "force": np.tile(drive.force, periods) + draws[2] * noise["force"],
        "injection": np.tile(drive.injection, periods),
        "reference": np.full(samples, drive.reference),
    }


def twin_periods(truth: Truth, gains: PID, drive: Drive, seed: int | None, periods: int = 9) -> dict[str, np.ndarray]:
    """As `simulate`, with each channel (periods, samples_per_period); the first period is the transient from rest."""
    channels = simulate(truth, gains, drive, periods, seed)
    return {name: values.reshape(periods, -1) for name, values in channels.items()}


def _dropped(draws: np.ndarray, share: float, burst: float) -> np.ndarray:
    """Which samples are dropped: a share of them, which come in bursts; draws are uniform numbers (samples,)."""
    held = draws < share
    again = share + burst * (1 - share)  # after a dropped sample; after others, so that the share is kept
    first = share * (1 - again) / (1 - share)
    for k in range(1, held.size if burst and share else 0):
        held[k] = draws[k] < (again if held[k - 1] else first)
    return held


def _tones(truth: Truth, samples: int, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Error of the probe's reading (samples,), m, and the external force (samples + 1,), N."""
    time = 60 * truth.start + np.arange(samples + 1) / rate
    shown, push = np.zeros(samples + 1), np.zeros(samples + 1)
    for name, e in truth.effects.items():
        if name in ("runout", "pickup"):
            base = truth.speed_rpm / 60 if name == "runout" else e["frequency"]
            shown += e["amplitude"] * _harmonics(e, base, time)
        elif name == "unbalance":
            turning = 2 * np.pi * truth.speed_rpm / 60
            push += e["moment"] * turning**2 * _harmonics(e, truth.speed_rpm / 60, time)
        elif name == "foreign_vibration":
            for n in range(int(e["tones"])):
                push += e["force"] * np.cos(2 * np.pi * e[f"frequency{n}"] * time + e[f"phase{n}"])
    return shown[:-1], push


def _harmonics(e: Mapping[str, float], base: float, time: np.ndarray) -> np.ndarray:
    total = np.zeros(time.size)
    for n in HARMONICS:
        total += e["harmonics"] ** (n - 1) * np.cos(2 * np.pi * n * base * time + e[f"phase{n}"])
    return total
