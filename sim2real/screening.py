"""Starting points of fits: every start of an effect beside a known fit is tested on one record, the others follow."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from sim2real.fitting import Fit, cost_of, reach, real_product
from sim2real.hypotheses import Coordinate, Hypothesis, coordinates_of
from sim2real.problem import Problem
from sim2real.simulated import TOLERANCE_EFFECTS

MOST_SCALED = 10.0  # multiple of its start that a linear prediction may give a size
FOLLOWED = 3  # starts of an effect beside a seed that are simulated, where what they change is known from another seed
RESONANT, APART = 3, 0.2  # starts of a resonance that are followed, and their least distance in ln frequency


Job = tuple[Fit, Hypothesis, np.ndarray]  # a seed's fit, a hypothesis that adds an effect to it, and coordinates
# What starts change in the prediction of one record: by effect, whether its form is free, and its coordinates.
Changes = dict[tuple[str, bool, bytes], np.ndarray]


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


def screened(problem: Problem, jobs: Sequence[Job], changes: Changes, keep: bool = False) -> list[Start]:
    """Rank starting points by their cost on one record.

    Beside a seed whose Jacobian is known, the size of the effect and everything that the seed fits are moved as well,
    by a linear prediction. Where `changes` has what a start changes beside another seed, that stands for what it
    changes beside this one, and only the most promising starts are simulated where the prediction leads.

    Args:
        problem: The problem.
        jobs: The starting points.
        changes: What starts change.
        keep: Whether all starts are simulated, and what they change is kept in `changes`.

    Returns:
        Starts, the lowest cost first; those that make the rotor touch down are left out.
    """
    loudest = problem.loudest
    single = problem.only(loudest)
    looks: dict[tuple[Fit, tuple[str, ...]], _Look] = {}
    for seed, h, _ in jobs:
        if np.isfinite(seed.cost) and seed.jacobian is not None and (seed, h.effects) not in looks:
            looks[seed, h.effects] = _Look(seed, h, loudest.place)
    told = [not keep and (seed, h.effects) in looks and _key((seed, h, u)) in changes for seed, h, u in jobs]
    unknown = [job for job, known in zip(jobs, told, strict=True) if not known]
    found: list[Start] = []
    tried: list[tuple[Hypothesis, np.ndarray]] = []
    for (seed, h, u), p in zip(unknown, _simulated(single, [(h, u) for _, h, u in unknown]), strict=True):
        if not np.isfinite(p).all():
            continue
        found.append(_start(single, h, h.bounded(u), p))
        if look := looks.get((seed, h.effects)):
            change = p - (single.data - look.residual)
            tried += [(h, v) for v in look.followed(u, change)]
            if keep:
                changes[_key((seed, h, u))] = change
    promising: dict[_Look, list[tuple[float, Hypothesis, np.ndarray, np.ndarray]]] = {}
    for seed, h, u in compress(jobs, told):
        look, change = looks[seed, h.effects], changes[_key((seed, h, u))]
        promising.setdefault(look, []).append((look.promised(change), h, u, change))
    for look, starts in promising.items():
        for _, h, u, change in sorted(starts, key=lambda s: -s[0])[:FOLLOWED]:
            tried += [(h, v) for v in look.followed(u, change)]
    # A linear prediction goes too far where an effect is large, so the cost is simulated where it leads.
    found += [_start(single, h, v, p) for (h, v), p in zip(tried, _simulated(single, tried), strict=True)
              if np.isfinite(p).all()]  # fmt: skip
    return sorted(found, key=lambda start: start.cost)


def _simulated(single: Problem, at: Sequence[tuple[Hypothesis, np.ndarray]]) -> np.ndarray:
    """Predictions (n, K) at coordinates that are brought within their bounds."""
    return single.simulate([h.point(h.bounded(u)) for h, u in at], settled=False) if at else np.empty((0, 0))


def _key(job: Job) -> tuple[str, bool, bytes]:
    """A start's key in `Changes`."""
    _, h, u = job
    name, last = h.effects[-1], len(h.coordinates)
    return name, name in h.shaped, u[last - len(coordinates_of(name)) : last].tobytes()


def _start(single: Problem, h: Hypothesis, u: np.ndarray, predicted: np.ndarray) -> Start:
    return Start(h, u, cost_of(single.data - predicted, u, h.prior))


