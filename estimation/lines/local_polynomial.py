"""Line statistics of a record whose excitation never repeats (noise, a chirp, hammer blows): local polynomial method.

Over a narrow window of DFT bins k + r an output is G(k + r) U(k + r) + T(k + r) plus noise. Both the response G to the
recorded excitation U and the transient T (the leakage caused by different states at the start and end of the record)
are smooth. Least squares with quadratics in r for both need no taper and leave the noise as the residual (Schoukens,
Vandersteen, Barbe and Pintelon, European Journal of Control 15, 2009; Pintelon and Schoukens 2012, ch. 7).

Windows do not overlap, and each reports its response at three bins, the zeros of the third discrete Legendre
polynomial. There the values of a quadratic fit are uncorrelated and a cubic term does not bias them
(Christoffel-Darboux; exact for constant |U|). The three values together hold all the information of the window; the
value at its centre alone is 1.5 times as uncertain.
"""

import numpy as np
import scipy

from estimation.lines.periods import LineStatistics

_TERMS = 3  # terms of each quadratic, and also lines per window
_NARROWEST = 21  # bins of the narrowest window, which leaves 15 residual degrees of freedom
_MOST_LINES = 1000
_RANGE = 1e-4  # 40 dB of power
_DISTINCT = 0.1  # share of the excitation that no transient can mimic; below it the three lines are hardly independent
_ROUNDING = 1e-12  # of the strongest bin's amplitude
_BINS_AT_ONCE = 1 << 16


