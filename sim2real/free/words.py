"""A free correction in words: "between command and current: a symmetric dead band of about 4 mA"."""

import numpy as np

from sim2real.free.drawn import Drawn
from sim2real.free.kinds import CURVE, LINEAR, PLACES
from sim2real.free.shape import Form
from sim2real.gap.leftover_words import NORMAL_95
from sim2real.words import quantity

WHERE = {
    "free_command": "between command and current",
    "free_current": "between current and force",
    "free_gain": "the actuator's gain over the displacement",
    "free_gain_velocity": "the actuator's gain over the velocity",
    "free_spring": "the mechanics, a force over the displacement",
    "free_damper": "the mechanics, a force over the velocity",
    "free_reading": "the probe's reading",
}
UNITS = {"command": "A", "current": "A", "displacement": "m", "velocity": "m/s", "force": "N", "share": ""}
UNEVEN = 0.3  # slope, as a share of a bend, from which both ends differ too much to be told together
NOTHING_PASSES = 0.4  # share of the gain outside of a band below which the band is dead


def in_words(d: Drawn) -> str:
    """Where a correction acts, its shape, sizes and their 95 % intervals."""
    return f"{WHERE[d.kind.place]}: {_shape(d)}"


def _shape(d: Drawn) -> str:
    if d.kind.shape == LINEAR:
        return _factor(d)
    if d.kind.shape == CURVE and d.form is not None:
        quantity_of, values = PLACES[d.kind.place]
        if values == "share":
            return _of_gain(d, d.form, UNITS[quantity_of])
        return (_of_signal if d.relative else _of_force)(d, d.form, UNITS[quantity_of])
    return _loop(d)


def _at(size: float, unit: str) -> str:
    return quantity(size, None, unit)


def _knee(f: Form, unit: str) -> str:
    """A knee with its interval: "4.1 mA (3.5 mA .. 4.6 mA)"."""
    lo, hi = f.knee_ends or (0.0, 0.0)
    return f"{_at(f.knee or 0.0, unit)} (95 %: {_at(max(lo, 0.0), unit)} .. {_at(hi, unit)})"


def _share(size: float, se: float) -> str:
    return f"{quantity(size, NORMAL_95 * se, '', True)} (95 %)"


def _size(size: float, se: float, unit: str) -> str:
    return f"{quantity(size, NORMAL_95 * se, unit)} (95 %)"


def _ends(d: Drawn, unit: str) -> tuple[str, str]:
    """The curve at its least and at its largest input: the form lies beside a straight line, so its size is neither."""
    low, high = (_size(float(d.value[i]), float(d.se[i]), unit) for i in (0, -1))
    return low, high


def _gains_at_ends(d: Drawn) -> tuple[str, str]:
    """The same of a curve in the unit of its input, as shares of that."""
    low, high = (_share(float(d.value[i] / d.at[i]), float(d.se[i]) / d.range) for i in (0, -1))
    return low, high


def _free(d: Drawn, unit: str) -> str:
    """A curve without a simple form: its ends."""
    low, high = _ends(d, unit)
    return f"{low} at one end and {high} at the other"


def _of_signal(d: Drawn, f: Form, unit: str) -> str:
    """Words of a curve whose values are in the unit of its input."""
    reach, knee = _at(d.range, unit), f.knee or 0.0
    share = _share(f.size / d.range, f.se / d.range)
    if f.name == "straight":
        return f"a gain that is off by {share}"
    if f.name in ("cubic", "quadratic"):
        return f"grows {'more' if f.size > 0 else 'less'} than linearly: {share} at {reach}"
    if f.name == "one-sided":
        low, high = _gains_at_ends(d)
        return f"another gain for either sign: {high} for positive, {low} for negative"
    if f.name == "bent":
        low, high = _gains_at_ends(d)
        return f"bends to one side: {high} at {reach}, {low} at -{reach}"
    if f.name == "step":
        what = "a symmetric dead band of" if f.size < 0 else "a jump at zero by"
        return f"{what} {_size(abs(f.size), f.se, unit)} either way"
    if f.name == "band":
        outside, inside = 1 + f.slope / d.range, 1 + f.slope / d.range + f.size / knee
        if inside < NOTHING_PASSES * outside:
            return f"a symmetric dead band of {_size(abs(f.size), f.se, unit)} either way"
        if f.size < 0:
            lost = _size(-f.size, f.se, unit)
            return f"beyond {_knee(f, unit)} either way {lost} less passes, as behind a dead band that noise smooths"
        change = _share(-f.size / knee, f.se / knee)
        return f"beyond {_knee(f, unit)} either way the gain is smaller, by {change}"
    if f.name.startswith("kink"):
        slope = f.size / max(d.range - knee, 1e-300) * (1 if f.name == "kink above" else -1)
        side = "above" if f.name == "kink above" else "below -"
        return f"{side} {_knee(f, unit)} the gain changes by {_share(slope, f.se * abs(slope / f.size))}"
    return f"no simple form; {_free(d, unit)}"


