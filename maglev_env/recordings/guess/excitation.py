"""What excited a recording: lines of the injection, reference or force, or in words what else happened."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from maglev_env.channels import SHOWN_BY
from maglev_env.recordings.guess.behaviour import roughness, steps_in
from maglev_env.recordings.guess.evidence import LIKELY, OPEN, SURE, Guess
from maglev_env.recordings.guess.period import Lines, lines_of, period_of, strongest_line
from maglev_env.recordings.guess.shape import shape_of

_CLEANEST_FIRST = ("current", "reference", "force")  # an injection and a reference are made, a force is measured
_MADE = ("current", "reference")  # by a generator, which does not only read them
# Share of the power of what is made that does not repeat, from which it is no period; growth of a difference over two
# periods that is a drift; and largest roughness of what moves slowly.
_BESIDE, _DRIFT, _SLOW = 0.02, 1.5, 0.5
_SMALL = 1e-6  # of a channel's largest value: below it a channel does not move
Table = dict[str, Any]


def guess_excitation(channels: Mapping[str, np.ndarray], rate: float | None) -> tuple[list[Table], Guess]:
    """The excitation tables of a recording.

    Args:
        channels: channel -> values (samples,) in SI.
        rate: sample rate, Hz; None where it is not known: periods are then stated in samples.

    Returns:
        Tables as [[recording.excitation]] takes them, and the evidence. Where nothing that is recorded excites, one
        table of kind "none".
    """
    moving = {
        (place, name): values
        for place in _CLEANEST_FIRST
        for name, values in channels.items()
        if name in (SHOWN_BY[place], f"{SHOWN_BY[place]}_x", f"{SHOWN_BY[place]}_y") and _moves(values)
    }
    period, of = _common_period(moving)
    if period:
        tables, words = _periodic(moving, period, rate)
        if tables:
            reason = f"{of} repeats every {period} samples: {'; '.join(words)}"
            return tables, Guess("excitation", tables, reason, SURE)
    return _aperiodic(moving, channels, rate)


def _moves(values: np.ndarray) -> bool:
    return bool(np.ptp(values) > _SMALL * max(np.abs(values).max(), 1e-300))


def _common_period(moving: Mapping[tuple[str, str], np.ndarray]) -> tuple[int, str]:
    """Samples of the longest period that a channel shows, and that channel; 0 where none repeats."""
    found = [
        (p[0], name)
        for (place, name), v in moving.items()
        if (p := period_of(v)) and not _wanders(v, p[0]) and not (place in _MADE and _more_than(v, p[0]))
    ]
    return max(found, default=(0, ""))


def _wanders(values: np.ndarray, period: int) -> bool:
    """Whether steps (samples,) come a sample earlier or later each time, as those of 0.3 Hz at 2 kHz do: they repeat
    nearly, and samples would seem to be missing."""
    later = values[period:] if values.size >= 3 * period else values  # before the first period it may rest
    return bool(steps_in(values) and np.any(later[period:] != later[:-period]))


def _more_than(values: np.ndarray, period: int) -> bool:
    """Whether what is made (samples,) moves slowly beside what repeats in it: noise on a square wave drives, too.

    The noise of a converter is rough, and what a clock of its own makes of a period differs more from one to the next.
    """
    if values.size < 3 * period:
        return False
    once, twice = values[period:] - values[:-period], values[2 * period :] - values[: -2 * period]
    share = float(once.var()) / max(2 * float(values.var()), 1e-300)
    return share > _BESIDE and float(twice.var()) < _DRIFT * float(once.var()) and roughness(once) < _SLOW


def _periodic(
    moving: Mapping[tuple[str, str], np.ndarray], period: int, rate: float | None
) -> tuple[list[Table], list[str]]:
    """A table for every channel with lines of its own."""
    taken: set[int] = set()
    tables, words = [], []
    for (place, name), values in moving.items():
        lines = lines_of(values, period)
        own = tuple(k for k in lines.harmonics if k not in taken)
        # What is left of a force beside the lines of the injection is the bearing's answer to it, unless it is strong.
        sizes = {k: abs(phasor) for k, phasor in zip(lines.harmonics, lines.phasors, strict=True)}
        strongest = max(sizes.values(), default=0.0)
        own_strongest = max((sizes[k] for k in own), default=0.0)
        if not own or own_strongest < 0.1 * strongest:
            continue
        taken |= set(own)
        tables.append(_table(place, name, own, lines, period, rate))
        words.append(_in_words(name, own, rate and rate / period, lines))
    return tables, words


def _table(place: str, name: str, own: tuple[int, ...], lines: Lines, period: int, rate: float | None) -> Table:
    first, last = own[0], own[-1]
    whole = first < last == first + len(own) - 1
    return {
        # The phases are not used where the channel is recorded: of the multisines this one claims nothing of them.
        "kind": "multisine",
        "at": place,
        **({"direction": 90.0} if name.endswith("_y") else {}),
        **({"fundamental": rate / period} if rate else {"period_samples": period}),
        **({"harmonics": [first, last]} if whole else {"lines": list(own)}),
        "amplitude": float(f"{lines.peak(own):.4g}"),
    }


def _in_words(name: str, own: tuple[int, ...], fundamental: float | None, lines: Lines) -> str:
    in_hertz = (lambda k: f"{k * fundamental:.6g} Hz") if fundamental else (lambda k: f"{k} per period")
    if len(own) == 1:
        return f"{name} is one sine of {in_hertz(own[0])}, peak {lines.peak(own):.3g}"
    steps = np.unique(np.diff(own))
    every = (
        f", every {steps[0]}" if steps.size == 1 and steps[0] > 1 else "" if steps.size == 1 else ", not all of them"
    )
    return f"{name} has {len(own)} lines from {in_hertz(own[0])} to {in_hertz(own[-1])}{every}, {lines.periods} periods"


def _aperiodic(
    moving: Mapping[tuple[str, str], np.ndarray], channels: Mapping[str, np.ndarray], rate: float | None
) -> tuple[list[Table], Guess]:
    shapes = {key: shape_of(values, rate) for key, values in moving.items()}
    planar = "displacement_x" in channels
    for wanted in ("noise", "chirp", "blows", "steps", "other"):
        for (place, name), (shape, why) in shapes.items():
            if shape == wanted and not planar:
                reason = f"{name} does not repeat, {shape}: {why}" if shape != "other" else f"{name} moves: {why}"
                return [{"kind": "recorded", "at": place}], Guess("excitation", shape, reason, LIKELY)
    moved = next((channels[n] for n in ("displacement", "displacement_x") if n in channels), None)
    known = "no force, injection or reference in the file moves"
    if moving:
        names = " and ".join(f"{name} ({shapes[key][0]})" for key in moving for name in key[1:])
        reason = f"{names} moves without a period: of two axes the rig is fitted to all of the record"
        return [{"kind": "none"}], Guess("excitation", "none", reason, LIKELY)
    hover = [{"kind": "none"}]
    if moved is None or not _moves(moved):
        return hover, Guess("excitation", "none", known, OPEN, "what excited the rotor, if anything")
    if period_of(moved):
        cycles = strongest_line(moved)  # after some turns only, a vibration fits into whole samples
        hint = f"{known}; the displacement vibrates " + (
            f"at {cycles * rate:.3g} Hz above all" if rate else f"above all every {1 / cycles:.3g} samples"
        )
    else:
        shape, why = shape_of(moved, rate)
        hint = f"{known}; the displacement is {shape}: {why}"
    ask = "what excited the rotor, if anything (hover: leave it; a stored column: name it in the channels)"
    return hover, Guess("excitation", "none", hint, OPEN, ask)
