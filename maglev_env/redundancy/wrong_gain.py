"""A gain of the stated controller that is not the one with which a recording was made."""

from dataclasses import dataclass

import numpy as np

from maglev_env.loop.gains import controller_response, gain_values, with_gains
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.relation import Relation, of_gain, squares
from maglev_env.redundancy.rows import LEVEL, MODEL
from maglev_env.redundancy.view import View

NOISE = 3.0  # times what chance leaves of noise alone, a line
# Change of another gain that is looked at, and share of what it does by which twice as much may do another amount.
CHANGED, LINEAR = 0.01, 1e-6
SOUGHT = 6  # steps towards the constant of a filter
INTEGRALS, PER_SAMPLE = ("ki", "integral", "outer_ki"), 0.05  # gains by name; of the control rate


@dataclass(frozen=True)
class WrongGain:
    """A gain that explains what a high-pass does: its name, stated and found value, and its error.

    `clearly`: better than any high-pass. `whole`: it leaves noise alone.
    """

    gain: str
    stated: float
    value: float
    se: float
    clearly: bool
    whole: bool


def wrong_gain(view: View, relation: Relation) -> WrongGain | None:
    """The integral gain of the stated controller under which the relation of the command agrees; None: none does.

    What is integrated lacks in the command as what a high-pass takes from the displacement does. Where another gain of
    the controller explains more, it is that one.
    """
    lines, dt = view.lines, 1 / view.rig.control_rate
    gains = gain_values(view.gains)
    integral = next((name for name in INTEGRALS if name in gains), None)
    if integral is None:
        return None
    w, z = 2 * np.pi * lines.frequency, np.exp(2j * np.pi * lines.frequency * dt)
    own = controller_response(view.gains, z, dt)
    weight = 1 / np.maximum(relation.variance + (MODEL * np.abs(relation.out)) ** 2, 1e-300)
    free = [v for term in relation.made.values() for v in (term, -1j * w * term)]
    _, coupled_left, _ = squares(relation.out, [*free, -1j / w * relation.made["displacement"]], weight)
    found = {}
    for name, stated in gains.items():
        step = float(np.abs(own[0]) * w[0]) if name == integral else CHANGED * stated
        approached = _approached(view, relation, weight, free, name, step)
        if approached is not None:
            found[name] = approached
    if integral not in found:
        return None
    best = min(found, key=lambda name: found[name][2] + (0.0 if name == integral else LEVEL**2))
    size, se, left, alone = found[best]
    if left > coupled_left + LEVEL**2 or abs(size) < LEVEL * se:
        return None
    whole = left < NOISE * weight.size
    if best != integral and not alone < NOISE * weight.size:
        return None  # beside another scale: several gains are wrong, or something else
    return WrongGain(best, gains[best], gains[best] + size, se, left < coupled_left - LEVEL**2, whole)


def _approached(
    view: View, relation: Relation, weight: np.ndarray, free: list[np.ndarray], name: str, step: float
) -> tuple[float, float, float, float] | None:
    """Change of a gain with which the relation of the command agrees, its error, and the costs that are left: with
    gains and delays of what it is made of free, and without; None of one that does nothing.

    The constant of a filter does not act in proportion to its value, so it is approached in steps.
    """
    lines, stated = view.lines, gain_values(view.gains)[name]
    z, dt = np.exp(2j * np.pi * lines.frequency / view.rig.control_rate), 1 / view.rig.control_rate
    y, at = lines.parts["displacement"].mean(axis=0), 2 * list(relation.made).index("displacement")
    own, misfit = controller_response(view.gains, z, dt), relation.out - sum(relation.made.values())
    found, size = None, 0.0
    for _ in range(SOUGHT):
        try:
            now, once, twice = (
                controller_response(with_gains(view.gains, **{name: stated + size + n * step}), z, dt) - own
                for n in range(3)
            )
        except ValueError:
            return found  # it cannot be larger
        slope, bent = once - now, twice - 2 * once + now
        if not slope.any():
            return found
        known, more = -now * y, -slope / step * y
        by, left, error = squares(relation.out - known, [*free, more], weight)
        change, se = of_gain(by[-1], error, by[at])
        _, alone, _ = squares(misfit - known, [more], weight)
        if np.abs(bent).max() <= LINEAR * np.abs(slope).max():
            return size + change, se, left, alone
        size = min(max(stated + size + change, (stated + size) / 2), 2 * (stated + size)) - stated
        found = size, se, left, alone
    return found


def finding_of(view: View, found: WrongGain) -> Finding:
    text = (
        f"gains: the command is what the stated controller makes of the displacement with {found.gain} = "
        f"{found.value:.4g} +- {2 * found.se:.1g} in place of {found.stated:g}{unit_of_time(view, found)}; correct "
        f"{found.gain}{of_time(view, found)}"
    )
    return Finding("filter", view.recording, "gains", found.value,
                   (found.value - 2 * found.se, found.value + 2 * found.se), text, "wiring")  # fmt: skip


def of_time(view: View, found: WrongGain) -> str:
    """The integral gain behind one that multiplies a low-pass of unit gain: of both, lines far above tell no more."""
    ti = gain_values(view.gains).get("ti") if view.gains is not None else None
    return f" (ki / ti, the integral gain, is {found.value / ti:.4g} A/(m s))" if ti and found.gain == "ki" else ""


def unit_of_time(view: View, found: WrongGain) -> str:
    """What is said of an integral gain that counts in samples."""
    times = found.value / found.stated if found.stated else 0.0
    if not abs(times / view.rig.control_rate - 1) < PER_SAMPLE:
        return ""
    return ", which is that one times the control rate: it is stated for one sample, and counts for one second"
