"""The action: a point of the box [-1, 1]^k is a gain set within the rig's bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from maglev_env.loop.gains import Controllers, Gains, of_axis, with_gains
from maglev_env.rig.rig import Rig

TUNED = ("kp", "ki", "kd")
WIDE_RANGE = 5.0  # a range whose ends have at least this ratio is mapped logarithmically
TIME_CONSTANTS = (0.3, 3.0)  # bounds of td and ti relative to the preset, if the rig gives none


@dataclass(frozen=True, eq=False)
class GainBox:
    """Mapping between actions and gains.

    Args:
        names: of the k gains that are tuned.
        low: (k,), lower bounds in the gains' units.
        high: (k,), upper bounds.
        log: (k,), whether a gain is mapped logarithmically.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    log: np.ndarray

    def gains(self, actions: np.ndarray) -> np.ndarray:
        """Gains (..., k) of actions (..., k) in [-1, 1]."""
        unit = (np.asarray(actions, dtype=float) + 1) / 2
        straight = self.low + (self.high - self.low) * unit
        low, high = np.where(self.log, self.low, 1.0), np.where(self.log, self.high, 1.0)
        return np.where(self.log, low * (high / low) ** unit, straight)

    def actions(self, gains: np.ndarray) -> np.ndarray:
        """Actions (..., k) of gains (..., k), clipped into the box."""
        g = np.clip(np.asarray(gains, dtype=float), self.low, self.high)
        low, high = np.where(self.log, self.low, 1.0), np.where(self.log, self.high, 2.0)
        curved = np.log(np.where(self.log, g, 1.0) / low) / np.log(high / low)
        return 2 * np.where(self.log, curved, (g - self.low) / (self.high - self.low)) - 1

    def point(self, gains: Gains) -> np.ndarray:
        """The action (k,) of a controller's gains, clipped into the box."""
        return self.actions([getattr(gains, name) for name in self.names])

    def applied(self, preset: Controllers, values: np.ndarray) -> Controllers:
        """The preset controllers with the box's gains set to values (k,) in their units."""
        return with_gains(preset, **dict(zip(self.names, map(float, values), strict=True)))


def gain_box(rig: Rig, tuned: Sequence[str] = TUNED, bounds: Mapping[str, Sequence[float]] | None = None) -> GainBox:
    """The box of some gains of a rig.

    Args:
        rig: with PID gains.
        tuned: names of the gains.
        bounds: (low, high) by name. For other gains the rig's bounds are used; without those, for td and ti, a range
            around the preset.

    Raises:
        ValueError: A gain does not exist, is named twice or has no bounds, or its range is empty; the message names the
            argument.
    """
    known = [f.name for f in fields(Gains)]
    tuned, bounds = tuple(tuned), dict(bounds or {})
    for name in (*tuned, *bounds):
        if name not in known:
            raise ValueError(f"tuned, bounds: no gain {name!r}; gains are {', '.join(known)}")
    if not tuned or len(set(tuned)) < len(tuned):
        raise ValueError(f"tuned = {tuned!r}: name at least one gain, each once")
    preset = of_axis(rig.gains, 0)
    if not isinstance(preset, Gains):
        raise ValueError(f"rig {rig.name}: there are no PID gains to tune")
    pairs = []
    for name in tuned:
        pair = bounds.get(name) or rig.bounds.get(name)
        if pair is None and name in ("td", "ti"):
            pair = [getattr(preset, name) * factor for factor in TIME_CONSTANTS]
        if pair is None:
            raise ValueError(f"bounds: rig {rig.name} gives none for {name}; pass bounds={{{name!r}: (low, high)}}")
        low, high = map(float, pair)
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError(f"bounds: {name} = {low:g} .. {high:g} is an empty range; the first must be the smaller")
        if low < 0 or (low == 0 and name in ("td", "ti")):
            raise ValueError(f"bounds: {name} starts at {low:g}; it cannot be negative, nor a time constant zero")
        pairs.append((low, high))
    low, high = np.array(pairs).T
    return GainBox(tuned, low, high, (low > 0) & (high >= WIDE_RANGE * np.where(low > 0, low, np.inf)))
