"""The action: a point of the box [-1, 1]^k is a gain set within the rig's bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.gain_card import stated_gains
from maglev_env.loop.gains import NO_CONTROLLER, Controller, Controllers, digital, gain_values, of_axis, with_gains
from maglev_env.rig.rig import Rig

TUNED = ("kp", "ki", "kd")  # of plain PID gains
WIDE_RANGE = 5.0  # a range whose ends have at least this ratio is mapped logarithmically
TOP = 0.45  # of the control rate: highest default frequency of a filter


@dataclass(frozen=True, eq=False)
class GainBox:
    """Mapping between actions and gains.

    Args:
        names: of the k gains that are tuned.
        low: (k,), lower bounds in the gains' units.
        high: (k,), upper bounds.
        log: (k,), whether a gain is mapped logarithmically.
        units: of the k gains, SI.
    """

    names: tuple[str, ...]
    low: np.ndarray
    high: np.ndarray
    log: np.ndarray
    units: tuple[str, ...]

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

    def point(self, controller: Controller) -> np.ndarray:
        """The action (k,) of a controller's gains, clipped into the box."""
        gains = gain_values(controller)
        return self.actions([gains[name] for name in self.names])

    def applied(self, preset: Controllers, values: np.ndarray) -> Controllers:
        """The preset controllers with the box's gains set to values (k,) in their units."""
        return with_gains(preset, **dict(zip(self.names, map(float, values), strict=True)))


def parse_tuned(texts: Sequence[str]) -> tuple[tuple[str, ...] | None, dict[str, tuple[float, float]]]:
    """Names of gains to tune and bounds of some, each written as `name` or `name=lo:hi`; None without any.

    Raises:
        ValueError: A text has another form.
    """
    bounds: dict[str, tuple[float, float]] = {}
    names = []
    for text in texts:
        name, sign, ends = text.partition("=")
        names.append(name)
        if sign:
            try:
                low, high = map(float, ends.split(":"))
            except ValueError:
                raise ValueError(f"{text!r} is not name or name=lo:hi, such as notch_frequency=500:800") from None
            bounds[name] = low, high
    return tuple(names) or None, bounds


def gain_box(
    rig: Rig, tuned: Sequence[str] | None = None, bounds: Mapping[str, Sequence[float]] | None = None
) -> GainBox:
    """The box of some gains of a rig.

    Args:
        rig: with gains.
        tuned: names of the gains; None: all that are there, except time constants.
        bounds: (low, high) by name. For other gains the rig's bounds are used; without those the range of the gain's
            card around the preset.

    Raises:
        ValueError: A gain does not exist, is named twice or has no bounds, its range is no pair of numbers or empty, or
            it has bounds and is not tuned; the message names the argument.
    """
    preset, bounds = of_axis(rig.gains or NO_CONTROLLER, 0), dict(bounds or {})
    table = {name: (value, card) for name, value, card in stated_gains(preset)}
    if not table:
        raise ValueError(
            f"rig {rig.name}: its controller is given by numerator and denominator, which have no gains to tune; state "
            "the form that is fitted to them (--controller 'pid + notch 650'), or give [gains]"
        )
    for name in (*(() if tuned is None else tuned), *bounds):
        if name not in table:
            raise ValueError(f"tuned, bounds: no gain {name!r}; gains are {', '.join(table)}")
    if tuned is None:
        tuned = [n for n, (value, card) in table.items() if card.first and (value or n in rig.bounds or n in bounds)]
    tuned = tuple(tuned)
    if not tuned or len(set(tuned)) < len(tuned):
        raise ValueError(f"tuned = {tuned!r}: name at least one gain, each once")
    if others := [name for name in bounds if name not in tuned]:
        raise ValueError(f"bounds: {others[0]} is not tuned (tuned: {', '.join(tuned)}); tune it too, or leave it out")
    pairs = []
    for name in tuned:
        value, card = table[name]
        pair = bounds.get(name, rig.bounds.get(name))
        if pair is None and name not in bounds:
            low, high = card.range(value)
            pair = low, min(high, TOP * rig.control_rate) if card.unit == "Hz" else high
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise ValueError(f"bounds: {name} = {pair!r}; give two numbers, (low, high)") from None
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError(
                f"bounds: {name} = {low:g} .. {high:g} is an empty range; the first must be the smaller"
                + (f" (rig {rig.name} gives none; pass bounds={{{name!r}: (low, high)}})" if low == high == 0 else "")
            )
        if low < 0 or (low == 0 and card.unit == "s"):
            raise ValueError(f"bounds: {name} starts at {low:g}; it cannot be negative, nor a time constant zero")
        pairs.append((low, high))
    low, high = np.array(pairs).T
    log = (low > 0) & (high >= WIDE_RANGE * np.where(low > 0, low, np.inf))
    box = GainBox(tuned, low, high, log, tuple(table[name][1].unit for name in tuned))
    for end in (low, high):
        try:
            digital(of_axis(box.applied(preset, end), 0), 1 / rig.control_rate)
        except ValueError as error:
            raise ValueError(f"bounds: {error}") from None
    return box