def kept(starts: Sequence[Start]) -> list[Start]:
    """The best start of each hypothesis.

    Of resonances, several starts of clearly different frequency are kept, because each is a minimum of its own.
    """
    found: list[Start] = []
    for start in starts:
        h = start.hypothesis
        same = [s for s in found if set(s.hypothesis.effects) == set(h.effects)]
        at = [i for i, c in enumerate(h.coordinates) if c.parameter == "frequency"]
        apart = all(np.any(abs(start.u[at] - s.u[at]) > APART) for s in same if s.hypothesis.effects == h.effects)
        if not same or (at and apart and len(same) < RESONANT):
            found.append(start)
    return found


def _is_size(c: Coordinate) -> bool:
    """Whether an effect vanishes where this coordinate is zero."""
    return c.scale is not None and c.parameter != "order"


class _Look:
    """Linear prediction of a seed's residual on one record, for a hypothesis that adds an effect to the seed's."""

    def __init__(self, seed: Fit, h: Hypothesis, at: slice) -> None:
        known = len(seed.hypothesis.coordinates)
        names = [*range(known), *seed.hypothesis.calibrated]
        own = [*range(known), *[None] * (len(h.coordinates) - known), *h.calibrated]
        rows = [i for i, name in enumerate(names) if name in own]
        self.seed, self.h, self.new = seed, h, slice(known, len(h.coordinates))
        self.columns = [own.index(names[i]) for i in rows]
        self.residual = seed.residual[at]
        self.jacobian, prior = np.ascontiguousarray(seed.jacobian[rows][:, at]), seed.prior[rows]
        normal = real_product(self.jacobian, self.jacobian) + np.diag(prior)
        self.solve = np.linalg.pinv(normal, hermitian=True)
        self.gradient = real_product(self.jacobian, self.residual) - prior * seed.u[rows]
        self.signed = any(c.signed for c in coordinates_of(h.effects[-1]))
        self.sized = any(map(_is_size, coordinates_of(h.effects[-1])))

    def followed(self, u: np.ndarray, change: np.ndarray) -> list[np.ndarray]:
        """Coordinates of a start with its effect scaled to fit the residual best and all else following it.

        Sizes on a logarithmic scale are kept.

        Args:
            u: Coordinates of the start.
            change: What the start adds to the seed's prediction.
        """
        cross = real_product(self.jacobian, change)
        without = u.copy()
        for i, c in zip(range(self.new.start, self.new.stop), coordinates_of(self.h.effects[-1]), strict=True):
            if _is_size(c):
                without[i] = 0.0
        if (without == u).all():
            return [self._moved(u, cross, 1.0)]
        without = extended(self.h, without[: len(self.h.coordinates)], self.seed)
        share = self._share(change, cross)
        return [self._moved(without + part * (u - without), cross, part) for part in (share, 0.5 * share)]

    def promised(self, change: np.ndarray) -> float:
        """What a change in its best size saves of the cost, by the linear prediction."""
        cross = real_product(self.jacobian, change)
        own, along = self._products(change, cross)
        share = self._share(change, cross) if self.sized else 1.0
        return share * (2.0 * along - share * own)

    def _products(self, change: np.ndarray, cross: np.ndarray) -> tuple[float, float]:
        """Products of a change with itself and with the residual when the other parameters may follow."""
        own = np.vdot(change, change).real - cross @ self.solve @ cross
        return own, np.vdot(change, self.residual).real - cross @ self.solve @ self.gradient

    def _share(self, change: np.ndarray, cross: np.ndarray) -> float:
        """Share of a change that fits the residual best when the other parameters may follow."""
        own, along = self._products(change, cross)
        if own <= 1e-9 * np.vdot(change, change).real or (along <= 0 and not self.signed):
            return 0.0
        return float(np.clip(along / own, -MOST_SCALED, MOST_SCALED))

    def _moved(self, u: np.ndarray, cross: np.ndarray, share: float) -> np.ndarray:
        moved = u.copy()
        step = np.zeros_like(u)
        step[self.columns] = self.solve @ (self.gradient - share * cross)
        moved += step / np.max(abs(step) / reach(self.h, u), initial=1.0)
        return self.h.bounded(moved)
