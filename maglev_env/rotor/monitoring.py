"""Monitoring of the bearings' stiffness and damping while the pump runs, by a small SPHS at the translation controller.

D 5.2.3: with a known actuator gain, the bearings themselves can excite the rotor in operation. The injection rotates
forward as in `identification`, on lines clear of the rotation's harmonics. Every period is a block in which lines and
rotation are fitted together; the tracker continues from block to block.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from estimation.online.line_block import Block, checked_block, measured_at_mode
from estimation.multisine.line_choice import lines_off_spin
from estimation.lines.spin import lines_beside_spin, spin_speed
from estimation.multisine.sphs import sphs, synthesise
from estimation.online.tracking import Tracked, TrackerSettings, noise_from_scatter, track
from maglev_env.rotor.identification import forward, motion, period_samples, turning
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import control_matrices, control_response, held_current, mechanics, sampled
from maglev_env.rotor.operating_point import at_operating_point
from maglev_env.rotor.rotor import CONTROLS, Rotor
from maglev_env.rotor.run_up import waiting
from maglev_env.rotor.simulate import spin

ORDERS = (1, 2, 3)  # harmonics of the rotation
WIDE = np.array([1e14, 1e8])  # variances of an uninformative prior, (N/m)^2 and (N s/m)^2


@dataclass(frozen=True)
class MonitorPlan:
    """Settings of the monitoring.

    Attributes:
        fundamental: Hz; one period of it is a block.
        amplitude: Peak of the injection in each direction, A.
        band: Band of its lines, Hz.
        settle: Blocks before the first one that is used, beside those of a force rejection.
        drift: Relative drift of stiffness and damping per square root of a second.
        false_alarm_blocks: As in `TrackerSettings`.
    """

    fundamental: float = 4.0
    amplitude: float = 0.02
    band: tuple[float, float] = (60.0, 180.0)
    settle: int = 4
    drift: float = 1e-3
    false_alarm_blocks: float = 1e4


@dataclass(frozen=True)
class Monitored:
    """A monitored rotor.

    Attributes:
        time: Ends of the blocks, (blocks,), s.
        tracked: State after each block.
        expected: Stiffness N/m and damping N s/m before and after the change, (2, 2), of the linear model along the
            orbit.
        centred: The same of the linear model about the centre, (2, 2).
        change: Time at which the rotor changed, s.
        frequency: Frequencies of the lines, (n,), Hz.
        mass: Mass that the tracker assumes, kg; see `monitor`.
        spin_hz: Rotation frequency found in the first block, Hz.
    """

    time: np.ndarray
    tracked: Tracked
    expected: np.ndarray
    centred: np.ndarray
    change: float
    frequency: np.ndarray
    mass: float
    spin_hz: float

    @cached_property
    def alarms(self) -> np.ndarray:
        """Times (n,) s of the blocks with an alarm of stiffness or damping."""
        return self.time[self.tracked.alarm.any(axis=-1)]

    @property
    def delay(self) -> float:
        """Time from the change to the end of the first block that shows it, s; nan where none does."""
        later = self.alarms[self.alarms > self.change]
        return float(later[0] - self.change) if later.size else np.nan


def monitor(
    before: Rotor,
    after: Rotor,
    speed_rpm: float,
    blocks: int = 80,
    change: int = 40,
    plan: MonitorPlan = MonitorPlan(),
    seed: int = 0,
) -> Monitored:
    """Track a rotor that changes while it runs.

    The controller's lead and delay make the stiffness rise with frequency, as if the rotor were lighter. The tracker
    uses the mass that the linear model of `before` shows over the lines, so that its stiffness is one number. It knows
    the injected current, the actuator gain at the centre and the nominal speed.

    Args:
        before: The rotor in the first `change` blocks.
        after: The rotor in the other blocks.
        speed_rpm: Speed, rpm.
        blocks: Number of blocks.
        change: Number of blocks before the change.
        plan: Settings.
        seed: Seed of the noise.

    Raises:
        ValueError: Unless 10 <= change < blocks; a speed that is not positive; a rotor without a translation
            controller; or a touchdown.
    """
    if not 10 <= change < blocks:
        raise ValueError(f"monitor: change = {change} of {blocks} blocks; at least 10 must come before it, one after")
    if any(tuple(rotor.gains) != CONTROLS[0] for rotor in (before, after)):
        raise ValueError("monitor: the rotor needs controllers of translation and tilt ([gains.translation])")
    if not (np.isfinite(speed_rpm) and speed_rpm > 0):
        raise ValueError(f"monitor: speed_rpm = {speed_rpm} must be above 0")
    rate, f0, speed = before.axis.control_rate, plan.fundamental, speed_rpm * np.pi / 30
    n = period_samples(before, f0)
    first, last = np.ceil(plan.band[0] / f0), np.floor(plan.band[1] / f0)
    lines = lines_off_spin(np.arange(int(first), int(last) + 1), f0, [speed_rpm], ORDERS, f0)
    wave = synthesise(sphs(lines, n, plan.amplitude), n)
    _, out = control_matrices(before)
    injection = out[:, :2] @ turning(wave)
    runs = [Run(rotor, speed_rpm, (seed, stage)) for stage, rotor in enumerate((before, after))]
    settle = plan.settle + ceil(waiting(before) * f0)
    probes = _recorded(runs, (change, blocks - change), settle, injection)
    f = lines * f0
    spin_hz = spin_speed(probes[0, 0], rate, f, speed_rpm / 60, ORDERS[:1])
    displacement = motion(before, forward(lines_beside_spin(probes, rate, f, spin_hz, ORDERS).amplitude), f)[:, 0]
    current = np.fft.rfft(wave)[lines] * (2 / n)
    force = np.broadcast_to(_force(before, current, f), displacement.shape)
    noise = noise_from_scatter(force, displacement)
    w = 2 * np.pi * f
    z = _stiffness(before, f, speed, before)
    mass = float(-np.polyfit(w**2, z.real, 1)[0])

    def model(rotor: Rotor) -> np.ndarray:
        # Constants over the lines at which the tracker would settle if this were the only response.
        y = force[0] / _stiffness(rotor, f, speed, before)
        return measured_at_mode(checked_block(Block(0.0, force[0], y, noise), f), w, mass, guess, WIDE)[0]

    guess = np.array([np.mean(z.real + mass * w**2), np.mean(z.imag / w)])
    settings = TrackerSettings(
        *guess, mass, plan.drift, plan.drift, start=0.3, false_alarm_blocks=plan.false_alarm_blocks
    )
    time = np.arange(1, blocks + 1) / f0
    tracked = track(settings, f, time, force, displacement, noise)
    expected, centred = (
        np.array([model(one) for one in pair])
        for pair in ([at_operating_point(rotor, speed) for rotor in (before, after)], (before, after))
    )
    return Monitored(time, tracked, expected, centred, change / f0, f, mass, spin_hz)


def _recorded(runs: Sequence[Run], counts: Sequence[int], settle: int, injection: np.ndarray) -> np.ndarray:
    """Probes (blocks, 4, n) m over periods of the injection (4, n) A, in one run continued by the next."""
    records, start, n = [], None, injection.shape[1]
    for stage, (run, count) in enumerate(zip(runs, counts, strict=True)):
        skipped = 0 if stage else settle * n
        spun = spin([run], count * n, skipped, injection, start=start, threads=1)
        if np.isfinite(spun.first_contact).any():
            raise ValueError(f"monitor: the rotor touches down {('before', 'after')[stage]} the change; see its run-up")
        start = spun.end
        records.append(spun.channels[0, :4].reshape(4, count, n).transpose(1, 0, 2))
    return np.concatenate(records)


def _force(rotor: Rotor, current: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Force (n,) N of a current added to both commands: held, then through amplifiers and actuators."""
    return mechanics(rotor).drive[0, [0, 2]].sum() * current * held_current(rotor, frequency)


def _stiffness(rotor: Rotor, frequency: np.ndarray, speed: float, known: Rotor) -> np.ndarray:
    """Complex ratio (n,) N/m of the injected force, as computed for `known`, to the rotor's response (linear model)."""
    a, b, c = sampled(rotor, speed)
    _, out = control_matrices(rotor)
    z = np.exp(2j * np.pi * frequency / rotor.axis.control_rate)
    control = control_response(rotor, frequency, speed)
    closed = z[:, None, None] * np.eye(8) - a + b[:, :2] @ control @ c
    states = np.linalg.solve(closed, b[:, :2] @ out[::2, [0]])
    return _force(known, np.ones(len(frequency)), frequency) / states[:, 0, 0]
