"""Starting points of fits: every start of an effect beside a known fit is tested on one record, the others follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import log

import numpy as np

from maglev_env.loop.effect import EFFECTS
from sim2real.compared.point import TOLERANCE_EFFECTS
from sim2real.compared.problem import Part, Problem
from sim2real.search.fit import Fit, cost_of
from sim2real.search.fitting import within_reach
from sim2real.search.following import following
from sim2real.search.hypotheses import AT_BOUND, Hypothesis, coordinates_of

MOST_SCALED = 10.0  # multiple of its start that a linear prediction may give a size
MOST_GROWN = 30.0  # the same, and its inverse, of one that a fit varies on a logarithmic scale
MUCH = 0.3  # share of the most that any record leaves beyond noise from which the one with the largest motion is taken
FOLLOWED = 2  # starts of an effect that are simulated where they lead; of a resonance, at every frequency
RESONANT, APART = 3, 0.2  # starts of a resonance that are followed, and their least distance in ln frequency


@dataclass(frozen=True)
class Start:
    """Coordinates that a fit may start from, and their cost on one record."""

    hypothesis: Hypothesis
    u: np.ndarray
    cost: float


def extended(hypothesis: Hypothesis, effects: np.ndarray, near: Fit) -> np.ndarray:
    """Coordinates of the effects, with the tolerances at their values in another fit."""
    known = dict(zip(near.hypothesis.calibrated, near.u[len(near.hypothesis.coordinates) :], strict=True))
    if not np.isfinite(near.cost):
        known = {}
    effects = effects.copy()
    for i, c in enumerate(hypothesis.coordinates):  # a parameter that is now free begins where its tolerance moved it
        for name in known.keys() - set(hypothesis.calibrated):
            if TOLERANCE_EFFECTS.get(name) == c.effect and c.scale:
                effects[i] += known[name] * hypothesis.sigma(name) / c.scale
    return np.concatenate([effects, [known.get(name, 0.0) for name in hypothesis.calibrated]])


def beside(h: Hypothesis, effects: np.ndarray, seed: Fit, forms: Mapping[str, float]) -> np.ndarray:
    """Coordinates beside a seed, with the coordinates of forms that it does not have."""
    u, first = extended(h, effects, seed), len(h.coordinates)
    for i, name in enumerate(h.calibrated, first):
        if name in forms and name in h.shapes and name not in seed.hypothesis.shapes:
            u[i] = forms[name]
    return u


def formed(hypothesis: Hypothesis, u: np.ndarray) -> dict[str, float]:
    """Coordinates of forms, and of all else that is calibrated, by name."""
    return dict(zip(hypothesis.calibrated, u[len(hypothesis.coordinates) :].tolist(), strict=True))


def screened(problem: Problem, jobs: Sequence[tuple[Fit, Hypothesis, np.ndarray]], apart: bool = True) -> list[Start]:
    """Rank starting points by their cost on one record.

    Beside a seed whose Jacobian is known, the size of the effect and everything that the seed fits are moved as well,
    by a linear prediction; those of an effect's starts that then promise most are simulated there.

    Args:
        problem: The problem.
        jobs: A seed's fit, a hypothesis that adds an effect to it, and coordinates.
        apart: Whether resonances of different frequency are told apart.

    Returns:
        Starts, the lowest cost first; those that make the rotor touch down are left out.
    """
    if not jobs:
        return []
    part = _telling(problem, [seed for seed, _, _ in jobs])
    single = problem.only(part)
    predicted = single.simulate([h.point(h.bounded(u)) for _, h, u in jobs], settled=False)
    tried: dict[tuple, list[_Promise]] = {}
    found: list[Start] = []
    looks: dict[tuple[Fit, tuple[str, ...]], _Look] = {}
    for (seed, h, u), p in zip(jobs, predicted, strict=True):
        if not np.isfinite(p).all():
            continue
        found.append(_start(single, h, h.bounded(u), p))
        if not np.isfinite(seed.cost) or seed.jacobian is None:
            continue
        key = seed, h.effects
        if key not in looks:
            looks[key] = _Look(seed, h, part.place)
        at = tuple(v for c, v in zip(h.coordinates, u, strict=False) if apart and c.parameter == "frequency")
        promise = looks[key].followed(h, u, p - (single.data - looks[key].follows.residual))
        tried.setdefault((*key, h.shaped, at), []).append(promise)
    # A linear prediction goes too far where an effect is large, so the cost is simulated where it leads.
    best = [p for same in tried.values() for p in sorted(same, key=lambda p: -p.saved)[:FOLLOWED]]
    led = [(p.hypothesis, v) for p in best for v in p.at]
    predicted = single.simulate([h.point(v) for h, v in led], settled=False) if led else []
    found += [_start(single, h, v, p) for (h, v), p in zip(led, predicted, strict=True) if np.isfinite(p).all()]
    return sorted(found, key=lambda start: start.cost)


def _telling(problem: Problem, seeds: Sequence[Fit]) -> Part:
    """The record on which starts are ranked.

    It is the one with the largest motion, in which nonlinearity shows, but where the best of the seeds leaves next to
    nothing there: one sine may be the loudest, and tells nothing of a resonance at another frequency.
    """
    best = min(seeds, key=lambda seed: seed.cost)
    if not np.isfinite(best.cost):
        return problem.loudest
    left = {id(p): float(np.sum(np.abs(best.residual[p.place]) ** 2 - 2.0)) for p in problem.parts}
    most = max(problem.parts, key=lambda p: left[id(p)])
    return problem.loudest if left[id(problem.loudest)] > MUCH * left[id(most)] else most


@dataclass(frozen=True)
class _Promise:
    """Where a start leads, and by how much the cost on one record is predicted to fall from that of the seed."""

    hypothesis: Hypothesis
    at: list[np.ndarray]
    saved: float


def _start(single: Problem, h: Hypothesis, u: np.ndarray, predicted: np.ndarray) -> Start:
    return Start(h, u, cost_of(single.data - predicted, u, h.prior))


def kept(starts: Sequence[Start]) -> list[Start]:
    """The best start of each hypothesis.

    Of resonances, several starts of clearly different frequency are kept, because each is a minimum of its own; of what
    may sit at several places (`place`), the best at each, that of the plain formula among them.
    """
    found: list[Start] = []
    for start in starts:
        h = start.hypothesis
        same = [s for s in found if set(s.hypothesis.effects) == set(h.effects)]
        at = [i for i, c in enumerate(h.coordinates) if c.parameter == "frequency"]
        apart = all(np.any(abs(start.u[at] - s.u[at]) > APART) for s in same if s.hypothesis.effects == h.effects)
        own = place(h, start.u)
        elsewhere = all(own != place(s.hypothesis, s.u) for s in same if s.hypothesis.effects == h.effects)
        if not same or (at and apart and len(same) < RESONANT) or elsewhere:
            found.append(start)
    return found


def place(h: Hypothesis, u: np.ndarray) -> tuple[str, ...]:
    """What tells apart starts of the same effects that lead to minima of their own.

    An effect may sit elsewhere: coordinates of its form that are not at the plain formula. A size of it may be so small
    that it does nothing, as of bristles that do not bend: where a fit begins there, the cost does not depend on it.
    """
    own = zip(h.calibrated, u[len(h.coordinates) :], strict=True)
    nothing = (c for c, v in zip(h.coordinates, u, strict=False) if c.scale is None and abs(v - c.at(c.low)) < AT_BOUND)
    return (*(n for n, v in own if n in h.shapes and v), *(f"{c.effect}.{c.parameter}" for c in nothing))


class _Look:
    """Linear prediction of a seed's residual on one record, for a hypothesis that adds an effect to the seed's."""

    def __init__(self, seed: Fit, h: Hypothesis, at: slice) -> None:
        known = len(seed.hypothesis.coordinates)
        names = [*range(known), *seed.hypothesis.calibrated]
        own = [*range(known), *[None] * (len(h.coordinates) - known), *h.calibrated]
        rows = [i for i, name in enumerate(names) if name in own]
        self.seed, self.h, self.new = seed, h, slice(known, len(h.coordinates))
        self.columns = [own.index(names[i]) for i in rows]
        self.follows = following(seed, rows, at)
        self.signed = any(c.signed for c in coordinates_of(h.effects[-1], h.scales))

    def followed(self, h: Hypothesis, u: np.ndarray, change: np.ndarray) -> _Promise:
        """A start with its effect scaled to fit the residual best and all else following it.

        Of those on a logarithmic scale only that is scaled to which what an effect does is in proportion.

        Args:
            h: Its hypothesis.
            u: Its coordinates.
            change: What it adds to the seed's prediction.
        """
        without = u.copy()
        for i, c in zip(range(self.new.start, self.new.stop), self.h.coordinates[self.new], strict=True):
            if c.scale is not None and c.parameter != "order":
                without[i] = 0.0
        own, along = (float(np.squeeze(v)) for v in self.follows.along(change[None]))
        if (without == u).all():
            return self._grown(h, u, change, own, along)
        without = extended(h, without[: len(h.coordinates)], self.seed)
        forms = [i for i, name in enumerate(h.calibrated, len(h.coordinates)) if name in h.shapes]
        without[forms] = u[forms]
        share = self._share(own, along, float(np.vdot(change, change).real))
        moved = [self._moved(h, without + part * (u - without), part * change) for part in (share, 0.5 * share)]
        return _Promise(h, moved, share * (2.0 * along - share * own))

    def _grown(self, h: Hypothesis, u: np.ndarray, change: np.ndarray, own: float, along: float) -> _Promise:
        """A start as it is, and with the size to which what it does is in proportion as the residual asks."""
        at, saved = [self._moved(h, u, change)], 2.0 * along - own
        new = zip(range(self.new.start, self.new.stop), h.coordinates[self.new], strict=True)
        sizes = [i for i, c in new if EFFECTS[c.effect].parameters[c.parameter].in_proportion]
        if sizes and own > 0 and along > 0:
            share = float(np.clip(along / own, 1 / MOST_GROWN, MOST_GROWN))
            grown = u.copy()
            grown[sizes] += log(share)
            at.append(self._moved(h, h.bounded(grown), share * change))
            saved = max(saved, share * (2.0 * along - share * own))
        return _Promise(h, at, saved)

    def _share(self, own: float, along: float, size: float) -> float:
        """Share of a change that fits the residual best when the other parameters may follow."""
        if own <= 1e-9 * size or (along <= 0 and not self.signed):
            return 0.0
        return float(np.clip(along / own, -MOST_SCALED, MOST_SCALED))

    def _moved(self, h: Hypothesis, u: np.ndarray, change: np.ndarray) -> np.ndarray:
        moved = u.copy()
        step = np.zeros_like(u)
        step[self.columns] = self.follows.step(change)
        moved += within_reach(h, u, step)
        return h.bounded(moved)
