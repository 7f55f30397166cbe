"""Attribution of a gap under the noise that its best explanation leaves.

How loud the noise of a recording without a period is shows only when a good simulation is subtracted. So the hypotheses
are fitted again, once or twice, where the best of them leaves another noise than was assumed; those that are so far
behind that no noise makes them probable keep the parameters that they had.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from estimation.lines.tones import Tone
from sim2real.compared.bench_noise import BenchNoise
from sim2real.compared.open_tones import toned
from sim2real.compared.problem import Problem
from sim2real.compared.stated_noise import STATED, louder_than_stated
from sim2real.compared.tones_left import resolution_of
from sim2real.judgement.belief import Judge
from sim2real.judgement.evidence import evidence_of
from sim2real.judgement.judge import reach
from sim2real.judgement.nonstationary import widening
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import Record
from sim2real.recorded.tones import origin
from sim2real.search.attribute import attribute
from sim2real.search.candidates import NO_GAP, Attribution
from sim2real.search.fit import Fit
from sim2real.search.fitting import differentiate
from sim2real.search.hypotheses import RESONANCES
from sim2real.search.pairs import saved_by_second

LOUDER = 1.05  # times its noise that a record without a period may seem to have under a wrong simulation
MARGIN = 2.0  # times the cost that makes a candidate hopeless: what another noise and a refit may change of it
QUIETER = 1.5  # times by which noise may have been taken too large
SEARCHED = 1.3  # times the stated noise from which on pairs are looked for under that


class Settled(NamedTuple):
    """Problems and attribution under the noise that the best fit leaves.

    Attributes:
        fitted: What is fitted.
        judged: What the gap is judged on.
        attribution: Of what is fitted.
        again: What is fitted, under the noise that the last best fit leaves, where that is hardly another one.
        louder: How many times as loud that noise is taken as it looks.
    """

    fitted: Problem
    judged: Problem
    attribution: Attribution
    again: Problem
    louder: float


def attributed(
    records: Sequence[Record | OpenRecord],
    fitted: Problem,
    judged: Problem,
    bench: BenchNoise,
    progress: Callable[[str], None],
) -> tuple[Problem, Problem, Attribution, list[str]]:
    """Attribute the gap; of recordings without a period, under the noise that the best explanation leaves.

    Args:
        records: of the campaign.
        fitted: what is fitted.
        judged: what the gap is judged on.
        bench: the noise that recordings with a period show.
        progress: called with the name of each step.

    Returns:
        Both problems with that noise, the attribution, and notes.

    Raises:
        ValueError: As `attribute`.
    """
    attribution = attribute(fitted, progress)
    if not any(isinstance(r, OpenRecord) for r in records):
        return fitted, judged, attribution, []
    settled = _settled(fitted, judged, attribution, progress)
    if (instead := _as_quiet_as_stated(settled, bench, progress)) is not None:
        settled = instead
    if (instead := _with_tones_for_modes(settled, progress)) is not None:
        settled = instead
    fitted, judged, attribution, again, louder = settled
    notes = []
    if bounded := [p.record.name for p in again.parts if bench.reached(p.record, p.opened.outputs, p.noise)]:
        notes.append(
            f"{', '.join(bounded)}: what is left exceeds the noise that the recordings with a period show; it is "
            "taken for a gap, not for noise"
        )
    elif louder > LOUDER:
        notes.append(
            f"errors at single moments, as at steps or kicks: the noise is taken as {louder:.2g} times as large as "
            "it looks"
        )
    return fitted, judged, attribution, notes


def _settled(fitted: Problem, judged: Problem, attribution: Attribution, progress: Callable[[str], None]) -> Settled:
    """Fit again, once or twice, under the noise that the best fit leaves."""
    again, judged, louder = _with_noise_of_best(fitted, judged, attribution)
    if _other_noise(fitted, again) or _other_nuisances(fitted, again):
        fitted, attribution = again, attribute(again, progress, attribution, _reach(attribution))
        # What the first fits could not simulate may have been taken for noise that the later ones do not leave.
        again, later, less = _with_noise_of_best(fitted, judged, attribution)
        if _quieter(fitted, again):
            judged, louder = later, less
            fitted, attribution = again, attribute(again, progress, attribution, _reach(attribution))
        else:
            again = fitted
    return Settled(fitted, judged, attribution, again, louder)


def _reach(attribution: Attribution) -> np.ndarray:
    """Cost above the best within which each candidate may still matter under another noise."""
    # By the constants of the code, so that evidence does not depend on the judge that learns from it.
    return MARGIN * reach(evidence_of(attribution, {}, {}, {}), Judge())


def _with_noise_of_best(fitted: Problem, judged: Problem, attribution: Attribution) -> tuple[Problem, Problem, float]:
    """Both problems with the noise and the tones that the best fit leaves, and how many times as loud that noise is
    taken as it looks.

    A tone that stands far above the noise may be hidden by what the nominal simulation leaves of its window.
    """
    best = attribution.best.fit
    # What only a further effect is uncertain by, which explains hardly more, is no noise of the rest.
    plain = attribution.simplest.fit
    for fit in (best, plain):
        if fit.jacobian is None:  # it was far behind before, and only simulated
            differentiate([fit], fitted.data, fitted.simulate, True)
    louder = float(widening(fitted, plain).max(initial=1.0))
    return *_with_noise_of(fitted, judged, best, louder), louder


def _with_noise_of(fitted: Problem, judged: Problem, fit: Fit, louder: float = 1.0) -> tuple[Problem, Problem]:
    """Both problems with the noise and the tones that a fit leaves."""
    near = fit.hypothesis.point(fit.u)
    own = {p.record.name: p.record for p in (*fitted.parts, *judged.parts)}
    own = dict(zip(own, toned([*own.values()], near), strict=True))
    fitted, judged = (p.again(near, louder, [own[part.record.name] for part in p.parts]) for p in (fitted, judged))
    return fitted, judged


def _with_tones_for_modes(settled: Settled, progress: Callable[[str], None]) -> Settled | None:
    """The same with tones in place of the modes of the best fit, where these explain the recordings better; else None.

    A vibration from outside in the band of a drive looks like a mode that rings for ever, of which a fit makes a
    resonance before anybody looks for tones.
    """
    attribution = settled.attribution
    best = attribution.best
    modes = set(RESONANCES).intersection(best.effects)
    rest = attribution.of(*(name for name in best.effects if name not in modes))
    if not modes or rest is None or not np.isfinite(rest.fit.cost):
        return None
    fitted, judged = _with_noise_of(settled.fitted, settled.judged, rest.fit)
    if all(not _tones(part.record) for part in fitted.parts):
        return None
    found = attribute(fitted, progress, attribution, _reach(attribution))
    if _surprise(fitted, found) >= _surprise(settled.fitted, attribution):
        return None
    return _settled(fitted, judged, found, progress)


def _as_quiet_as_stated(settled: Settled, bench: BenchNoise, progress: Callable[[str], None]) -> Settled | None:
    """The same with the pairs that are found under the noise that the rig states, where these explain the recordings
    better under the noise that they leave; else None.

    What a second effect does in recordings that never repeat passes for noise beside the first one, under which no pair
    is promising. A rig that states too little noise only costs time: it is not what the pairs are judged by.
    """
    fitted, attribution = settled.fitted, settled.attribution
    noisy = [(part.record, part.opened.outputs, part.noise) for part in fitted.parts]
    if bench.shown or not louder_than_stated(noisy, SEARCHED):
        return None
    near, singles = attribution.best.fit, tuple(c for c in attribution.candidates if len(c.effects) < 2)
    quiet = replace(fitted, bench=STATED).again(near.hypothesis.point(near.u))
    found = attribute(quiet, progress, replace(attribution, candidates=singles))
    alone = [c.fit for c in found.candidates if len(c.effects) == 1]
    if not found.best.fit.cost < min((f.cost for f in alone), default=np.inf) - saved_by_second(quiet, alone):
        return None
    new = _settled(replace(quiet, bench=bench), settled.judged, found, progress)
    return new if _surprise(new.fitted, new.attribution) < _surprise(fitted, attribution) else None


def _tones(record: Record | OpenRecord) -> Sequence[Tone]:
    """Tones of a record without a period that neither the mains nor the rotation makes."""
    if not isinstance(record, OpenRecord):
        return ()
    spacing, speed = resolution_of(record), record.experiment.speed_rpm
    return [tone for tone in record.tones if origin(tone.frequency, speed, spacing) is None]


def _surprise(problem: Problem, attribution: Attribution) -> float:
    """-2 ln likelihood of the best candidate, with the noise that was told from what it leaves."""
    return attribution.best.predictive + 4.0 * float(sum(np.log(part.noise).sum() for part in problem.parts))


def _quieter(old: Problem, new: Problem) -> bool:
    """Whether the noise of a recording is less by more than QUIETER."""
    return any(np.median(a.noise / b.noise) > QUIETER for a, b in zip(old.parts, new.parts, strict=True))


def _other_noise(old: Problem, new: Problem) -> bool:
    """Whether the noise of a recording is another one by more than LOUDER."""
    ratios = [np.median(a.noise / b.noise) for a, b in zip(old.parts, new.parts, strict=True)]
    return bool(np.any(np.abs(np.log(ratios)) > np.log(LOUDER)))


def _other_nuisances(old: Problem, new: Problem) -> bool:
    """Whether a nuisance within its tolerance changes the data in another way than was taken, by what an effect might.

    Of a recording without a period that way is simulated, first on the nominal rig, which may be far off.
    """
    if old.nuisances.names != new.nuisances.names:
        return True
    # Along a direction that is taken out anyway, it does not matter by how much.
    apart = old.nuisances.without(new.nuisances.columns - old.nuisances.columns)
    return bool(np.any(np.linalg.norm(apart, axis=1) ** 2 > NO_GAP))
