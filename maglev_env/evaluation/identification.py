"""Identification of one recording: stiffness, damping and stability with their uncertainty, for `maglev estimate`."""

from dataclasses import dataclass, replace

import numpy as np

from estimation.actuator import ActuatorEstimate, actuator_estimate, as_force
from estimation.apparent_gain import ApparentGain, periodic_gain
from estimation.bands import band_slices, sliding_bands
from estimation.effective import effective_coefficients
from estimation.frequency_response import Distortion, coherence, distortion, frequency_response, pooled_variance
from estimation.iso_14839 import iso_14839_2_zone, iso_14839_3_zone
from estimation.least_squares import LeastSquares, least_squares
from estimation.max_likelihood import BandEstimate, least_squares_bias, maximum_likelihood
from estimation.modal import ModalEstimate, modal_estimate
from estimation.periods import LineStatistics, held
from estimation.stability_margins import Margins, margins
from maglev_env.evaluation.sensitivity import injected_sensitivity
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import LoopResponse, loop_response
from maglev_env.loop.gains import NO_CONTROLLER, of_axis, reads_current
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.spectra import RecordedSignals, RecordSpectra, record_spectra
from maglev_env.rig.rig import Rig

NORMAL_95 = 1.959964
BIAS_SHARE = 0.5  # least squares counts as biased when noise moves it by half of its own standard error


@dataclass(frozen=True)
class Band:
    """One estimation band in SI units, with 95 % intervals that are -inf or inf where they are not bounded."""

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


@dataclass(frozen=True)
class Stability:
    """Margins with intervals; source is "injection" (measured) or "assumes the nominal actuator"."""

    source: str
    margins: Margins
    iso_14839_3_zone: str
    iso_14839_2_zone: str | None
    frequency: np.ndarray
    sensitivity: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True)
class Identification:
    """Everything that one recording shows; notes say what was assumed, dropped or not available."""

    bands: tuple[Band, ...]
    mass: float
    modal: ModalEstimate | None
    actuator: ActuatorEstimate | None
    natural_frequency: float | None
    damping_ratio: float | None
    distortion: Distortion
    stability: Stability | None
    transient_periods: int
    periods: int
    statistics: LineStatistics
    notes: tuple[str, ...]
    gain: ApparentGain | None = None


def identify(
    signals: RecordedSignals,
    rig: Rig | None,
    mass: float | None,
    estimate_mass: bool = False,
    band_width: float | None = None,
    band_overlap: float | None = None,
) -> Identification:
    """Identify one axis of a recording; for one of two axes see `axis_signals`.

    Args:
        signals: The recording.
        rig: Nominal rig, for the protocol's bands, the clearance and margins that assume its actuator.
        mass: Moving mass, kg; required unless estimate_mass.
        estimate_mass: Whether the mass is estimated.
        band_width: Width of the bands, Hz; by default that of the rig's protocol, otherwise 12 excited lines.
        band_overlap: Their overlap, Hz; by default that of the rig's protocol, otherwise two thirds.

    Raises:
        ValueError: Something is missing; the message says what.
    """
    notes = list(signals.assumed)
    if "displacement" not in signals.channels:
        raise ValueError("stiffness and damping need the channel displacement")
    spectra = record_spectra(signals)
    statistics, force, dropped = spectra.all, spectra.force, spectra.transient_periods
    actuator = None
    if not force.lines.size or "force" not in force.channels:
        actuator, force, drive = _through_magnets(signals, spectra, mass, estimate_mass)
        notes.append(
            f"no force is excited and recorded: the {drive} stands for it, its actuator gain fitted to the mass; "
            "stiffness and damping are those of the rotor without its controller"
        )
    if dropped:
        notes.append(f"the first {dropped} period(s) carry a transient and were dropped")
    if spectra.leftover:
        notes.append(f"{spectra.leftover} samples after the last whole period were not used")
    if signals.hold_rate and not actuator:
        notes.append("the force is held over each sample by its converter: corrected")
    if not signals.periodic and not actuator:
        share = float(np.median(1 / np.maximum(coherence(force, "displacement"), 1e-3) - 1))
        notes.append(
            f"the excitation is not periodic: responses by local polynomials, {force.frequency[0]:.4g} to "
            f"{force.frequency[-1]:.4g} Hz. Noise in the force reading makes the response too small by its share of "
            f"the force's power, here at most {share:.2g} (median; all noise taken as the force's)"
        )
    modal = None
    if estimate_mass:
        modal = modal_estimate(force)
        mass = modal.mass
        if modal.discrepancy:
            notes.append(
                f"one mass, stiffness and damping miss {modal.discrepancy:.1%} of the displacement, "
                f"{modal.cost_ratio:.3g} times the noise power: the rig is not linear, has more modes, or its support "
                "varies with frequency as a controlled one does; the fit is that of the nearest such model, not the "
                "rig's mass: give the mass if it is known"
            )
    if mass is None:
        raise ValueError("the moving mass is not known: give [parameters] mass, or estimate it with --estimate-mass")
    layout = band_layout(force, rig, band_width, band_overlap)
    bands = _bands(force, mass, layout, signals, None if actuator else rig)
    if modal:
        bands = tuple(_with_mass_uncertainty(b, modal.mass_se) for b in bands)
    if actuator:
        bands = tuple(_with_gain_uncertainty(b, actuator.gain_se / abs(actuator.gain), mass) for b in bands)
    sure = [b for b in bands if b.informative]
    if sure and np.mean([b.damping_ci[1] < 0 for b in sure]) > 0.8:
        notes.append("damping is negative nearly everywhere: is the sign of force or displacement flipped?")
    natural, zeta = (modal.natural_frequency, modal.damping_ratio) if modal else _crossing(bands, mass)
    if natural is None:
        notes.append("no informative band holds the natural frequency")
    excited = np.unique(np.concatenate([*spectra.driven.values(), signals.elsewhere]))
    inner = statistics.at_lines(np.arange(excited.min(), force.lines.max() + 1))
    bent = distortion(inner, "displacement", excited)
    if bent.even is None and bent.odd is None:
        notes.append("no detection lines: nonlinear distortion cannot be told from this excitation")
    stability, why = _stability(signals, spectra, rig)
    if why:
        notes.append(why)
    periods = statistics.periods
    return Identification(
        bands, float(mass), modal, actuator, natural, zeta, bent, stability, dropped, periods, force, tuple(notes),
        None if estimate_mass else _apparent_gain(signals, spectra, float(mass)),
    )  # fmt: skip


