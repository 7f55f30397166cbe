"""What may be wrong with the channels of a recording, as its campaign states it: scales and delays within tolerance."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maglev_env.recordings.campaign import RecordingSpec

BY_MOTION = "current that motion induces"  # of the sizes of channels: what a displacement read as one adds


@dataclass(frozen=True)
class ChannelError:
    """One standard deviation of an error: true value = (1 + scale) * reading, `delay` seconds earlier, other shape.

    Args:
        name: for reports; an error of the same name is the same in all recordings.
        channel: "displacement", "current", "force", ...
        axis: 0 or 1.
        scale: relative.
        delay: s.
        shape: a term (j omega)^order of what undoes a low-pass, s^order; of order 2, for one that is symmetric in
            time, half its second moment.
        order: of that term.
        coil: resistance (ohm) and inductance (H) of a coil whose voltage tells this current, by Kirchhoff's law with
            what the motion induces; None: it is measured.
        induced: of that coil, V s/m: the error is this more of induced voltage, by the displacement.
        inductance: of that coil, relative: the error is this more of inductance.
        read: the recorded channel of which a campaign may state it, where another one is computed from that; empty: the
            channel itself.
    """

    name: str
    channel: str
    axis: int = 0
    scale: float = 0.0
    delay: float = 0.0
    shape: float = 0.0
    order: int = 2
    coil: tuple[float, float] | None = None
    induced: float = 0.0
    inductance: float = 0.0
    read: str = ""

    @property
    def by(self) -> str:
        """Of what it is a relative change: the channel itself, or the displacement that induces a voltage in it."""
        return BY_MOTION if self.induced else self.channel

    def factor(self, frequency: np.ndarray) -> np.ndarray:
        """Change of the channel's spectrum at frequencies in Hz, in units of that of `by`."""
        s = 2j * np.pi * frequency
        if self.coil is not None:
            resistance, inductance = self.coil
            return -s * (self.induced + self.inductance * inductance) / (resistance + s * inductance)
        return self.scale + s * self.delay + s**self.order * self.shape

    def whole_factor(self, frequency: np.ndarray, amount: float) -> np.ndarray:
        """Change of the spectrum, in units of that of `by`, by an amount of the error, in standard deviations, however
        large: late readings turn the phase alone, and an inductance stays positive."""
        s = 2j * np.pi * frequency
        if self.coil is not None and self.inductance:
            resistance, inductance = self.coil
            larger = np.expm1(amount * self.inductance) * inductance
            return -s * larger / (resistance + s * (inductance + larger))
        if self.induced:
            return amount * self.factor(frequency)
        rest = amount * (self.scale + s**self.order * self.shape)
        return np.exp(amount * self.delay * s) - 1 + rest

    def applied(self, spectra: np.ndarray, frequency: np.ndarray) -> np.ndarray:
        """Change of spectra (..., axes, *frequency.shape) of the channel: that of the other axis is none."""
        found = np.zeros(spectra.shape, complex)
        at = (..., self.axis, *(slice(None) for _ in frequency.shape))
        found[at] = self.factor(frequency) * spectra[at]
        return found


def scale_of(channel: str) -> str:
    """The name of an error of a channel's scale."""
    return f"scale of {channel}"


def time_of(channel: str) -> str:
    """The name of an error of the time at which a channel is read."""
    return f"delay of {channel}"


def channel_errors(spec: RecordingSpec) -> tuple[ChannelError, ...]:
    """The errors that a campaign states of a recording's channels."""
    found = []
    for name, source in spec.channels.items():
        kind, _, letter = name.partition("_")
        axis = 1 if letter == "y" else 0
        if source.scale_tolerance:
            found.append(ChannelError(scale_of(name), kind, axis, scale=source.scale_tolerance))
        if source.delay_tolerance:
            found.append(ChannelError(time_of(name), kind, axis, delay=source.delay_tolerance))
    return tuple(found)


def changes(
    errors: tuple[ChannelError, ...],
    frequency: np.ndarray,
    outputs: tuple[str, ...],
    sizes: Mapping[str, Mapping[str, np.ndarray]],
) -> dict[str, np.ndarray]:
    """Change of the opened residuals, measured less predicted, by each error.

    Args:
        errors: of a recording.
        frequency: of the lines, Hz, any shape.
        outputs: "plant", and "amplifier" where the current is an output.
        sizes: channel -> output -> what the channel adds to the residual of that output, free of noise,
            (axes, *frequency.shape); what is predicted from it counts negative.

    Returns:
        Name -> (outputs, axes, *frequency.shape).
    """
    found = {}
    for error in errors:
        own = sizes.get(error.by, {})
        rows = [error.applied(own[o], frequency) if o in own else None for o in outputs]
        if any(r is not None for r in rows):
            shape = next(r.shape for r in rows if r is not None)
            found[error.name] = np.stack([np.zeros(shape, complex) if r is None else r for r in rows])
    return found