def local_polynomial(
    signals: np.ndarray,
    channels: tuple[str, ...],
    sample_rate: float,
    reference: str | np.ndarray,
    band: tuple[float, float] | None = None,
    resolution: float | None = None,
) -> LineStatistics:
    """Responses of all channels to a recorded excitation, as the line statistics of an equivalent periodic record.

    Each window contributes three lines. The returned `mean` is the response times a real effective amplitude of the
    reference, about that of one bin; lines that are known better have a larger amplitude. All lines of a window share
    the `covariance` of the noise in one bin divided by `periods`. A window of 3 (P + 1) bins leaves 3 (P - 1) complex
    degrees of freedom, which its lines share; `periods` is P, which is right for everything that pools lines and
    cautious for a single line. A constant offset does no harm; a drift affects little above the lowest window.

    Args:
        signals: Signals (channels, samples) in SI units.
        channels: Names of the channels.
        sample_rate: Hz.
        reference: The channel that excites, or an array (samples,) to which every channel responds. It is treated as
            exact: noise in its reading with n times its power turns G into G / (1 + n) and looks like output noise,
            and noise that a feedback brings into it biases G as well. In those cases use the commanded or injected
            signal as the reference; the ratio of two channels' responses to it is free of both errors.
        band: Lowest and highest frequency used, Hz. By default the contiguous band around the strongest window in
            which the reference's power density, over 21 bins, is within 40 dB of its highest.
        resolution: Average distance of lines, Hz. A window is three times as wide and should be narrower than the
            half-power width of a resonance (at equal width, G is wrong by 1 % there). The default is 7 bins, that is
            7 / duration, but no more than 1000 lines; state the band to resolve more of a long record.

    Returns:
        Line statistics. Windows whose excitation is missing or could be a transient are left out: where a chirp
        starts and ends with the record, or around a single blow so near an end of the record that its phase turns
        less than twice over a window.

    Raises:
        ValueError: Wrong shapes, values that are not finite, an unknown channel, a record that is too short, a
            reference without power, or a band or resolution that the record does not allow.
    """
    _check(signals, channels, sample_rate, reference)
    known = channels.index(reference) if isinstance(reference, str) else None
    exciting = signals[channels.index(reference)] if isinstance(reference, str) else reference
    samples = signals.shape[1]
    spacing = sample_rate / samples
    excitation = _spectrum(exciting)
    floor = _ROUNDING * np.max(np.abs(excitation[1:]))
    first, stop = _excited(excitation, samples) if band is None else _bins(band, sample_rate, samples)
    width = _width(stop - first, spacing, resolution)
    count = (stop - first) // width
    first += (stop - first - count * width) // 2
    bins = slice(first, first + count * width)
    u = excitation[bins].reshape(count, width)
    z = np.stack([_spectrum(x)[bins] for x in signals], axis=-1).reshape(count, width, -1)

    node = round(np.sqrt((3 * width**2 - 7) / 20))  # zeros of the third discrete Legendre polynomial: 0, +-node
    at = np.array([-node, 0, node])
    chunk = max(_BINS_AT_ONCE // width, 1)
    fits = [_fit(u[i : i + chunk], z[i : i + chunk], at, floor) for i in range(0, count, chunk)]
    sound, response, variance, noise = (np.concatenate(parts) for parts in zip(*fits, strict=True))
    if not sound.any():
        raise ValueError(
            f"the reference has no power between {first * spacing:.4g} and {(bins.stop - 1) * spacing:.4g} Hz, or none "
            "that differs from a transient (a single blow near an end of the record, a few lines): choose another "
            "band, a coarser resolution, or the periods of a periodic excitation"
        )
    if known is not None:  # make the reference's own response exact, not only within rounding
        response[:, :, known] = 1
        noise[:, known], noise[:, :, known] = 0, 0

    periods = width // _TERMS - 1
    lines = (first + width // 2 + width * np.flatnonzero(sound)[:, None] + at).ravel()
    mean = response / np.sqrt(periods * variance)[:, :, None]
    covariance = np.repeat(noise / periods, _TERMS, axis=0)
    return LineStatistics(
        lines * spacing,
        lines,
        tuple(channels),
        mean.reshape(lines.size, -1).T,
        np.moveaxis(covariance, 0, -1),
        periods,
    )


def _fit(
    u: np.ndarray, z: np.ndarray, at: np.ndarray, floor: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Least squares in windows u (w, bins) of the reference and z (w, bins, channels) of all channels.

    Returns:
        sound: Which windows are usable (w,); the other results hold these s windows only.
        response: Responses (s, 3, channels) at bins `at` from the centre.
        variance: Their variance (s, 3) per unit of noise.
        noise: Noise covariance of one bin (s, channels, channels).
    """
    width = u.shape[1]
    basis = np.linalg.qr(np.linspace(-1, 1, width)[:, None] ** np.arange(_TERMS))[0] * np.sqrt(width)
    design = np.concatenate([np.broadcast_to(basis, (len(u), *basis.shape)), u[:, :, None] * basis], axis=-1)
    q, r = np.linalg.qr(design)
    r = r[:, _TERMS:, _TERMS:]  # the part of U that a transient cannot explain
    power = np.sum(np.abs(u) ** 2, axis=1)
    distinct = np.abs(np.diagonal(r, axis1=1, axis2=2)).min(axis=1) ** 2
    sound = (power > width * floor**2) & (distinct > _DISTINCT * power)
    q, r, z = q[sound], r[sound], z[sound]
    inside = np.conj(q.swapaxes(1, 2)) @ z
    rest = z - q @ inside
    noise = rest.swapaxes(1, 2) @ np.conj(rest) / (width - 2 * _TERMS)
    nodes = basis[width // 2 + at]
    response = nodes @ np.linalg.solve(r, inside[:, _TERMS:])
    spread = np.linalg.solve(np.conj(r.swapaxes(1, 2)), np.broadcast_to(nodes.T, r.shape))
    return sound, response, np.sum(np.abs(spread) ** 2, axis=1), noise


def _spectrum(signal: np.ndarray) -> np.ndarray:
    """Complex amplitudes of all bins. A constant offset is in bin 0 alone, which is never used."""
    return np.asarray(scipy.fft.rfft(signal)) * (2 / len(signal))


def _bins(band: tuple[float, float], sample_rate: float, samples: int) -> tuple[int, int]:
    low, high = band
    if not 0 <= low < high <= sample_rate / 2:
        raise ValueError(f"band {low:g} .. {high:g} Hz must increase and lie within 0 .. {sample_rate / 2:g} Hz")
    start = int(np.ceil(low * samples / sample_rate - 1e-6))
    stop = int(np.floor(high * samples / sample_rate + 1e-6)) + 1
    return max(start, 1), min(stop, (samples + 1) // 2)


def _excited(excitation: np.ndarray, samples: int) -> tuple[int, int]:
    """First bin, and the one after the last, of the contiguous windows around the strongest that are within 40 dB."""
    count = ((samples + 1) // 2 - 1) // _NARROWEST
    power = np.mean(np.abs(excitation[1 : 1 + count * _NARROWEST]).reshape(count, -1) ** 2, axis=1)
    strongest = int(np.argmax(power))
    weak = np.flatnonzero(power < _RANGE * power[strongest])
    first, last = weak[weak < strongest].max(initial=-1) + 1, weak[weak > strongest].min(initial=count)
    return 1 + int(first) * _NARROWEST, 1 + int(last) * _NARROWEST


def _width(bins: int, spacing: float, resolution: float | None) -> int:
    """Bins of a window: odd, so that its centre is a bin, and a multiple of 3, so that `periods` is whole."""
    if resolution is None:
        width = max(_NARROWEST, -(-_TERMS * bins // _MOST_LINES))
        width += -(width - _TERMS) % (2 * _TERMS)
    else:
        finest = _NARROWEST / _TERMS * spacing
        if not finest * (1 - 1e-6) <= resolution < np.inf:
            raise ValueError(f"resolution {resolution:g} Hz: the record allows {finest:.4g} Hz at best; record longer")
        width = int(_TERMS * resolution / spacing + 1e-3)
        width -= (width - _TERMS) % (2 * _TERMS)
    if bins < width:
        raise ValueError(
            f"the band holds {bins} DFT bins {spacing:.4g} Hz apart, and one window takes {width}: widen the band, "
            "record longer or ask for a finer resolution"
        )
    return width


def _check(signals: np.ndarray, channels: tuple[str, ...], sample_rate: float, reference: str | np.ndarray) -> None:
    if signals.ndim != 2 or len(signals) != len(channels):
        raise ValueError(f"signals must be ({len(channels)} channels, samples), not {signals.shape}")
    if not (np.isfinite(sample_rate) and sample_rate > 0):
        raise ValueError(f"sample_rate = {sample_rate} must be positive, in Hz")
    samples = signals.shape[1]
    if samples < 2 * _NARROWEST + 1:
        raise ValueError(f"{samples} samples are too short a record: one window takes {2 * _NARROWEST + 1}")
    for name, x in zip(channels, signals, strict=True):
        if not np.all(np.isfinite(x)):
            raise ValueError(f"channel {name!r} has values that are not finite; cut them out or record again")
    if isinstance(reference, str):
        if reference not in channels:
            raise ValueError(f"reference {reference!r} is missing; the record has {', '.join(channels)}")
        reference = signals[channels.index(reference)]
    if np.shape(reference) != (samples,) or not np.all(np.isfinite(reference)):
        raise ValueError(f"reference must hold {samples} finite values, one per sample")
    if np.ptp(reference) == 0:
        raise ValueError("the reference is constant: without power it excites nothing; name the excitation's channel")
