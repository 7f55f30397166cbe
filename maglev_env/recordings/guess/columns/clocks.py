"""Columns that stand behind a time of their own, which is not that of the displacement."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.evidence import OPEN
from maglev_env.recordings.guess.rate import time_scale
from maglev_env.recordings.guess.units import Unit
from maglev_env.recordings.guess.words import meaning
from maglev_env.recordings.own_clocks import apart, own_times


def called_time(label: str, unit: Unit | None) -> TypeGuard[Unit]:
    """Whether a column is called a time in seconds."""
    return bool(unit and unit.si == "s" and meaning(label, "s").channel == "time")


def at_one_clock(
    guesses: Mapping[str, ColumnGuess],
    times: Mapping[str, ColumnGuess],
    units: Mapping[str, Unit | None],
    values: Mapping[str, np.ndarray],
    numbers: Mapping[str, float],
) -> dict[str, ColumnGuess]:
    """The guesses of a file with its time that of the displacement, and without channels that were read at others.

    Args:
        guesses: by column, in the file's order.
        times: those that are times, as they were taken first.
        units: that the file states, by column.
        values: (samples,) by column, of samples at which all were read.
        numbers: single numbers of the file.

    Returns:
        A channel whose own clock overlaps that of the displacement, but differs, is none; of one that counts from
        another instant it is asked.
    """
    guesses = dict(guesses)
    main = next((n for n, g in guesses.items() if g.channel == "time" and n in times), "")
    if len(times) < 2 or not main:
        return guesses
    own = own_times(list(guesses), times)
    moved = next((n for n, g in guesses.items() if g.channel.startswith("displacement") and n in own), "")
    if moved and main not in own[moved]:
        guesses[main] = replace(guesses[main], channel="", reason=f"{guesses[main].reason}: not the displacement's")
        main = own[moved][0]
        guesses[main] = times[main]
    clocks = {n: values[n] * _scale(n, units, values, numbers) for n in times}
    for name, guess in guesses.items():
        if not guess.channel or name not in own or main in own[name]:
            continue
        distances = {t: apart(clocks[main], clocks[t]) for t in own[name]}
        nearest = min(distances, key=lambda t: distances[t][0])
        distance, overlap = distances[nearest]
        if not distance:
            continue
        between = f'its time "{times[nearest].label}" is {distance:.3g} s from "{times[main].label}" in the same row'
        if overlap:
            ask = (
                f"whether {guess.channel} is sampled at the other clock of its time column: write both into a file of "
                "their own, and files of one run are joined on their clocks"
            )
            guesses[name] = replace(guess, channel="", reason=f"{guess.reason}; {between}", confidence=OPEN, ask=ask)
        else:
            ask = "; ".join(filter(None, (guess.ask, "whether it was read at the times of the displacement")))
            guesses[name] = replace(guess, reason=f"{guess.reason}; {between}", confidence=OPEN, ask=ask)
    return guesses


def _scale(
    name: str, units: Mapping[str, Unit | None], values: Mapping[str, np.ndarray], numbers: Mapping[str, float]
) -> float:
    unit = units[name]
    return unit.scale if unit else time_scale(values[name], numbers)[0]
