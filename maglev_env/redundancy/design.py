"""The designed waveform against the recorded force, injection and reference."""

import numpy as np

from maglev_env.channels import SHOWN_BY, unit_of
from maglev_env.recordings.guess.behaviour import steps_in
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import MODEL, Row
from maglev_env.redundancy.view import Lines, View
from maglev_env.rig.excitation import Excitation

# How far a sound excitation may be from its stated peak: a shaker's amplifier is set by hand, a sequence is digital.
SHAKER, DIGITAL = 0.1, 0.02
ALIKE = 0.9  # correlation with the designed period from which its sign is told
SHAPE = 0.2  # relative: an unequal spectrum of a designed one
SIGNIFICANT, FLOOR = 3.0, 1e-6  # standard errors of a line's mean, and share of the strongest line: as `check_excited`
MOST_DEAD, LEAST = 0.3, 12  # share of lines that noise may hide in every channel, and lines for which that is judged


def designed(view: View) -> list[Row]:
    """The gain of each recorded excitation against its stated peak, and how unequal its lines are.

    The peak of the mean period, of its stated lines alone, is normal about the stated one with the error of the mean;
    phases are not compared, because a recording may begin anywhere in a period.
    """
    return [row for e in view.excitations if (row := _row(view, e)) is not None]


def _row(view: View, e: Excitation) -> Row | None:
    name = SHOWN_BY[e.at]
    if not e.periodic or e.at not in view.stated_peaks or name not in view.recorded:
        return None
    lines = view.lines.at(np.isin(view.lines.harmonics, e.lines))
    parts = lines.parts[name]
    mean = parts.mean(axis=0)
    variance = parts.var(axis=0, ddof=1) / len(parts)
    size = float(np.sqrt((np.abs(mean) ** 2).sum()))
    if not size:
        return None
    samples, every = view.block
    # The peak is stated of the samples of the controller, and a slower recording misses it.
    made = samples if view.rig is None else max(samples, round(samples * view.rig.control_rate / view.rate))
    spectrum = np.zeros(made // 2 + 1, complex)
    spectrum[lines.harmonics * every] = mean * (made / 2)
    peak = float(np.abs(np.fft.irfft(spectrum, made)).max())
    sign = _sign(view, e, mean)
    amplitude = np.abs(mean)
    level = float(np.median(amplitude))
    # The lines of steps fall with their frequency, and a few sines have amplitudes of their own: both are stated as a
    # multisine.
    equal = e.kind != "low_crest" and amplitude.size >= LEAST and not steps_in(view.channels[name])
    uneven = float(np.median(np.abs(amplitude - level))) / level if equal else 0.0
    falls = 0.0  # one line has no slope
    if amplitude.size > 1:
        falls = float(np.polyfit(np.log(lines.frequency), np.log(np.maximum(amplitude, 1e-9 * level)), 1)[0])
    return Row(
        f"designed {name}",
        {name: 1},
        (sign or 1) * peak / e.amplitude,
        float(np.sqrt(variance.sum()) / size) + MODEL / np.sqrt(len(mean)),
        DIGITAL if e.at == "current" else SHAKER,
        f"its stated {e.amplitude:g} {unit_of(name)} peak",
        misfit=uneven,
        most_misfit=SHAPE,
        signed=sign != 0,
        notes={"slope": falls},
    )


def _sign(view: View, e: Excitation, mean: np.ndarray) -> int:
    """1 or -1 where the recorded lines are the design's or its negative, in a period that begins as stated; else 0."""
    if e.kind != "sphs":
        return 0
    try:
        wave = e.on_grid(view.rate).multisine(view.rate)
    except ValueError:
        return 0
    design = wave.amplitudes * np.exp(1j * wave.phases)
    if design.size != mean.size:
        return 0
    agreement = np.vdot(design, mean).real / np.sqrt(np.vdot(design, design).real * np.vdot(mean, mean).real)
    direction = np.cos(np.deg2rad(e.direction))
    known = agreement * np.sign(direction or 1.0)
    return int(np.sign(known)) if abs(known) > ALIKE else 0


def dead_lines(view: View) -> list[Finding]:
    """Stated lines without power: in the recorded excitation itself, or, where that is not recorded, in any channel."""
    if not view.periodic:
        return []
    found = []
    for e in view.excitations:
        name = SHOWN_BY[e.at]
        if not e.periodic or name not in view.recorded:
            continue
        dead = _dead(view, name, view.lines.at(np.isin(view.lines.harmonics, e.lines)))
        if dead.any():
            line = e.lines[int(np.argmax(dead))]
            text = (
                f"channel {name!r}: no excitation at line {line} ({line * e.fundamental:g} Hz), and at {dead.sum()} of "
                f"{dead.size} stated lines in all; correct the excitation's lines, fundamental, sample_rate or start, "
                f"or column {view.columns.get(name, name)!r}"
            )
            found.append(Finding("lines", view.recording, name, float(dead.sum()), None, text, "contradiction"))
    if found:
        return found
    dead = [_dead(view, name, view.lines) for name in view.lines.parts if name in view.recorded]
    share = float(np.all(dead, axis=0).mean()) if dead else 0.0
    if share > MOST_DEAD and view.lines.frequency.size >= LEAST:
        text = (
            f"time: {share:.0%} of the stated lines move no channel; check sample_rate ({view.rate:g} Hz), the "
            "excitation's fundamental and its lines"
        )
        return [Finding("lines", view.recording, "time", share, None, text, "contradiction")]
    return []


def _dead(view: View, name: str, lines: Lines) -> np.ndarray:
    """Lines (n,) at which a channel does not exceed its error, and hardly its strongest line."""
    parts = lines.parts[name]
    amplitude = np.abs(parts.mean(axis=0))
    error = np.sqrt(parts.var(axis=0, ddof=1) / len(parts))
    return (amplitude <= SIGNIFICANT * error) | (amplitude <= FLOOR * amplitude.max(initial=0.0))
