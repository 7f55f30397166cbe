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
    w, z, y = 2 * np.pi * lines.frequency, np.exp(2j * np.pi * lines.frequency * dt), lines.parts["displacement"]
    own = controller_response(view.gains, z, dt)
    weight = 1 / np.maximum(relation.variance + (MODEL * np.abs(relation.out)) ** 2, 1e-300)
    free = [v for term in relation.made.values() for v in (term, -1j * w * term)]
    _, coupled_left, _ = squares(relation.out, [*free, -1j / w * relation.made["displacement"]], weight)
    misfit = relation.out - sum(relation.made.values())
    found: dict[str, tuple[float, float, float, float]] = {}
    for name, stated in gains.items():
        step = float(np.abs(own[0]) * w[0]) if name == integral else CHANGED * stated
        try:
            once, twice = (
                controller_response(with_gains(view.gains, **{name: stated + n * step}), z, dt) - own for n in (1, 2)
            )
        except ValueError:
            continue  # it cannot be larger
        if not once.any() or np.abs(twice - 2 * once).max() > LINEAR * np.abs(once).max():
            continue  # it does nothing, or not in proportion, as the constant of a filter
        more = -(once * y.mean(axis=0)) / step
        by, left, se = squares(relation.out, [*free, more], weight)
        _, alone, _ = squares(misfit, [more], weight)
        found[name] = (*of_gain(by[-1], se, by[2 * list(relation.made).index("displacement")]), left, alone)
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
