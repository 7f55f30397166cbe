"""Whether a recording is good enough, and for what: the checks of an engineer before trusting an estimate."""

from dataclasses import dataclass, replace

import numpy as np

from estimation.lines.frequency_response import coherence
from estimation.multisine.sphs import crest_factor
from maglev_env.recordings.alarms.alarm import Alarm
from maglev_env.recordings.spectra import RecordedSignals, RecordSpectra, record_spectra
from maglev_env.rig.rig import Rig

GOOD_SNR = 10.0  # amplitude over noise of the mean; one line then gives 10 %
POOR_SNR = 3.0
# The fit of a named rig, of which `estimate` tells the band, needs neither.
_NO_RESPONSE = "no response: needs displacement, and force or current, where one of them is excited"


@dataclass(frozen=True)
class ChannelQuality:
    """One channel.

    Attributes:
        name: Its name.
        rms: In its unit.
        crest: Crest factor.
        resolution: Usual step between readings, in its unit.
        resolution_share: That step as a share of the rms.
        snr_median: Median amplitude over noise of the period mean, over the excited lines; None if never excited.
        snr_worst: The same for the worst line.
    """

    name: str
    rms: float
    crest: float
    resolution: float
    resolution_share: float
    snr_median: float | None
    snr_worst: float | None


@dataclass(frozen=True)
class BandQuality:
    """Quality of one band (Hz): median amplitude over noise, coherence, and a verdict in words.

    It refers to the displacement at force lines or, without any, at all excited lines.
    """

    f_lo: float
    f_hi: float
    snr: float
    coherence: float
    verdict: str


@dataclass(frozen=True)
class Quality:
    """Quality of a recording.

    Attributes:
        periods: Steady periods; of a recording without a period the degrees of freedom of its noise.
        transient_periods: Dropped periods.
        leftover: Samples that belong to no whole period.
        channels: Quality of each channel.
        bands: Quality of each band.
        can: For each use, "yes" or what is missing.
        problems: What to correct before recording again.
        alarms: What went wrong while it was recorded; with one, nothing is "good" or "yes".
        repeats: Whether it has a period.
    """

    periods: int
    transient_periods: int
    leftover: int
    channels: tuple[ChannelQuality, ...]
    bands: tuple[BandQuality, ...]
    can: dict[str, str]
    problems: tuple[str, ...]
    alarms: tuple[Alarm, ...] = ()
    repeats: bool = True


def recording_quality(
    signals: RecordedSignals, rig: Rig | None = None, bands: int = 8, alarms: tuple[Alarm, ...] = ()
) -> Quality:
    """Check one axis of a recording, against the rig's clearance where the rig is known.

    A recording that nothing periodic and no recorded waveform excites gives its levels, and what can be done with it.

    Args:
        signals: The recording.
        rig: Its nominal rig.
        bands: Number of bands.
        alarms: What `read_recording` found.

    Raises:
        ValueError: A periodic recording holds fewer than two periods, or several recorded waveforms excite it.
    """
    if all(e.kind == "none" for e in signals.excitations):
        return _alarmed(_unexcited(signals, rig), alarms)
    return _alarmed(_excited(signals, rig, bands), alarms)


def _unexcited(signals: RecordedSignals, rig: Rig | None) -> Quality:
    """Levels alone, and what each command makes of a recording without an excitation."""
    channels = tuple(_channel(name, values, None) for name, values in signals.channels.items())
    known = {"command", "displacement"} <= signals.channels.keys() and signals.gains is not None
    driven = known or not signals.channels.keys().isdisjoint(("injection", "reference", "force"))
    why = "no: no excitation is stated; state it, or record an injection or force"
    uses = dict.fromkeys(("estimate", "margins", "tune", "diagnose"), why)
    if rig is None:
        uses["diagnose"] = "no: needs a rig"
    elif signals.sample_rate < rig.control_rate:
        uses["estimate"] = uses["diagnose"] = "no: recorded below the control rate of the rig"
    elif driven:
        source = "command and displacement" if known else "the recorded drive"
        uses["estimate"] = uses["diagnose"] = f"yes, in closed loop: {source} give what drove it"
    return Quality(0, 0, 0, channels, (), uses, _beyond(signals, rig))


def _alarmed(quality: Quality, alarms: tuple[Alarm, ...]) -> Quality:
    """The quality with alarms: nothing is "good" or "yes" beside one."""
    if not alarms:
        return quality
    worst = alarms[0]
    refused = worst.severity == "refuse"
    why = f"{'no' if refused else 'with care'}: {worst.code} at {worst.time:.4g} s"
    can = {use: why if refused or verdict.startswith("yes") else verdict for use, verdict in quality.can.items()}
    verdict = worst.code if refused else "usable"
    bands = tuple(replace(b, verdict=verdict if refused or b.verdict == "good" else b.verdict) for b in quality.bands)
    return replace(quality, can=can, bands=bands, alarms=alarms)


_WRITTEN = ("reference", "injection")  # by a generator: the levels of a set point or a telegraph are no converter's


def _beyond(signals: RecordedSignals, rig: Rig | None) -> tuple[str, ...]:
    reach = np.abs(signals.channels["displacement"]).max() if rig and "displacement" in signals.channels else 0.0
    if not rig or reach <= rig.clearance:
        return ()
    return (
        f"displacement reaches {reach:.3g} m, beyond the rig's clearance of {rig.clearance:g} m: "
        "check its scale and offset in [recording.channels]",
    )


