"""What no method could have told: other explanations that the noise of a campaign does not reject.

The oracle knows the generator. Against the true mean of the recordings (see `detect`) it fits every kind of the
vocabulary, alone and, for a pair, beside either of its effects, with the size free and other values as in the truth or
drawn. An explanation whose squared distance, in units of the noise and after calibration, is below that of a 1 % test
of one parameter with a power of one half is a rival of the truth.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi, sqrt

import numpy as np

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.detect import NOMINAL, RANDOM, ROUGH, Detector, critical
from sim2real.blind.benchmark.kinds import VOCABULARY, Kind, known_on
from sim2real.blind.benchmark.simulate import LoopFailed

REJECTED = critical(1)  # squared distance from which the truth is told from a rival
ALIKE = 0.3  # squared cosine with the truth from which a rival's size is searched
SIZES = (0.3, 0.6, 0.8, 1.0, 1.3, 1.7, 2.5)  # of the one with the strength of the truth
FEW_SIZES = (0.6, 1.0, 1.7)  # the same where each takes several simulations
REFINED = 8  # nearest explanations that are fitted
STEPS, GROWTH, START = 5, 1.03, 0.3  # of such a fit, of a size for its derivative, and share of the largest size
SETTLED = 0.01  # relative change of the distance with which a fit ends
DRAWS = 3  # of a rival's other values
TONES: Mapping[str, int] = {  # and the value that turns their phase
    "runout": at.RUNOUT_PHASE,
    "unbalance": at.ANGLE,
    "pickup": at.MAINS_PHASE,
    "foreign_vibration": at.SHAKE_PHASE,
}
PURE = (at.RUNOUT_SHAPE, at.MAINS_SHAPE)  # values of a tone that are 0 where it has no harmonics
_ROLES = ((at.BODY, at.MOUNT), (at.BODY_DAMPING, at.MOUNT_DAMPING), (at.MAINS, at.SHAKE_FREQUENCY))

Values = Mapping[int, float]


def _middle(d: np.ndarray) -> np.ndarray:
    """The mean of the estimates of a difference (1, n)."""
    return d.mean(axis=0, keepdims=True)


def _product(one: np.ndarray, other: np.ndarray) -> float:
    """Inner product of differences as `Detector.with_effects` gives them, (1, n) or (2, n) each.

    Where both have two estimates, their errors do not add to it.
    """
    return 0.5 * float(one[0] @ other[-1] + one[-1] @ other[0])


def _distance(left: np.ndarray) -> float:
    """Squared distance of what is left of a difference, and two standard errors where it is known by two estimates.

    Chance therefore makes no rival. Of a product of values m + e and m + e', the variance 2 m^2 s^2 + s^4 is, in the
    mean, the square of their mean times that of their difference.
    """
    error = np.linalg.norm(left.mean(axis=0) * (left[0] - left[-1]))
    return _product(left, left) + 2 * float(error)


class _Metric:
    """Inner products of whitened differences that calibration, and some directions, cannot take up."""

    def __init__(self, detector: Detector, free: Sequence[np.ndarray] = ()):
        self.detector, self.free = detector, None
        if free:
            self.free = np.linalg.qr(np.concatenate([self.left(_middle(f)) for f in free]).T)[0].T

    def left(self, d: np.ndarray) -> np.ndarray:
        """What is left of a difference (1 or 2, values + parameters): its product with itself is the distance."""
        found = np.concatenate(self.detector.calibrated(d), axis=1)
        return found if self.free is None else found - (found @ self.free.T) @ self.free


def rivals(detector: Detector, found: Mapping[str, Values], seed: int) -> list[dict]:
    """Explanations other than the truth that are not rejected: {"effects": names, "distance": squared}, nearest first.

    A method has all recordings. More of them only move explanations further away, so the holdout is asked of those that
    the recordings to fit do not reject.

    Args:
        detector: Of the recordings of the campaign that are to be fitted.
        found: Values of the true effects by name.
        seed: Draws values of rivals that the truth does not state.

    Returns:
        The rivals; ["none"] stands for no effect at all.
    """
    kept = _distances(detector, found, seed) if found else {}
    if kept:
        kept = _distances(detector.of_all_recordings(), found, seed, kept)
    return [{"effects": [*n], "distance": d} for n, d in sorted(kept.items(), key=lambda item: item[1])]


def _distances(
    detector: Detector, found: Mapping[str, Values], seed: int, only: Collection[tuple[str, ...]] | None = None
) -> dict[tuple[str, ...], float]:
    """Squared distance of each explanation that a detector does not reject, by its sorted names.

    Args:
        detector: Of the campaign.
        found: Values of the true effects by name.
        seed: As of `rivals`.
        only: The explanations that are asked for; None: all.
    """
    together = _sum(found.values())
    truth = detector.with_effects(together)
    alone = {name: detector.with_effects(values) for name, values in found.items()} if len(found) > 1 else {}
    metrics = {(): _Metric(detector), **{(name,): _Metric(detector, [d]) for name, d in alone.items()}}
    targets = {beside: metric.left(truth) for beside, metric in metrics.items()}
    own = {beside: [_Part.of(detector, name, found[name]) for name in beside] for beside in metrics}
    names = [n for n in known_on(detector.truth.rig.family) if only is None or any(n in one for one in only)]

    def asked(name: str, beside: tuple[str, ...]) -> bool:
        key = tuple(sorted({name, *beside}))
        return name not in beside and key != tuple(sorted(found)) and (only is None or key in only)

    near: dict[tuple[str, ...], tuple[float, list[_Part]]] = {}
    for beside, target in targets.items():
        near[beside or ("none",)] = _distance(target), own[beside]
    for name in names:
        if name in TONES and not set(found) & set(TONES):
            continue
        besides = [beside for beside in metrics if asked(name, beside)]
        # Each name has its own draws, so that they are the same whatever else is asked for.
        rng = np.random.default_rng([seed, 7, list(VOCABULARY).index(name)])
        for curve in _curves(detector, name, together, truth, rng) if besides else []:
            for beside in besides:
                left = [(metrics[beside].left(d), p) for d, p in curve]
                distance, part = _nearest(targets[beside], left, name in TONES)
                key = tuple(sorted({name, *beside}))
                if distance < near.get(key, (np.inf,))[0]:
                    near[key] = distance, [*own[beside], *([part] if part else [])]
    near = {key: value for key, value in near.items() if only is None or key in only}
    nearest = sorted(near.items(), key=lambda item: item[1][0])[:REFINED]
    fitted = [(min(least, _refined(detector, truth, parts)), key) for key, (least, parts) in nearest]
    # Changes of parameters are too large for a linear calibration to rank them, and so gentle that a fit finds them.
    for name in names:
        kind = VOCABULARY[name]
        if kind.value in NOMINAL and name not in found:
            for beside, parts in own.items():
                if asked(name, beside):
                    starts = ([*parts, _Part(kind, sign * START * kind.most, {})] for sign in (1.0, -1.0))
                    least = min(_refined(detector, truth, start) for start in starts)
                    fitted.append((least, tuple(sorted({name, *beside}))))
    return {key: least for least, key in sorted(fitted, reverse=True) if least < REJECTED}


@dataclass(frozen=True)
class _Part:
    """One effect of an explanation: its kind, its size with its sign, and its other values."""

    kind: Kind
    size: float
    others: Values

    @staticmethod
    def of(detector: Detector, name: str, values: Values) -> "_Part":
        kind = VOCABULARY[name]
        ratio = values[kind.value] / kind.scale(detector.truth.rig)
        others = {index: value for index, value in values.items() if index != kind.value}
        return _Part(kind, 1 / ratio if kind.inverse else ratio, others)

    def grown(self, factor: float) -> "_Part":
        size = float(np.clip(self.size * factor, -self.kind.most, self.kind.most))
        return replace(self, size=size)


def _refined(detector: Detector, truth: np.ndarray, parts: Sequence[_Part]) -> float:
    """Squared distance after the sizes of an explanation and the calibration are fitted with the loop as it is."""
    rig, rows = detector.truth.rig, detector.calibration
    theta, least, found = np.zeros(len(rows)), np.inf, np.inf

    def shown(some: Sequence[_Part], most: int = 2) -> np.ndarray:
        values = _sum(p.kind.values(rig, p.size, p.others) for p in some)
        return detector.with_effects(values, theta, most)

    try:
        for _ in range(STEPS):
            d = shown(parts)
            rest = truth - d
            before, found = found, _distance(rest) + float(theta @ theta)
            least = min(least, found)
            if abs(before - found) < SETTLED * found:
                break
            grown = [shown([*parts[:n], p.grown(GROWTH), *parts[n + 1 :]], 1) - d[:1] for n, p in enumerate(parts)]
            columns, rest = np.vstack([rows, *(g / (GROWTH - 1) for g in grown)]), rest.mean(axis=0)
            prior = np.concatenate([np.ones(len(theta)), np.full(len(parts), 1e-9)])
            step = np.linalg.solve(
                columns @ columns.T + np.diag(prior), columns @ rest - np.concatenate([theta, np.zeros(len(parts))])
            )
            theta = theta + step[: len(theta)]
            parts = [p.grown(1 + float(np.clip(s, -0.6, 1.5))) for p, s in zip(parts, step[len(theta) :], strict=True)]
    except LoopFailed:
        pass
    return least


def _sum(parts) -> dict[int, float]:
    total: dict[int, float] = {}
    for values in parts:
        for index, value in values.items():
            total[index] = total.get(index, 0.0) + value
    return total


def _curves(
    detector: Detector, name: str, true: Values, truth: np.ndarray, rng: np.random.Generator
) -> Iterator[list[tuple[np.ndarray, _Part]]]:
    """Differences that a kind makes: for each choice of its other values, along its size; of a tone two phases."""
    kind, rig = VOCABULARY[name], detector.truth.rig
    metric = _Metric(detector)
    target = metric.left(truth)
    # Of what chance has a part in, noise may take more than there is.
    total, chance = max(_distance(target), 0.0), not (RANDOM | ROUGH).isdisjoint({kind.value})
    for others in _choices(detector, name, kind, true, rng):
        try:
            if name in TONES:
                turned = {**others, TONES[name]: others.get(TONES[name], 0.0) + 0.5 * pi}
                tones = [_Part(kind, 0.1 * kind.most, o) for o in (others, turned)]
                yield [(detector.with_effects(kind.values(rig, p.size, p.others)), p) for p in tones]
                continue
            size, sign = 0.2 * kind.most, 1.0
            for _ in range(3):  # towards the strength of the truth
                one = metric.left(detector.with_effects(kind.values(rig, sign * size, others), most=1))
                strength, along = _product(one, one), _product(one, target)
                if kind.signed and along < 0:
                    sign = -sign
                wanted = size * sqrt(total / max(strength, 1e-12))
                if 0.7 < wanted / size < 1.4:
                    break
                size = min(max(wanted, size / 30, 1e-5), size * 30, kind.most)
            if along**2 < ALIKE * strength * total:
                continue
        except LoopFailed:
            continue
        curve = []
        for share in FEW_SIZES if chance else SIZES:
            if share * size <= kind.most:
                part = _Part(kind, sign * share * size, others)
                try:
                    curve.append((detector.with_effects(kind.values(rig, part.size, others)), part))
                except LoopFailed:
                    break
        yield curve


def _choices(
    detector: Detector, name: str, kind: Kind, true: Values, rng: np.random.Generator
) -> Iterator[dict[int, float]]:
    """Other values of a kind: as the truth has them where it has such, and drawn ones."""
    drawn = [{i: float(v) for i, v in kind.others(detector.truth.rig, rng).items()} for _ in range(DRAWS)]
    known: dict[int, float] = {}
    for index in drawn[0]:
        like = next((role for role in _ROLES if index in role), (index,))
        for other in like:
            known[index] = true.get(other, known.get(index, drawn[0][index]))
    if known or not drawn[0]:
        yield {**drawn[0], **known}
    if name in TONES:
        # No method knows that all runouts of this generator have harmonics: one without is a rival, too.
        for speed in {r.speed for r in detector.recordings if r.speed}:
            turning = {index: speed / (2 * pi) for index in _ROLES[2] if index in drawn[0]}
            for pure in ({}, {index: 0.0 for index in PURE if index in drawn[0]}):
                yield {**drawn[0], **turning, **pure}
    elif drawn[0]:
        yield from drawn


def _nearest(target: np.ndarray, curve: Sequence[tuple[np.ndarray, _Part]], plane: bool) -> tuple[float, _Part | None]:
    """Squared distance of a target from a plane, or from a polygon that begins at zero, and the part at its corner."""
    if plane:
        basis = np.linalg.qr(np.concatenate([_middle(d) for d, _ in curve]).T)[0]
        rest = target - (target @ basis) @ basis.T
        return _distance(rest), None
    least, nearest, before = _distance(target), None, np.zeros_like(target)
    for point, part in curve:
        step = point - before
        share = min(max(_product(step, target - before) / max(_product(step, step), 1e-12), 0.0), 1.0)
        rest = target - before - share * step
        if (found := _distance(rest)) < least:
            least, nearest = found, part
        before = point
    return least, nearest
