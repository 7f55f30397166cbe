"""What is known of a gain set: responses of loop and plant, failures, and what these tell of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimation.lines.periods import LineStatistics
from estimation.max_likelihood import maximum_likelihood
from estimation.normal import NOISELESS
from estimation.stability_margins import Margins, margins
from maglev_env.loop.gains import PidGains

DRAWS = 200  # of an interval


@dataclass(frozen=True, eq=False)
class Response:
    """A complex frequency response at frequencies (n,) Hz, increasing: value (n,) and variance (n,), E|noise|^2."""

    frequency: np.ndarray
    value: np.ndarray
    variance: np.ndarray


@dataclass(frozen=True, eq=False)
class GainSet:
    """All recordings at equal gains.

    Attributes:
        gains: The gains.
        files: The recordings.
        receptance: From the continuous force, m/N; None where nothing shows it.
        sensitivity: None where nothing shows it.
        plant: From command to reading, m/A; None where nothing shows it.
        force: Line statistics of the recordings that a force excites.
        peak_displacement: m.
        current_rms: A.
        failed: Why nothing is identified here, or None.
        beside: What failed in single recordings here while others held, each with its file.
        noise_current: Rms of what does not repeat of the coil's current, less the stated noise of its reading, A; nan
            where no period shows it.
        noise_error: Its relative standard error.
        untold: Why recordings without a period do not tell the margins here, or None.
        open: Whether all recordings are without a period.
    """

    gains: PidGains
    files: tuple[str, ...]
    receptance: Response | None
    sensitivity: Response | None
    plant: Response | None
    force: tuple[LineStatistics, ...]
    peak_displacement: float
    current_rms: float
    failed: str | None
    untold: str | None = None
    open: bool = False
    noise_current: float = np.nan
    noise_error: float = 0.0
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Shown:
    """Results of a gain set with standard errors; nan where the recordings do not show them.

    Attributes:
        stiffness: In the target band, N/m.
        stiffness_se: Its standard error.
        damping: In the target band, N s/m.
        damping_se: Its standard error.
        margins: Margins of the measured sensitivity.
    """

    stiffness: float
    stiffness_se: float
    damping: float
    damping_se: float
    margins: Margins | None


def shown(found: GainSet, band: tuple[float, float], mass: float, seed: int = 0) -> Shown:
    """Coefficients and margins of a set that did not fail, for the stated moving mass (kg) and a target band (Hz)."""
    coefficients = [maximum_likelihood(f, np.array([band]), mass, intervals=False) for f in found.force]
    k, k_se = _mean([(c.stiffness[0], c.stiffness_se[0]) for c in coefficients])
    c, c_se = _mean([(c.damping[0], c.damping_se[0]) for c in coefficients])
    s = found.sensitivity
    curve = margins(s.frequency, s.value, s.variance, DRAWS, seed) if s is not None else None
    return Shown(k, k_se, c, c_se, curve)


def pooled(parts: Sequence[Response]) -> Response | None:
    """Several measurements of one response as one: at each line the mean weighted by inverse variances."""
    if not parts:
        return None
    frequency, at = np.unique(np.round(np.concatenate([p.frequency for p in parts]), 9), return_inverse=True)
    value, variance = (np.concatenate([getattr(p, name) for p in parts]) for name in ("value", "variance"))
    weight = 1 / np.maximum(variance, NOISELESS * np.abs(value) ** 2)  # so that a recording without noise stays finite
    total = np.bincount(at, weight)
    mean = np.bincount(at, weight * value.real) + 1j * np.bincount(at, weight * value.imag)
    return Response(frequency, mean / total, 1 / total)


def failed_set(gains: PidGains, file: str, why: str) -> GainSet:
    """A recording at which nothing is identified, with the reason."""
    return GainSet(gains, (file,), None, None, None, (), np.nan, np.nan, why)


def joined(gains: PidGains, parts: list[GainSet]) -> GainSet:
    """Recordings at equal gains as one set, which failed if none of them held.

    Where one held, what failed in another is not the gains' alone: it may have been driven harder.
    """
    files = tuple(file for p in parts for file in p.files)
    wrong = [p for p in parts if p.failed]
    parts = [p for p in parts if not p.failed] or parts
    failed = parts[0].failed
    beside = () if failed else tuple(f"{', '.join(p.files)}: {p.failed}" for p in wrong)
    curves = [
        pooled([r for p in parts if (r := getattr(p, n)) is not None]) for n in ("receptance", "sensitivity", "plant")
    ]
    force = tuple(f for p in parts for f in p.force)
    # Of the first recording that shows them, because a later one may have been driven harder on purpose.
    peak, current, noise = (
        next((v for p in parts if not np.isnan(v := getattr(p, name))), np.nan)
        for name in ("peak_displacement", "current_rms", "noise_current")
    )
    error = next((p.noise_error for p in parts if not np.isnan(p.noise_current)), 0.0)
    untold = None if any(not p.untold for p in parts) else parts[-1].untold
    return GainSet(
        gains, files, *curves, force, peak, current, failed, untold, all(p.open for p in parts), noise, error, beside
    )


def _mean(values: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Mean and its standard error, from estimates (value, standard error)."""
    if not values:
        return np.nan, np.nan
    v, se = np.array(values, float).T
    return float(v.mean()), float(np.sqrt((se**2).sum()) / len(se))
