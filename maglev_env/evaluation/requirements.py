"""What the requirements of a goal are compared with, by the identification experiment and the large-signal test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimation.gain_margin import at_rest, gain_factors
from estimation.lines.frequency_response import POOL, frequency_response, pooled_variance
from estimation.lines.periods import LineStatistics
from estimation.lines.smooth_loop import smooth_closed_loop
from estimation.margin_errors import margin_errors
from estimation.normal import NORMAL_95, widening
from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import Block
from maglev_env.kernel.events import Event, simulated_events
from maglev_env.rig.goal import QUANTITIES, EventKind, Goal, Requirement

# The band in which a rotor has come to rest: a share of the peak, of the clearance, and times the rms of hovering,
# whichever is widest. What is less than a hundredth of the clearance matters to nobody.
SETTLED, NEAR, NOISE_BAND = 0.1, 0.01, 5.0
MEAN_OVER = 1 / 30  # of a time's limit, over which readings are averaged before they are compared with that band
LAST = 0.2  # share of an event, its end, whose mean is where the rotor comes to rest
FOLLOWED, LEAST_FOLLOWED = 3.0, 1.5  # a time is followed for so many times its limit, or at least for so many
# Shares of the identification experiment's duration: hovering, an impulse, and at most each of the two times.
HOVER, IMPULSE, TIMED = 0.03, 0.03, 0.09
WARMING = 0.2  # share of the hovering that is left out, in which the noise builds up
EVENT_NAMES: Mapping[EventKind, str] = {
    "impulse": "impulse_displacement",
    "step": "recovery_time",
    "lift_off": "lift_off_time",
}
LOOP = ("peak_sensitivity", "phase_margin", "gain_margin", "disk_margin")  # of the loop gain
AMPLE = 2.0  # loop gain at the lowest line, from which on what lies below it has ample margins
ALWAYS = ("compliance", "noise_current")  # whatever the goal is: the two conflict in every loop
BLOCKS = 8  # of hovering, whose spread is the uncertainty of its rms


@dataclass(frozen=True)
class Measured:
    """Values (n,) of one quantity with 95 % bounds; nan bounds: the test gives none.

    A margin is nan where no crossing lies within the excited lines, and infinitely bad where one must lie below them. A
    quantity of an event is inf where the rotor touched down in it, and a time is a lower bound (that of the event's
    end) where the rotor had not come to rest.
    """

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def events_of(goal: Goal, first: Experiment) -> tuple[int, list[Event]]:
    """Control samples of hovering, and the events of a goal's large-signal test.

    Together they take at most a quarter of the time of the identification experiment, unless a time limit is longer
    than a seventeenth of it.

    Raises:
        ValueError: A time limit is longer than half the experiment, or the rotor cannot lift off from where it is said.
    """
    if first.sensor != "probe" and "lift_off" in goal.events:
        raise ValueError("goal: lift_off_time needs a probe: a self-sensor reads nothing before the amplifier is on")
    rate, whole = first.rig.control_rate, first.samples_per_period * (first.periods + first.transient_periods)
    events = []
    for kind, requirement in goal.events.items():
        samples = int(IMPULSE * whole)
        if kind != "impulse":
            limit = requirement.limit * rate
            if limit > whole / 2:
                raise ValueError(
                    f"goal: {requirement.name} up to {requirement.limit:g} s: the experiment itself takes "
                    f"{whole / rate:g} s; the longest limit is half of that"
                )
            samples = int(np.ceil(min(FOLLOWED * limit, max(TIMED * whole, LEAST_FOLLOWED * limit))))
        if kind == "lift_off" and not requirement.size < first.rig.clearance:
            raise ValueError(
                f"goal: lift_off_time from {requirement.size:g} m: the rotor's clearance is {first.rig.clearance:g} m"
            )
        events.append(Event(kind, requirement.size, samples))
    return int(HOVER * whole), events


@dataclass(frozen=True, eq=False)
class Followed:
    """The large-signal test of one axis of n loops.

    Attributes:
        hovering: Displacement and current, (n, 2, samples).
        events: Each event with its limit and its displacement and current, (n, 2, samples).
        dt: Control sample, s.
        clearance: (n,), m.
    """

    hovering: np.ndarray
    events: Sequence[tuple[Event, float, np.ndarray]]
    dt: float
    clearance: np.ndarray

    @property
    def rest(self) -> np.ndarray:
        """Where the rotor hovers, (n, 1)."""
        return self.hovering[:, 0].mean(axis=-1, keepdims=True)


def followed_events(goal: Goal, experiments: Sequence[Experiment], blocks: Sequence[Block]) -> list[Followed]:
    """Hovering and a goal's events, simulated, of each axis; blocks: the lanes by `simulate.own_lanes`."""
    hover, events = events_of(goal, experiments[0])
    hovering, *series = simulated_events(blocks, hover, events, threads=1)
    steady = hovering[..., int(WARMING * hover) :]
    dt = 1 / experiments[0].rig.control_rate
    clearance = np.array([e.rig.clearance for e in experiments])
    limits = [requirement.limit for requirement in goal.events.values()]
    return [
        Followed(
            steady[:, :, axis],
            list(zip(events, limits, [one[:, :, axis] for one in series], strict=True)),
            dt,
            clearance,
        )
        for axis in range(steady.shape[2])
    ]


