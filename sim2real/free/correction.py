"""The free correction of a campaign, where no known effect explains its gap, and whether it is worth anything.

It is no cause and competes with none: a flexible residual would absorb every effect. It says where and of what shape a
correction must be, and makes the corrected rig simulate what was recorded. It counts only where it closes clearly more
of recordings that no fit has seen than a refit of every nominal parameter does.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sim2real.attribute import Attribution, Candidate
from sim2real.fitting import Fit
from sim2real.free import drawn as drawing
from sim2real.free.drawn import Drawn, drawn
from sim2real.free.fit import corrected, excess, lacks, refined
from sim2real.free.words import in_words
from sim2real.problem import Problem
from sim2real.recorded.open_record import OpenRecord
from sim2real.simulated import Point
from sim2real.words import percent

GAINED, SURELY = 0.2, 0.1  # share of what a refit leaves that must be closed, and the lower end of its 95 % interval
BEYOND_NOISE, DRAWN = 4.0, 400  # standard deviations of the noise's cost that a rival must leave; draws of the noise
POOR = 0.3  # share of the gap that corrections of calibration may leave before those of the best explanation are tried


@dataclass(frozen=True)
class Free:
    """A free correction.

    Attributes:
        base: Effects that it stands beside; none beside calibration alone.
        named: Effects that are named as the cause, which it must beat; without any, a refit of every parameter.
        drawn: Its corrections.
        candidate: Its fit.
        judged: The recordings that judge, with the noise that it leaves of those without a period.
        gained: Whether it is worth showing.
        beyond: Share that it closes, on recordings that no fit has seen, of what its rival leaves; None where that is
            too near to the noise.
        beyond_ci: Its 95 % interval.
    """

    base: tuple[str, ...]
    named: tuple[str, ...]
    drawn: tuple[Drawn, ...]
    candidate: Candidate
    judged: Problem
    gained: bool
    beyond: float | None
    beyond_ci: tuple[float, float] | None

    @property
    def rival(self) -> str:
        """What it must beat."""
        return " with ".join(self.named) or "a refit of every nominal parameter"

    @property
    def block(self) -> str:
        """Blocks that are corrected, "a+b"."""
        return "+".join(dict.fromkeys(d.kind.block for d in self.drawn))

    def to_json(self) -> dict[str, Any]:
        return {
            "gained": self.gained,
            "beside": list(self.base),
            "block": self.block,
            "in_words": self.sentence(),
            "rival": self.rival,
            "closes": self.beyond,
            "closes_ci": None if self.beyond_ci is None else list(self.beyond_ci),
            "corrections": [{**drawing.to_json(d), "in_words": in_words(d)} for d in self.drawn] if self.gained else [],
        }

    def sentence(self) -> str:
        """What it is, or that nothing was gained."""
        if not self.gained:
            found = "too near to the noise to tell" if self.beyond is None else f"{percent(max(self.beyond, 0.0))}"
            return (
                "No free correction of a block is shown: on what no fit has seen, the best one closes too little of "
                f"what {self.rival} leaves ({found}; wanted {percent(GAINED)})."
            )
        lo, hi = self.beyond_ci or (np.nan, np.nan)
        beside = f" beside {' with '.join(self.base)}" if self.base else ""
        return (
            f"A free correction{beside}: {'; and '.join(map(in_words, self.drawn))}. On what no fit has seen it closes "
            f"{percent(min(max(self.beyond or 0.0, 0.0), 1.0))} (95 %: {100 * lo:.0f} .. {100 * min(hi, 1.0):.0f}) of "
            f"what {self.rival} leaves. It describes, and names no cause."
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
        if best is not None and excess(best) < POOR * max(excess(calibration.fit), 0.0):
            break
        if not lacks(base.fit):
            continue
        found = corrected(problem, base.fit)
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    if best is None:
        return None
    if any(isinstance(part.record, OpenRecord) for part in problem.parts):
        # The noise of a record without a period is what a good simulation leaves of it.
        near = best.hypothesis.point(best.u)
        problem, judged = problem.again(near), judged.again(near)
        best = refined(problem, best)
    rival = partial.fit if named else attribution.refitted or calibration.fit
    beyond, ends = _beyond(judged, rival, best, seed)
    gained = beyond is not None and ends is not None and beyond >= GAINED and ends[0] >= SURELY
    against = partial.effects if named else ()
    return Free(best.hypothesis.effects, against, drawn(problem, best), Candidate(best), judged, gained, beyond, ends)


def _beyond(judged: Problem, rival: Fit, fit: Fit, seed: int) -> tuple[float | None, tuple[float, float] | None]:
    """Share of what a rival leaves that a correction closes, with its 95 % interval."""
    against = rival.hypothesis.point(rival.u) if np.isfinite(rival.cost) else Point({}, {})
    before, after = judged.data - judged.simulate([against, fit.hypothesis.point(fit.u)])
    return share_closed(before, after, seed)


def share_closed(before: np.ndarray, after: np.ndarray, seed: int) -> tuple[float | None, tuple[float, float] | None]:
    """Share of the excess over noise that is closed, with the 95 % interval that the noise of these lines leaves it.

    Noise is drawn once more for both residuals together (a parametric bootstrap), because a gap of a few lines leaves
    too little to draw from.

    Args:
        before: Whitened residual (K,) to compare with.
        after: Whitened residual (K,).
        seed: Of the noise.

    Returns:
        The share and its interval; None where the rotor touches down, or there is no excess beyond the noise.
    """
    n = before.size
    total = float(np.sum(abs(before) ** 2)) - 2.0 * n
    if not (np.isfinite(before).all() and np.isfinite(after).all()) or total < BEYOND_NOISE * np.sqrt(4.0 * n):
        return None, None
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((DRAWN, n, 2)) @ np.array([1.0, 1.0j])
    b, a = (np.sum(abs(r + noise) ** 2, axis=1) - 4.0 * n for r in (before, after))
    lo, hi = np.quantile(1 - a / np.maximum(b, 1e-9), [0.025, 0.975])
    return 1 - (float(np.sum(abs(after) ** 2)) - 2.0 * n) / total, (float(lo), float(hi))
