"""How far an identified gain and stiffness are from those of the stated rig, and whether one factor explains both."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.axes import AXES
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig, axis_rig
from maglev_env.units import prefixed
from maglev_workbench.page import number

# Relative standard deviations where the rig's [tolerance] states none.
UNSTATED = {"actuator_gain": 0.3, "negative_stiffness": 0.3}
UNSTATED_SPRING = 0.3
APART = 2.5  # of them, beyond two standard errors, from which a coefficient is said to be another one
ALIKE, ERRORS = 0.03, 3.0  # logarithm, and standard errors: how far two factors may be from one


@dataclass(frozen=True)
class Found:
    """An identified coefficient beside the stated one, SI.

    Attributes:
        name: Of the rig's parameter.
        value: As identified.
        se: Standard error of `value`.
        stated: As the rig states it.
        spring: Stiffness of a support that is in `stated`.
    """

    name: str
    value: float
    se: float
    stated: float
    spring: float = 0.0

    @property
    def ratio(self) -> float:
        return self.value / self.stated

    @property
    def error(self) -> float:
        """Standard error of the ratio."""
        return abs(self.se / self.stated)

    @property
    def said(self) -> str:
        """The name in a sentence: with a support it is no longer the magnets' own."""
        return "stiffness" if self.spring else self.name.replace("_", " ")

    def tolerances(self, tolerance: Mapping[str, float], nearer: float = 0.0) -> float:
        """How far the value is from the stated one, in relative standard deviations of this.

        A factor and its inverse are equally far, and another sign is infinitely far. What magnets and a support add up
        to may nearly vanish, so that factors say nothing: then the difference counts, in N/m.

        Args:
            tolerance: By parameter.
            nearer: Standard errors by which the value is first taken nearer to the stated one.
        """
        off = self.value - self.stated
        off = np.sign(off) * max(abs(off) - nearer * self.se, 0.0)
        own = tolerance[self.name]
        if self.spring:
            ends = own * (self.stated - self.spring), tolerance.get("support_stiffness", UNSTATED_SPRING) * self.spring
            far, unit = abs(off), float(np.hypot(*ends))
        else:
            ratio = 1 + off / self.stated
            far, unit = max(ratio, 1 / ratio) - 1 if ratio > 0 else np.inf, own
        if not unit:
            return np.inf if far else 0.0
        return far / unit


def of_axis_named(rig: Rig, file: str, gain: tuple[float, float], stiffness: tuple[float, float]) -> list[Found]:
    """Values and standard errors of a recording beside those of its axis, which the name of a file ends with."""
    own = axis_rig(rig, AXES.index(file[-1]) if rig.axes == 2 and file[-3:-1] == ", " and file[-1] in AXES else 0)
    if not own.controlled:
        return []
    stated = linearise(force_law(own))
    return [
        Found("actuator_gain", *gain, stated[0]),
        Found("negative_stiffness", *stiffness, stated[1] + own.support_stiffness, own.support_stiffness),
    ]


def from_stated(rig: Rig | None, found: Sequence[Found]) -> str:
    """A clause on what is far from the stated rig; "" where nothing is.

    Gain and stiffness are both told by the mass that is stated: one factor on both is what a wrong mass makes.
    """
    tolerances = UNSTATED | dict(rig.tolerance) if rig is not None else {}
    known = {one.name: one for one in found if rig is not None and one.stated and np.isfinite(one.se)}
    far = [one for one in known.values() if one.name in tolerances and one.tolerances(tolerances, 2.0) > APART]
    if not far:
        return ""
    said = []
    for one in far:
        scale, unit = prefixed(one.stated, "N/A" if one.name == "actuator_gain" else "N/m")
        off = one.tolerances(tolerances)
        said.append(
            f"the {one.said} is {one.ratio:.3g} times the stated {number(one.stated * scale)} {unit}"
            + (f" ({off:.2g} tolerances)" if np.isfinite(off) else "")
        )
    text = f"; {' and '.join(said)}"
    both = [known[name] for name in UNSTATED if name in known]
    if len(both) == 2 and all(one.ratio > 0 for one in both):
        logs, errors = np.log([one.ratio for one in both]), [one.error / one.ratio for one in both]
        if abs(logs[0] - logs[1]) < ALIKE + ERRORS * np.hypot(*errors):
            factor = float(np.exp(np.mean(logs)))
            times, how = (factor, "large") if factor > 1 else (1 / factor, "small")
            return (
                f"{text}: gain and stiffness are off by one factor, as a stated mass makes them that is {times:.3g} "
                f"times too {how}; check [parameters] mass"
            )
    return f"{text}: check the scales and axes of the channels, and the rig"
