"""The opened loop: spectra are turned into the contribution of each block, whose noise is measured over its periods.

Let A (command to current) and P (command to reading) be the nominal responses. A digital controller computes the
command U = C (reference - reading) + injection exactly from its reading; where it reads the current too, that has its
part in U. The combinations

    amplifier   I - A U          plant   D - P U

then contain, for white noise in the probe and in the current measurement, that noise alone, each its own, although the
feedback correlates the channels and colours their noise. They are linear in the recorded spectra, so measured and
simulated spectra go through the same transform.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from itertools import product

import numpy as np
from scipy import stats

from estimation.lines.noise_shape import noise_shape
from estimation.lines.periods import straightened
from maglev_env.rig.rig import axis_rig
from sim2real.recorded.nominal import nominal_blocks, outputs_of
from sim2real.recorded.records import Record
from sim2real.recorded.tones import near_tones

# Lines on either side over which noise is pooled: WINDOW, or NARROW where the noise is steeper than STEEP.
WINDOW, NARROW, STEEP = 7, 1, 1.8
BESIDE = 2.5  # lines beside a tone of known origin that are not judged
LOUD, FALSE_ALARM = 2.0, 1e-8  # a band is loud above this mean power over the noise shape, and below this probability
LOUDEST = 6.0  # largest noise standard deviation, as a multiple of the one that the rig states
OUTLIER = 12.0  # a line whose variance exceeds its surroundings by this factor keeps its own variance


@dataclass(frozen=True)
class Opened:
    """The nominal responses of a record's blocks, (axes, n) each.

    Where the controller reads the current but the record does not have it, the current's loop stays closed, by the
    nominal amplifier: controller, from_reference and from_injection then contain it, and from_current is 0.

    Attributes:
        controller: From the negative reading to the command, A/m.
        amplifier: A/A.
        plant: From command to reading, m/A.
        receptance: Of the opened loop, m/N.
        from_reference: From the reference to the command, A/m.
        from_current: From the negative current to the command, A/A.
        from_injection: From the injection to the command, A/A.
        outputs: Outputs that the record's channels give.
    """

    controller: np.ndarray
    amplifier: np.ndarray
    plant: np.ndarray
    receptance: np.ndarray
    from_reference: np.ndarray
    from_current: np.ndarray
    from_injection: np.ndarray
    outputs: tuple[str, ...]

    def residuals(self, displacement: np.ndarray, current: np.ndarray | None) -> np.ndarray:
        """Residuals (..., outputs, axes, n) of spectra (..., axes, n), without what injection and force contribute."""
        command = -self.controller * displacement
        if current is not None:
            command = command - self.from_current * current
        found = {"plant": displacement - self.plant * command}
        if current is not None:
            found["amplifier"] = current - self.amplifier * command
        return np.stack([found[name] for name in self.outputs], axis=-3)

    def at(self, lines: np.ndarray) -> "Opened":
        """The responses at some of the lines."""
        return Opened(*(getattr(self, f.name)[..., lines] for f in fields(self)[:-1]), self.outputs)

    def displacement(self, residuals: np.ndarray) -> np.ndarray:
        """The displacement (axes, n) of which residuals (outputs, axes, n) are those: `residuals` backwards."""
        plant = residuals[self.outputs.index("plant")]
        command = self.controller * plant
        if "amplifier" in self.outputs:
            command = command + self.from_current * residuals[self.outputs.index("amplifier")]
        return plant - self.plant * command / self.closed

    @property
    def closed(self) -> np.ndarray:
        """1 + loop gain (axes, n): by how much smaller a disturbance is in closed loop."""
        return 1 + self.controller * self.plant + self.from_current * self.amplifier

    @property
    def of_injection(self) -> np.ndarray:
        """C (axes, n), A/m, with which the sensitivity is 1 - C displacement / injection."""
        return self.controller / self.from_injection

    def driven(self, record: Record) -> np.ndarray:
        """What force, injection and reference add to `residuals` on the linear nominal rig, (outputs, axes, n)."""
        force, injection, reference = map(record.driving, ("force", "current", "reference"))
        command = self.from_injection * injection + self.from_reference * reference
        found = {
            "plant": self.plant * command + self.receptance * force,
            "amplifier": self.amplifier * command,
        }
        return np.stack([found[name] for name in self.outputs])

    def parts(self, record: Record) -> dict[str, dict[str, np.ndarray]]:
        """What each channel adds to the residuals, see `channel_errors.changes`, by the linear nominal rig, (axes, n).

        A reading of the displacement enters the command too: the opened change is (1 + P C) times that of the reading,
        which is what drives the opened loop.
        """
        force, injection, reference = map(record.driving, ("force", "current", "reference"))
        driven = dict(zip(self.outputs, self.driven(record), strict=True))
        found = {"displacement": {"plant": driven["plant"]}, "force": {"plant": -self.receptance * force}}
        if "amplifier" in driven:
            displacement = driven["plant"] / self.closed
            found["displacement"]["amplifier"] = self.amplifier * self.controller * displacement
            found["current"] = {"amplifier": driven["amplifier"] - self.amplifier * self.controller * displacement}
        own = (("injection", self.from_injection * injection), ("reference", self.from_reference * reference))
        for channel, command in own:
            found[channel] = {"plant": -self.plant * command, "amplifier": -self.amplifier * command}
        return found


def opened_loop(record: Record) -> Opened:
    """Nominal responses at a record's lines, under the record's gains."""
    outputs = outputs_of("current" in record.periods, record.experiment)
    return Opened(*nominal_blocks(record.experiment, record.frequency, "amplifier" in outputs), outputs)


def noise_of(record: Record, opened: Opened) -> np.ndarray:
    """Standard deviation (outputs, axes, n) of the mean complex residuals, E|n|^2 = sd^2.

    It comes from the spread over periods, pooled over neighbouring lines after dividing by its shape. The shape is the
    sum of white noise, current noise through the plant and force noise through the receptance, in proportions fitted to
    the record. A line with extra noise, as from a tone, keeps its own variance. Added are the resolution of the
    converters where no noise dithers it, and the uncertainty of a measured exciting force.
    """
    resolution = _resolution(record, opened)
    variance = _smooth(record, opened)
    for j, name in enumerate(opened.outputs):
        dithered = variance[j] > resolution[name]
        variance[j] = variance[j] / record.count + np.where(dithered, 0.0, resolution[name])
    if "force" in record.periods:
        known = record.periods["force"].var(axis=0, ddof=1) / record.count
        smooth = np.array([_pooled(v, np.ones((1, v.size)), record.count - 1)[0] for v in known])
        on = record.driven["force"]
        variance[opened.outputs.index("plant")] += np.where(on, smooth * abs(opened.receptance) ** 2, 0.0)
    return np.sqrt(variance)


def by_rounding(values: np.ndarray, step: float, samples: int) -> float:
    """Variance of a line's amplitude that a converter makes of a motion, in squares of the step's unit.

    What a rounded reading lacks is a saw tooth over the motion, whose period is a step. In a period of the recording it
    has about two lines for each step that is passed: slow motion over few steps is rounded worse than white noise says.

    Args:
        values: Readings (n,) of whole periods.
        step: Of the converter; 0: none.
        samples: Of a period.
    """
    if not step:
        return 0.0
    passed = np.abs(np.diff(values)).sum() / step * samples / values.size
    return float(step**2 / 12 * 4 / np.clip(4 * passed, 1, samples))


def noise_about_trends(record: Record, opened: Opened, first: int = 0) -> np.ndarray:
    """Variance (outputs, axes, n) of one period's residuals about a straight line over the periods from `first`, pooled
    as in `noise_of`."""
    return _smooth(record, opened, first, drifting=True)


def _smooth(record: Record, opened: Opened, first: int = 0, drifting: bool = False) -> np.ndarray:
    """Variance (outputs, axes, n) of one period's residuals, as of `_spread`, pooled over lines by its shape."""
    own, shapes = _spread(record, opened, first, drifting)
    freedom = record.count - first - 1 - drifting
    found = np.empty_like(own)
    for (j, name), axis in product(enumerate(opened.outputs), range(record.axes)):
        found[j, axis], _ = _pooled(own[j, axis], np.array([s[axis] for s in shapes[name]]), freedom)
    return found


