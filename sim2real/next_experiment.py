"""What to measure next: the recording of a menu that best separates the remaining candidates for its effort."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from maglev_env.loop.gains import Gains, with_gains
from sim2real.attribute import Attribution
from sim2real.fitting import CALIBRATION_STEP, STEP, Fit
from sim2real.judge import CLASS_SHARE, Entry
from sim2real.recorded.opened import opened_loop, stated_noise
from sim2real.recorded.records import Record
from sim2real.simulated import Point, predictor

OFFSET, GAINS = 0.1, (0.8, 1.3)  # offset as a share of the gap; factors on kp and kd
REMAINING = 4  # candidates to be separated
SEPARATED = 4.7  # cost between two candidates below which they count as alike (a likelihood ratio of about ten)
ENOUGH = 25.0  # separation above which more effort is not worthwhile


@dataclass(frozen=True)
class Proposal:
    """A proposed recording.

    Attributes:
        what: What to record.
        why: The reason.
        expected_separation: Cost (-2 ln likelihood ratio) between the two candidates that it separates least.
        table: Every item of the menu with its separation.
        change: What differs from the first recording: "amplitude" (factor), "offset" (m), "gains" (factors on kp and
            kd), "excitation" (at, lines and peak, N or A; these lines are no longer driven otherwise), "channels"
            (recorded in addition), "speed" (another one).
    """

    what: str
    why: str
    expected_separation: float
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


@dataclass(frozen=True)
class _Item:
    what: str
    effort: float  # relative: 1 for a change of software, 2 of wiring, 3 of hardware
    record: Record
    outputs: tuple[str, ...]
    change: Mapping[str, Any]


def propose(attribution: Attribution, found: Sequence[Entry]) -> Proposal | None:
    """The most useful next recording; None where one candidate is left and nothing is unknown."""
    tones = {name for e in found[:REMAINING] for name in e.effects if name in ("runout", "unbalance")}
    if len(tones) == 2:
        return Proposal(
            "the same recording at another speed of rotation",
            "a force of unbalance grows with the square of the speed, a runout reads the same",
            ENOUGH,
            (),
            {"speed": True},
        )
    likely: list[Fit] = []
    best = max((e.probability for e in found if e.candidate), default=0.0)
    for e in found:
        if len(likely) >= 2 and e.probability < CLASS_SHARE * best:
            break  # candidates that are already separated need no further recording
        fit = attribution.candidates[e.candidate].fit if e.candidate else None
        # The same effects with a superfluous one added are not a rival hypothesis.
        if fit and not any(set(fit.hypothesis.effects) >= set(f.hypothesis.effects) for f in likely):
            likely.append(fit)
    fits = likely[:REMAINING]
    if len(fits) < 2:
        return None
    items = [i for i in menu(attribution.problem.parts[0].record) if i.outputs]
    table = [(item, _separation(item, fits)) for item in items]
    table = [(item, value) for item, value in table if np.isfinite(value)]
    if not table:
        return None
    # Choose the least effort that certainly separates them; where none does, the most separation per effort.
    sure = [row for row in table if row[1] >= ENOUGH]
    pick = min(sure, key=lambda row: row[0].effort) if sure else max(table, key=lambda row: row[1] / row[0].effort)
    chosen, value = pick
    names = " from ".join("+".join(f.hypothesis.effects) for f in fits[:2])
    told = "tells" if value > SEPARATED else "does not surely tell"
    ordered = sorted(((i.what, float(v)) for i, v in table), key=lambda row: -row[1])
    return Proposal(chosen.what, f"it {told} {names}", float(value), tuple(ordered), chosen.change)


def menu(base: Record) -> list[_Item]:
    """Recordings that could be made in addition to one that was made."""
    rig, has_current = base.nominal, "current" in base.periods
    outputs = ("plant", "amplifier") if has_current else ("plant",)
    items = [_Item("the same at twice the amplitude", 1.0, _scaled(base, 2.0), outputs, {"amplitude": 2.0})]
    if rig.controlled:
        if not has_current:
            beside = {"channels": ["current"]}
            items.append(_Item("the coil current beside the same channels", 2.0, base, ("plant", "amplifier"), beside))
        offset = OFFSET * rig.gap
        moved = replace(base, waves={**base.waves, "reference": base.waves["reference"] + offset})
        what = f"the same at a static offset of {OFFSET:.0%} of the gap, the reference recorded".replace("%", " %")
        items.append(_Item(what, 1.0, moved, outputs, {"offset": offset}))
        gains = base.experiment.gains
        if isinstance(gains, Gains):
            kp, kd = GAINS
            experiment = replace(base.experiment, gains=with_gains(gains, kp=kp * gains.kp, kd=kd * gains.kd))
            other = replace(base, experiment=experiment)
            items.append(_Item(f"the same with kp x {kp}, kd x {kd}", 1.0, other, outputs, {"gains": list(GAINS)}))
    peaks = {e.at: e.amplitude for e in rig.protocol.excitations} if rig.protocol else {}
    for place, effort, what in (
        ("force", 3.0, "a shaker's force beside the injection"),
        ("current", 1.0, "an injection into the current beside the force"),
    ):
        if place in peaks and not base.driven[place].any() and (rig.controlled or place == "force"):
            driven = _excited(base, place, peaks[place])
            lines = base.lines[driven.driven[place].any(axis=0)].tolist()
            added = {"excitation": {"at": place, "lines": lines, "peak": peaks[place]}}
            items.append(_Item(what, effort, driven, outputs, added))
    return items


def _scaled(base: Record, factor: float) -> Record:
    reference = base.waves["reference"]
    waves = {place: wave * factor for place, wave in base.waves.items() if place != "reference"}
    steady = reference.mean(axis=1, keepdims=True)
    return replace(base, waves={**waves, "reference": steady + factor * (reference - steady)})


def _excited(base: Record, place: str, peak: float) -> Record:
    """The record with a random-phase multisine on lines that nothing drives, odd ones if there are any.

    Where all lines are driven, every second one is taken over.
    """
    rng = np.random.default_rng(0)
    free = base.lines[~base.excited]
    lines = odd if (odd := free[free % 2 == 1]).size else free
    if not lines.size:
        lines = base.lines[base.excited][1::2]
    n = base.waves[place].shape[1]
    waves = {at: _without(wave, lines) if at != "reference" else wave for at, wave in base.waves.items()}
    spectrum = np.zeros((base.axes, n // 2 + 1), complex)
    spectrum[:, lines] = np.exp(2j * np.pi * rng.random((base.axes, lines.size)))
    wave = np.fft.irfft(spectrum, n, axis=1)
    wave *= peak / abs(wave).max()
    taken = np.isin(base.lines, lines)
    driven = {at: on & ~taken for at, on in base.driven.items()}
    driven[place] = np.repeat(taken[None], base.axes, axis=0)
    return replace(base, waves={**waves, place: wave}, driven=driven)


def _without(wave: np.ndarray, lines: np.ndarray) -> np.ndarray:
    spectrum = np.fft.rfft(wave, axis=1)
    spectrum[:, lines] = 0.0
    return np.fft.irfft(spectrum, wave.shape[1], axis=1)


def _separation(item: _Item, fits: Sequence[Fit]) -> float:
    """Smallest cost by which any two candidates differ in a recording; -inf where one of them touches down in it.

    The other candidate is refitted to the old and the new recordings together.
    """
    opened = replace(opened_loop(item.record), outputs=item.outputs)
    predict = predictor(item.record, opened)
    weights = np.sqrt(2 / stated_noise(item.record, opened) * item.record.count)
    points: list[Point] = []
    steps = []
    for fit in fits:
        points.append(fit.hypothesis.point(fit.u))
        own = np.where(fit.prior > 0, CALIBRATION_STEP, np.maximum(STEP, STEP * abs(fit.u)))
        steps.append(own)
        points += [fit.hypothesis.point(fit.hypothesis.bounded(fit.u + d)) for d in np.diag(own)]
    predicted = (predict(points) * weights).reshape(len(points), -1)
    at, found = 0, []
    for fit, own in zip(fits, steps, strict=True):
        rows = predicted[at : at + 1 + fit.hypothesis.size]
        found.append((rows[0], (rows[1:] - rows[0]) / own[:, None]))
        at += len(rows)
    worst = np.inf
    for i, j in permutations(range(len(fits)), 2):
        change, jacobian = found[i][0] - found[j][0], found[j][1]
        if not (np.isfinite(change).all() and np.isfinite(jacobian).all()):
            return -np.inf
        cross = (jacobian @ change.conj()).real
        normal = fits[j].normal + (jacobian @ jacobian.conj().T).real
        value = np.vdot(change, change).real - cross @ np.linalg.pinv(normal, hermitian=True) @ cross
        worst = min(worst, float(value))
    return worst
