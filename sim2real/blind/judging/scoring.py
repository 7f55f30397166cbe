"""The figures of a blind check: every target with its interval, over all campaigns and over subsets of them."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binomtest

from sim2real.blind.judging.calibration import calibration_error
from sim2real.blind.judging.judging import SIZES, Judgement, size_range

_RESAMPLES = 2000


@dataclass(frozen=True)
class Target:
    """What a figure should reach: a floor, and an ambitious range. at_most: small values are good."""

    floor: float
    ambitious: tuple[float, float]
    at_most: bool = False


@dataclass(frozen=True)
class Row:
    """A figure with its 95 % interval over n campaigns (nan for n = 0).

    Attributes:
        name: Name of the figure.
        value: Its value.
        low: Lower end of the interval.
        high: Upper end of the interval.
        n: Number of campaigns.
        unit: "share", "s" or "".
        target: Its target, if any.
        verdict: "ambitious", "floor", "missed", "no cases", or "" without a target.
        decided: The whole interval lies on one side of the floor, so other campaigns would hardly change the verdict.
    """

    name: str
    value: float
    low: float
    high: float
    n: int
    unit: str
    target: Target | None
    verdict: str
    decided: bool


@dataclass(frozen=True)
class Share:
    """A share: how many campaigns of one kind in a range of sizes (None: any) are good."""

    name: str
    kind: str | None
    sizes: tuple[float, float] | None
    good: Callable[[Judgement], bool]
    target: Target | None


SMALL, MEDIUM, LARGE = SIZES
SHARES = (
    Share("false alarm", "none", None, lambda j: j.false_alarm, Target(0.05, (0.0, 0.02), True)),
    Share("right class", "single", LARGE, lambda j: j.right_class, Target(0.90, (0.95, 1.0))),
    Share("named alone", "single", LARGE, lambda j: j.alone, None),
    Share(
        "right class or correct abstention",
        "single",
        MEDIUM,
        lambda j: j.right_class or j.abstained,
        Target(0.55, (0.70, 1.0)),
    ),
    Share("right block", "single", LARGE, lambda j: j.right_block, Target(0.92, (0.97, 1.0))),
    Share("right block", "single", MEDIUM, lambda j: j.right_block, Target(0.75, (0.85, 1.0))),
    Share("pairs: both named", "pair", None, lambda j: j.right_class, Target(0.50, (0.65, 1.0))),
    Share("pairs: at least one named", "pair", None, lambda j: j.one_named, Target(0.95, (0.98, 1.0))),
    Share("spurious second effect", "single", None, lambda j: j.second, Target(0.10, (0.0, 0.05), True)),
    Share("unknown flagged", "unknown", None, lambda j: j.flagged, Target(0.75, (0.85, 1.0))),
    Share("90 % set holds the truth", None, None, lambda j: j.covered, Target(0.85, (0.88, 0.93))),
)
ERROR_TARGET = Target(0.08, (0.0, 0.05), True)
CLOSED_TARGET = Target(0.85, (0.95, inf))
REGRET_TARGET = Target(-0.50, (-inf, -0.70), True)
SECONDS_TARGET = Target(180.0, (0.0, 60.0), True)


def row(name: str, value: float, interval: tuple[float, float], n: int, unit: str, target: Target | None) -> Row:
    """A figure judged against its target."""
    low, high = interval
    if n == 0:
        return Row(name, nan, nan, nan, 0, unit, target, "no cases", False)
    if target is None:
        return Row(name, value, low, high, n, unit, None, "", False)
    met = value <= target.floor if target.at_most else value >= target.floor
    best = target.ambitious[0] <= value <= target.ambitious[1]
    verdict = "ambitious" if best else "floor" if met else "missed"
    return Row(name, value, low, high, n, unit, target, verdict, not low <= target.floor <= high)


def statistic_row(
    name: str,
    data: ArrayLike,
    statistic: Callable[[np.ndarray], Any],
    unit: str = "",
    target: Target | None = None,
) -> Row:
    """A statistic over rows of data (n, ...), with its bootstrap interval."""
    values = np.asarray(data)
    found = float(statistic(values)) if len(values) else nan
    return row(name, found, bootstrap(values, statistic), len(values), unit, target)


def share_row(share: Share, judged: Sequence[Judgement], any_size: bool = False) -> Row:
    """A share over judged campaigns, with Wilson's interval (1927); any_size ignores the range of sizes."""
    sizes = None if any_size else share.sizes
    of = [j for j in judged if (share.kind in (None, j.case.kind)) and (sizes is None or size_range(j.case) == sizes)]
    name = share.name + ("" if sizes is None else f", {size_words(sizes)}")
    good = sum(map(share.good, of))
    if not of:
        return row(name, nan, (nan, nan), 0, "share", share.target)
    ci = binomtest(good, len(of)).proportion_ci(method="wilson")
    return row(name, good / len(of), (ci.low, ci.high), len(of), "share", share.target)


