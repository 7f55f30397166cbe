"""The free correction of a campaign, where no known effect explains its gap, and whether it is worth anything.

It is no cause and competes with none: a flexible residual would absorb every effect. It says where and of what shape a
correction must be, and makes the corrected rig simulate what was recorded. It counts only where it closes clearly more
of recordings that no fit has seen than a refit of every nominal parameter does.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import Problem
from sim2real.free import drawn as drawing
from sim2real.free.drawn import Drawn, drawn
from sim2real.free.fit import corrected, lacks, refined
from sim2real.free.share import GAINED, SURELY, share_closed
from sim2real.free.trend import Trend, trend_of
from sim2real.free.words import in_words
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fit import Fit
from sim2real.words import percent

POOR = 0.3  # share of the gap that corrections of calibration may leave before those of the best explanation are tried


@dataclass(frozen=True)
class Free:
    """A free correction.

    Attributes:
        base: Effects that it stands beside; none beside calibration alone.
        rival: What it must beat, in words: what is named, or a refit of every nominal parameter.
        drawn: Its corrections.
        candidate: Its fit.
        judged: The recordings that judge, with the noise that it leaves of those without a period.
        gained: Whether it is worth showing.
        beyond: Share that it closes, on recordings that no fit has seen, of what its rival leaves; None where that is
            too near to the noise.
        beyond_ci: Its 95 % interval.
        trend: A gain that changes over time; None where no trend holds on what no fit has seen.
    """

    base: tuple[str, ...]
    rival: str
    drawn: tuple[Drawn, ...]
    candidate: Candidate
    judged: Problem
    gained: bool
    beyond: float | None
    beyond_ci: tuple[float, float] | None
    trend: Trend | None = None

    @property
    def block(self) -> str:
        """Blocks that are corrected, "a+b"."""
        found = [d.kind.block for d in self.drawn if self.gained] + ([self.trend.block] if self.trend else [])
        return "+".join(dict.fromkeys(found))

    def added_to(self, point: Point) -> Point:
        """The point of the corrected rig, with what changes over time."""
        return point if self.trend is None else self.trend.added_to(point)

    def to_json(self) -> dict[str, Any]:
        return {
            "gained": self.gained,
            "beside": list(self.base),
            "block": self.block,
            "in_words": self.sentence(),
            "rival": self.rival,
            "closes": self.beyond,
            "closes_ci": None if self.beyond_ci is None else list(self.beyond_ci),
            "trend": None if self.trend is None else self.trend.to_json(),
            "corrections": [{**drawing.to_json(d), "in_words": in_words(d)} for d in self.drawn] if self.gained else [],
        }

    def sentence(self) -> str:
        """What it is, or that nothing was gained."""
        of_time = "" if self.trend is None else f" A free correction {self.trend.in_words()}."
        if not self.drawn:
            return of_time.strip()
        if not self.gained:
            ends = (
                ""
                if self.beyond_ci is None
                else f", 95 %: {100 * self.beyond_ci[0]:.0f} .. {100 * self.beyond_ci[1]:.0f}"
            )
            found = "too near to the noise to tell" if self.beyond is None else f"{100 * self.beyond:.0f} %{ends}"
            return (
                "No free correction of a block is shown: on what no fit has seen, the best one closes too little of "
                f"what {self.rival} leaves ({found}; wanted {percent(GAINED)}, and {percent(SURELY)} surely).{of_time}"
            )
        lo, hi = self.beyond_ci or (np.nan, np.nan)
        beside = f" beside {' with '.join(self.base)}" if self.base else ""
        return (
            f"A free correction{beside}: {'; and '.join(map(in_words, self.drawn))}. On what no fit has seen it closes "
            f"{percent(min(max(self.beyond or 0.0, 0.0), 1.0))} (95 %: {100 * lo:.0f} .. {100 * min(hi, 1.0):.0f}) of "
            f"what {self.rival} leaves. It describes, and names no cause.{of_time}"
        )


def free_correction(
    attribution: Attribution, judged: Problem, partial: Candidate, named: bool, seed: int
) -> Free | None:
    """The free correction of a campaign; None where there is nothing to correct, or no correction helps.

    Args:
        attribution: The fitted candidates.
        judged: The recordings or lines that no fit has seen.
        partial: The best partial explanation, or what is named.
        named: Whether it is named: then the correction stands beside it.
        seed: Of the bootstrap.
    """
    problem, calibration = attribution.problem, attribution.calibration
    bases = [partial] if named or not np.isfinite(calibration.fit.cost) else [calibration, partial]
    best: Fit | None = None
    for base in dict.fromkeys(bases):
        if best is not None and best.excess < POOR * max(calibration.fit.excess, 0.0):
            break
        if not lacks(base.fit):
            continue
        found = corrected(problem, base.fit)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    near = calibration.fit if np.isfinite(calibration.fit.cost) else partial.fit
    trend = trend_of(problem, judged, near.hypothesis.point(near.u), seed) if not named else None
    rival, words = _rival(attribution, partial, named)
    if best is None:
        return None if trend is None else Free((), words, (), calibration, judged, False, None, None, trend)
    if any(isinstance(part.record, OpenRecord) for part in problem.parts):
        # The noise of a record without a period is what a good simulation leaves of it.
        near = best.hypothesis.point(best.u)
        problem, judged = problem.again(near), judged.again(near)
        best = refined(problem, best)
    beyond, ends = _beyond(judged, rival, best, seed)
    gained = beyond is not None and ends is not None and beyond >= GAINED and ends[0] >= SURELY
    beside, found = best.hypothesis.effects, drawn(problem, best)
    return Free(beside, words, found, Candidate(best), judged, gained, beyond, ends, trend)


def _rival(attribution: Attribution, partial: Candidate, named: bool) -> tuple[Fit, str]:
    """What a correction must beat, and its name: where tones alone are named, their candidate is calibration."""
    if named:
        return partial.fit, " with ".join(partial.effects) or "calibration"
    if attribution.refitted is None:
        return attribution.calibration.fit, "calibration"
    return attribution.refitted, "a refit of every nominal parameter"


def _beyond(judged: Problem, rival: Fit, fit: Fit, seed: int) -> tuple[float | None, tuple[float, float] | None]:
    """Share of what a rival leaves that a correction closes, with its 95 % interval."""
    against = rival.hypothesis.point(rival.u) if np.isfinite(rival.cost) else NOMINAL
    before, after = judged.data - judged.simulate([against, fit.hypothesis.point(fit.u)])
    return share_closed(before, after, seed)
