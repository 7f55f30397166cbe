"""By how much candidates differ in a recording that was not made yet."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from sim2real.advice.recording_menu import Item
from sim2real.compared.point import Point
from sim2real.compared.problem import Part
from sim2real.compared.simulated import Predictor, predictor
from sim2real.recorded.open_evidence import Replay, opened_of
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import opened_loop, stated_noise
from sim2real.search.fit import Fit
from sim2real.search.fitting import CALIBRATION_STEP, STEP, aside


def look(item: Item, base: Part) -> tuple[Predictor, np.ndarray]:
    """What predicts a recording of the menu, and the weights of its residuals (outputs, axes, n).

    What the recording that was made shows is expected to be as noisy again, another output of the protocol as the rig
    states it; where it states no noise, its weights are infinite.
    """
    if isinstance(item.record, OpenRecord):
        loop = nominal_loop(item.record)
        predict = Predictor(item.record, opened_of(loop), 0, Replay(item.record, loop, item.outputs))
        stated = item.record.nominal.noise.current  # of the only output that the recording may not have
        known = _on_lines(base, base.noise, item.record.lines)
        noise = np.full((len(item.outputs), *known.shape[1:]), 2 * stated / np.sqrt(item.record.windows.samples))
        for at, name in enumerate(base.opened.outputs):
            noise[item.outputs.index(name)] = known[at]
        used = _on_lines(base, base.used, item.record.lines)
        return predict, np.where(noise > 0, np.sqrt(2) / np.where(noise > 0, noise, 1.0) * used, np.inf)
    opened = replace(opened_loop(item.record), outputs=item.outputs)
    noise = np.sqrt(stated_noise(item.record, opened) / item.record.count)
    for at, name in enumerate(opened.outputs):
        if name in base.opened.outputs:
            noise[at] = _on_lines(base, base.noise[base.opened.outputs.index(name)], item.record.lines)
    weights = np.sqrt(2) / np.where(noise > 0, noise, 1.0)
    return predictor(item.record, opened), np.where(noise > 0, weights, np.inf)


def _on_lines(base: Part, values: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Values (..., n) of a recording on the lines of one that reaches higher: there what the highest ones have."""
    at = np.searchsorted(base.record.lines, lines).clip(max=base.record.lines.size - 1)
    return values[..., at]


# Of each ordered pair of candidates: the squared change between them, what the other's parameters have of it (size,),
# and the normal matrix of these parameters (size, size).
Differences = Mapping[tuple[int, int], tuple[float, np.ndarray, np.ndarray]]


def differences(item: Item, base: Part, fits: Sequence[Fit]) -> Differences | None:
    """By how much candidates differ in a recording; None where one of them touches down in it, or where nothing says
    how noisy it would be.
    """
    predict, weights = look(item, base)
    if not np.isfinite(weights).all():
        return None
    points: list[Point] = []
    steps = []
    for fit in fits:
        points.append(fit.hypothesis.point(fit.u))
        own = np.where(fit.prior > 0, CALIBRATION_STEP, np.maximum(STEP, STEP * abs(fit.u)))
        moved = [aside(fit, i, step) for i, step in enumerate(own)]
        steps.append(np.array([v[i] - fit.u[i] for i, v in enumerate(moved)]))
        points += [fit.hypothesis.point(v) for v in moved]
    predicted = (predict.smoothed(points) * weights).reshape(len(points), -1)
    if not np.isfinite(predicted).all():
        return None
    at, rows = 0, []
    for fit, own in zip(fits, steps, strict=True):
        own_rows = predicted[at : at + 1 + fit.hypothesis.size]
        # A parameter with a step of 0 is held.
        rows.append((own_rows[0], (own_rows[1:] - own_rows[0]) / np.where(own == 0, np.inf, own)[:, None]))
        at += len(own_rows)
    found = {}
    for i, j in permutations(range(len(fits)), 2):
        change, jacobian = rows[i][0] - rows[j][0], rows[j][1]
        normal = (jacobian @ jacobian.conj().T).real
        found[i, j] = (np.vdot(change, change).real, (jacobian @ change.conj()).real, normal)
    return found


def longer(look: Differences, times: float) -> Differences:
    """By how much candidates differ in a recording that lasts so many times as long, under the same noise."""
    return {pair: (times * squared, times * cross, times * normal) for pair, (squared, cross, normal) in look.items()}


def separation(looks: Sequence[Differences], fits: Sequence[Fit]) -> tuple[float, tuple[Fit, ...]]:
    """Smallest cost by which any two candidates differ in new recordings, and these two in the order of the fits.

    The other candidate is refitted to the old and the new recordings together. -inf where it has no bounded fit.
    """
    worst: tuple[float, tuple[Fit, ...]] = np.inf, ()
    for i, j in looks[0]:
        squared, cross, normal = (sum(terms) for terms in zip(*(look[i, j] for look in looks), strict=True))
        normal = fits[j].normal + normal
        if not np.isfinite(normal).all():  # a candidate without a bounded fit separates nothing
            return -np.inf, ()
        value = squared - cross @ np.linalg.pinv(normal, hermitian=True) @ cross
        if value < worst[0]:
            worst = float(value), (fits[min(i, j)], fits[max(i, j)])
    return worst
