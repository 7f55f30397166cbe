"""The dissertation's shaker experiments: one force on every line, and a fit in each band."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from estimation.bands import band_slices
from estimation.least_squares import LeastSquares, least_squares
from estimation.lines.frequency_response import frequency_response
from estimation.lines.periods import LineStatistics, held
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_statistics
from maglev_env.loop.axes import suffixes
from maglev_env.loop.effect import NO_EFFECTS, Effects
from maglev_env.loop.gains import NO_CONTROLLER, Controllers
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig

PERIODS = 5  # averaged throughout the dissertation
SWITCHING = 12.5e-6  # m rms: the 100 mV of switching noise on the probe (4.4.3) at 8 V/mm


@dataclass(frozen=True)
class Shaker:
    """The shaker's SPHS (or another kind) on every harmonic of `fundamental` (Hz) up to `last`.

    amplitude is the peak (N); direction is in degrees from x toward y on an x-y rig; transient is the number of periods
    that are dropped before those that are kept.
    """

    last: int
    amplitude: float
    fundamental: float = 1.0
    direction: float = 0.0
    transient: int = 1
    kind: Literal["sphs", "impulse"] = "sphs"
    periods: int = PERIODS

    @property
    def excitation(self) -> Excitation:
        lines = tuple(range(1, self.last + 1))
        return Excitation(self.kind, "force", self.fundamental, lines, self.amplitude, direction=self.direction)


def with_noise(rig: Rig, displacement: float) -> Rig:
    """The rig with another noise of the probe (m rms per sample)."""
    return replace(rig, noise=replace(rig.noise, displacement=displacement))


@dataclass(frozen=True)
class Shaken:
    """Records under a shaker: their statistics (first axis: records), and the rms of the current (n,), A."""

    statistics: LineStatistics
    current_rms: np.ndarray


def simulated(
    rigs: Sequence[Rig],
    shaker: Shaker,
    seeds: Sequence[int],
    gains: Sequence[Controllers] | None = None,
    effects: Effects = NO_EFFECTS,
    speed_rpm: float = 0.0,
) -> Shaken:
    """One record per rig and seed, the force of its statistics freed of its converter's hold.

    gains: one controller per rig (default: the rig's own). ValueError where a rotor touches down.
    """
    gains = gains or [rig.gains or NO_CONTROLLER for rig in rigs]
    experiments = [
        Experiment(r, g, (shaker.excitation,), shaker.periods, shaker.transient, effects, seed=s, speed_rpm=speed_rpm)
        for r, g, s in zip(rigs, gains, seeds, strict=True)
    ]
    result = simulate_statistics(experiments)
    if not np.isnan(result.touchdown_time).all():
        raise ValueError(f"rig {rigs[0].name}: the rotor touches down under this shaker; choose other gains")
    statistics = result.statistics
    for suffix in suffixes(rigs[0].axes):
        statistics = held(statistics, f"force{suffix}", rigs[0].control_rate)
    return Shaken(statistics, result.current_rms)


def receptance(statistics: LineStatistics) -> np.ndarray:
    """Displacement over force (..., lines), m/N."""
    return frequency_response(statistics, "displacement", "force")[0]


def planar_response(statistics: LineStatistics) -> np.ndarray:
    """Displacements in x and y over the magnitude of one oblique force, (lanes, 2, lines), m/N."""
    along = [statistics.amplitude(f"force_{a}") for a in "xy"]
    force = np.hypot(*np.abs(along)) * np.exp(1j * np.angle(along[0]))
    return np.stack([statistics.amplitude(f"displacement_{a}") / force for a in "xy"], axis=1)


def least_squares_bands(statistics: LineStatistics, bands: np.ndarray, mass: float) -> LeastSquares:
    """The dissertation's estimator in each band: fields (..., bands)."""
    g = receptance(statistics)
    fits = [
        least_squares(statistics.frequency[start:stop], g[..., start:stop], mass)
        for start, stop in band_slices(statistics.frequency, bands)
    ]
    return LeastSquares(**{f.name: np.stack([getattr(fit, f.name) for fit in fits], -1) for f in fields(LeastSquares)})


def least_squares_limit(statistics: LineStatistics, bands: np.ndarray, stiffness: float, mass: float) -> np.ndarray:
    """What least squares tends to (bands,) on a constant stiffness (N/m) under the noise of these records (n, ...).

    rho k + (1 - rho) m w^2, with rho the signal's share of |G|^2 in the band.
    """
    force = np.abs(statistics.amplitude("force")) ** 2
    power = (np.abs(statistics.amplitude("displacement")) ** 2 / force).mean(0)
    noise = (statistics.cross("displacement", "displacement") / force).mean(0)
    inertia = mass * (2 * np.pi * statistics.frequency) ** 2
    return np.array(
        [
            ((power - noise) * stiffness + noise * inertia)[start:stop].sum() / power[start:stop].sum()
            for start, stop in band_slices(statistics.frequency, bands)
        ]
    )
