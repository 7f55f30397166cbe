"""What to measure next: the recording of a menu that best separates the remaining candidates for its effort."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from sim2real.advice.recording_menu import Item, menu
from sim2real.compared.point import Point
from sim2real.compared.problem import Part
from sim2real.compared.simulated import Predictor, predictor
from sim2real.judgement.judge import Entry
from sim2real.judgement.verdict import CLASS_SHARE, alternatives, with_effects
from sim2real.recorded.open_evidence import Replay, opened_of
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.opened import opened_loop, stated_noise
from sim2real.recorded.records import Record
from sim2real.search.candidates import Attribution
from sim2real.search.fit import Fit
from sim2real.search.fitting import CALIBRATION_STEP, STEP, aside, differentiate

REMAINING = 4  # candidates to be separated
SEPARATED = 4.7  # cost between two candidates below which they count as alike (a likelihood ratio of about ten)
ENOUGH = 25.0  # separation above which more effort is not worthwhile
TURNING = {"runout", "unbalance"}  # alike at one speed of rotation


@dataclass(frozen=True)
class Proposal:
    """A proposed recording.

    Attributes:
        what: What to record.
        why: The reason.
        expected_separation: Cost (-2 ln likelihood ratio) between the two candidates that it separates least; None
            where it is not computed, as of another speed.
        table: Every item of the menu with its separation.
        change: What differs from the first recording: "amplitude" (factor), "offset" (m), "gains" (factors on kp and
            kd), "excitation" (at, lines and peak, N or A; these lines are no longer driven otherwise; or, beside what
            never repeats, frequencies in Hz in place of lines), "channels" (recorded in addition), "speed" (another
            one).
    """

    what: str
    why: str
    expected_separation: float | None
    table: tuple[tuple[str, float], ...]
    change: Mapping[str, Any]

    def to_json(self) -> dict[str, Any]:
        return {
            "what": self.what,
            "why": self.why,
            "expected_separation": self.expected_separation,
            "change": dict(self.change),
            "menu": [{"what": what, "expected_separation": value} for what, value in self.table],
        }


OTHER_SPEED = Proposal(
    "the same recording at another speed of rotation",
    "a force of unbalance grows with the square of the speed, a runout reads the same",
    None,
    (),
    {"speed": True},
)


def propose(attribution: Attribution, found: Sequence[Entry]) -> Proposal | None:
    """The most useful next recording; None where one candidate is left and nothing is unknown."""
    alike = [set(e.effects) for e in alternatives([e for e in with_effects(found) if e.probability > 0])]
    turning = set().union(*alike) >= TURNING
    if turning and all(names - TURNING == alike[0] - TURNING for names in alike):
        return OTHER_SPEED  # they differ in nothing else
    return _between(attribution, found) or (OTHER_SPEED if turning else None)


def _between(attribution: Attribution, found: Sequence[Entry]) -> Proposal | None:
    """The recording that best separates the fits of what is left; None with fewer than two, or where none does."""
    likely: list[Fit] = []
    best = max((e.probability for e in found if e.candidate), default=0.0)
    for e in found:
        if e.probability == 0 or (len(likely) >= 2 and e.probability < CLASS_SHARE * best):
            break  # what is refuted or already separated needs no further recording
        fit = attribution.candidates[e.candidate].fit if e.candidate else None
        # The same effects with a superfluous one added are not a rival hypothesis.
        if fit and not any(set(fit.hypothesis.effects) >= set(f.hypothesis.effects) for f in likely):
            likely.append(fit)
    fits = likely[:REMAINING]
    if len(fits) < 2:
        return None
    p, parts = attribution.problem, attribution.problem.parts
    differentiate([f for f in fits if f.jacobian is None], p.data, p.simulate, True)  # far behind, and only simulated
    base = next((part for part in parts if isinstance(part.record, Record)), attribution.problem.loudest)
    items = [i for i in menu(base.record) if i.outputs]
    table = [(item, _separation(item, base, fits)) for item in items]
    table = [row for row in table if np.isfinite(row[1][0])]
    if not table:
        return None
    # Choose the least effort that certainly separates them; where none does, the most separation per effort.
    sure = [row for row in table if row[1][0] >= ENOUGH]
    pick = min(sure, key=lambda row: row[0].effort) if sure else max(table, key=lambda row: row[1][0] / row[0].effort)
    chosen, (value, pair) = pick
    names = " from ".join("+".join(f.hypothesis.effects) for f in pair)
    told = "tells" if value > SEPARATED else "does not surely tell"
    ordered = sorted(((i.what, v) for i, (v, _) in table), key=lambda row: -row[1])
    return Proposal(chosen.what, f"it {told} {names}", value, tuple(ordered), chosen.change)


def _look(item: Item, base: Part) -> tuple[Predictor, np.ndarray]:
    """What predicts a recording of the menu, and the weights of its residuals (outputs, axes, n).

    What the recording that was made shows is expected to be as noisy again, another output of the protocol as the rig
    states it; where it states no noise, its weights are infinite.
    """
    if isinstance(item.record, OpenRecord):
        loop = nominal_loop(item.record)
        predict = Predictor(item.record, opened_of(loop), 0, Replay(item.record, loop, item.outputs))
        return predict, np.sqrt(2) / base.noise * base.used
    opened = replace(opened_loop(item.record), outputs=item.outputs)
    noise = np.sqrt(stated_noise(item.record, opened) / item.record.count)
    for at, name in enumerate(opened.outputs):
        if name in base.opened.outputs:
            noise[at] = base.noise[base.opened.outputs.index(name)]
    weights = np.sqrt(2) / np.where(noise > 0, noise, 1.0)
    return predictor(item.record, opened), np.where(noise > 0, weights, np.inf)


def _separation(item: Item, base: Part, fits: Sequence[Fit]) -> tuple[float, tuple[Fit, ...]]:
    """Smallest cost by which any two candidates differ in a recording, and these two in the order of the fits; -inf
    where one of them touches down in it, or where nothing says how noisy it would be.

    The other candidate is refitted to the old and the new recordings together.
    """
    predict, weights = _look(item, base)
    if not np.isfinite(weights).all():
        return -np.inf, ()
    points: list[Point] = []
    steps = []
    for fit in fits:
        points.append(fit.hypothesis.point(fit.u))
        own = np.where(fit.prior > 0, CALIBRATION_STEP, np.maximum(STEP, STEP * abs(fit.u)))
        moved = [aside(fit, i, step) for i, step in enumerate(own)]
        steps.append(np.array([v[i] - fit.u[i] for i, v in enumerate(moved)]))
        points += [fit.hypothesis.point(v) for v in moved]
    predicted = (predict.smoothed(points) * weights).reshape(len(points), -1)
    at, found = 0, []
    for fit, own in zip(fits, steps, strict=True):
        rows = predicted[at : at + 1 + fit.hypothesis.size]
        found.append((rows[0], (rows[1:] - rows[0]) / np.where(own == 0, np.inf, own)[:, None]))  # 0: it is held
        at += len(rows)
    worst: tuple[float, tuple[Fit, ...]] = np.inf, ()
    for i, j in permutations(range(len(fits)), 2):
        change, jacobian = found[i][0] - found[j][0], found[j][1]
        if not (np.isfinite(change).all() and np.isfinite(jacobian).all()):
            return -np.inf, ()
        cross = (jacobian @ change.conj()).real
        normal = fits[j].normal + (jacobian @ jacobian.conj().T).real
        if not np.isfinite(normal).all():  # a candidate without a bounded fit separates nothing
            return -np.inf, ()
        value = np.vdot(change, change).real - cross @ np.linalg.pinv(normal, hermitian=True) @ cross
        if value < worst[0]:
            worst = float(value), (fits[min(i, j)], fits[max(i, j)])
    return worst
