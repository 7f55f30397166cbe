"""Multisines whose phases are optimised for a low crest factor, which puts more force into each line for a given peak.

The search minimises the L_p norm of one period over the phases for rising p; the norm tends to the peak (Guillaume,
Schoukens, Pintelon and Kollar, IEEE Trans. Instrum. Meas. 40, 1991, 982-989).
"""

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from estimation.multisine.sphs import Multisine, sphs, synthesise

EXPONENTS = (4, 8, 16, 32, 64, 128, 256)
ITERATIONS = 50  # per exponent; further iterations gain less than another seed does
OVERSAMPLING = 24  # grid points per cycle of the highest line; the peak between grid points is then under 1 % higher


def low_crest(
    lines: ArrayLike, samples_per_period: int, peak: float = 1.0, power: ArrayLike | None = None, seed: int = 0
) -> Multisine:
    """Multisine of low crest factor, also between samples, whose sampled period peaks at exactly `peak`.

    Flat lines 1..n with n from 100 to 250 reach a crest factor of 1.38 to 1.41; Schroeder phases reach 1.7. Where the
    search does worse than Schroeder phases on the sampled grid (only with a few lines), Schroeder phases are returned.
    The samples are far from normally distributed, so the best linear approximation of a nonlinear plant differs from
    the one that `random_phase` gives. The search takes about 0.2 s for lines up to 250, in proportion to the highest
    line.

    Args:
        lines: As in `sphs`.
        samples_per_period: As in `sphs`.
        peak: As in `sphs`.
        power: As in `sphs`.
        seed: Seed of the random starting phases. On one machine the same seed gives the same phases for every peak
            and grid; another processor may round to a slightly different minimum that is equally low.

    Raises:
        ValueError: Bad input.
    """
    schroeder = sphs(lines, samples_per_period, peak, power)
    start = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, schroeder.lines.size)
    shape = np.ones(start.size) if power is None else np.sqrt(power)
    phases = _minimise_peak(schroeder.lines, shape, start)
    searched = Multisine(schroeder.lines, schroeder.amplitudes, phases)
    gain = peak / np.max(np.abs(synthesise(searched, samples_per_period)))
    return Multisine(searched.lines, gain * searched.amplitudes, phases) if gain > 1 else schroeder


def _minimise_peak(
    lines: NDArray[np.int64], amplitudes: NDArray[np.float64], phases: NDArray[np.float64]
) -> NDArray[np.float64]:
    lines = lines // np.gcd.reduce(lines)  # a waveform that repeats within the period is searched only once
    amplitudes = amplitudes / np.linalg.norm(amplitudes)
    points = scipy.fft.next_fast_len(OVERSAMPLING * int(lines[-1]), real=True)
    for exponent in EXPONENTS:
        # Conjugate gradients: L-BFGS-B is no better here, and its threaded linear algebra stalls on a busy machine.
        options = {"maxiter": ITERATIONS}
        given = (lines, amplitudes, points, exponent)
        phases = scipy.optimize.minimize(_log_norm, phases, given, method="CG", jac=True, options=options).x
    return phases


def _log_norm(
    phases: NDArray[np.float64],
    lines: NDArray[np.int64],
    amplitudes: NDArray[np.float64],
    points: int,
    exponent: int,
) -> tuple[float, NDArray[np.float64]]:
    """Log of the L_p norm of one period on `points` samples, and its gradient (n,) with respect to the phases.

    The exponent p must be a power of two.
    """
    lined = amplitudes * np.exp(1j * phases)
    spectrum = np.zeros(points // 2 + 1, dtype=complex)
    spectrum[lines] = lined / 2
    signal = np.asarray(scipy.fft.irfft(spectrum, n=points, norm="forward"))
    peak = np.max(np.abs(signal))
    signal /= peak  # without this scaling, high powers underflow everywhere
    power, raised = signal**2, signal.copy()
    for _ in range(exponent.bit_length() - 2):  # signal^(p - 1) by squaring; np.power would take most of the time
        raised *= power
        power *= power
    mean = np.mean(raised * signal)
    slope = scipy.fft.rfft(raised, norm="forward")[lines]
    return np.log(peak) + np.log(mean) / exponent, np.imag(np.conj(lined) * slope) / (mean * peak)
