"""The apparent gain of an actuator in bands: force per ampere, complex, where mass, stiffness and damping are known."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from estimation.actuator import ActuatorEstimate
from estimation.lines.periods import LineStatistics
from estimation.normal import freedom_of_sum, reach, variance_of_difference

GROWTH = 2 ** (1 / 3)  # from a band's lower to its upper edge, where it then holds enough lines
LINES = 3  # least lines of a band of a record with a period
TOLD = 0.5  # relative standard error from which a band tells nothing
SURE = 0.95  # of an interval, and of those of all bands together
SURELY = 2.0  # standard errors from which a positive damping counts as damping


@dataclass(frozen=True)
class BandGain:
    """The apparent gain in a band.

    Attributes:
        f_lo, f_hi: Hz.
        frequency: Hz, where the band's power lies.
        gain: Complex, N/A.
        size_se: Standard error of its size, N/A.
        phase_se: Standard error of its phase, rad.
        of_each: Recording -> its own gain, where there are several; those that tell one.
        sign: Of the one gain of all frequencies, beside which the phase is counted; -1 where a current in the opposite
            direction makes the force.
        own_se: What of the standard error of its size no other band shares, N/A; 0 where that is not told.
        freedom: Degrees of freedom of that error; infinite where it is known.
    """

    f_lo: float
    f_hi: float
    frequency: float
    gain: complex
    size_se: float
    phase_se: float
    of_each: Mapping[str, complex] = field(default_factory=dict)
    sign: float = 1.0
    own_se: float = 0.0
    freedom: float = np.inf

    @property
    def size(self) -> tuple[float, float, float]:
        """Size and its 95 % interval, N/A."""
        return self.size_within(SURE)

    @property
    def phase(self) -> tuple[float, float, float]:
        """Phase and its 95 % interval, degrees; negative is late."""
        return self.phase_within(SURE)

    def size_within(self, level: float) -> tuple[float, float, float]:
        """Size and an interval that holds it with a probability, N/A."""
        half = self._reach(self.size_se, self.own_se, level)
        return abs(self.gain), max(abs(self.gain) - half, 0.0), abs(self.gain) + half

    def phase_within(self, level: float) -> tuple[float, float, float]:
        """Phase and an interval that holds it with a probability, degrees."""
        own = self.own_se / abs(self.gain) if self.own_se else 0.0
        angle, half = self.phase_of(self.gain), np.degrees(self._reach(self.phase_se, own, level))
        return angle, float(angle - half), float(angle + half)

    def _reach(self, se: float, own: float, level: float) -> float:
        """Half an interval: what the lines of one band show of their noise, few of them tell with few freedoms."""
        return float(se * reach(freedom_of_sum(self.freedom, np.square(own), np.square(se)), level))

    def phase_of(self, gain: complex) -> float:
        """Phase of a gain of this band, degrees; negative is late."""
        return float(np.degrees(np.angle(gain * self.sign)))


@dataclass(frozen=True)
class ApparentGain:
    """The gain over frequency.

    Attributes:
        bands: Those that tell a gain.
        stiffness: The stiffness without control that it stands on, N/m.
        stiffness_se: Its standard error.
        source: Where that is from.
        damping: The damping without control that it stands on, N s/m.
    """

    bands: tuple[BandGain, ...]
    stiffness: float
    stiffness_se: float
    source: str
    damping: float

    def with_errors(self, size: float, time: float, stiffness: float) -> "ApparentGain":
        """The same with further, independent standard errors, each of which all bands have in common.

        Args:
            size: Of the gain, relative.
            time: Of when the force acts, s.
            stiffness: Of the stiffness that it stands on, N/m; what it does to the gain is in `size`.
        """
        bands = tuple(
            replace(
                b,
                size_se=float(np.hypot(b.size_se, size * abs(b.gain))),
                phase_se=float(np.hypot(b.phase_se, 2 * np.pi * b.frequency * time)),
            )
            for b in self.bands
        )
        return replace(self, bands=bands, stiffness_se=float(np.hypot(self.stiffness_se, stiffness)))

    @property
    def scatter(self) -> float:
        """Standard deviation of the bands' gains, relative, beyond what noise makes; 0 where one gain may do.

        By the moments of R. DerSimonian and N. Laird, Controlled Clinical Trials 7, 1986.
        """
        gain, se = np.array([[abs(b.gain), b.own_se] for b in self.bands]).T
        if gain.size < 2 or not se.all():
            return 0.0
        weight = se**-2
        mean = weight @ gain / weight.sum()
        beyond = weight @ (gain - mean) ** 2 - (gain.size - 1)
        return float(np.sqrt(max(beyond, 0.0) / (weight.sum() - weight @ weight / weight.sum())) / mean)

    @property
    def together(self) -> float:
        """Probability with which each band must lie in its interval for all of them to do so with 95 % (Bonferroni).

        One band picked out of many is the one that chance moved most, so that 95 % of each are not enough for it.
        """
        return 1 - (1 - SURE) / len(self.bands)

    @property
    def extremes(self) -> tuple[BandGain, BandGain] | None:
        """The bands of largest and smallest gain, where the gains of all bands surely differ; None: one gain may do."""
        largest, smallest = (pick(self.bands, key=lambda b: abs(b.gain)) for pick in (max, min))
        apart = largest.size_within(self.together)[1] > smallest.size_within(self.together)[2]
        return (largest, smallest) if apart else None

    @property
    def latest(self) -> BandGain | None:
        """The band that is latest, of those that are surely late; None where none surely is."""
        late = [b for b in self.bands if b.phase_within(self.together)[2] < 0]
        return min(late, key=lambda b: b.phase[0], default=None)


def tells(noise: float, factor: complex, common: np.ndarray) -> bool:
    """Whether a band tells a gain.

    Args:
        noise: Variance of the real part of the factor, by noise.
        factor: The band's gain over the one gain of all frequencies.
        common: Relative errors of its size that are not noise of the band.
    """
    # In bands of much noise those that chance made large would be picked if their own size were the measure.
    return bool(np.sqrt(noise / min(abs(factor), 1.0) ** 2 + np.sum(common**2)) < TOLD)


def edges(lowest: float, highest: float, narrowest: float) -> list[tuple[float, float]]:
    """Adjoining bands (Hz) from the lowest to the highest frequency, third octaves where these are wide enough."""
    bands, low = [], lowest
    while low <= highest:
        bands.append((low, max(low + narrowest, low * GROWTH)))
        low = bands[-1][1]
    return bands


def _of_lines(f: np.ndarray) -> list[tuple[float, float]]:
    """Adjoining bands of lines (n,), Hz, third octaves where these hold LINES of them."""
    ends = [float(f[0])]
    for line in f:
        if line >= ends[-1] * GROWTH and ((f >= ends[-1]) & (f < line)).sum() >= LINES:
            ends.append(float(line))
    top = float(np.nextafter(f[-1], np.inf))
    if len(ends) > 1 and (f >= ends[-1]).sum() < LINES:
        ends.pop()
    return list(pairwise([*ends, top]))


def periodic_gain(force: LineStatistics, mass: float, actuator: ActuatorEstimate) -> ApparentGain | None:
    """The gain over frequency of a record with a period: (k - m w^2 + j w c) Y over the current.

    Args:
        force: Channels "displacement" and "force", which is the current times the actuator's gain, at lines that an
            injection excites.
        mass: kg.
        actuator: Fitted to the same lines.
    """
    f, y, x = force.frequency, force.amplitude("displacement"), force.amplitude("force")
    w = 2 * np.pi * f
    # A force that comes late acts as a negative damping, and is to be seen in the phase.
    sure = actuator.damping > SURELY * actuator.damping_se
    damping, damping_se = (actuator.damping, actuator.damping_se) if sure else (0.0, 0.0)
    dynamic = actuator.stiffness - mass * w**2 + 1j * w * damping
    of_y, of_x = np.real(force.cross("displacement", "displacement")), np.real(force.cross("force", "force"))
    of_x, shared = of_x / abs(dynamic) ** 2, force.cross("displacement", "force") / np.conj(dynamic)
    found = []
    loose = float(np.sqrt(max(actuator.cost_ratio, 1.0)))  # where one gain does not fit, nor are its errors right
    for low, high in _of_lines(f):
        on = (f >= low) & (f < high)
        moved = x[on] / dynamic[on]
        if not np.any(moved):
            continue
        factor = 1.0 + 0j
        # A line beside a tone that nothing excites, such as that of a turning rotor, has far more noise than the others
        # and power of its own. The others count alike, since few periods tell the noise of each line badly.
        for _ in range(2):
            variance = variance_of_difference(of_y[on], of_x[on], shared[on], factor)
            usual = np.median(variance)
            weight = usual / np.maximum(variance, usual) if usual > 0 else np.ones(moved.size)
            power = np.sum(weight * abs(moved) ** 2)
            share = weight * np.conj(moved) / power  # of each line in the factor
            factor = complex(np.sum(share * y[on]))
        centre = float(np.sum(weight * abs(moved) ** 2 * f[on]) / power)
        # What is left is also of a gain that changes in the band.
        left = abs(y[on] - factor * moved) ** 2 * moved.size / max(moved.size - 1, 1)
        noise, freedom = max(_of_noise(abs(share) ** 2 * v, p) for v, p in ((variance, force.periods), (left, 2)))
        known = np.stack([np.full(moved.size, actuator.stiffness_se), 1j * w[on] * damping_se])
        common = loose * np.sum(known * share * moved / dynamic[on], axis=1)
        if tells(noise, factor, common.real):
            relative = noise / abs(factor) ** 2
            size, phase = (np.sqrt(relative + np.sum(part**2)) for part in (common.real, common.imag))
            gain, sign = actuator.gain * factor, float(np.sign(actuator.gain))
            own = float(np.sqrt(noise)) * abs(actuator.gain)
            errors = {"size_se": float(size) * abs(gain), "phase_se": float(phase), "own_se": own, "freedom": freedom}
            found.append(BandGain(low, high, centre, gain, sign=sign, **errors))
    if not found:
        return None
    return ApparentGain(tuple(found), actuator.stiffness, actuator.stiffness_se, "identified", damping)


def _of_noise(parts: np.ndarray, periods: int) -> tuple[float, float]:
    """Noise of the real part of a factor, by that of its lines (n,), and its freedoms."""
    # The square of a sample variance is P / (P - 1) times the true square (Satterthwaite).
    several = 2 * periods * parts.sum() ** 2 / np.sum(parts**2) if parts.any() else np.inf
    return float(parts.sum() / 2), float(min(several, 2 * (periods - 1) * parts.size))
