"""Where tones of the mains, of the rotation or of unknown origin come from, and their lines over a whole record."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
from scipy import stats

from estimation.lines.line_windows import WIDTH, LineWindows
from estimation.lines.tones import Tone

MAINS = (50.0, 60.0)  # Hz
HARMONICS = 3
HIGHEST = 9  # harmonic of the mains or of the rotation that a tone of unknown origin may be, where that is seen
ON_LINE = 0.1  # share of the line spacing within which a tone counts as lying on a line
NEAR = 2e-3  # relative uncertainty of the frequencies of mains and rotation
TURNS = 3.0  # in a recording, below which what seems a tone may be any slow wander of the reading
SAME = 0.6  # bins of the record's resolution within which two frequencies count as one


def families(speed_rpm: float) -> dict[str, tuple[float, ...]]:
    """Frequencies (Hz) by origin: "pickup" of 50 or 60 Hz mains, and "spin" of a rotating rotor."""
    found = {f"pickup {f:g} Hz": tuple(f * n for n in range(1, HARMONICS + 1)) for f in MAINS}
    if speed_rpm > 0:
        found["spin"] = tuple(speed_rpm / 60 * n for n in range(1, HARMONICS + 1))
    return found


def near_tones(frequency: np.ndarray, width: float, speed_rpm: float, further: Sequence[float] = ()) -> np.ndarray:
    """Whether frequencies (n,) lie within a width (Hz) of a possible tone of known origin, or of a further one."""
    near = np.zeros(frequency.size, bool)
    for f in (*chain.from_iterable(families(speed_rpm).values()), *further):
        near |= abs(frequency - f) < width
    return near


def wanders(tone: Tone, resolution: float) -> bool:
    """Whether a tone between the harmonics, of a record that tells frequencies apart by so much (Hz), may be none."""
    return tone.frequency < TURNS * resolution


def wander_in_words(tones: Sequence[Tone], resolution: float) -> list[str]:
    """A note on what was taken off the displacement as a tone that may be none; nothing without it."""
    said = (
        "the displacement wanders slowly, which was taken off: a drift of the probe or of the temperature, or a tone "
        f"that turns less than {TURNS:.0f} times in a recording"
    )
    return [said] if any(wanders(tone, resolution) for tone in tones) else []


def origin(frequency: float, speed_rpm: float, resolution: float) -> str | None:
    """The family to which a tone belongs, or None."""
    off = {
        name: min(abs(frequency - f) / (SAME * resolution + NEAR * f) for f in tones)
        for name, tones in families(speed_rpm).items()
    }
    nearest = min(off, key=off.__getitem__)
    return nearest if off[nearest] < 1 else None


def order_of(frequency: float, family: str, speed_rpm: float) -> int:
    """The harmonic of a family to which a frequency (Hz) is nearest; 1 is the fundamental."""
    return 1 + int(np.argmin([abs(frequency - f) for f in families(speed_rpm)[family]]))


def overtones(frequency: float, speed_rpm: float, resolution: float) -> list[float]:
    """Frequencies (Hz) of the higher harmonics beside a tone that is one of a known origin; none of another tone."""
    name = origin(frequency, speed_rpm, resolution)
    if name is None:
        return []
    first = frequency / order_of(frequency, name, speed_rpm)
    return [first * order for order in range(HARMONICS + 1, HIGHEST + 1)]


def outstanding(own: np.ndarray, around: Sequence[float] | np.ndarray) -> float:
    """Chi-square by which whitened residuals (m,) at a tone's lines exceed their neighbours; 0 if not significant.

    The level of significance is 1e-4.
    """
    level = max(1.0, float(np.median(abs(np.asarray(around)) ** 2)) / (2 * np.log(2))) if len(around) else 1.0
    chi2 = float((abs(own) ** 2).sum()) / level
    return chi2 if stats.chi2.sf(chi2, 2 * own.size) < 1e-4 else 0.0


def tone_lines(windows: LineWindows, frequency: float) -> np.ndarray:
    """Lines (2, windows, WIDTH) of the cosine and the sine of a frequency (Hz) over a whole record, of amplitude 1."""
    lines = windows.first + np.arange(windows.count * WIDTH)
    found = transform_of_tone(lines, frequency * windows.samples / windows.sample_rate, windows.samples)
    return found.reshape(2, windows.count, WIDTH)


def without_tone(lines: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Lines (axes, windows, WIDTH) without what goes with the cosine and the sine of a tone, as of `tone_lines`."""
    own = np.ascontiguousarray(columns).reshape(2, -1).view(float)  # real and imaginary parts in turn
    parts = np.ascontiguousarray(lines).reshape(len(lines), -1).view(float)
    found = np.linalg.lstsq(own.T, parts.T, rcond=None)[0]
    return (parts - found.T @ own).view(complex).reshape(lines.shape)


def transform_of_tone(lines: np.ndarray, at: float | np.ndarray, samples: int) -> np.ndarray:
    """Amplitudes (2, ...) at lines of the cosine and the sine of frequencies in lines: geometric sums."""

    def of(frequency: float | np.ndarray) -> np.ndarray:
        off = np.where(frequency == lines, 1e-9, frequency - lines)
        return 2 / samples * np.expm1(2j * np.pi * off) / np.expm1(2j * np.pi * off / samples)

    ahead, back = of(at), of(-at)
    return np.array([(ahead + back) / 2, (ahead - back) / 2j])