def _spread(
    record: Record, opened: Opened, first: int = 0, drifting: bool = False
) -> tuple[np.ndarray, dict[str, tuple[np.ndarray, ...]]]:
    """Variance (outputs, axes, n) of one period's residuals over the periods from `first`, and its possible shapes; of
    a drifting record about a straight line over time."""
    periods = opened.residuals(record.periods["displacement"], record.periods.get("current"))[first:]
    own = periods.var(axis=0, ddof=1)
    if drifting:
        own = straightened(periods)[1].var(axis=0, ddof=2)
    return own, {
        "plant": (np.ones_like(own[0]), abs(opened.plant) ** 2, abs(opened.receptance) ** 2),
        "amplifier": (np.ones_like(own[0]), abs(opened.amplifier) ** 2),
    }


def stated_noise(record: Record, opened: Opened) -> np.ndarray:
    """Variance (outputs, axes, n) of one period's residuals from the noise and the converters that the rig states."""
    noise, resolution = record.nominal.noise, _resolution(record, opened)
    white = {"plant": noise.displacement**2, "amplifier": noise.current**2}
    n = record.experiment.recorded_per_period
    return np.stack([resolution[name] + white[name] * 4 / n for name in opened.outputs])


def loud_bands(record: Record, opened: Opened, drifting: bool = False) -> list[tuple[float, float, float]]:
    """Third octaves in which something unsynchronised is present, and not merely a drift if there is one.

    There the reading or the current varies from period to period much more than noise of any of the shapes does. The
    shape of the current's noise is limited to about the size that the rig states.

    Returns:
        (f_lo, f_hi, chi-square beyond its expectation) of each band, Hz.
    """
    first = 1 if record.dropped == 0 and record.count > 3 else 0
    own, shapes = _spread(record, opened, first, drifting)
    told, stated = record.count - first - 1 - drifting, stated_noise(record, opened)  # told: complex freedom of a line
    noise = record.nominal.noise
    thirds, found = np.floor(3 * np.log2(record.frequency)).astype(int), []
    e = record.experiment
    apart = ~near_tones(record.frequency, BESIDE * e.fundamental, e.speed_rpm)  # a tone leaks into neighbouring lines
    for tone in record.tones:
        apart &= abs(record.frequency - tone.frequency) > BESIDE * e.fundamental
    for (j, name), axis in product(enumerate(opened.outputs), range(record.axes)):
        _, shape = _pooled(own[j, axis], np.array([s[axis] for s in shapes[name]]), told)
        if name == "amplifier" and noise.current:  # external forces shake the rotor, but nothing drives the current
            shape = np.minimum(shape, LOUDEST**2 * stated[j, axis])
        ratio = own[j, axis] / shape
        for third in np.unique(thirds[apart]):
            r = ratio[(thirds == third) & apart]
            chi2, freedom = 2 * told * r.sum(), 2 * told * r.size
            if r.mean() > LOUD and stats.chi2.sf(chi2, freedom) < FALSE_ALARM:
                found.append((float(2.0 ** (third / 3)), float(2.0 ** ((third + 1) / 3)), float(chi2 - freedom)))
    return found


