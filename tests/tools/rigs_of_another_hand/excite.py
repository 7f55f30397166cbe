"""What happens on a bench: one value of the reference or injection per tick."""

import numpy as np


def steps(rng: np.random.Generator, n: int, dt: float, size: float, hold: float) -> np.ndarray:
    """Set points drawn within +-size (m), held for about `hold` s, as a person types them (rounded to a tenth)."""
    out = np.zeros(n)
    at = round(0.3 * hold / dt)
    while at < n:
        out[at:] = np.round(rng.uniform(-1, 1), 1) * size
        at += round(hold * rng.uniform(0.7, 1.3) / dt)
    return out


def square(n: int, dt: float, size: float, hold: float) -> np.ndarray:
    return size * np.where(np.arange(n) * dt % (2 * hold) < hold, 0.0, 1.0)


def sine(n: int, dt: float, size: float, frequency: float) -> np.ndarray:
    return size * np.sin(2 * np.pi * frequency * dt * np.arange(n))


def chirp(n: int, dt: float, size: float, low: float, high: float) -> np.ndarray:
    t = np.arange(n) * dt
    return size * np.sin(2 * np.pi * (low * t + (high - low) * t**2 / (2 * n * dt)))


def stepped_sweep(n: int, dt: float, size: float, frequencies: np.ndarray) -> np.ndarray:
    """One frequency after the other, each as long, with continuous phase."""
    which = np.minimum(np.arange(n) * len(frequencies) // n, len(frequencies) - 1)
    return size * np.sin(2 * np.pi * dt * np.cumsum(frequencies[which]))


def white(rng: np.random.Generator, n: int, rms: float) -> np.ndarray:
    return rms * rng.standard_normal(n)


def band_noise(rng: np.random.Generator, n: int, dt: float, rms: float, corner: float) -> np.ndarray:
    """First-order noise below a corner, Hz."""
    a = np.exp(-2 * np.pi * corner * dt)
    out, x = np.empty(n), 0.0
    for k, w in enumerate(rng.standard_normal(n)):
        x = a * x + w
        out[k] = x
    return rms * out / out.std()
