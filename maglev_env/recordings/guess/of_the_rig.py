"""What a named rig may tell of a recording that its file does not."""

from dataclasses import replace

from maglev_env.loop.gains import Gains, as_table
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.recordings.guess.recording import RecordingGuess
from maglev_env.rig.rig import Rig


def perhaps_of_the_rig(guess: RecordingGuess, rig: Rig) -> RecordingGuess:
    """The guess of a file whose command nothing explains, with the controller that the rig states to ask for: a
    recording has the one that it names itself, and none otherwise."""
    own = rig.gains
    if guess.gains or guess.form or own is None or isinstance(own, tuple):
        return guess
    if not {"displacement", "command"} <= guess.channels.keys():
        return guess
    key = "gains" if isinstance(own, Gains) else "controller"
    ask = f"whether the controller is that of the rig; then {key} = {toml_value(as_table(own))}"
    return replace(guess, controller=replace(guess.controller, ask=ask))
