"""Forward paths: filters that turn a switching current into the amplitude of its ripple (D 6.2.2, 6.4.1, App. D)."""

from dataclasses import dataclass
from functools import lru_cache
from math import pi, sqrt

import numpy as np
import scipy

from selfsense.coil import is_number

BUTTERWORTH = 1 / sqrt(2)  # quality of two poles; D writes its damping as 1.414


@dataclass(frozen=True)
class DigitalPath:
    """The digital path: high-pass, rectifier, low-pass; Butterworth of second order, corners in Hz (D eq 6.21-6.23)."""

    high_pass: float = 15e3
    low_pass: float = 5e3

    rms = False

    def __post_init__(self) -> None:
        _check_corners("digital path", vars(self))

    def sections(self, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Second-order sections (1, 5) before the rectifier and (1, 5) behind it, by Tustin's rule at rate (Hz)."""
        _check_below_half(self.high_pass, rate)
        w = 2 * pi * self.high_pass
        before = tustin((1.0, 0.0, 0.0), (1.0, w / BUTTERWORTH, w**2), rate)
        return before[None], low_pass_section(self.low_pass, rate)[None]


@dataclass(frozen=True)
class AnalogPath:
    """The analog path: two band-pass stages, then the root of the low-passed square (true rms).

    The gain of 1.15 and quality of 0.83 per stage are those of D 6.4.1.2. The pass band is 30 kHz wide as D states, but
    reaches from 14 to 44 kHz (-3 dB) and not from 10 to 40. The low-pass stands for the averaging of the rms converter
    and its two-pole filter, whose corner D does not give. centre and low_pass are in Hz.
    """

    centre: float = 25e3
    quality: float = 0.83
    gain: float = 1.15
    low_pass: float = 5e3

    rms = True

    def __post_init__(self) -> None:
        _check_corners("analog path", vars(self))

    def sections(self, rate: float) -> tuple[np.ndarray, np.ndarray]:
        """Second-order sections (2, 5) before the square and (1, 5) behind it, by Tustin's rule at rate (Hz).

        The band-pass is prewarped so that its centre frequency is kept.
        """
        _check_below_half(self.centre, rate)
        w = 2 * rate * np.tan(pi * self.centre / rate)
        stage = tustin((0.0, self.gain * w / self.quality, 0.0), (1.0, w / self.quality, w**2), rate)
        return np.stack([stage, stage]), low_pass_section(self.low_pass, rate)[None]


ForwardPath = DigitalPath | AnalogPath


def low_pass_section(corner: float, rate: float) -> np.ndarray:
    """A Butterworth low-pass of second order (5,), corner in Hz, at a rate in Hz (D eq 6.23)."""
    _check_below_half(corner, rate)
    w = 2 * pi * corner
    return tustin((0.0, 0.0, w**2), (1.0, w / BUTTERWORTH, w**2), rate)


@lru_cache(maxsize=256)  # hundreds of sensors share a few filters
def tustin(numerator: tuple[float, ...], denominator: tuple[float, ...], rate: float) -> np.ndarray:
    """b0, b1, b2, a1, a2 of a filter of second order in s, highest power first, by Tustin's rule (D eq 6.22)."""
    b, a = map(np.asarray, scipy.signal.bilinear(numerator, denominator, rate))
    b = np.concatenate([np.zeros(3 - len(b)), b])
    section = np.array([*b, *a[1:]])
    section.flags.writeable = False
    return section


def response(sections: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Response of sections (n, 5) in series at points z of the complex plane; shape of z."""
    d = 1 / np.asarray(z)
    total = np.ones(d.shape, complex)
    for b0, b1, b2, a1, a2 in sections:
        total = total * (b0 + d * (b1 + d * b2)) / (1 + d * (a1 + d * a2))
    return total


def unit_circle(n: int) -> np.ndarray:
    """The n-th roots of unity (n,): z at the harmonics of a cycle of n samples, in the order of np.fft."""
    return np.exp(2j * pi * np.arange(n) / n)


def _check_corners(where: str, values: dict[str, float]) -> None:
    for name, value in values.items():
        if not (is_number(value) and value > 0):
            raise ValueError(f"{where}: {name} = {value!r} must be a positive number")


def _check_below_half(corner: float, rate: float) -> None:
    if corner >= rate / 2:
        raise ValueError(
            f"forward path: a corner of {corner:g} Hz is not below half of the {rate:g} Hz sampled; sample faster"
        )
