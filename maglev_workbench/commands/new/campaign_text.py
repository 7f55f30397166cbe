"""campaign.toml with the evidence of every guess as a comment."""

from collections.abc import Sequence
from textwrap import wrap

from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.controllers import said_of_the_integral
from maglev_env.recordings.guess.evidence import Guess
from maglev_env.recordings.guess.recording import RecordingGuess
from maglev_env.rig.rig_file import PRESETS
from maglev_workbench.commands.new.stated import Stated

PLEASE = "please state:"
_WIDTH = 118


def campaign_text(guesses: Sequence[RecordingGuess], stated: Stated) -> str:
    """The content of campaign.toml.

    Args:
        guesses: one for each file.
        stated: what the user said.

    Returns:
        TOML that `load_campaign` reads, but for a sample rate that is not known and stands as 0.
    """
    lines = [
        "# A first description of these files, guessed. Every guess stands with its evidence; what could not be known,",
        f'# or should be looked at, is marked "{PLEASE}". Then: maglev check on this folder.',
        f"schema = {toml_value(SCHEMA)}",
    ]
    if stated.rig:
        lines.append(f"rig = {toml_value(stated.rig)}")
    else:
        lines += _comment(
            f"{PLEASE} the rig, a preset ({', '.join(PRESETS)}) or rig.toml once it is filled in. Without one, "
            "estimate knows only the mass, and diagnose and tune have nothing to compare with."
        )
        lines.append('# rig = "rig.toml"')
    if stated.mass is not None:
        lines += ["", "[parameters]", f"mass = {toml_value(stated.mass)}  # kg, stated"]
    elif not stated.rig:
        lines += ["", *_comment(f"{PLEASE} the moving mass in kg (estimate --estimate-mass fits it from a force).")]
        lines += ["# [parameters]", "# mass = 0.1"]
    for guess in guesses:
        lines += _recording(guess)
    return "\n".join(lines) + "\n"


def _recording(guess: RecordingGuess) -> list[str]:
    lines = ["", "[[recording]]", f"file = {toml_value(guess.file)}", 'role = "fit"']
    for note in guess.notes:
        lines += _comment(f"note: {note}")
    lines += _evidence(guess.rate)
    lines.append(f"sample_rate = {toml_value(float(guess.rate.value or 0.0))}")
    if guess.part:
        lines += [f"start = {guess.part[0]}", f"samples = {guess.part[1]}"]
    if guess.speed_rpm:
        lines.append(f"speed_rpm = {toml_value(guess.speed_rpm)}")
    lines += _evidence(guess.rotor)
    lines += _evidence(guess.controller)
    if guess.gains or guess.form:
        # The table in one line: a table header would end the recording's own keys.
        lines.append(f"gains = {toml_value(guess.gains)}" if guess.gains else f"controller = {toml_value(guess.form)}")
        if guess.gains and guess.rate.value:
            said, same = said_of_the_integral(guess.gains, guess.rate.value)
            lines += [*_comment(said), *([f"# {same}"] if same else [])]
        if any(c.ask for name, c in guess.channels.items() if name.startswith(("displacement", "command"))):
            lines += _comment(
                "these gains hold for the scales below: where you change that of the displacement by a factor, divide "
                "kp, ki and kd by it; of the command, multiply them"
            )
    if guess.excitation.value != "none":
        lines += _comment(
            f'{PLEASE} intersample = "zoh" where a converter holds the excitation, "bl" where it is smooth.'
        )
    lines += _evidence(guess.excitation)
    for table in guess.excitations:
        lines += ["", "[[recording.excitation]]", *(f"{key} = {toml_value(value)}" for key, value in table.items())]
    lines += ["", "[recording.channels]  # SI value = scale * column + offset"]
    for name, column in guess.channels.items():
        lines += _column(column)
        parts = ", ".join(f"{key} = {toml_value(value)}" for key, value in column.source.items())
        lines.append(f"{name} = {{ {parts} }}")
    for column in guess.columns:
        if not column.channel:
            lines += _comment(f"not used: {column.column!r}: {_with_ask(column.reason, column.ask)}")
    return lines


def _column(column: ColumnGuess) -> list[str]:
    return _comment(f"{column.channel} ({column.confidence:.0%}): {_with_ask(column.reason, column.ask)}")


def _evidence(guess: Guess) -> list[str]:
    shown = f"{guess.what}" + (f": {guess.value}" if isinstance(guess.value, str) else "")
    return _comment(f"{shown} ({guess.confidence:.0%}): {_with_ask(guess.reason, guess.ask)}")


def _with_ask(reason: str, ask: str) -> str:
    return f"{reason}. {PLEASE} {ask}" if ask else reason


def _comment(text: str) -> list[str]:
    """A comment of one line or several; no character of a file can end it."""
    text = "".join(c if c.isprintable() else " " for c in text)
    return [f"# {line}" for line in wrap(text, _WIDTH)]
