"""What a campaign's recordings show at each gain set: responses of loop and plant, and failures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimation.lines.frequency_response import frequency_response, pooled_variance
from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import maximum_likelihood
from estimation.normal import NOISELESS
from estimation.stability_margins import Margins, margins
from maglev_env.experiment import sampling
from maglev_env.loop.gains import Gains, controller_response
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.each_recording import each_recording
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals, record_spectra
from maglev_env.rig.rig import Rig
from tuning.campaign.open_recording import with_injection

TOUCHED = 0.95  # share of the clearance that counts as touchdown (or the sensor's scale is wrong)
UNSTEADY = 0.02  # share of the clearance: a larger rms that does not repeat and outweighs what does is self-oscillation
CAUSED = ("clipped at", "levitation is lost")  # faults of a record that gains cause; any other is one of the file
DRAWS, LEAST_LINES = 200, 4  # draws of an interval; lines that a curve of margins needs
LEVEL_SD = 3.92  # width of a 95 % interval in standard deviations
KNOWN, SMOOTH = 0.3, 9  # relative noise of lines without a period that are used, and lines over which it is looked at
MOST_DOUBT = 2.0  # times the peak sensitivity that single lines of a recording without a period may leave possible


@dataclass(frozen=True, eq=False)
class Response:
    """A complex frequency response at frequencies (n,) Hz, increasing: value (n,) and variance (n,), E|noise|^2."""

    frequency: np.ndarray
    value: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True, eq=False)
class GainSet:
    """All recordings at equal gains.

    Attributes:
        gains: The gains.
        files: The recordings.
        receptance: From the continuous force, m/N; None where nothing shows it.
        sensitivity: None where nothing shows it.
        plant: From command to reading, m/A; None where nothing shows it.
        force: Line statistics of the recordings that a force excites.
        peak_displacement: m.
        current_rms: A.
        failed: Why nothing is identified here, or None.
        noise_current: Rms of what does not repeat of the coil's current, less the stated noise of its reading, A; nan
            where no period shows it.
        untold: Why recordings without a period do not tell the margins here, or None.
        open: Whether all recordings are without a period.
    """

    gains: Gains
    files: tuple[str, ...]
    receptance: Response | None
    sensitivity: Response | None
    plant: Response | None
    force: tuple[LineStatistics, ...]
    peak_displacement: float
    current_rms: float
    failed: str | None
    untold: str | None = None
    open: bool = False
    noise_current: float = np.nan


@dataclass(frozen=True)
class Shown:
    """Results of a gain set with standard errors; nan where the recordings do not show them.

    Attributes:
        stiffness: In the target band, N/m.
        stiffness_se: Its standard error.
        damping: In the target band, N s/m.
        damping_se: Its standard error.
        margins: Margins of the measured sensitivity.
    """

    stiffness: float
    stiffness_se: float
    damping: float
    damping_se: float
    margins: Margins | None


def recorded_sets(campaign: Campaign) -> tuple[Campaign, list[GainSet]]:
    """The fit recordings of a one-axis campaign, grouped by their gains, in the order recorded.

    A clipped channel, a touchdown and self-oscillation make a failed set. Of a recording without a period, what was
    added to its command drives the loop; where that cannot tell the margins, `untold` says why.

    Returns:
        The campaign of the recordings that were used, with those that have no PID gains, or whose period shows nothing
        of the loop, in its `left_out`; and the sets.

    Raises:
        ValueError: No recording is left, or one cannot be read.
    """
    fit = tuple(spec for spec in campaign.recordings if spec.role == "fit")
    if not fit:
        raise ValueError(f"{campaign.folder / 'campaign.toml'}: every recording is a holdout; give one the role fit")

    def read(spec: RecordingSpec) -> GainSet:
        return _one(campaign, spec, _gains(campaign, spec))

    used, found = each_recording(replace(campaign, recordings=fit), read)
    groups: dict[Gains, list[GainSet]] = {}
    for one in found:
        groups.setdefault(one.gains, []).append(one)
    return used, [_joined(gains, parts) for gains, parts in groups.items()]


def shown(found: GainSet, band: tuple[float, float], mass: float, seed: int = 0) -> Shown:
    """Coefficients and margins of a set that did not fail, for the stated moving mass (kg) and a target band (Hz)."""
    coefficients = [maximum_likelihood(f, np.array([band]), mass, intervals=False) for f in found.force]
    k, k_se = _mean([(c.stiffness[0], c.stiffness_se[0]) for c in coefficients])
    c, c_se = _mean([(c.damping[0], c.damping_se[0]) for c in coefficients])
    s = found.sensitivity
    curve = margins(s.frequency, s.value, s.variance, DRAWS, seed) if s is not None else None
    return Shown(k, k_se, c, c_se, curve)


def pooled(parts: Sequence[Response]) -> Response | None:
    """Several measurements of one response as one: at each line the mean weighted by inverse variances."""
    if not parts:
        return None
    frequency, at = np.unique(np.round(np.concatenate([p.frequency for p in parts]), 9), return_inverse=True)
    value, variance = (np.concatenate([getattr(p, name) for p in parts]) for name in ("value", "variance"))
    weight = 1 / np.maximum(variance, NOISELESS * np.abs(value) ** 2)  # so that a recording without noise stays finite
    total = np.bincount(at, weight)
    mean = np.bincount(at, weight * value.real) + 1j * np.bincount(at, weight * value.imag)
    return Response(frequency, mean / total, 1 / total)


def _gains(campaign: Campaign, spec: RecordingSpec) -> Gains:
    if isinstance(spec.gains, Gains):
        return spec.gains
    what = "no gains are stated" if spec.gains is None else "its controller is another one than plain PID gains"
    raise TellsNothing(
        what,
        "tuning needs the PID gains it was recorded at: gains = { kp = ..., ki = ..., kd = ..., td = ..., ti = ... }",
        campaign.folder / spec.file,
    )


def _one(campaign: Campaign, spec: RecordingSpec, gains: Gains) -> GainSet:
    where, rig = campaign.folder / spec.file, campaign.rig
    try:
        dataset = read_recording(campaign, spec)
    except ValueError as error:
        if any(words in str(error) for words in CAUSED):
            return _failed(gains, spec, str(error).partition(f"{where}: ")[2] or str(error))
        raise
    signals = _at_control_rate(recorded_signals(campaign, spec, dataset, excited=False), rig)
    if "displacement" not in signals.channels:
        raise ValueError(f"{where}: the channel displacement is missing; nothing is known of the rotor without it")
    moved = signals.channels["displacement"]
    if (reach := float(np.abs(moved).max())) >= TOUCHED * rig.clearance:
        share = f"{reach / rig.clearance:.0%} of the clearance"
        return _failed(gains, spec, f"touchdown: the displacement reaches {share} (or its scale is wrong)")
    if not signals.periodic:
        return _open(with_injection(signals, dataset, rig, gains), rig, gains, spec)
    if why := _swings(signals, rig):
        return _failed(gains, spec, why)
    try:
        return _identified(signals, rig, gains, spec)
    except TellsNothing:
        raise
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _open(signals: RecordedSignals | str, rig: Rig, gains: Gains, spec: RecordingSpec) -> GainSet:
    """A recording without a period: what it shows, or why it does not tell the margins."""
    nothing = replace(_failed(gains, spec, ""), failed=None, open=True)
    if isinstance(signals, str):
        return replace(nothing, untold=signals)
    try:
        found = _identified(signals, rig, gains, spec)
    except ValueError as error:
        return replace(nothing, untold=str(error))
    curves = {name: _known(getattr(found, name)) for name in ("sensitivity", "plant")}
    return replace(found, **curves, untold=_untold(curves["sensitivity"]), open=True)


def _known(curve: Response | None) -> Response | None:
    """The widest band of a response in which noise leaves something of its lines; None where there is none."""
    if curve is None:
        return None
    doubt = np.sqrt(curve.variance) / np.abs(curve.value)
    told = np.concatenate([[False], scipy.ndimage.median_filter(doubt, SMOOTH, mode="nearest") < KNOWN, [False]])
    edges = np.flatnonzero(np.diff(told.astype(int))).reshape(-1, 2)
    if not edges.size:
        return None
    first, last = max(edges, key=lambda e: np.log(curve.frequency[e[1] - 1] / curve.frequency[e[0]]))
    band = slice(first, last)
    return Response(curve.frequency[band], curve.value[band], curve.variance[band])


def _untold(s: Response | None) -> str | None:
    """Why a sensitivity does not bound its peak, or None."""
    if s is None or s.value.size < LEAST_LINES:
        return "what drives it is no more than the noise"
    found = margins(s.frequency, s.value, s.variance, DRAWS)
    if found.intervals["peak_sensitivity"][1] is None:
        return found.reasons.get("peak_sensitivity", "its peak sensitivity is not bounded")
    worst = float(np.max(np.abs(s.value) + LEVEL_SD / 2 * np.sqrt(s.variance / 2)))
    if worst > MOST_DOUBT * found.peak_sensitivity:
        return f"single lines leave a peak sensitivity of up to {worst:.3g}, {MOST_DOUBT:g} times the one seen"
    return found.reasons.get("peak_sensitivity")


def _identified(signals: RecordedSignals, rig: Rig, gains: Gains, spec: RecordingSpec) -> GainSet:
    """What the lines of a recording show.

    Raises:
        TellsNothing: They show nothing of the loop.
        ValueError: What is stated of the recording or the rig is wrong.
    """
    try:
        spectra = record_spectra(signals)
    except ValueError as error:
        raise TellsNothing(str(error), "record what is stated of its excitation, over more periods") from error
    receptance = sensitivity = plant = None
    if spectra.driven["force"].size >= LEAST_LINES and "force" in spectra.force.channels:
        receptance = _response(spectra.force, "displacement", "force")
    injected = spectra.all.at_lines(spectra.driven["current"])
    if injected.lines.size >= LEAST_LINES:
        if "command" in injected.channels:
            sensitivity = _response(injected, "command", "injection")
            plant = _response(injected, "displacement", "command")
        else:  # the controller is known: command = injection - controller * displacement
            moved = _response(injected, "displacement", "injection")
            z = np.exp(2j * np.pi * moved.frequency / rig.control_rate)
            c = controller_response(gains, z, 1 / rig.control_rate)
            s = 1 - c * moved.value
            sensitivity = Response(moved.frequency, s, np.abs(c) ** 2 * moved.variance)
            plant = Response(moved.frequency, moved.value / s, moved.variance / np.abs(s) ** 4)
    if receptance is None and plant is None:
        raise TellsNothing(
            "it shows nothing of the loop",
            f"excite {LEAST_LINES} lines or more at the force (with the channel force) or at the current, best both as "
            "the rig's [protocol] does",
        )
    kept = slice(spectra.transient_periods * _per_period(signals) if signals.periodic else 0, None)
    current = signals.channels.get("current", signals.channels.get("command", np.full(1, np.nan)))
    return GainSet(
        gains, (spec.file,), receptance, sensitivity, plant, (spectra.force,) if receptance else (),
        float(np.abs(signals.channels["displacement"][kept]).max()), float(np.sqrt(np.mean(current[kept] ** 2))), None,
        noise_current=_noise_current(signals, rig),
    )  # fmt: skip


def _noise_current(signals: RecordedSignals, rig: Rig) -> float:
    """Rms of what does not repeat of the coil's current, less the noise of its reading; nan where nothing is left."""
    if not signals.periodic or "current" not in signals.channels:
        return np.nan
    n, current = _per_period(signals), signals.channels["current"]
    periods = current[: current.size // n * n].reshape(-1, n)[1:]
    if len(periods) < 2:
        return np.nan
    power = float((periods - periods.mean(axis=0)).var() * len(periods) / (len(periods) - 1))
    left = power - rig.noise.current**2
    return float(np.sqrt(left)) if left > 0 else np.nan


def _response(statistics: LineStatistics, output: str, source: str) -> Response:
    value, variance = frequency_response(statistics, output, source)
    return Response(statistics.frequency, value, pooled_variance(variance))


def _at_control_rate(signals: RecordedSignals, rig: Rig) -> RecordedSignals:
    """Faster recordings, reduced to the control samples at which the loop's responses are defined."""
    try:
        multiple, _ = sampling(signals.sample_rate, rig.control_rate)
    except ValueError:
        return signals
    if multiple == 1:
        return signals
    channels = {name: values[::multiple] for name, values in signals.channels.items()}
    hold = rig.control_rate if signals.hold_rate else None
    return replace(signals, channels=channels, sample_rate=signals.sample_rate / multiple, hold_rate=hold)


def _per_period(signals: RecordedSignals) -> int:
    return next(e for e in signals.excitations if e.periodic).samples_per_period(signals.sample_rate)


def _swings(signals: RecordedSignals, rig: Rig) -> str | None:
    """Why the loop looks unstable: motion that does not repeat between periods is large and outweighs what does."""
    n, moved = _per_period(signals), signals.channels["displacement"]
    periods = moved[: moved.size // n * n].reshape(-1, n)[1:]
    if len(periods) < 2:
        return None
    repeating = periods.mean(axis=0) - periods.mean()
    rest = float((periods - periods.mean(axis=0)).std() * np.sqrt(len(periods) / (len(periods) - 1)))
    if rest < UNSTEADY * rig.clearance or rest < repeating.std():
        return None
    return f"the rotor swings by itself: {rest * 1e6:.3g} µm rms do not repeat, {repeating.std() * 1e6:.3g} µm do"


def _failed(gains: Gains, spec: RecordingSpec, why: str) -> GainSet:
    return GainSet(gains, (spec.file,), None, None, None, (), np.nan, np.nan, why)


def _joined(gains: Gains, parts: list[GainSet]) -> GainSet:
    """Recordings at equal gains as one set, which failed if one of them did."""
    failed = next((p.failed for p in parts if p.failed), None)
    files = tuple(file for p in parts for file in p.files)
    curves = [
        pooled([r for p in parts if (r := getattr(p, n)) is not None]) for n in ("receptance", "sensitivity", "plant")
    ]
    force = tuple(f for p in parts for f in p.force)
    # Of the first recording that shows them, because a later one may have been driven harder on purpose.
    peak, current, noise = (
        next((v for p in parts if not np.isnan(v := getattr(p, name))), np.nan)
        for name in ("peak_displacement", "current_rms", "noise_current")
    )
    untold = None if any(not p.untold for p in parts) else parts[-1].untold
    return GainSet(gains, files, *curves, force, peak, current, failed, untold, all(p.open for p in parts), noise)


def _mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean and its standard error, from estimates (value, standard error)."""
    if not values:
        return np.nan, np.nan
    v, se = np.array(values, float).T
    return float(v.mean()), float(np.sqrt((se**2).sum()) / len(se))