def large_signal_test(
    goal: Goal, experiments: Sequence[Experiment], blocks: Sequence[Block]
) -> list[dict[str, Measured]]:
    """Quantities of a goal's events, by name, of each axis; blocks: the lanes by `simulate.own_lanes`."""
    return [_of_axis(one) for one in followed_events(goal, experiments, blocks)]


def _of_axis(followed: Followed) -> dict[str, Measured]:
    """Quantities of one axis."""
    current = followed.hovering[:, 1]
    usable = current.shape[1] // BLOCKS * BLOCKS
    power = (current - current.mean(axis=1, keepdims=True))[:, :usable] ** 2
    rms = np.sqrt(power.mean(axis=1))
    blocks = power.reshape(len(power), BLOCKS, -1).mean(axis=2)
    se = blocks.std(axis=1, ddof=1) / np.sqrt(BLOCKS) / (2 * np.where(rms > 0, rms, 1.0))
    found = {"noise_current": _with_error(rms, se)}
    peaks = [np.abs(current).max(axis=1)]
    for event, limit, series in followed.events:
        peaks.append(np.abs(series[:, 1]).max(axis=1))
        if event.kind == "impulse":
            found[EVENT_NAMES[event.kind]] = _exactly(np.abs(series[:, 0] - followed.rest).max(axis=1))
            continue
        found[EVENT_NAMES[event.kind]] = _exactly(time_to_rest(followed, limit, series))
    found["current_peak"] = _exactly(np.max(peaks, axis=0))
    return found


def time_to_rest(followed: Followed, limit: float, series: np.ndarray, wider: float = 1.0) -> np.ndarray:
    """Time (n,) after which the rotor has come to rest in an event (n, 2, samples) with a limit, s.

    Args:
        followed: The test.
        limit: Of the time, s.
        series: Displacement and current of the event.
        wider: Factor on the band in which it is at rest.
    """
    width = max(1, round(MEAN_OVER * limit / followed.dt))
    calm = followed.hovering[:, 0] - followed.rest
    noise = scipy.ndimage.uniform_filter1d(calm, width, axis=-1).std(axis=-1)
    near = np.maximum(NOISE_BAND * noise, NEAR * followed.clearance)
    y = scipy.ndimage.uniform_filter1d(series[:, 0] - followed.rest, width, axis=-1, mode="nearest")
    return settling_time(y, near, followed.dt, wider)


def settling_time(y: np.ndarray, least: np.ndarray, dt: float, wider: float = 1.0) -> np.ndarray:
    """Time (n,) from which displacements (n, samples) stay near where they end, s.

    Near is within SETTLED of the largest displacement, and at least `least` (n,), both `wider`; where they end is the
    mean of the last LAST of the samples. The whole time where they are still outside in there, nan where they are not
    known.
    """
    end = y[:, -max(1, int(LAST * y.shape[1])) :].mean(axis=1)
    band = wider * np.maximum(SETTLED * np.abs(y).max(axis=1), least)
    outside = np.abs(y - end[:, None]) > band[:, None]
    last = np.where(outside.any(axis=1), y.shape[1] - outside[:, ::-1].argmax(axis=1), 0)
    settled = np.where(last > (1 - LAST) * y.shape[1], y.shape[1], last) * dt
    return np.where(np.isnan(end), np.nan, settled)


