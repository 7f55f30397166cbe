"""What drives a coil and what reads its current: switching supply and sampled acquisition."""

from dataclasses import dataclass
from math import hypot, sqrt

from selfsense.coil import is_number


@dataclass(frozen=True)
class Supply:
    """A switching amplifier: voltage (V), PWM frequency (Hz), states, and dead time (s) between its switches.

    The drive is the mean voltage asked for, over `voltage`, in -1 .. 1. With two states the output is +voltage for the
    first (1 + drive) / 2 of a period and -voltage for the rest (D Fig. 6.3); with three it is voltage times the sign of
    the drive for |drive| of a period, then 0. Edges lie where they fall, not at samples. During a dead time the coil's
    current holds the voltage against itself. ValueError when a value is out of range.
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
    """How current and switching voltage are read: rate (Hz), bits over +-current_range (A; 0: ideal), noise (A rms).

    The switching voltage of a sample is its mean since the sample before, as a timer or an integrator reads it.
    ValueError when a value is out of range.
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
        """Noise of one reading (A rms): the current's own, and the converter's count over sqrt(12).

        A count is noise where the noise spans half a count, or where ripple and slow current wander over tens of
        counts: 8 bits on a ripple of a twelfth of their range. With 6 bits, or at rest without noise, the same counts
        come back every PWM period: an error that is no white noise, which no average takes away, or that spares the
        estimator's band. A ratio to the Cramer-Rao bound far above 1, or below, then says so.
        """
        return hypot(self.noise, self.resolution / sqrt(12))

    @property
    def resolution(self) -> float:
        """One count of the converter, A; 0 when it is ideal."""
        return 2 * self.current_range / 2**self.bits if self.bits else 0.0


def check_rates(supply: Supply, acquisition: Acquisition) -> None:
    """ValueError unless the current is sampled at least twice in a PWM period: below that its ripple folds back."""
    if acquisition.rate < 2 * supply.frequency * (1 - 1e-12):
        raise ValueError(
            f"acquisition: rate = {acquisition.rate:g} Hz is below twice the PWM frequency ({supply.frequency:g} Hz): "
            f"the ripple that carries the gap would fold back; sample at {2 * supply.frequency:g} Hz or faster"
        )