def size_words(sizes: tuple[float, float]) -> str:
    """A range of sizes as it is written in tables."""
    low, high = sizes
    return f"< {high:g} x" if not low else f">= {low:g} x" if high == inf else f"{low:g}-{high:g} x"


def rows(judged: Sequence[Judgement]) -> list[Row]:
    """Every figure of the table of targets except the regret, over these campaigns."""
    right = [j.answer.closed_fraction for j in judged if j.right_class and _large_single(j)]
    seconds = [j.answer.seconds for j in judged]
    top = np.array([(j.top_probability, j.top_right) for j in judged], dtype=float).reshape(-1, 2)
    return [
        *(share_row(share, judged) for share in SHARES),
        statistic_row("calibration error", top, calibration_error, target=ERROR_TARGET),
        statistic_row(f"median closed fraction, {size_words(LARGE)}", right, np.median, target=CLOSED_TARGET),
        statistic_row("mean time per campaign", seconds, np.mean, "s", SECONDS_TARGET),
    ]


def by_size(judged: Sequence[Judgement]) -> dict[str, list[Row]]:
    """The shares that depend on a size, for each range of sizes."""
    sized = {(s.name, s.kind): s for s in SHARES if s.kind not in (None, "none")}.values()
    return {
        size_words(sizes): [share_row(s, [j for j in judged if size_range(j.case) == sizes], True) for s in sized]
        for sizes in SIZES
    }


def by(judged: Sequence[Judgement], part: Callable[[Judgement], str]) -> dict[str, list[Row]]:
    """The figures of `rows` for each part of the campaigns, for example each channel set."""
    return {name: rows([j for j in judged if part(j) == name]) for name in sorted({part(j) for j in judged})}


def bootstrap(data: np.ndarray, statistic: Callable[[np.ndarray], float]) -> tuple[float, float]:
    """95 % percentile interval of a statistic over resampled rows of data (n, ...); nan without rows; reproducible."""
    if not len(data):
        return nan, nan
    draws = np.random.default_rng(0).integers(len(data), size=(_RESAMPLES, len(data)))
    values = [statistic(data[draw]) for draw in draws]
    low, high = np.quantile(values, (0.025, 0.975), method="nearest")  # some may be infinite
    return float(low), float(high)


def named_in_class(judged: Sequence[Judgement]) -> Counter[int]:
    """Number of singles at LARGE by the number of members of the cause that holds the truth; 0 when none does."""
    return Counter(j.class_size for j in judged if _large_single(j))


def confusion(judged: Sequence[Judgement]) -> Counter[tuple[str, str]]:
    """How often each truth got each answer, both in words."""
    return Counter((truth_words(j), answer_words(j)) for j in judged)


def truth_words(j: Judgement) -> str:
    """The truth of a case: its effects; an unknown one is given in brackets."""
    names = " + ".join(sorted(j.case.effects)) or "none"
    return f"[{names}]" if j.case.kind == "unknown" else names


def answer_words(j: Judgement) -> str:
    """The answer: its cause, with the members of a class separated by "or", or its verdict."""
    return " or ".join(sorted(" + ".join(sorted(member)) for member in j.answer.cause)) or j.answer.verdict


def _large_single(j: Judgement) -> bool:
    return j.case.kind == "single" and size_range(j.case) == LARGE
