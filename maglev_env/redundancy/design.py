"""The designed waveform against the recorded force, injection and reference."""

import numpy as np

from maglev_env.channels import SHOWN_BY, unit_of
from maglev_env.redundancy.finding import Finding
from maglev_env.redundancy.rows import MODEL, Row
from maglev_env.redundancy.view import View
from maglev_env.rig.excitation import Excitation

# How far a sound excitation may be from its stated peak: a shaker's amplifier is set by hand, a sequence is digital.
SHAKER, DIGITAL = 0.1, 0.02
SHAPE = 0.2  # relative: an unequal spectrum of a designed one
DEAD, SIGNIFICANT = 0.01, 5.0  # of the median amplitude: a line without power, if it is below so many of its errors


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
    spectrum = np.zeros(samples // 2 + 1, complex)
    spectrum[lines.harmonics * every] = mean * (samples / 2)
    peak = float(np.abs(np.fft.irfft(spectrum, samples)).max())
    amplitude = np.abs(mean)
    level = float(np.median(amplitude))
    uneven = float(np.median(np.abs(amplitude - level))) / level if e.kind != "low_crest" else 0.0
    falls = float(np.polyfit(np.log(lines.frequency), np.log(np.maximum(amplitude, 1e-9 * level)), 1)[0])
    return Row(
        f"designed {name}",
        {name: 1},
        _sign(view, e, mean, lines.harmonics) * peak / e.amplitude,
        float(np.sqrt(variance.sum()) / size) + MODEL / np.sqrt(len(mean)),
        DIGITAL if e.at == "current" else SHAKER,
        f"its stated {e.amplitude:g} {unit_of(name)} peak",
        misfit=uneven,
        most_misfit=SHAPE,
        notes={"slope": falls},
    )


def _sign(view: View, e: Excitation, mean: np.ndarray, harmonics: np.ndarray) -> int:
    """-1 where the recorded lines are the design's with the sign reversed and a period that begins as stated."""
    if e.kind != "sphs":
        return 1
    try:
        wave = e.on_grid(view.rate).multisine(view.rate)
    except ValueError:
        return 1
    design = wave.amplitudes * np.exp(1j * wave.phases)
    if design.size != mean.size:
        return 1
    agreement = np.vdot(design, mean).real / np.sqrt(np.vdot(design, design).real * np.vdot(mean, mean).real)
    direction = np.cos(np.deg2rad(e.direction))
    return -1 if agreement * np.sign(direction or 1.0) < -0.9 else 1


def dead_lines(view: View) -> list[Finding]:
    """Stated lines at which the recorded injection or reference has no power (`check_excited` does the force)."""
    found = []
    for e in view.excitations:
        name = SHOWN_BY[e.at]
        if not e.periodic or e.at == "force" or name not in view.recorded:
            continue
        lines = view.lines.at(np.isin(view.lines.harmonics, e.lines))
        parts = lines.parts[name]
        amplitude = np.abs(parts.mean(axis=0))
        error = np.sqrt(parts.var(axis=0, ddof=1) / len(parts))
        level = float(np.median(amplitude[amplitude > 0])) if amplitude.any() else 0.0
        dead = (amplitude <= SIGNIFICANT * error) & (amplitude <= DEAD * max(level, 1e-300)) if level else amplitude == 0
        noisy = bool(np.median(amplitude) <= 3 * np.median(error))
        if dead.any() or noisy:
            count = int(dead.sum()) if dead.any() else int((amplitude <= 3 * error).sum())
            text = (
                f"{name}: no power at {count} of its {amplitude.size} stated lines; check the excitation's lines and "
                f"fundamental, sample_rate, start, and column {view.columns.get(name, name)!r}"
            )
            found.append(Finding("lines", view.recording, name, float(count), None, text, "contradiction"))
    return found