def _of_force(d: Drawn, f: Form, unit: str) -> str:
    """Words of a force against its input."""
    reach, knee = _at(d.range, unit), f.knee or 0.0
    per = "N/m" if unit == "m" else "N s/m"
    size = _size(f.size, f.se, "N")
    if f.name == "straight":
        return f"{_size(f.size / d.range, f.se / d.range, per)} more"
    if f.name in ("cubic", "quadratic"):
        return f"it grows {'more' if f.size > 0 else 'less'} than linearly, by {size} at {reach}"
    if f.name == "one-sided":
        low, high = _ends(d, "N")
        return f"other slopes for either sign: {high} at {reach}, {low} at -{reach}"
    if f.name == "bent":
        low, high = _ends(d, "N")
        return f"it bends to one side: {high} at {reach}, {low} at -{reach}"
    if f.name == "step":
        like = ", as of dry friction" if f.size > 0 else ", which drives where dry friction would hold back"
        return f"a step at zero of {size} either way{'' if unit == 'm' else like}"
    if f.name == "band" and f.size < 0:
        steeper = _size(-f.size / knee, f.se / knee, per)
        return f"beyond {_knee(f, unit)} either way it grows more steeply, by {steeper}"
    if f.name == "band":
        return f"{size} that is reached within {_knee(f, unit)} either way"
    if f.name.startswith("kink"):
        slope, se = (v / max(d.range - knee, 1e-300) for v in (f.size, f.se))
        side, sign = ("beyond ", 1.0) if f.name == "kink above" else ("beyond -", -1.0)
        return f"{side}{_knee(f, unit)} another slope, by {_size(sign * slope, se, per)}"
    return f"no simple form; {_free(d, 'N')}"


def _of_gain(d: Drawn, f: Form, unit: str) -> str:
    """Words of a relative change of the gain."""
    reach, share = _at(d.range, unit), _share(f.size, f.se)
    low, high = (_share(float(d.value[i]), float(d.se[i])) for i in (0, -1))
    ends = f"{low} at -{reach} and {high} at {reach}"
    if f.name == "straight":
        return f"changes evenly, by {share} up to {reach}"
    if f.name in ("cubic", "quadratic"):
        return f"changes by {share} more than evenly up to {reach}"
    if f.name in ("bent", "one-sided") and abs(f.slope) > UNEVEN * abs(f.size):
        return f"changes by {ends}"
    if f.name in ("bent", "one-sided"):
        return f"{'grows' if f.size > 0 else 'falls'} alike to both sides, by {share} at {reach}"
    if f.name == "step":
        return f"steps at zero, by {_share(2 * f.size, 2 * f.se)}"
    if f.name == "band":
        return f"changes within {_knee(f, unit)} either way, by {share} to each side"
    if f.name.startswith("kink"):
        side = "above" if f.name == "kink above" else "below -"
        return f"{side} {_knee(f, unit)} changes, by {share} at {'' if f.name == 'kink above' else '-'}{reach}"
    return f"no simple form; {ends}"


def _factor(d: Drawn) -> str:
    """Words of a linear correction, at both ends of what is excited."""
    ends = []
    for i in (0, -1):
        value, se, f = d.value[i], float(d.se[i]), _at(float(d.at[i]), "Hz")
        if d.relative:
            late = -np.degrees(np.angle(1 + value))
            ends.append(f"{_share(abs(1 + value) - 1, se)} at {f}, {abs(late):.2g}° {'late' if late >= 0 else 'early'}")
        else:
            ends.append(f"{_size(value.real, se, 'N/m')} at {f}")
    what = "a gain over frequency" if d.relative else "a stiffness over frequency"
    return f"{what}: {'; '.join(ends)}"


def _loop(d: Drawn) -> str:
    """Words of a hysteretic correction: the height of its loop at zero."""
    half = d.at.size // 4
    down, up = d.value[half], d.value[-half]
    height, se = abs(float(down - up)), float(np.hypot(d.se[half], d.se[-half]))
    over, of = (UNITS[name] for name in PLACES[d.kind.place])
    return (
        f"it remembers: over a cycle up to {_at(d.range, over)} the ways up and down differ by "
        f"{_size(height, se, of)} at zero"
    )
