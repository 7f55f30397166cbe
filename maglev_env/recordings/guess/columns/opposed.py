"""The currents of two opposed coils, each in a column of its own."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from maglev_env.recordings.guess import behaviour as shown
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.evidence import LIKELY
from maglev_env.recordings.guess.units import Unit

_AGAINST = -0.8  # correlation of two currents from which one rises as the other falls
WHICH = "whether the first of these coils pulls towards positive displacements (else exchange them)"


def opposed(
    guesses: dict[str, ColumnGuess],
    named: Mapping[str, ColumnGuess],
    units: Mapping[str, Unit | None],
    values: Mapping[str, np.ndarray],
) -> dict[str, ColumnGuess]:
    """Guesses in which a current that moves against another one is the opposed coil's.

    Each of them is the bias and the control current, with either sign, so half of their difference is the control
    current of the pair. The one that rises with the command is the first; without a command it is asked for.

    Args:
        guesses: by column.
        named: by column, what its name says, also where another column was taken for that channel.
        units: of each column.
        values: of each column (samples,).
    """
    for taken, guess in list(guesses.items()):
        if guess.channel.partition("_")[0] != "current":
            continue
        others = [
            n
            for n, g in named.items()
            if g.channel.startswith("current") and not guesses[n].channel and units[n] == units[taken]
        ]
        against = [n for n in others if _against(values[taken], values[n])]
        if len(against) == 1:
            guesses = guesses | _pair(guesses, taken, against[0], values)
    return guesses


def _against(a: np.ndarray, b: np.ndarray) -> bool:
    one_sided = all(shown.of_one_sign(v * np.sign(v.mean())) for v in (a, b))
    return one_sided and a.mean() * b.mean() > 0 and shown.correlation(a, b) < _AGAINST


def _pair(
    guesses: Mapping[str, ColumnGuess], taken: str, other: str, values: Mapping[str, np.ndarray]
) -> dict[str, ColumnGuess]:
    a, b = values[taken], values[other]
    of = guesses[taken].channel.replace("current", "command")
    command = next((n for n, g in guesses.items() if g.channel == of), None)
    if command is not None and shown.correlation(values[command], a - b) < 0:
        taken, other = other, taken
    reason = (
        f"{guesses[taken].reason.partition(': also')[0]}, moves against {other} (correlation "
        f"{shown.correlation(a, b):.2f}): two opposed coils, of which half the difference is the control current, and "
        f"half the sum, {(a + b).mean() / 2:.4g}, the bias"
    )
    channel = of.replace("command", "current")
    first = replace(
        guesses[taken],
        channel=channel,
        less=other,
        reason=reason,
        confidence=LIKELY,
        ask="" if command is not None else WHICH,
    )
    return {taken: first, other: replace(guesses[other], channel="", reason=f"the coil opposed to {taken}", ask="")}
