"""What a campaign's recordings show at each gain set, as far as its gains let the rotor levitate."""

from dataclasses import replace

import numpy as np

from maglev_env.experiment import sampling
from maglev_env.loop.gains import PidGains
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.each_recording import each_recording
from maglev_env.recordings.left_out import TellsNothing
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Rig
from tuning.campaign.gain_set import GainSet, failed_set, joined
from tuning.campaign.lines_shown import identified, per_period
from tuning.campaign.open_recording import open_set

TOUCHED = 0.95  # share of the clearance that counts as touchdown (or the sensor's scale is wrong)
UNSTEADY = 0.02  # share of the clearance: a larger rms that does not repeat and outweighs what does is self-oscillation
# Alarms of a record that its gains cause, of what the loop moves; any other is one of the file, or of a sensor.
CAUSED = ("rail", "lost levitation")
MOVED = ("displacement", "command", "current")


def recorded_sets(campaign: Campaign) -> tuple[Campaign, list[GainSet]]:
    """The fit recordings of a one-axis campaign, grouped by their gains, in the order recorded.

    A clipped channel that the loop moves, a touchdown and self-oscillation make a failed set, unless another recording
    at the same gains held. Of a recording without a period, what was
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
    groups: dict[PidGains, list[GainSet]] = {}
    for one in found:
        groups.setdefault(one.gains, []).append(one)
    return used, [joined(gains, parts) for gains, parts in groups.items()]


def _gains(campaign: Campaign, spec: RecordingSpec) -> PidGains:
    if isinstance(spec.gains, PidGains):
        return spec.gains
    what = "no gains are stated" if spec.gains is None else "its controller is another one than a PID"
    raise TellsNothing(
        what,
        "tuning needs the PID gains it was recorded at: gains = { kp = ..., ki = ..., kd = ..., td = ..., ti = ... }, "
        'or controller = { form = "pid", kp = ..., ki = ..., kd = ..., td = ... }',
        campaign.folder / spec.name,
    )


def _one(campaign: Campaign, spec: RecordingSpec, gains: PidGains) -> GainSet:
    where, rig = campaign.folder / spec.name, campaign.rig
    try:
        dataset = read_recording(campaign, spec)
    except TellsNothing as nothing:
        alarm = nothing.alarm
        if alarm and alarm.code in CAUSED and alarm.channel.partition("_")[0] in MOVED:
            return failed_set(gains, spec.name, alarm.sentence)
        raise
    signals = _at_control_rate(recorded_signals(campaign, spec, dataset, excited=False), rig)
    if "displacement" not in signals.channels:
        raise ValueError(f"{where}: the channel displacement is missing; nothing is known of the rotor without it")
    moved = signals.channels["displacement"]
    if (reach := float(np.abs(moved).max())) >= TOUCHED * rig.clearance:
        share = f"{reach / rig.clearance:.0%} of the clearance"
        return failed_set(gains, spec.name, f"touchdown: the displacement reaches {share} (or its scale is wrong)")
    if not signals.periodic:
        return open_set(signals, dataset, rig, gains, spec.name)
    if why := _swings(signals, rig):
        return failed_set(gains, spec.name, why)
    try:
        return identified(signals, rig, gains, spec.name)
    except TellsNothing:
        raise
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


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


def _swings(signals: RecordedSignals, rig: Rig) -> str | None:
    """Why the loop looks unstable: motion that does not repeat between periods is large and outweighs what does."""
    n, moved = per_period(signals), signals.channels["displacement"]
    periods = moved[: moved.size // n * n].reshape(-1, n)[1:]
    if len(periods) < 2:
        return None
    repeating = periods.mean(axis=0) - periods.mean()
    rest = float((periods - periods.mean(axis=0)).std() * np.sqrt(len(periods) / (len(periods) - 1)))
    if rest < UNSTEADY * rig.clearance or rest < repeating.std():
        return None
    return f"the rotor swings by itself: {rest * 1e6:.3g} µm rms do not repeat, {repeating.std() * 1e6:.3g} µm do"