def _excited(signals: RecordedSignals, rig: Rig | None, bands: int) -> Quality:
    spectra = record_spectra(signals)
    statistics, dropped = spectra.all, spectra.transient_periods
    problems = []
    if signals.periodic and statistics.periods < 4:
        problems.append(f"{statistics.periods} steady periods: noise is poorly known; record at least 5, better 16")
    if dropped > 1:
        problems.append(f"{dropped} periods of transient: wait longer before recording")
    channels = tuple(_channel(name, values, spectra) for name, values in signals.channels.items())
    for c in channels:
        if c.resolution_share > 0.05 and c.name not in _WRITTEN:
            share = f"{c.resolution_share:.0%}"
            problems.append(f"{c.name}: one converter step is {share} of the rms: raise the amplitude")
    problems.extend(_beyond(signals, rig))
    force = [c for c in channels if c.name == "force"]
    if signals.periodic and force and force[0].crest > 4:
        problems.append(f"force: crest factor {force[0].crest:.1f}; Schroeder phases reach 1.7, optimised ones 1.4")
    per_band = _bands(spectra, bands)
    weak = [b for b in per_band if b.verdict == "noise rules"]
    if weak:
        problems.append(
            f"displacement is lost in noise at {weak[0].f_lo:.0f} .. {weak[-1].f_hi:.0f} Hz: use more force or periods"
        )
    uses = _uses(signals, spectra)
    return Quality(statistics.periods, dropped, spectra.leftover, channels, per_band, uses, tuple(problems),
                   repeats=signals.periodic)  # fmt: skip


def _channel(name: str, values: np.ndarray, spectra: RecordSpectra | None) -> ChannelQuality:
    steps = np.diff(np.unique(values))
    # The mean of equal values differs from them by rounding.
    rms = float(np.sqrt(np.mean((values - values.mean()) ** 2))) if np.ptp(values) else 0.0
    resolution = float(np.median(steps)) if steps.size else 0.0
    median = worst = None
    if spectra is not None and name in spectra.all.channels and name != "injection":
        lines = spectra.driven["force"] if name == "force" else np.concatenate([*spectra.driven.values()])
        excited = spectra.all.at_lines(lines)
        noise = np.sqrt(excited.cross(name, name))
        with np.errstate(divide="ignore", invalid="ignore"):
            snr = np.abs(excited.amplitude(name)) / noise
        if snr.size:
            median, worst = float(min(np.median(snr), 1e9)), float(min(snr.min(), 1e9))
    share = resolution / rms if rms else 0.0
    return ChannelQuality(
        name, rms, crest_factor(values - values.mean()) if rms else 0.0, resolution, share, median, worst
    )


def _bands(spectra: RecordSpectra, count: int) -> tuple[BandQuality, ...]:
    lines = spectra.force.lines if spectra.force.lines.size else np.concatenate([*spectra.driven.values()])
    force = spectra.all.at_lines(lines)
    if not lines.size or "displacement" not in force.channels:
        return ()
    noise = np.sqrt(force.cross("displacement", "displacement"))
    with np.errstate(divide="ignore"):
        snr = np.minimum(np.abs(force.amplitude("displacement")) / noise, 1e9)
    gamma = coherence(force, "displacement")
    rows = []
    for part in np.array_split(np.arange(len(lines)), min(count, len(lines))):
        level = float(np.median(snr[part]))
        verdict = "good" if level >= GOOD_SNR else "usable" if level >= POOR_SNR else "noise rules"
        f = force.frequency[part]
        rows.append(BandQuality(float(f[0]), float(f[-1]), level, float(np.median(gamma[part])), verdict))
    return tuple(rows)


def _uses(signals: RecordedSignals, spectra: RecordSpectra) -> dict[str, str]:
    """For each use of the recording, "yes" or what is missing."""
    have, force, injection = signals.channels.keys(), *(spectra.driven[p] for p in ("force", "current"))
    stiffness = "yes" if force.size and {"force", "displacement"} <= have else _NO_RESPONSE
    if not force.size and {"current", "displacement"} <= have:
        stiffness = "yes, with a known mass, without control: the current stands for the force"
    loop = "yes" if injection.size and {"command", "injection"} <= have else "no: needs an injection and the command"
    amplifier = "yes" if {"command", "current"} <= have else "no: needs command and current"
    controller = "yes" if {"displacement", "command"} <= have else "no: needs displacement and command"
    excited = np.unique(np.concatenate([*spectra.driven.values(), signals.elsewhere]))
    free = np.setdiff1d(np.arange(excited[0], (force if force.size else excited)[-1]), excited)
    found = [name for name, rest in (("even", 0), ("odd", 1)) if (free % 2 == rest).any()]
    distortion = {2: "yes", 1: f"{''.join(found)} only", 0: "no: every line is excited"}[len(found)]
    if not signals.periodic:
        distortion = "no: needs a periodic excitation with lines left out"
    return {
        "stiffness and damping": stiffness,
        "margins": loop,
        "controller block": controller,
        "amplifier block": amplifier,
        "nonlinear distortion": distortion,
    }
