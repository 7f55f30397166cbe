"""The apparent gain of an actuator in bands: force per ampere, complex, where mass, stiffness and damping are known."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from estimation.actuator import ActuatorEstimate
from estimation.lines.periods import LineStatistics
from estimation.normal import NORMAL_95

GROWTH = 2 ** (1 / 3)  # from a band's lower to its upper edge, where it then holds enough lines
LINES = 3  # least lines of a band of a record with a period
TOLD = 0.5  # relative standard error from which a band tells nothing
SURELY = 2.0  # standard errors from which a positive damping counts as damping


@dataclass(frozen=True)
class BandGain:
    """The apparent gain in a band.

    Attributes:
        f_lo, f_hi: Hz.
        frequency: Hz, where the band's power lies.
        gain: Complex, N/A; a negative angle is late.
        size_se: Standard error of its size, N/A.
        phase_se: Standard error of its angle, rad.
        of_each: Recording -> its own gain, where there are several; those that tell one.
    """

    f_lo: float
    f_hi: float
    frequency: float
    gain: complex
    size_se: float
    phase_se: float
    of_each: Mapping[str, complex] = field(default_factory=dict)

    @property
    def size(self) -> tuple[float, float, float]:
        """Size and its 95 % interval, N/A."""
        half = NORMAL_95 * self.size_se
        return abs(self.gain), max(abs(self.gain) - half, 0.0), abs(self.gain) + half

    @property
    def phase(self) -> tuple[float, float, float]:
        """Angle and its 95 % interval, degrees."""
        angle, half = np.degrees(np.angle(self.gain)), np.degrees(NORMAL_95 * self.phase_se)
        return float(angle), float(angle - half), float(angle + half)


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

    @property
    def extremes(self) -> tuple[BandGain, BandGain] | None:
        """The bands of largest and smallest gain, where their intervals are apart; None: one gain may do."""
        largest, smallest = (pick(self.bands, key=lambda b: abs(b.gain)) for pick in (max, min))
        return (largest, smallest) if largest.size[1] > smallest.size[2] else None

    @property
    def latest(self) -> BandGain | None:
        """The band that is latest, of those that are surely late; None where none is."""
        late = [b for b in self.bands if b.phase[2] < 0]
        return min(late, key=lambda b: b.phase[0], default=None)


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
            variance = of_y[on] + abs(factor) ** 2 * of_x[on] - 2 * (np.conj(factor) * shared[on]).real
            usual = np.median(variance)
            weight = usual / np.maximum(variance, usual) if usual > 0 else np.ones(moved.size)
            power = np.sum(weight * abs(moved) ** 2)
            share = weight * np.conj(moved) / power  # of each line in the factor
            factor = complex(np.sum(share * y[on]))
        centre = float(np.sum(weight * abs(moved) ** 2 * f[on]) / power)
        # What is left is also of a gain that changes in the band.
        left = abs(y[on] - factor * moved) ** 2 * moved.size / max(moved.size - 1, 1)
        noise = float(max(np.sum(abs(share) ** 2 * v) for v in (variance, left)) / 2) / abs(factor) ** 2
        known = np.array([actuator.stiffness_se, 2j * np.pi * centre * damping_se])
        common = loose * known / np.mean(dynamic[on])
        size, phase = (np.sqrt(noise + np.sum(part**2)) for part in (common.real, common.imag))
        if size < TOLD:
            gain = actuator.gain * factor
            found.append(BandGain(low, high, centre, gain, float(size) * abs(gain), float(phase)))
    if not found:
        return None
    return ApparentGain(tuple(found), actuator.stiffness, loose * actuator.stiffness_se, "identified", damping)
