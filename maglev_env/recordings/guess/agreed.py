"""Guesses of several files of one rig: what a file cannot tell of a column, another file with the same column may."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from maglev_env.channels import EFFORTS, MEASURED
from maglev_env.recordings.formats.time_stamps import JITTERED_RATE_TOLERANCE, STEP_TOLERANCE
from maglev_env.recordings.guess.columns.column_guess import ColumnGuess
from maglev_env.recordings.guess.controllers import SAME_GAIN, alike
from maglev_env.recordings.guess.evidence import LIKELY, STATED, Guess
from maglev_env.recordings.guess.recording import RecordingGuess, in_another_unit, other_way_round
from maglev_env.recordings.guess.suspended import CENTRE, asked_for_the_centre
from maglev_env.recordings.guess.told_by_others import as_told, told_by

AGREED = frozenset(MEASURED) | {"reference", "injection", "voltage"}  # the clock is each file's own, and so is its unit


def without_motion(guesses: Mapping[Path, RecordingGuess]) -> dict[Path, RecordingGuess]:
    """Files in which nothing says how the rotor moves, where others do; without any other a coil alone may be meant."""
    moving = ("displacement", "acceleration")
    still = {f: g for f, g in guesses.items() if not any(name.startswith(moving) for name in g.channels)}
    return still if len(still) < len(guesses) else {}


def _agrees(channel: str) -> bool:
    """Whether the files of a rig have one scale for a channel; of two axes for each."""
    return channel.removesuffix("_x").removesuffix("_y") in AGREED


def _place(guess: RecordingGuess, column: str) -> str:
    """Where a column is in a file, without the name of the file as which programs such as ControlDesk save it."""
    root, _, rest = column.partition(".")
    return rest if rest and root == Path(guess.file).stem else column


def like_most(guesses: Sequence[RecordingGuess]) -> list[tuple[ColumnGuess, ...] | None]:
    """What the columns of each file are where files with the same columns are not taken for the same.

    The assignment that most of them have is taken, and of two the one with more channels; for files that have it, None.
    One that shows opposed coils goes before all others: at rest, noise hides that one current rises as the other falls.
    A column that rests in a file, as the injection of the other axis, says nothing against what it is in others.

    Args:
        guesses: one for each file.
    """
    alike: dict[tuple[str, ...], list[RecordingGuess]] = {}
    for guess in guesses:
        alike.setdefault(tuple(_place(guess, c.column) for c in guess.columns), []).append(guess)
    found = []
    for guess in guesses:
        others = alike[tuple(_place(guess, c.column) for c in guess.columns)]
        model = max(others, key=lambda one: (_pairs(one), sum(_agree(one, g) for g in others), len(one.channels)))
        if _agree(guess, model):
            found.append(None)
            continue
        both = list(zip(model.columns, guess.columns, strict=True))
        names = {c.column: own.column for c, own in both}
        found.append(
            tuple(own if own.channel == c.channel == "time" else _as_in(model, c, own, names) for c, own in both)
        )
    return found


def _pairs(guess: RecordingGuess) -> int:
    """How many pairs of opposed coils a file shows."""
    return sum(bool(c.less) for c in guess.columns)


def _as_in(model: RecordingGuess, column: ColumnGuess, own: ColumnGuess, names: Mapping[str, str]) -> ColumnGuess:
    """The column of a file as the one of the model with the same name; names: those of the model -> of the file."""
    less = names.get(column.less, "")
    same = (column.channel, less) == (own.channel, own.less)
    reason = column.reason if same else f"as in {model.file}, which has the same columns: {column.reason}"
    return replace(column, column=own.column, reason=reason, less=less)


def _agree(one: RecordingGuess, other: RecordingGuess) -> bool:
    """Whether two files with the same columns take each for the same channel, where it does not rest."""
    both = zip(one.columns, other.columns, strict=True)
    same = all(a.channel == b.channel or a.resting or b.resting for a, b in both)
    return same and _pairs(one) == _pairs(other)


def one_clock(guesses: Sequence[RecordingGuess]) -> list[Guess]:
    """The rate of each file, with one for all whose clocks jitter about nearly the same.

    The mean rate of such a clock differs from run to run, and it is no other one for that. The rate that most have is
    taken, of several the first.

    Args:
        guesses: one for each file.
    """
    jittering = [g for g in guesses if g.jitter > STEP_TOLERANCE and g.rate.value and g.rate.confidence < STATED]
    found = []
    for guess in guesses:
        jitters = any(g is guess for g in jittering)
        near = [g for g in jittering if jitters and _nearly(g.rate.value, guess.rate.value)]
        values = [g.rate.value for g in near]
        model = max(near, key=lambda g: values.count(g.rate.value), default=guess)
        clock = guess.rate
        if model.rate.value != clock.value:
            said = f"{model.rate.value:g} Hz, that of {model.file}, because the clock jitters; here {clock.reason}"
            clock = replace(clock, value=model.rate.value, reason=said)
        found.append(clock)
    return found


def _nearly(one: float, other: float) -> bool:
    return abs(one / other - 1) < JITTERED_RATE_TOLERANCE


def one_rotor(guesses: Sequence[RecordingGuess]) -> list[RecordingGuess]:
    """The guesses with the rotor that hangs below a magnet in all files, where the current of one shows it.

    A large excitation may turn the current of another file round, which then shows nothing by itself.

    Args:
        guesses: one for each file.
    """
    hangs = next((g for g in guesses if g.rotor.value == "suspended" and g.rotor.confidence >= LIKELY), None)
    if hangs is None:
        return list(guesses)
    seen = f"as {hangs.file} shows it ({hangs.rotor.reason})"
    return [
        replace(g, rotor=replace(hangs.rotor, reason=f"{seen}; here {g.rotor.reason}"))
        if g.rotor.confidence < LIKELY and _efforts(g) & _efforts(hangs)
        else g
        for g in guesses
    ]


def _efforts(guess: RecordingGuess) -> set[tuple[str, str]]:
    return {(c.channel, _place(guess, c.column)) for c in guess.columns if c.channel.partition("_")[0] in EFFORTS}


def agreed(guesses: Sequence[RecordingGuess]) -> list[RecordingGuess]:
    """The guesses with one scale for each column that several files have as the same channel.

    Without a unit in its header the file with the largest values tells the unit, because the size of small ones may be
    that of a quiet rotor; the clock of each file is its own. A file in which the current shows that positions are
    distances from the magnet tells it of the others, too; files whose controller is known rather than others. What is
    asked stays asked.

    Args:
        guesses: one for each file.
    """
    columns: dict[tuple[str, str], list[tuple[str, ColumnGuess]]] = {}
    for guess in guesses:
        for column in guess.columns:
            if _agrees(column.channel):
                columns.setdefault((column.channel, _place(guess, column.column)), []).append((guess.file, column))
    known_loops = {g.file for g in guesses if g.gains or g.form}
    told = {key: told_by(same, known_loops) for key, same in columns.items()}
    apart = {key for key, same in columns.items() if any(CENTRE in c.ask for _, c in same)}

    def with_others(guess: RecordingGuess, column: ColumnGuess) -> ColumnGuess:
        if not _agrees(column.channel):
            return column
        key = column.channel, _place(guess, column.column)
        column = as_told(column, told[key])
        return asked_for_the_centre(column) if key in apart else column

    found = []
    for guess in guesses:
        own = tuple(with_others(guess, c) for c in guess.columns)
        known = replace(guess, columns=own)
        changed = next(
            (a.scale / b.scale for a, b in zip(own, guess.columns, strict=True)
             if a.channel in ("displacement", "displacement_x")), 1.0
        )  # fmt: skip
        known = other_way_round(known) if changed < 0 else known
        found.append(in_another_unit(known, abs(changed)) if abs(changed) != 1 else known)
    found = one_controller(found)
    return [_perhaps_the_same_controller(guess, found) for guess in found]


def one_controller(guesses: Sequence[RecordingGuess]) -> list[RecordingGuess]:
    """The guesses with one set of gains in all files whose sets differ by no more than their fits may.

    Of the sets with all parts that any file shows the most certain one is taken, and of these the one that leaves
    least of its command: there the digits of the columns spoil it least. Rest does not show an integral part.

    Args:
        guesses: one for each file.
    """
    shown = sorted(
        (g for g in guesses if g.gains),
        key=lambda g: (not g.gains["ki"], not g.gains["kd"], -g.controller.confidence, g.controller.left),
    )
    found: list[RecordingGuess] = []
    for guess in guesses:
        if guess.form:
            same = next((g for g in found if g.form and _like(g.form, guess.form)), guess)
            said = (
                guess.controller
                if same is guess
                else replace(
                    guess.controller, value=same.form, reason=f"{guess.controller.reason}; as that of {same.file}"
                )
            )
            found.append(replace(guess, form=same.form, controller=said))
            continue
        like = next((g for g in shown if guess.gains and alike(g.gains, guess.gains, SAME_GAIN)), guess)
        if like.gains != guess.gains:
            said = replace(guess.controller, reason=f"{guess.controller.reason}; the gains are those of {like.file}")
            guess = replace(guess, gains=like.gains, controller=replace(said, value=like.gains))
        found.append(_with_time_constants(guess, shown))
    return found


def _with_time_constants(guess: RecordingGuess, shown: Sequence[RecordingGuess]) -> RecordingGuess:
    """The guess with the time constants of the first file that has nearly the same: other gains of one controller.

    Its slope and its integral stay, since a fit tells these and not the constants beside them.
    """
    if not guess.gains:
        return guess
    gains, said = dict(guess.gains), []
    for time, gain in (("td", "kd"), ("ti", "ki")):
        own = gains[time]
        if not gains[gain] or own <= 0:
            continue
        like = next((g for g in shown if g.gains[gain] and abs(g.gains[time] - own) <= SAME_GAIN * own), guess)
        first = like.gains[time]
        if first != own:
            gains[gain], gains[time] = float(f"{gains[gain] * first / own:.7g}"), first
            said.append(f"{time} is that of {like.file} (what is left is that of {own:g} s here), and {gain} follows")
    controller = replace(guess.controller, value=gains, reason="; ".join([guess.controller.reason, *said]))
    return replace(guess, gains=gains, controller=controller)


def _like(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two controllers of another form have the same parts, and numbers that their fits may leave different."""

    def same(a: Any, b: Any) -> bool:
        return a == b if isinstance(a, str) or isinstance(b, str) else abs(a - b) <= SAME_GAIN * max(abs(a), abs(b))

    return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)


def _perhaps_the_same_controller(guess: RecordingGuess, others: Sequence[RecordingGuess]) -> RecordingGuess:
    """The guess of a file whose command holds more than a controller makes, with the one that others show to ask for.

    Of several the one under which most happened is shown, since rest tells a controller badly.
    """
    shown = [g for g in others if g.gains and _efforts(g) & _efforts(guess)]
    kinds = {name.partition("_")[0] for name in guess.channels}
    if guess.gains or guess.form or not shown or not {"displacement", "command"} <= kinds:
        return guess
    best = min(shown, key=lambda g: g.excitation.value == "none")
    gains = ", ".join(f"{name} = {value:.7g}" for name, value in best.gains.items())
    ask = (
        f"whether the controller is that of {best.file}; then gains = {{ {gains} }}, and what it does not make of the "
        "command counts as added by somebody"
    )
    return replace(guess, controller=replace(guess.controller, ask=ask))
