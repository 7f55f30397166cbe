"""Identification of one recording: stiffness, damping and stability with their uncertainty, for `maglev estimate`."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from estimation.actuator import ActuatorEstimate, actuator_estimate, as_force
from estimation.apparent_gain import ApparentGain, periodic_gain
from estimation.lines.frequency_response import Distortion, coherence, distortion, frequency_response
from estimation.lines.periods import LineStatistics, held
from estimation.modal import ModalEstimate, modal_estimate
from estimation.stability_margins import loop_gain
from maglev_env.evaluation.bands import (
    Band,
    band_coefficients,
    band_layout,
    with_gain_uncertainty,
    with_mass_uncertainty,
    with_timing_uncertainty,
)
from maglev_env.evaluation.known_chain import coil_current, flowing, rotor_motion
from maglev_env.evaluation.stability import Stability, stability_of
from maglev_env.linear.control_systems import python_control
from maglev_env.presented import Presented, matplotlib_figure
from maglev_env.recordings.spectra import RecordedSignals, RecordSpectra, record_spectra
from maglev_env.rig.rig import Rig

if TYPE_CHECKING:
    import control
    import xarray as xr
    from matplotlib.figure import Figure

_INERTIA = 0.5  # share of the mass that the lines must show to tell its sign
_SURE = 3.0  # standard errors by which they must show more
_Magnets = tuple[ActuatorEstimate, LineStatistics, str, float]  # the last: how far the current's time is unknown, s


@dataclass(frozen=True, repr=False)
class Identification(Presented):
    """Everything that one recording shows.

    Attributes:
        bands: Stiffness and damping in bands of frequency.
        mass: Moving mass, kg.
        modal: Mass, stiffness and damping as one mode, if the mass was estimated.
        actuator: Gain of the magnets, if the current stands for the force.
        natural_frequency: Hz; None where no informative band holds it.
        damping_ratio: Of the mode at that frequency; None where its band does not tell the sign of the damping.
        distortion: Nonlinear distortion at detection lines.
        stability: Margins with intervals; None where the recording shows none.
        transient_periods: Leading periods that were dropped.
        periods: Those that were used.
        statistics: Of the force lines.
        notes: What was assumed, dropped or not available.
        gain: The actuator's apparent gain over frequency, where the current is recorded.
    """

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

    rows = "band"

    def __str__(self) -> str:
        sure = sum(b.informative for b in self.bands)
        parts = [f"Identification: {sure} of {len(self.bands)} bands informative, mass {self.mass:.4g} kg"]
        if self.natural_frequency is not None:
            parts.append(f"natural frequency {self.natural_frequency:.4g} Hz")
        if self.stability is not None:
            peak = self.stability.margins.peak_sensitivity
            parts.append(f"peak |S| {peak:.3g} (zone {self.stability.iso_14839_3_zone} of ISO 14839-3)")
        return ", ".join(parts)

    def to_xarray(self) -> "xr.Dataset":
        """Coefficients by band at the bands' centres (Hz), and the sensitivity by line; units are in the attributes.

        `stiffness_low` and the like are ends of 95 % intervals, infinite where they are not bounded.
        """
        import xarray as xr

        columns = {
            "stiffness": "N/m", "stiffness_se": "N/m", "damping": "N s/m", "damping_se": "N s/m",
            "ls_stiffness": "N/m", "ls_damping": "N s/m", "noise_share": "", "informative": "",
        }  # fmt: skip
        found: dict[str, Any] = {
            name: ("band", [getattr(b, name) for b in self.bands], {"units": u}) for name, u in columns.items()
        }
        for name in ("stiffness", "damping"):
            for i, end in enumerate(("low", "high")):
                ends = [getattr(b, f"{name}_ci")[i] for b in self.bands]
                found[f"{name}_{end}"] = ("band", ends, {"units": columns[name]})
        hertz = {"units": "Hz"}
        low, high = ([getattr(b, end) for b in self.bands] for end in ("f_lo", "f_hi"))
        centre = [(one + other) / 2 for one, other in zip(low, high, strict=True)]
        coordinates: dict[str, Any] = {
            "band": ("band", centre, hertz),
            "f_lo": ("band", low, hertz),
            "f_hi": ("band", high, hertz),
        }
        if self.stability is not None:
            coordinates["frequency"] = ("frequency", self.stability.frequency, hertz)
            found["sensitivity"] = ("frequency", self.stability.sensitivity, {"units": ""})
            found["sensitivity_variance"] = ("frequency", self.stability.variance, {"units": ""})
        return xr.Dataset(found, coordinates, {"rows": self.rows, "notes": list(self.notes)})

    def to_control(self) -> "control.FrequencyResponseData":
        """The measured loop gain L = 1 / S - 1 at its lines, for the margins and diagrams of python-control.

        Raises:
            ValueError: The recording shows nothing of the loop.
            ImportError: python-control is not installed.
        """
        if self.stability is None:
            raise ValueError(
                "the recording shows nothing of the loop: nothing was injected, or no controller is stated"
            )
        loop = loop_gain(self.stability.sensitivity)
        return python_control().frd(loop, 2 * np.pi * self.stability.frequency)

    def plot(self) -> "Figure":
        """Stiffness and damping of the informative bands with 95 % intervals, as a matplotlib figure."""
        sure = [b for b in self.bands if b.informative]
        centre, half = ([(b.f_lo + sign * b.f_hi) / 2 for b in sure] for sign in (1, -1))
        figure = matplotlib_figure()(layout="constrained")
        axes = figure.subplots(2, 1, sharex=True)
        for ax, name, unit in zip(axes, ("stiffness", "damping"), ("N/m", "N s/m"), strict=True):
            value = np.array([getattr(b, name) for b in sure])
            ends = np.array([getattr(b, f"{name}_ci") for b in sure]).reshape(-1, 2).T
            off = np.abs(np.where(np.isfinite(ends), ends - value, 0.0))
            ax.errorbar(centre, value, off, np.abs(half), fmt=".", capsize=2)
            ax.set_ylabel(f"{name}, {unit}")
        axes[1].set_xlabel("frequency, Hz")
        return figure


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
    actuator, magnets, unsure = None, None, 0.0
    if not force.lines.size or "force" not in force.channels:
        magnets = _through_magnets(signals, spectra, rig, mass, estimate_mass)
        actuator, force, drive, unsure = magnets
        notes.append(
            f"no force is excited and recorded: the {drive} stands for it, its actuator gain fitted to the mass; "
            "stiffness and damping are those of the rotor without its controller"
        )
        if unsure and rig is not None and not (rig.amplifier_time_constant and "command" in statistics.channels):
            lacks = "the rig states no amplifier_time_constant"
            if rig.amplifier_time_constant:
                lacks = "no command is recorded that would tell how long the controller computes"
            notes.append(
                f"{lacks}: how the current moves between its readings is not known, which widens the intervals of the "
                "damping"
            )
    else:
        force = rotor_motion(force, rig)
    if rig is not None and rig.sensor_time_constant:
        notes.append(f"the lag of the nominal probe, {rig.sensor_time_constant * 1e6:.3g} µs, is taken out")
    if dropped:
        notes.append(f"the first {dropped} period(s) carry a transient and were dropped")
    notes += spectra.notes
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
    gain = None if estimate_mass else _apparent_gain(signals, spectra, rig, float(mass), magnets)
    layout = band_layout(force, rig, band_width, band_overlap)
    bands = band_coefficients(force, mass, layout, signals, None if actuator else rig)
    if modal:
        bands = tuple(with_mass_uncertainty(b, modal.mass_se) for b in bands)
    if actuator:
        # Where one gain does not fit all lines, that of a band is as unsure as the gains of the bands differ.
        share = np.hypot(actuator.gain_se / actuator.gain, gain.scatter if gain else 0.0)
        bands = tuple(with_gain_uncertainty(b, float(share), mass) for b in bands)
        bands = tuple(with_timing_uncertainty(b, unsure, mass) for b in bands)
    sure = [b for b in bands if b.informative]
    if sure and np.mean([b.damping_ci[1] < 0 for b in sure]) > 0.8:
        notes.append(f"damping is negative nearly everywhere: {_negative_damping(force, mass)}")
    natural, zeta = (modal.natural_frequency, modal.damping_ratio) if modal else _crossing(bands, mass)
    if natural is None:
        notes.append("no informative band holds the natural frequency")
    excited = np.unique(np.concatenate([*spectra.driven.values(), signals.elsewhere]))
    inner = statistics.at_lines(np.arange(excited.min(), force.lines.max() + 1))
    bent = distortion(inner, "displacement", excited)
    if bent.even is None and bent.odd is None:
        notes.append("no detection lines: nonlinear distortion cannot be told from this excitation")
    stability, why = stability_of(signals, spectra, rig)
    if why:
        notes.append(why)
    periods = statistics.periods
    return Identification(
        bands, float(mass), modal, actuator, natural, zeta, bent, stability, dropped, periods, force, tuple(notes), gain
    )  # fmt: skip


def _negative_damping(force: LineStatistics, mass: float) -> str:
    """What a negative damping may come from: a flipped sign turns the inertia, too, where the lines show that."""
    response, _ = frequency_response(force, "displacement", "force")
    square = (2 * np.pi * force.frequency) ** 2
    known = np.isfinite(response) & (response != 0)
    # Of k - m w^2 only the slope tells the sign: below the resonance a flipped k - m w^2 is negative, too.
    if known.sum() > 2:
        (slope, _), covariance = np.polyfit(square[known], np.real(1 / response[known]), 1, cov=True)
        if slope + _SURE * np.sqrt(covariance[0, 0]) < -_INERTIA * mass:
            return (
                "the inertia has the right sign, so force and displacement are not flipped; the force may be late "
                "against the displacement, or a mode, or what else is in the loop, feeds the motion"
            )
    return "is the sign of force or displacement flipped?"


def _apparent_gain(
    signals: RecordedSignals, spectra: RecordSpectra, rig: Rig | None, mass: float, magnets: _Magnets | None
) -> ApparentGain | None:
    """The actuator's gain over frequency at the lines of an injection; None where the current is not recorded there.

    `magnets` is what `_through_magnets` gave already.
    """
    if "current" not in spectra.all.channels:
        return None
    try:
        actuator, force, _, unsure = magnets or _through_magnets(signals, spectra, rig, mass, False)
    except ValueError:  # nothing is injected, or too few lines are
        return None
    found = periodic_gain(force, mass, actuator)
    return found and found.with_errors(0.0, unsure, 0.0)


def _through_magnets(
    signals: RecordedSignals, spectra: RecordSpectra, rig: Rig | None, mass: float | None, estimate_mass: bool
) -> _Magnets:
    """The actuator, the lines of an injection or reference with the current (else the command) as the force, which of
    both it is, and the standard error of its time, s."""
    statistics = spectra.all
    lines = np.union1d(spectra.driven["current"], spectra.driven["reference"])
    drive = next((name for name in ("current", "command") if name in statistics.channels), None)
    if lines.size and drive and (estimate_mass or mass is None):
        raise ValueError(
            f"stiffness and damping from the {drive} need a known mass; state it in kg, in [parameters] of "
            "campaign.toml or with --mass (only a recorded force tells the mass, too)"
        )
    if not lines.size or drive is None:
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
        excited = coil_current(excited, rig)
    otherwise, unsure = None, 0.0
    if drive == "current" and not hold_rate:
        excited, otherwise, unsure = flowing(excited, rig, signals.sample_rate)
    excited = rotor_motion(excited, rig)
    actuator = actuator_estimate(excited, mass)
    if otherwise is not None:
        moved = actuator_estimate(rotor_motion(otherwise, rig), mass)
        actuator = actuator.with_errors(
            moved.gain - actuator.gain, moved.stiffness - actuator.stiffness, moved.damping - actuator.damping
        )
    return actuator, as_force(excited, "current", actuator.gain), drive, unsure


def _crossing(bands: tuple[Band, ...], mass: float) -> tuple[float | None, float | None]:
    """Natural frequency and damping ratio of the informative band that holds its own resonance most centrally.

    The ratio is None where the band does not tell the sign of the damping.
    """
    found = []
    for b in bands:
        if b.informative and b.stiffness > 0:
            natural = np.sqrt(b.stiffness / mass) / (2 * np.pi)
            if b.f_lo <= natural <= b.f_hi:
                off_centre = abs(2 * natural - b.f_lo - b.f_hi) / (b.f_hi - b.f_lo)
                found.append((off_centre, natural, b.damping / (2 * np.sqrt(b.stiffness * mass)), b.damping_ci))
    if not found:
        return None, None
    _, natural, ratio, (low, high) = min(found)
    return float(natural), float(ratio) if low * high > 0 else None