def measured(
    goal: Goal,
    force: LineStatistics,
    injection: tuple[np.ndarray, np.ndarray, np.ndarray],
    margins: Mapping[str, np.ndarray],
    known: Mapping[str, Measured],
    runs_away: bool,
) -> dict[str, Measured]:
    """What a goal measures of n loops, and ALWAYS, by name.

    Margins that lie below the lines (`margins_below_lines`) are not known, and count as missed.

    Args:
        goal: The goal.
        force: Statistics of the force lines.
        injection: Frequencies (f,), smooth sensitivities (n, f) and their variances at the injection lines.
        margins: By `stability_margins.margin_arrays`.
        known: Quantities that are measured already, by name; of unlike events too.
        runs_away: Whether the plant does so at rest.
    """
    errors = margin_errors(*injection, margins)
    found = dict(known)
    for name in ("peak_sensitivity", "phase_margin", "disk_margin"):
        found[name] = _with_error(margins[name], errors[name])
    found["gain_margin"] = _gain_margin(injection, margins, errors)
    below = runs_away & margins_below_lines(*injection[:2], margins)
    for name in LOOP:
        worst = np.inf if QUANTITIES[name].most else -np.inf
        own = found[name]
        found[name] = Measured(
            np.where(below, worst, own.value), *(np.where(below, np.nan, v) for v in (own.low, own.high))
        )
    asked = {r.name: r for r in goal.measured}
    found["compliance"] = _compliance(force, asked.get("compliance"))
    return {name: found[name] for name in dict.fromkeys([*asked, *ALWAYS])}


def margins_below_lines(
    frequency: np.ndarray, sensitivity: np.ndarray, margins: Mapping[str, np.ndarray], share: float = 1.0
) -> np.ndarray:
    """Whether loops of a plant that runs away at rest have margins below their lines, (n,).

    Such a plant is held by a loop gain beyond 1 at rest, and its gain may fall by some factor only. Where the lowest
    line shows less gain, or less than AMPLE while no such factor follows from the lines, margins lie below the lines.

    Args:
        frequency: Of the injection lines, (f,), Hz.
        sensitivity: (n, f).
        margins: By `stability_margins.margin_arrays`.
        share: Of the gain at the lowest line that counts.
    """
    fall = gain_factors(frequency, sensitivity, margins)[1]
    lowest = share * np.abs(1 / sensitivity[:, 0] - 1)
    return (lowest < 1) | (np.isnan(fall) & (lowest < AMPLE))


def held(reading: Measured, name: str, hidden: np.ndarray) -> Measured:
    """A reading of the lines whose bounds hold what the loop has between them.

    Args:
        reading: The reading.
        name: One of LOOP.
        hidden: (n,), nan where the lines show as much.
    """
    if QUANTITIES[name].most:
        return replace(reading, high=np.where(np.isnan(hidden), reading.high, np.fmax(reading.high, hidden)))
    return replace(reading, low=np.where(np.isnan(hidden), reading.low, np.fmin(reading.low, hidden)))


def _gain_margin(
    injection: tuple[np.ndarray, np.ndarray, np.ndarray],
    margins: Mapping[str, np.ndarray],
    errors: Mapping[str, np.ndarray],
) -> Measured:
    """The factor by which the loop's gain may rise or fall, whichever is smaller.

    The error of L at its crossing of the real axis is normal. That of the factor is not where it is large: its upper
    end is unknown where L may be zero there. That at rest is cautious, and its upper end unknown.
    """
    up, down = gain_factors(*injection[:2], margins)
    crossing, error = 1 / up, NORMAL_95 * errors["gain_margin_high"] / up**2
    nearest = np.maximum(crossing - error, 0.0)
    high = np.divide(1.0, nearest, out=np.full_like(nearest, np.nan), where=nearest > 0)
    rise = np.stack([up, 1 / (crossing + error), high])
    still, of_still = at_rest(*injection)
    half = NORMAL_95 * np.where(down == still, of_still, errors["gain_margin_low"] * down**2)
    fall = np.stack([down, down - half, np.where(down == still, np.nan, down + half)])
    return Measured(*np.where((down < up) | np.isnan(up), fall, rise))


def _compliance(force: LineStatistics, requirement: Requirement | None) -> Measured:
    """Largest displacement per force of the loop at the force lines, those in the requirement's band if it has one."""
    frequency = force.frequency
    low, high = requirement.band if requirement else (0.0, np.inf)
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any():
        raise ValueError(
            f"goal: compliance in {low:g}..{high:g} Hz: the protocol's force excites {frequency[0]:g} to "
            f"{frequency[-1]:g} Hz"
        )
    response, variance = frequency_response(force, "displacement", "force")
    response, variance = smooth_closed_loop(frequency, response, pooled_variance(variance), receptance=True)
    size = np.abs(response[:, inside])
    at = np.arange(len(size)), size.argmax(axis=1)
    few = widening(2 * POOL * (force.periods - 1))
    return _with_error(size[at], few * np.sqrt(variance[:, inside][at] / 2))


def _with_error(value: np.ndarray, se: np.ndarray) -> Measured:
    return Measured(value, value - NORMAL_95 * se, value + NORMAL_95 * se)


def _exactly(value: np.ndarray) -> Measured:
    """A quantity of an event, whose noise nobody estimates; inf where the rotor touched down."""
    unknown = np.full(len(value), np.nan)
    return Measured(np.where(np.isnan(value), np.inf, value), unknown, unknown)
