"""Pairs of effects of which neither does much alone, found by a linear prediction beside the nominal rig.

A gain and a stiffness that are off together look like another mass: either alone explains little, and is no seed for a
pair. So the change that each effect makes is simulated once, and every pair of changes is scaled to fit, all else
following.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sim2real.compared.problem import Problem
from sim2real.recorded.drifting import DRIFTING
from sim2real.search.fit import Fit
from sim2real.search.fitting import within_reach
from sim2real.search.following import following
from sim2real.search.hypotheses import Hypothesis
from sim2real.search.screening import MOST_SCALED, extended

JOINT = 3  # pairs that are proposed
ALIKE = 1e-4  # share of two changes, at least, that the other one does not make


@dataclass(frozen=True)
class Proposed:
    """A pair's hypothesis, where to begin its fit, and the cost that the linear prediction promises there."""

    hypothesis: Hypothesis
    u: np.ndarray
    cost: float


def joint_pairs(
    problem: Problem, base: Fit, singles: Sequence[Fit], known: Collection[frozenset[str]] = ()
) -> list[Proposed]:
    """The most promising pairs of effects that act together.

    Args:
        problem: The campaign.
        base: A fit without effects whose Jacobian is known.
        singles: Fits of single effects, which tell how large each may be.
        known: Pairs that are not proposed.
    """
    # In the mean a drift is another gain, and would take the place of every pair that has one.
    able = [f for f in singles if np.isfinite(f.cost) and f.hypothesis.effects != (DRIFTING,)]
    scaled = [f for f in able if _sizes(f).any()]
    alone = [extended(f.hypothesis, f.u[: len(f.hypothesis.coordinates)], base) for f in scaled]
    predicted = problem.simulate([f.hypothesis.point(u) for f, u in zip(scaled, alone, strict=True)])
    kept = [i for i, p in enumerate(predicted) if np.isfinite(p).all()]
    if len(kept) < 2:
        return []
    change = np.array([predicted[i] - (problem.data - base.residual) for i in kept])
    follows = following(base)
    own, along = follows.along(change)
    reachable = base.cost - follows.promised
    found = []
    for a, b in combinations(range(len(kept)), 2):
        first, second = scaled[kept[a]], scaled[kept[b]]
        names = first.hypothesis.effects[0], second.hypothesis.effects[0]
        matrix = own[np.ix_((a, b), (a, b))]
        if frozenset(names) in known or np.linalg.det(matrix) <= ALIKE * matrix[0, 0] * matrix[1, 1]:
            continue
        shares = np.linalg.solve(matrix, along[[a, b]])
        if any(s < 0 and not _signed(f) for s, f in zip(shares, (first, second), strict=True)):
            continue
        shares = np.clip(shares, -MOST_SCALED, MOST_SCALED)
        saved = float(2 * shares @ along[[a, b]] - shares @ matrix @ shares)
        sizes = [
            np.where(_sizes(f), s * f.u[: len(f.hypothesis.coordinates)], f.u[: len(f.hypothesis.coordinates)])
            for s, f in zip(shares, (first, second), strict=True)
        ]
        h = base.hypothesis.instead(*names)
        u = extended(h, np.concatenate(sizes), base)
        found.append((reachable - saved, h, u, follows.step(shares @ change[[a, b]])))
    best = sorted(found, key=lambda each: each[0])[:JOINT]
    return [Proposed(h, _followed(base, h, u, step), cost) for cost, h, u, step in best]


def _followed(base: Fit, h: Hypothesis, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The coordinates with the base's own moved by a step, as far as one step may go."""
    moved, own = np.zeros_like(u), dict(zip(base.hypothesis.calibrated, step, strict=True))
    for i, name in enumerate(h.calibrated, len(h.coordinates)):
        moved[i] = own.get(name, 0.0)
    return h.bounded(u + within_reach(h, u, moved))


def _sizes(f: Fit) -> np.ndarray:
    """Which of a fit's coordinates of effects are sizes that may be scaled, (coordinates,)."""
    return np.array([c.scale is not None and c.parameter != "order" for c in f.hypothesis.coordinates], bool)


def _signed(f: Fit) -> bool:
    return any(c.signed for c in f.hypothesis.coordinates)
