"""What else may be tuned where gains within the ranges do not meet a goal, as far as the user has left it open."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from maglev_env.design.defaults import with_defaults
from maglev_env.loop.gain_card import TIME_CONSTANT
from maglev_env.rig.rig import Rig
from maglev_env.task.gain_box import TUNED
from tuning.campaign.advice import Advice
from tuning.campaign.gain_set import GainSet

FILTER = "td"  # of the derivative, whose lag costs phase
BEYOND = 2.0  # factor by which ranges go on that nobody stated
FASTEST = 1 / 3  # of a control period: a filter that is faster hardly filters


def names_of(sets: Sequence[GainSet], tuned: Sequence[str] | None) -> tuple[str, ...]:
    """The gains to tune: those that were named, or else what recordings vary of those that are tuned by themselves."""
    if tuned is not None:
        return tuple(tuned)
    return (*TUNED, FILTER) if len({getattr(s.gains, FILTER) for s in sets}) > 1 else TUNED


def lacking(advice: Advice) -> bool:
    """Whether it stops with gains that miss a requirement, or may do so."""
    if advice.stop is None or advice.task.layout.goal is None or advice.keep is None:
        return False
    kept = advice.claimed[advice.keep]
    return bool(kept.missed or kept.unsure)


def farther(
    rig: Rig, ranges: Mapping[str, tuple[float, float]], bounds: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Names and ranges with the filter of the derivative among them, and wider where nobody stated them.

    Args:
        rig: As its file states it.
        ranges: Of the gains so far, by name.
        bounds: Those that the user stated.
    """
    stated = {**rig.bounds, **bounds}
    wider = {n: stated.get(n, (low / BEYOND, high * BEYOND)) for n, (low, high) in ranges.items() if n != FILTER}
    low, high = TIME_CONSTANT.range(getattr(with_defaults(rig).gains, FILTER))
    return (*wider, FILTER), {**wider, FILTER: stated.get(FILTER, (min(low, FASTEST / rig.control_rate), high))}


def in_words(advice: Advice, corners: np.ndarray) -> Advice:
    """The advice of a search farther out, with a sentence on where that was; corners: (2, k), as actions."""
    box = advice.task.box
    ends = zip(box.names, *box.gains(corners), strict=True)
    where = ", ".join(f"{name} {_digits(low)} .. {_digits(high)}" for name, low, high in ends)
    if advice.stop:
        return replace(advice, stop=f"{advice.stop}; searched: {where}")
    words = f"no gains within the ranges so far are sure to meet the goal, so the search goes farther ({where}): "
    return replace(advice, why=words + advice.why)


def _digits(value: float) -> str:
    return f"{float(f'{value:.3g}'):g}"
