"""A channel of time stamps against the stated rate: jitter that is taken out, samples that are missing or double."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

STEP_TOLERANCE = 0.01  # of a step: a clock as regular as this is taken as it stands
# Two clocks differ by up to so much, and more is another rate. From where it is said: the rows are then still one for
# each tick of the controller.
CLOCKS_DIFFER, SAID_FROM = 3e-4, 1e-4
MOST_MISSING = 100  # samples for each one that is there
JITTERED_RATE_TOLERANCE = 0.02  # a jittered record is resampled, so its own mean rate need not be the stated one
# A step that is longer or shorter by more than this share is no jitter: a sample is missing, or there twice. Half a
# step is where rounding to the nearest sample changes.
MOST_JITTER = 0.5
_DIGITS = 9  # of stamps that are printed, at most
_COARSE = 1.2  # steps from which the unit in which stamps rise is coarser than the clock: a fifth of them repeat
_LEAST_TICKS = 20  # of a coarse clock, that tell its mean
_BITS = (16, 32)  # of counters, which begin anew when they are full
_RISING = 0.98  # share of the steps of a counter that do not fall; of the others, lines of the file may be garbled
_ROUNDED = 1.05  # units of the last digit between stamps and an even clock; 1, but for what the line through them errs


@dataclass(frozen=True)
class Clock:
    """What the time stamps of a recording say.

    Attributes:
        instants: When the samples were taken, (samples,), in steps of the stated rate from the first one on; None: the
            clock is regular and the samples stand as they are.
        kept: Samples that are used, (samples,) bool: not those whose stamp repeats.
        gaps: First sample of every gap, and how many are missing in it.
        repeated: Samples whose stamp repeats the one before.
        backward: First sample after which time runs backward, None if none.
        notes: In words.
    """

    instants: np.ndarray | None
    kept: np.ndarray
    gaps: tuple[tuple[int, int], ...]
    repeated: tuple[int, ...]
    backward: int | None
    notes: tuple[str, ...]

    @property
    def rows(self) -> np.ndarray | None:
        """The sample that is nearest to each step of the stated rate, (steps,); None where they are the same."""
        if self.instants is None:
            return None
        at = np.flatnonzero(self.kept)
        grid = np.arange(int(np.floor(self.instants[at[-1]] + 1e-9)) + 1)
        return np.rint(np.interp(grid, self.instants[at], at)).astype(int)

    def resampled(self, values: np.ndarray) -> np.ndarray:
        """Values (samples,) at the steps of the stated rate, by local cubics that do not overshoot (Akima)."""
        if self.instants is None:
            return values
        return at_steps(self.instants[self.kept], values[self.kept])

    def marked(self, masked: np.ndarray) -> np.ndarray:
        """A mask (samples,) of readings at the steps of the stated rate, with the steps in gaps and beside repeats."""
        if self.instants is None:
            return masked
        instants = self.instants[self.kept]
        grid = np.arange(int(np.floor(instants[-1] + 1e-9)) + 1)
        found = np.interp(grid, instants, masked[self.kept].astype(float)) > 0
        for first, _ in self.gaps:
            found |= (grid > self.instants[first] + 1e-9) & (grid < self.instants[first + 1] - 1e-9)
        found[np.clip(np.rint(self.instants[list(self.repeated)]).astype(int), 0, grid.size - 1)] = True
        return found


def at_steps(instants: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (samples,) at instants (samples,) in steps, at 0, 1, 2, ... steps up to the last instant."""
    grid = np.arange(int(np.floor(instants[-1] + 1e-9)) + 1)
    return np.asarray(
        scipy.interpolate.Akima1DInterpolator(instants, values, method="makima")(
            np.clip(grid, instants[0], instants[-1])
        )
    )


