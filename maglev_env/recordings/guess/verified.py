"""A guess is tried before it is written: what the estimators refuse is not claimed."""

from dataclasses import replace
from pathlib import Path

from maglev_env.recordings.alarms.alarm import Alarm, alarms_of
from maglev_env.recordings.campaign import Campaign, parse_campaign
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.guess.evidence import OPEN
from maglev_env.recordings.guess.recording import RecordingGuess, guess_recording
from maglev_env.recordings.guess.suspended import around_the_centre, facing_the_magnet
from maglev_env.recordings.recording import read_recording
from maglev_env.recordings.signals import recorded_signals
from maglev_env.recordings.spectra import axis_signals, record_spectra

_MOST_CUTS = 4  # a rotor is often lost again where it was caught


def verified(guess: RecordingGuess, folder: Path, cuts: int = 0) -> RecordingGuess:
    """The guess with what reading the file by it shows.

    Args:
        guess: of a file in the folder.
        folder: of the campaign.
        cuts: how often the file has been cut to the part that levitates.

    Returns:
        Itself; of the longest stretch that levitates, where levitation is lost; without an excitation that gives no
        responses; with a note where the recording is refused.
    """
    if guess.rate.value is None:
        return guess
    try:
        campaign = parse_campaign(folder, {"schema": SCHEMA, "recording": [guess.table()]})
        dataset = read_recording(campaign, campaign.recordings[0], alarmed=True)
    except ValueError as error:
        return replace(guess, notes=(*guess.notes, f"reading says: {error}"))
    alarms = alarms_of(dataset)
    lost = next((alarm for alarm in alarms if alarm.code == "lost levitation" and alarm.stretch), None)
    if lost and cuts < _MOST_CUTS:
        return verified(_levitated(guess, folder, lost), folder, cuts + 1)
    guess = around_the_centre(facing_the_magnet(guess, dataset), dataset)
    heard = [f"alarm: {alarm.sentence}" for alarm in alarms]
    said = [note for note in dataset.attrs["notes"] if note not in guess.notes]
    guess = replace(guess, notes=(*guess.notes, *said, *heard))
    if all(e.kind == "none" for e in campaign.recordings[0].excitations):
        return guess
    try:
        signals = recorded_signals(campaign, campaign.recordings[0], dataset)
        for axis in range(signals.axes):
            if (own := axis_signals(signals, axis)).excitations:
                record_spectra(own)
    except ValueError as error:
        reason = f"{guess.excitation.reason}; no response can be told from it: {error}"
        nothing = replace(guess.excitation, reason=reason, confidence=OPEN, value="none")
        return replace(guess, excitation=nothing, excitations=({"kind": "none"},))
    return guess


def _levitated(guess: RecordingGuess, folder: Path, lost: Alarm) -> RecordingGuess:
    """The guess of the longest stretch that levitates; what was guessed or stated of the columns stays."""
    part = guess_recording(folder / guess.file, rate=guess.rate.value, part=lost.stretch, columns=guess.columns)
    notes = dict.fromkeys((*guess.notes, *part.notes, f"alarm: {lost.sentence}; that stretch is taken"))
    rotor = max(guess.rotor, part.rotor, key=lambda one: one.confidence)
    return replace(part, file=guess.file, rate=guess.rate, notes=tuple(notes), rotor=rotor)


def guessed_campaign(
    path: Path, rate: float | None = None, mass: float | None = None
) -> tuple[Campaign, RecordingGuess]:
    """One data file as a campaign in memory, without a rig.

    Args:
        path: the file.
        rate: sample rate in Hz where the user states it.
        mass: moving mass, kg, where the user states it.

    Returns:
        The campaign and what was guessed for it.

    Raises:
        OSError: the file cannot be read.
        ValueError: it is no data file, or its rate or displacement cannot be told.
    """
    guess = guess_recording(path, rate=rate)
    if guess.rate.value is None:
        raise ValueError(f"{path}: {guess.rate.reason}; state it: --rate HZ, or describe the file: maglev new {path}")
    guess = verified(guess, path.parent)
    parameters = {} if mass is None else {"mass": mass}
    table = {"schema": SCHEMA, "parameters": parameters, "recording": [guess.table()]}
    return parse_campaign(path.parent, table), guess