def _pooled(own: np.ndarray, shapes: np.ndarray, freedom: int) -> tuple[np.ndarray, np.ndarray]:
    """Variances (n,) of `freedom` complex degrees of freedom, smoothed over neighbours after dividing by their shape.

    Returns:
        smooth: Smoothed variances (n,).
        shape: The common shape (n,).
    """
    tiny = np.finfo(float).tiny
    shape = noise_shape(own, shapes)
    ratio = own / shape
    kept = ratio < OUTLIER * np.median(ratio) / np.log(2) ** (1 / max(freedom, 1)) + tiny
    smooth, local = (_neighbours(ratio, kept, width) for width in (WINDOW, NARROW))
    smooth = np.where(local > STEEP * smooth, local, smooth)  # where noise rises faster than the wide window follows
    return np.where(kept, smooth, ratio) * shape, shape


def _neighbours(ratio: np.ndarray, kept: np.ndarray, width: int) -> np.ndarray:
    """Mean of the kept values within `width` lines on either side, also of fewer lines than that."""
    kernel = np.ones(2 * width + 1)
    total, count = (
        np.convolve(v, kernel)[width : width + ratio.size] for v in (np.where(kept, ratio, 0.0), kept.astype(float))
    )
    return np.where(count > 0, total / np.maximum(count, 1), ratio)


def _resolution(record: Record, opened: Opened) -> Mapping[str, np.ndarray]:
    """Variance (axes, n) of a line from the converters' resolution, as noise that periods do not average.

    What a command lacks of its step is white.
    """
    rig, n = record.experiment.rig, record.experiment.recorded_per_period
    found = {"plant": np.zeros(opened.plant.shape), "amplifier": np.zeros(opened.plant.shape)}
    for axis in range(record.axes):
        own = axis_rig(record.nominal, axis)
        adc, dac = own.reading_step, own.command_step if rig.controlled else 0.0
        read = by_rounding(record.series["displacement"][axis], adc, n)
        commanded = dac**2 / 12 * 4 / n
        found["plant"][axis] = read + abs(opened.plant[axis]) ** 2 * commanded
        found["amplifier"][axis] = abs(opened.amplifier[axis]) ** 2 * commanded
    return found
