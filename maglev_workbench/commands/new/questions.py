"""What the terminal asks, where somebody sits at it."""

import sys
from dataclasses import replace
from math import inf

import typer

from maglev_env.loop.magnets.kinds import MAGNETS
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess, with_scale
from maglev_env.recordings.guess.recording import RecordingGuess
from maglev_env.recordings.guess.units import known_unit
from maglev_workbench.commands.new.stated import Stated
from maglev_workbench.printable import printable


def interactive() -> bool:
    """Whether somebody can answer: input and output are a terminal."""
    return sys.stdin.isatty() and sys.stdout.isatty()


def ask_rig(stated: Stated) -> Stated:
    """Mass and magnet, where they are not stated; an empty answer leaves them open."""
    if stated.mass is None:
        answer = _prompt("Moving mass in kg (empty: not known)")
        stated = replace(stated, mass=_positive(answer, "mass"))
    if stated.magnet is None and stated.rig is None:
        answer = _prompt(f"Magnet: {', '.join(MAGNETS)} (empty: state it later)")
        if answer and answer not in MAGNETS:
            raise ValueError(f"magnet {answer}: use one of {', '.join(MAGNETS)}")
        stated = replace(stated, magnet=answer or None)
    return stated


def ask_rate(file: str) -> float | None:
    """The sample rate of a file without time."""
    return _positive(_prompt(f"Sample rate of {file} in Hz (empty: later)"), "rate")


def ask_units(guess: RecordingGuess) -> RecordingGuess:
    """Units of columns whose header states none; an empty answer takes the guess."""
    return replace(guess, columns=tuple(_asked(c) for c in guess.columns))


def _asked(column: ColumnGuess) -> ColumnGuess:
    if not column.channel or "unit of this column" not in column.ask:
        return column
    answer = _prompt(f"Unit of column {column.column} ({column.channel}; {column.reason}; empty: as guessed)")
    if not answer:
        return column
    unit = known_unit(answer)
    if unit is None:
        raise ValueError(f"unit {answer}: not known; leave it empty, and state scale in campaign.toml")
    known = with_scale(column, unit.scale)
    return replace(known, ask="", confidence=1.0, reason=f"{column.reason}; unit stated: {answer}")


def _prompt(text: str) -> str:
    """What is answered; "" for nothing. The text may hold names of other people's files."""
    return typer.prompt(printable(text), default="", show_default=False)


def _positive(answer: str, what: str) -> float | None:
    if not answer:
        return None
    try:
        value = float(answer)
    except ValueError:
        value = 0.0
    if not 0 < value < inf:
        raise ValueError(f"{what} = {answer} must be a positive number")
    return value