def check_clock(time: np.ndarray, rate: float) -> Clock:
    """Compare time stamps (samples,) in s with the stated rate in Hz.

    Raises:
        ValueError: They belong to another rate, or are far apart.
    """
    everything = np.ones(time.size, bool)
    regular = Clock(None, everything, (), (), None, ())
    if time.size < 3:
        return regular
    step = 1 / rate
    steps = np.diff(time)
    mean, median = (time[-1] - time[0]) / steps.size, float(np.median(steps))
    rounded = rounded_step(time)
    if rounded or np.abs(steps - step).max() <= (1 + 1e-6) * STEP_TOLERANCE * step:
        mean, unsure = rounded or (mean, 0.0)
        apart = 1 / (mean * rate) - 1
        if abs(apart) > CLOCKS_DIFFER + unsure * rate:
            raise ValueError(
                f"mean rate {1 / mean:.8g} Hz, not sample_rate = {rate:g} Hz; state the one that the controller keeps"
            )
        if abs(apart) > SAID_FROM + unsure * rate:
            note = f"by its stamps the rate is {1e6 * apart:+.0f} ppm off: rows are taken as ticks of {rate:g} Hz"
            return replace(regular, notes=(note,))
        return regular
    late, repeated = steps > (1 + MOST_JITTER) * median, steps == 0
    early = (steps < (1 - MOST_JITTER) * median) & ~repeated
    backward = np.flatnonzero(steps < 0)
    usual = ~(late | early | repeated)
    own = float(steps[usual].mean()) if usual.any() else median
    if not own > 0:
        raise ValueError(
            "it does not run on: more than half of the stamps repeat the one before; is it another column?"
        )
    if abs(own * rate - 1) > JITTERED_RATE_TOLERANCE:
        raise ValueError(f"its usual step is {own:.6g} s ({1 / own:.6g} Hz), not that of sample_rate = {rate:g} Hz")
    reach = float(np.ptp(time / MOST_MISSING)) * rate  # divided first: a stamp may be near the largest number
    if not reach <= time.size + MOST_MISSING:
        raise ValueError(
            f"its {time.size} time stamps reach from {time.min():g} to {time.max():g} s: of {MOST_MISSING} samples at "
            f"sample_rate = {rate:g} Hz more than 99 would be missing"
        )
    reached = np.maximum.accumulate(time)
    kept = np.concatenate([[True], time[1:] > reached[:-1]])
    gaps = tuple((int(i), max(1, round(steps[i] / own) - 1)) for i in np.flatnonzero(late))
    off = steps[usual] - own
    notes = []
    if np.abs(off).max(initial=0.0) > STEP_TOLERANCE * step:
        notes.append(
            f"time stamps jitter by {np.sqrt(np.mean(off**2)):.3g} s rms, {np.abs(off).max():.3g} s at worst "
            f"({np.abs(off).max() / step:.0%} of a step): resampled at {rate:g} Hz"
        )
    if early.any():
        notes.append(f"{early.sum()} steps are shorter than half of the usual one")
    instants = (reached - time[0]) * rate
    return Clock(
        instants,
        kept,
        gaps,
        tuple(int(i) + 1 for i in np.flatnonzero(repeated)),
        int(backward[0]) if backward.size else None,
        tuple(notes),
    )


def rounded_step(time: np.ndarray) -> tuple[float, float] | None:
    """The step of a regular clock whose stamps (samples,) are printed with few digits, or are coarser than its step.

    Returns:
        The step, and by how much rounding may have changed it, in the unit of the stamps; None where they are not so.
    """
    for digits in range(_DIGITS):
        with np.errstate(over="ignore", invalid="ignore"):  # stamps near the largest number
            scaled = (time - time[0]) * 10.0**digits
            whole = np.abs(scaled - np.rint(scaled)).max() < 1e-4
        if whole:
            count, quantum = np.arange(time.size), 10.0**-digits
            step, begin = np.polyfit(count, time - time[0], 1)
            even = quantum < step and float(np.ptp(time - time[0] - begin - step * count)) <= _ROUNDED * quantum
            return (float(step), quantum / time.size) if even else coarse_step(time)
    return coarse_step(time)


def coarse_step(time: np.ndarray) -> tuple[float, float] | None:
    """The mean step of a regular clock whose stamps (samples,) repeat until the next one of their coarse unit.

    Milliseconds of a recording at 10 kHz are such, and seconds that float32 stores an hour after the start.

    Returns:
        The step, and by how much rounding may have changed it, in the unit of the stamps; None where they are not so.
    """
    steps = np.diff(time)
    risen = steps[steps > 0]
    if risen.size < _LEAST_TICKS or risen.size > steps.size / _COARSE or (steps < 0).any():
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # stamps near the largest number
        quantum, count = float(np.median(risen)), np.arange(time.size)
        step = float(np.polyfit(count, time - time[0], 1)[0])
        off = time - time[0] - step * count
        even = quantum >= _COARSE * step > 0 and float(np.ptp(off)) <= _ROUNDED * quantum
    return (step, quantum / time.size) if even else None


def unwrapped(values: np.ndarray) -> np.ndarray:
    """A counter of 16 or 32 bits (samples,) that goes on rising where it began anew; other values as they are.

    Values that are no numbers, and single ones that are garbled, stay among those beside them.
    """
    at = np.flatnonzero(np.isfinite(values))
    read = values[at]
    if read.size < 3 or not (np.diff(read) < 0).any() or (read % 1).any():
        return values
    for bits in _BITS:
        turn = 2.0**bits
        least = 0.0 if read.min() >= 0 else -turn / 2
        if read.min() < least or read.max() >= least + turn:
            continue
        steps = np.diff(read)
        turns = np.cumsum((steps < -turn / 2).astype(float) - (steps > turn / 2))
        on = read + turn * np.concatenate([[0.0], turns])
        if turns.any() and (np.diff(on) >= 0).mean() > _RISING:
            found = values.copy()
            found[at] = on
            return found
    return values