def band_layout(force: LineStatistics, rig: Rig | None, width: float | None, overlap: float | None) -> np.ndarray:
    """Estimation bands (b, 2) Hz: as stated, or as in the rig's protocol, or 12 lines with an overlap of two thirds.

    The bands of a protocol are those of its own excitation; where other lines do not fit them, 12 lines it is.
    """
    if width is None and rig is not None and rig.protocol is not None:
        own = rig.protocol.band_overlap if overlap is None else overlap
        try:
            return sliding_bands(force.frequency, rig.protocol.band_width, own)
        except ValueError:
            if overlap is not None:
                raise
    if width is None:
        width = min(12 * float(np.median(np.diff(force.frequency))), float(np.ptp(force.frequency)))
    return sliding_bands(force.frequency, width, 2 * width / 3 if overlap is None else overlap)


def _bands(
    force: LineStatistics, mass: float, bands: np.ndarray, signals: RecordedSignals, rig: Rig | None
) -> tuple[Band, ...]:
    ml: BandEstimate = maximum_likelihood(force, bands, mass)
    bias_k, bias_c = least_squares_bias(force, bands, mass, ml)
    receptance, _ = frequency_response(force, "displacement", "force")
    result = []
    for b, (start, stop) in enumerate(band_slices(force.frequency, bands)):
        ls: LeastSquares = least_squares(force.frequency[start:stop], receptance[start:stop], mass)
        biased = abs(bias_k[b]) > BIAS_SHARE * ls.stiffness_se or abs(bias_c[b]) > BIAS_SHARE * ls.damping_se
        effective = _effective(bands[b].mean(), signals, rig)
        result.append(
            Band(
                float(bands[b, 0]), float(bands[b, 1]),
                float(ml.stiffness[b]), float(ml.stiffness_se[b]),
                (float(ml.stiffness_low[b]), float(ml.stiffness_high[b])),
                float(ml.damping[b]), float(ml.damping_se[b]),
                (float(ml.damping_low[b]), float(ml.damping_high[b])),
                float(ls.r2_adjusted),
                float(ls.stiffness), float(ls.stiffness_se), float(ls.damping), float(ls.damping_se),
                bool(biased or ml.noise_share[b] > 0.1), bool(ml.informative[b]),
                float(ml.fit_p[b]), float(ml.noise_share[b]), *effective,
            )
        )  # fmt: skip
    return tuple(result)


def _apparent_gain(signals: RecordedSignals, spectra: RecordSpectra, mass: float) -> ApparentGain | None:
    """The actuator's gain over frequency at the lines of an injection; None where the current is not recorded there."""
    if "current" not in spectra.all.channels:
        return None
    try:
        actuator, force, _ = _through_magnets(signals, spectra, mass, False)
    except ValueError:  # nothing is injected, or too few lines are
        return None
    return periodic_gain(force, mass, actuator)


def _through_magnets(
    signals: RecordedSignals, spectra: RecordSpectra, mass: float | None, estimate_mass: bool
) -> tuple[ActuatorEstimate, LineStatistics, str]:
    """The actuator, and the lines of an injection or reference with the current (else the command) as the force."""
    statistics = spectra.all
    lines = np.union1d(spectra.driven["current"], spectra.driven["reference"])
    drive = next((name for name in ("current", "command") if name in statistics.channels), None)
    if not lines.size or drive is None or estimate_mass or mass is None:
        raise ValueError(
            "stiffness and damping need an excitation at the force, along the axis of the displacement, and the "
            "channel force; or one at the current or reference, the channel current, and a known mass"
        )
    excited = statistics.at_lines(lines)
    # A converter holds its output; a current behind an amplifier's lag is taken as held only where that is stated.
    hold_rate = signals.hold_rate or (signals.sample_rate if drive == "command" else None)
    if hold_rate:
        excited = held(excited, drive, hold_rate)
    if drive == "command":
        excited = replace(excited, channels=tuple("current" if n == drive else n for n in excited.channels))
    actuator = actuator_estimate(excited, mass)
    return actuator, as_force(excited, "current", actuator.gain), drive


