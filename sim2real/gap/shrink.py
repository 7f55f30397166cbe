"""How far the gap shrinks on recordings that no fit has used: in units of the noise, and in engineering quantities."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim2real.compared.point import NOMINAL
from sim2real.compared.problem import Part, Problem
from sim2real.gap.fit_figures import Figures, figures
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fit import Fit, inverse, real_product
from sim2real.search.fitting import begin, differentiate

REFIT = "refit all parameters"  # the foil that names nothing
RESAMPLES = 400
SURE = 0.9  # of the gap before: how far its 95 % interval may reach down for a share that is closed
CLEAR = 2.0  # times the noise from which on a gap is none of it, in however few lines it lies
LOST_SD = 2.0  # standard deviations beyond which one simulation is worse than another
GROWS = 1.05  # times the gap of the nominal rig from which on a corrected one is worse
BLOCK = 8  # neighbouring residuals drawn together, because what remains is similar on neighbouring lines


@dataclass(frozen=True)
class Words:
    """Engineering quantities of a loop, nan where the lines do not determine them.

    Attributes:
        stiffness: In the rig's target band, N/m.
        damping: In the rig's target band, N s/m.
        peak_sensitivity: Largest |S|.
    """

    stiffness: float
    damping: float
    peak_sensitivity: float


@dataclass(frozen=True)
class Gap:
    """The gap sqrt(cost / n), in units of the noise; None where the rotor touches down.

    Attributes:
        before: Gap of the nominal rig.
        calibrated: Gap after calibration alone.
        after: Gap of the corrected rig.
        floor: Gap of the noise alone.
        closed_fraction: Share of the excess before that is closed; None where the nominal rig does not levitate.
        closed_fraction_ci: Its 95 % interval.
        judged_on: "holdout" or "held-out lines".
        words: Engineering quantities of the judged recordings: "measured", "before" and "after".
        foils: Gap after refitting every parameter without a prior, and with another effect, for comparison.
        figures: How well the corrected rig simulates the judged recordings; None where it touches down.
    """

    before: float | None
    calibrated: float | None
    after: float | None
    floor: float
    closed_fraction: float | None
    closed_fraction_ci: tuple[float, float] | None
    judged_on: str
    words: Mapping[str, Words]
    foils: Mapping[str, float | None]
    figures: Figures | None = None

    @property
    def grows(self) -> bool:
        """Whether the corrected rig is farther from what judges than the nominal one is."""
        return self.before is not None and (self.after is None or self.after > GROWS * self.before)


def shrink(judged: Problem, attribution: Attribution, chosen: Candidate | None, held_out: str, seed: int) -> Gap:
    """Judge a chosen hypothesis on recordings that no fit has used.

    Args:
        judged: The recordings to judge on.
        attribution: The fitted candidates.
        chosen: The chosen candidate; None judges calibration alone.
        held_out: What is judged on, "holdout" or "held-out lines".
        seed: Seed of the foil and of the bootstrap.
    """
    chosen = chosen if chosen is not None else attribution.calibration
    other = _another(attribution, chosen, seed)
    refitted = attribution.refitted
    fits = [chosen.fit, attribution.calibration.fit, refitted, other]
    points = [NOMINAL] + [f.hypothesis.point(f.u) if f is not None else NOMINAL for f in fits]
    residuals = judged.data - judged.simulate(points)
    before, after, calibrated, refit, foil = residuals
    for known, r in ((attribution.calibration.fit, calibrated), (refitted, refit), (other, foil), (chosen.fit, after)):
        if known is None or not np.isfinite(known.cost):
            r[:] = np.nan
    fraction, interval = closed(before, after, seed)
    words = {"measured": _words(judged, None), "before": _words(judged, before), "after": _words(judged, after)}
    return Gap(
        gap_of(before),
        gap_of(calibrated),
        gap_of(after),
        1.0,
        fraction,
        interval,
        held_out,
        words,
        {REFIT: gap_of(refit), "another effect": gap_of(foil)},
        figures(judged, after),
    )


def gap_of(residual: np.ndarray) -> float | None:
    """The gap sqrt(cost / n) of a whitened residual; None where the rotor touches down."""
    size = float(np.mean(abs(residual) ** 2) / 2)
    return float(np.sqrt(size)) if np.isfinite(size) else None


def closed(before: np.ndarray, after: np.ndarray, seed: int) -> tuple[float | None, tuple[float, float] | None]:
    """Closed share of the gap, 1 - (V_after - n) / (V_before - n), with a 95 % block-bootstrap interval.

    The blocks are neighbouring residuals. A little less than the noise may be left by chance, but no share is more than
    all of the gap. The share is None where the rotor touches down before or after, because there is then no gap to
    compare with. It is also None where the gap to close is not known to within SURE of its size, or where less than the
    noise is left, unless the gap is CLEAR times the noise. A gap in few lines is then no chance, and the interval of
    the share is that of what is left. Where less than the noise is left, which was then assumed too large, the lower
    end of the interval is that of no noise at all.
    """
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        return None, None
    powers = [np.add.reduceat(abs(r) ** 2, np.arange(0, r.size, BLOCK)) for r in (before, after)]
    noise = 2.0 * np.diff([*np.arange(0, before.size, BLOCK), before.size])
    b, a = (power - noise for power in powers)
    total, left, scatter = b.sum(), a.sum(), 4.0 * np.sqrt(4.0 * before.size)
    clear = powers[0].sum() > CLEAR**2 * noise.sum()
    if total < scatter or (left < -scatter and not clear):
        return None, None  # there was no gap, or the noise is smaller than was assumed
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, b.size, (RESAMPLES, b.size))
    share = min(1.0, float(1 - left / total))
    if left < -scatter:
        return share, (float(1 - np.quantile(powers[1][drawn].sum(axis=1), 0.975) / powers[0].sum()), 1.0)
    of_gap, of_left = b[drawn].sum(axis=1), a[drawn].sum(axis=1)
    if np.quantile(of_gap, 0.025) < (1 - SURE) * total:
        if not clear:
            return None, None  # the gap may be noise alone, of which no share can be stated
        of_gap = np.full(RESAMPLES, total)
    lo, hi = np.minimum(np.quantile(1 - of_left / np.maximum(of_gap, 1e-9), [0.025, 0.975]), 1.0)
    return share, (float(min(lo, share)), float(max(hi, share)))


def lost(calibrated: np.ndarray, after: np.ndarray) -> float:
    """Cost by which the second of two simulations is worse on the same lines; 0 where scatter alone may make it so.

    Args:
        calibrated: Residuals (n,) of the first.
        after: Of the second.
    """
    if not (np.isfinite(calibrated).all() and np.isfinite(after).all()):
        return 0.0
    more = abs(after) ** 2 - abs(calibrated) ** 2
    blocks = np.add.reduceat(more, np.arange(0, more.size, BLOCK))
    return float(more.sum()) if more.sum() > LOST_SD * blocks.std() * np.sqrt(blocks.size) else 0.0


def left_on(judged: Problem, fit: Fit) -> float:
    """Least cost of recordings where the parameters of a fit may move as far as the fitted recordings leave open.

    To first order; what the fitted recordings lose by it counts.

    Args:
        judged: The recordings.
        fit: A fit of other recordings.

    Returns:
        Cost, about 2 for each complex value where noise alone is left; inf where the rotor touches down.
    """
    (there,) = begin([fit.hypothesis], [fit.u], judged.data, judged.simulate)
    if fit.jacobian is None or not np.isfinite(there.residual).all():
        return np.inf
    differentiate([there], judged.data, judged.simulate, calibrations=True)
    pulled = real_product(there.jacobian, there.residual)
    both = real_product(there.jacobian, there.jacobian) + fit.normal
    return float(np.vdot(there.residual, there.residual).real - pulled @ inverse(both) @ pulled)


def _another(attribution: Attribution, chosen: Candidate, seed: int) -> Fit | None:
    """Another single effect, drawn with the seed."""
    others = [
        c.fit
        for c in attribution.candidates
        if len(c.effects) == 1 and c.effects[0] not in chosen.effects and np.isfinite(c.fit.cost)
    ]
    return others[np.random.default_rng(seed).integers(len(others))] if others else None


def _words(problem: Problem, residual: np.ndarray | None) -> Words:
    """Averages over the judged recordings that have a period.

    Args:
        problem: The recordings.
        residual: Residual of a simulation; None for the measured quantities.
    """
    periodic = [p for p in problem.parts if p.record.axes == 1 and not isinstance(p.record, OpenRecord)]
    found = [_of_part(part, residual) for part in periodic]
    if not found:
        return Words(np.nan, np.nan, np.nan)
    with np.errstate(all="ignore"):
        values = np.array(found, float)
        means = [float(np.mean(c[np.isfinite(c)])) if np.isfinite(c).any() else float("nan") for c in values.T]
    return Words(*means)


def _of_part(part: Part, residual: np.ndarray | None) -> tuple[float, float, float]:
    """Stiffness, damping and peak sensitivity of a one-axis part."""
    if residual is not None and not np.isfinite(residual[part.place]).all():
        return np.nan, np.nan, np.nan  # the rotor touched down
    record, used, opened = part.record, part.used, part.opened
    whole = part.measured.copy()
    if residual is not None:
        shaped = residual[part.place].reshape(*part.measured.shape[:2], -1)
        whole[..., used] -= shaped * part.noise[..., used] / np.sqrt(2)
    displacement, controller = opened.displacement(whole)[0, used], opened.of_injection[0, used]
    kinds, frequency = {name: on[0, used] for name, on in record.driven.items()}, record.frequency[used]
    stiffness = damping = peak = np.nan
    rig = record.nominal
    wave = record.driving("force")[0, used]
    lo, hi = rig.target.band
    on = kinds["force"] & (frequency >= lo) & (frequency <= hi)
    if on.sum() >= 3:
        omega = 2 * np.pi * frequency[on]
        dynamic = wave[on] / np.where(displacement[on] == 0, np.nan, displacement[on])
        weight = abs(displacement[on]) ** 2
        stiffness = float(np.average(dynamic.real + rig.mass * omega**2, weights=weight))
        damping = float((weight * dynamic.imag * omega).sum() / (weight * omega**2).sum())
    injection = record.driving("current")[0, used]
    on = kinds["current"]
    if on.sum() >= 3:
        peak = float(np.max(abs(1 - controller[on] * displacement[on] / injection[on])))
    return stiffness, damping, peak


def errors(gap: Gap, name: str) -> dict[str, float | None]:
    """Relative error of one of `Words` before and after; None where it is not known."""
    measured = getattr(gap.words["measured"], name)
    found = {}
    for when in ("before", "after"):
        off = getattr(gap.words[when], name) / measured - 1 if measured else float("nan")
        found[when] = float(off) if np.isfinite(off) else None
    return found
