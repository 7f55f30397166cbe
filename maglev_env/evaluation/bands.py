"""Stiffness and damping over the bands of one recording, with what widens their intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estimation.band_mean import BandMean, band_mean
from estimation.bands import band_slices, sliding_bands
from estimation.effective import effective_coefficients
from estimation.least_squares import LeastSquares, least_squares
from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import BandEstimate, least_squares_bias, maximum_likelihood
from estimation.normal import NORMAL_95
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import LoopResponse, loop_response
from maglev_env.loop.gains import NO_CONTROLLER, Controllers
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Rig

BAND_LINES = 12  # of a band, where nobody states its width
UNEVEN = 3.0  # ratio of the spacings of lines from which bands are counted in lines, not in Hz
CLEAR_NOISE = 0.1  # share of the displacement's power that is noise, up to which least squares and means are trusted
FEWEST_LINES = 4  # of a band whose mean is told from its constants
BIAS_SHARE = 0.5  # least squares counts as biased when noise moves it by half of its own standard error


@dataclass(frozen=True)
class Band:
    """One estimation band in SI units, with 95 % intervals that are -inf or inf where they are not bounded.

    Stiffness and damping are means over the band, and the ranges are those of their curves inside it. Where noise is
    more than CLEAR_NOISE of the displacement, or lines are few, they are the constants that fit best, without ranges.

    Intervals and standard errors hold the errors that all bands of a recording have in common, as that of the mass.
    `common` has for each of them, in the same order in all bands, by how much one standard error moves the stiffness,
    N/m, and the damping, N s/m, of this one: a mean over bands does not average them out.
    """

    f_lo: float
    f_hi: float
    stiffness: float
    stiffness_se: float
    stiffness_ci: tuple[float, float]
    damping: float
    damping_se: float
    damping_ci: tuple[float, float]
    r2_adjusted: float
    ls_stiffness: float
    ls_stiffness_se: float
    ls_damping: float
    ls_damping_se: float
    ls_biased: bool
    informative: bool
    fit_p: float
    noise_share: float
    effective_stiffness: float | None
    effective_damping: float | None
    stiffness_range: tuple[float, float] | None = None
    damping_range: tuple[float, float] | None = None
    common: tuple[tuple[float, float], ...] = ()


def band_layout(force: LineStatistics, rig: Rig | None, width: float | None, overlap: float | None) -> np.ndarray:
    """Estimation bands (b, 2) Hz: as stated, or as in the rig's protocol, or 12 lines with an overlap of two thirds.

    Lines of uneven spacing are counted; otherwise 12 lines are 12 times their spacing.

    The bands of a protocol are those of its own excitation; where other lines do not fit them, 12 lines it is.
    """
    if width is None and rig is not None and rig.protocol is not None:
        own = rig.protocol.band_overlap if overlap is None else overlap
        try:
            return sliding_bands(force.frequency, rig.protocol.band_width, own)
        except ValueError:
            if overlap is not None:
                raise
    spacing = np.diff(force.frequency)
    if width is None and overlap is None and spacing.max(initial=0.0) > UNEVEN * spacing.min(initial=np.inf):
        first = np.arange(0, max(force.frequency.size - BAND_LINES, 0) + 1, BAND_LINES // 3)
        last = np.minimum(first + BAND_LINES, force.frequency.size) - 1
        return np.stack([force.frequency[first], force.frequency[last]], axis=1)
    if width is None:
        width = min(BAND_LINES * float(np.median(spacing)), float(np.ptp(force.frequency)))
    return sliding_bands(force.frequency, width, 2 * width / 3 if overlap is None else overlap)


def band_coefficients(
    force: LineStatistics, mass: float, bands: np.ndarray, signals: RecordedSignals, rig: Rig | None
) -> tuple[Band, ...]:
    """Stiffness and damping of every band, by both methods.

    Args:
        force: Channels "force" and "displacement" at the force lines.
        mass: Moving mass, kg.
        bands: (b, 2), Hz.
        signals: The recording.
        rig: For the coefficients that its nominal controller gives; None for none.
    """
    ml: BandEstimate = maximum_likelihood(force, bands, mass)
    bias_k, bias_c = least_squares_bias(force, bands, mass, ml)
    receptance, _ = frequency_response(force, "displacement", "force")
    promised_k, promised_c = _effective(bands.mean(axis=1), signals, rig)
    result = []
    for b, (start, stop) in enumerate(band_slices(force.frequency, bands)):
        ls: LeastSquares = least_squares(force.frequency[start:stop], receptance[start:stop], mass)
        biased = abs(bias_k[b]) > BIAS_SHARE * ls.stiffness_se or abs(bias_c[b]) > BIAS_SHARE * ls.damping_se
        k, c = _coefficients(force, bands[b], mass, ml, b, stop - start)
        result.append(
            Band(
                f_lo=float(bands[b, 0]),
                f_hi=float(bands[b, 1]),
                stiffness=k.value,
                stiffness_se=k.se,
                stiffness_ci=(k.low, k.high),
                damping=c.value,
                damping_se=c.se,
                damping_ci=(c.low, c.high),
                r2_adjusted=float(ls.r2_adjusted),
                ls_stiffness=float(ls.stiffness),
                ls_stiffness_se=float(ls.stiffness_se),
                ls_damping=float(ls.damping),
                ls_damping_se=float(ls.damping_se),
                ls_biased=bool(biased or ml.noise_share[b] > CLEAR_NOISE),
                informative=bool(ml.informative[b]),
                fit_p=float(ml.fit_p[b]),
                noise_share=float(ml.noise_share[b]),
                effective_stiffness=promised_k[b],
                effective_damping=promised_c[b],
                stiffness_range=k.range,
                damping_range=c.range,
            )
        )
    return tuple(result)


def _coefficients(
    force: LineStatistics, band: np.ndarray, mass: float, ml: BandEstimate, index: int, lines: int
) -> tuple[BandMean, BandMean]:
    """Stiffness and damping of one band: means where the record is clear, otherwise the constants that fit best."""
    if ml.informative[index] and ml.noise_share[index] <= CLEAR_NOISE and lines >= FEWEST_LINES:
        return band_mean(force, band, mass, (float(ml.stiffness[index]), float(ml.damping[index])))

    def constant(name: str) -> BandMean:
        value, se, low, high = (float(getattr(ml, name + end)[index]) for end in ("", "_se", "_low", "_high"))
        return BandMean(value, se, low, high, None)

    return constant("stiffness"), constant("damping")


def with_gain_uncertainty(band: Band, share: float, mass: float) -> Band:
    """The band with intervals widened by a relative error of the actuator gain, which scales k - m w^2 and c."""
    w = np.pi * (band.f_lo + band.f_hi)
    return _widened(band, share * (band.stiffness - mass * w**2), share * band.damping)


def with_relative_uncertainty(band: Band, share: float) -> Band:
    """The band with intervals widened by a relative error of all that is told, as of the mass that sets the scale."""
    return _widened(band, share * band.stiffness, share * band.damping)


def with_timing_uncertainty(band: Band, time: float, mass: float) -> Band:
    """The band with its intervals widened by a standard error (s) of when the force acts.

    Of a force that comes late by t, the part (k - m w^2) y turns by w t, as that of a damping t (k - m w^2) does, and
    that of the damping becomes a stiffness t w^2 c.
    """
    w = np.pi * (band.f_lo + band.f_hi)
    return _widened(band, -time * w**2 * band.damping, time * (band.stiffness - mass * w**2))


def with_mass_uncertainty(band: Band, mass_se: float) -> Band:
    """The band with its stiffness interval widened by a mass error, which changes k by w^2 times as much."""
    return _widened(band, mass_se * (np.pi * (band.f_lo + band.f_hi)) ** 2, 0.0)


def _widened(band: Band, stiffness: float, damping: float) -> Band:
    """The band with intervals and standard errors, of both methods, widened by an error that all bands have in common.

    Args:
        band: as it was.
        stiffness: what one standard error of it adds to the stiffness, N/m.
        damping: what it adds to the damping, N s/m.
    """
    changes: dict[str, Any] = {"common": (*band.common, (float(stiffness), float(damping)))}
    for name, se in (("stiffness", stiffness), ("damping", damping)):
        value, (low, high) = getattr(band, name), getattr(band, f"{name}_ci")
        half = NORMAL_95 * se
        changes[f"{name}_ci"] = (
            float(value - np.hypot(value - low, half)),
            float(value + np.hypot(high - value, half)),
        )
        for one in (f"{name}_se", f"ls_{name}_se"):
            changes[one] = float(np.hypot(getattr(band, one), se))
    return replace(band, **changes)


def _effective(
    frequency: np.ndarray, signals: RecordedSignals, rig: Rig | None
) -> tuple[Sequence[float | None], Sequence[float | None]]:
    """D eq 4.5 with the digital controller's own response: the values of the gains alone, with the support."""
    if rig is None or not rig.controlled or signals.gains is None:
        return [None] * frequency.size, [None] * frequency.size
    gain, stiffness = linearise(force_law(rig))
    controller = nominal_response(rig, signals.gains, frequency).controller
    k, c = effective_coefficients(frequency, controller, gain, stiffness)
    return (k + rig.support_stiffness).tolist(), (c + rig.support_damping).tolist()


def nominal_response(rig: Rig, gains: Controllers | None, frequency: np.ndarray) -> LoopResponse:
    """Responses of the nominal loop under the controller of a recording."""
    return loop_response(Experiment(rig, gains or NO_CONTROLLER, ()), frequency)
