"""The switching supply that drives a coil, and the sampled acquisition that reads its current."""

from dataclasses import dataclass
from math import hypot, sqrt

from selfsense.coil import is_number


@dataclass(frozen=True)
class Supply:
    """A switching amplifier.

    The drive is the requested mean voltage over `voltage`, -1 .. 1. With two states the output is +voltage for the
    first (1 + drive) / 2 of a period and -voltage for the rest (D Fig. 6.3). With three states it is voltage times the
    sign of the drive for |drive| of a period, then 0. Edges lie between samples where they fall. During a dead time the
    coil's current holds the voltage against itself.

    Attributes:
        voltage: V.
        frequency: PWM frequency, Hz.
        states: 2 or 3.
        dead_time: Between its switches, s.

    Raises:
        ValueError: A value is out of range.
    """

    voltage: float = 24.0
    frequency: float = 25e3
    states: int = 2
    dead_time: float = 0.0

    def __post_init__(self) -> None:
        for name in ("voltage", "frequency"):
            value = getattr(self, name)
            if not (is_number(value) and value > 0):
                raise ValueError(f"supply: {name} = {value!r} must be a positive number: without it no current ripples")
        if self.states not in (2, 3):
            raise ValueError(f"supply: states = {self.states!r}; use 2 or 3")
        if not (is_number(self.dead_time) and 0 <= self.dead_time < 0.25 / self.frequency):
            raise ValueError(
                f"supply: dead_time = {self.dead_time!r} must be in 0 .. a quarter of the PWM period, "
                f"{0.25 / self.frequency:g} s"
            )


@dataclass(frozen=True)
class Acquisition:
    """How current and switching voltage are read.

    The switching voltage of a sample is its mean since the sample before, as a timer or an integrator reads it.

    Attributes:
        rate: Hz.
        bits: Resolution over +-current_range; 0 for an ideal converter.
        current_range: A.
        noise: A rms.

    Raises:
        ValueError: A value is out of range.
    """

    rate: float = 250e3
    bits: int = 0
    current_range: float = 5.0
    noise: float = 0.0

    def __post_init__(self) -> None:
        if not (is_number(self.rate) and self.rate > 0):
            raise ValueError(f"acquisition: rate = {self.rate!r} Hz must be a positive number")
        if (
            isinstance(self.bits, bool)
            or not isinstance(self.bits, int)
            or not (self.bits == 0 or 4 <= self.bits <= 24)
        ):
            raise ValueError(f"acquisition: bits = {self.bits!r}; use 4 to 24, or 0 for an ideal converter")
        if not (is_number(self.current_range) and self.current_range > 0):
            raise ValueError(f"acquisition: current_range = {self.current_range!r} A must be a positive number")
        if not (is_number(self.noise) and self.noise >= 0):
            raise ValueError(f"acquisition: noise = {self.noise!r} A must be at least 0")

    @property
    def reading_noise(self) -> float:
        """Noise of one reading (A rms): the current's own noise, and one count of the converter over sqrt(12).

        Rounding acts as noise where the noise spans half a count, or where ripple and slow current move over tens of
        counts: 8 bits on a ripple of a twelfth of their range. With 6 bits, or at rest without noise, the same counts
        return every PWM period. This error is not white: no averaging removes it, or it lies outside the estimator's
        band. A ratio to the Cramer-Rao bound far above 1, or below 1, shows this.
        """
        return hypot(self.noise, self.resolution / sqrt(12))

    @property
    def resolution(self) -> float:
        """One count of the converter, A; 0 when it is ideal."""
        return 2 * self.current_range / 2**self.bits if self.bits else 0.0


def check_rates(supply: Supply, acquisition: Acquisition) -> None:
    """Check that the current is sampled at least twice in a PWM period; otherwise its ripple is aliased.

    Raises:
        ValueError: It is not.
    """
    if acquisition.rate < 2 * supply.frequency * (1 - 1e-12):
        raise ValueError(
            f"acquisition: rate = {acquisition.rate:g} Hz is below twice the PWM frequency ({supply.frequency:g} Hz): "
            f"the ripple that carries the gap would fold back; sample at {2 * supply.frequency:g} Hz or faster"
        )