def _with_gain_uncertainty(band: Band, share: float, mass: float) -> Band:
    """The band with intervals widened by a relative error of the actuator gain, which scales k - m w^2 and c."""
    w = np.pi * (band.f_lo + band.f_hi)
    wide = _widened(band, "stiffness", share * abs(band.stiffness - mass * w**2))
    return _widened(wide, "damping", share * abs(band.damping))


def _widened(band: Band, name: str, se: float) -> Band:
    """The band with the interval and standard error of one coefficient widened by an independent standard error."""
    value, (low, high) = getattr(band, name), getattr(band, f"{name}_ci")
    ci = (
        float(value - np.hypot(value - low, NORMAL_95 * se)),
        float(value + np.hypot(high - value, NORMAL_95 * se)),
    )
    return replace(band, **{f"{name}_se": float(np.hypot(getattr(band, f"{name}_se"), se)), f"{name}_ci": ci})


def _with_mass_uncertainty(band: Band, mass_se: float) -> Band:
    """The band with its stiffness interval widened by a mass error, which changes k by w^2 times as much."""
    return _widened(band, "stiffness", mass_se * (np.pi * (band.f_lo + band.f_hi)) ** 2)


def _effective(frequency: float, signals: RecordedSignals, rig: Rig | None) -> tuple[float | None, float | None]:
    """D eq 4.5 with the digital controller's own response: the values of the gains alone, with the support."""
    if rig is None or not rig.controlled or signals.gains is None:
        return None, None
    gain, stiffness = linearise(force_law(rig))
    controller = _nominal(rig, signals, np.array([frequency])).controller
    k, c = effective_coefficients(np.array([frequency]), controller, gain, stiffness)
    return float(k[0] + rig.support_stiffness), float(c[0] + rig.support_damping)


def _nominal(rig: Rig, signals: RecordedSignals, frequency: np.ndarray) -> LoopResponse:
    return loop_response(Experiment(rig, signals.gains or NO_CONTROLLER, ()), frequency)


def _crossing(bands: tuple[Band, ...], mass: float) -> tuple[float | None, float | None]:
    """Natural frequency and damping ratio of the informative band that holds its own resonance most centrally."""
    found = []
    for b in bands:
        if b.informative and b.stiffness > 0:
            natural = np.sqrt(b.stiffness / mass) / (2 * np.pi)
            if b.f_lo <= natural <= b.f_hi:
                off_centre = abs(2 * natural - b.f_lo - b.f_hi) / (b.f_hi - b.f_lo)
                found.append((off_centre, natural, b.damping / (2 * np.sqrt(b.stiffness * mass))))
    return (float(min(found)[1]), float(min(found)[2])) if found else (None, None)


def _stability(
    signals: RecordedSignals, spectra: RecordSpectra, rig: Rig | None
) -> tuple[Stability | None, str | None]:
    statistics, force, injected = spectra.all, spectra.force, spectra.driven["current"]
    if injected.size >= 4 and {"command", "injection"} <= signals.channels.keys():
        loop, control_rate = statistics.at_lines(injected), rig and rig.control_rate
        s, variance = injected_sensitivity(loop, (of_axis(signals.gains or NO_CONTROLLER, 0),), control_rate)
        source, why = "injection", None
        if control_rate is None and signals.gains is not None and reads_current(signals.gains, 1.0):
            why = "the controller reads the current: without a rig the margins hold at the command, not the reading"
    elif rig is not None and rig.controlled and signals.gains is not None and "force" in statistics.channels:
        nominal = _nominal(rig, signals, force.frequency)
        open_receptance = nominal.receptance / nominal.sensitivity
        feedback = nominal.controller * nominal.plant / open_receptance
        measured = statistics.at_lines(force.lines)
        receptance, noise = frequency_response(measured, "displacement", "force")
        s, variance = 1 - feedback * receptance, np.abs(feedback) ** 2 * noise
        loop, source = force, "assumes the nominal actuator"
        why = "no injection at the current: margins assume the nominal actuator and controller"
    else:
        return None, "no injection at the current and no nominal controller: nothing can be said of the loop's margins"
    variance = pooled_variance(variance)
    found = margins(loop.frequency, s, variance)
    zone2 = None
    if rig is not None:
        zone2 = iso_14839_2_zone(float(np.abs(signals.channels["displacement"]).max()), rig.clearance)
    zone3 = iso_14839_3_zone(found.peak_sensitivity)
    return Stability(source, found, zone3, zone2, loop.frequency, s, variance), why
