"""Responses of the loop at any gains: a fitted rig, and what the recordings differ from it, carried along as draws."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.loop.gains import PidGains, controller_response
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig
from tuning.campaign.differences import SMOOTH_ERROR, SMOOTH_LENGTH, agreed, circular, differences, places, smooth
from tuning.campaign.gain_set import GainSet, Response
from tuning.campaign.opened import lags, open_responses, opened
from tuning.campaign.rig_fit import IdentifiedRig

DRAWS = 64  # the first is the best estimate
ELSEWHERE = 0.01  # relative standard deviation by which the plant may change where the controller doubles
ELSEWHERE_LENGTH = 1.0  # of ln f, over which that change is one
# Relative error of responses by the bend of the force: of any magnet, and of a single one over the share of its bias
# that the current is, rms.
BENT, SQUARE = 0.003, 0.5
UNEVEN, FINER = 3e-3, 5  # relative error of a curve through the lines beyond which points go between, and how often
BELOW = (0.125, 0.25, 0.5)  # of the lowest line: what the loop does below it follows from the rig and that line


@dataclass(frozen=True, eq=False)
class Carried:
    """Draws of a loop's open responses; the first is the best estimate.

    Attributes:
        rate: Control rate, Hz.
        injected: Frequencies (s,) of the sensitivity, Hz; those of the lines, and some below.
        forced: Frequencies (r,) of the receptance, Hz.
        plant: (DRAWS, s), from command to reading, m/A.
        plant_forced: (DRAWS, r), the same at the frequencies of the receptance.
        free: (DRAWS, r), from force to reading with the loop open, m/N.
        rest: (DRAWS,), the plant at rest.
        change: (DRAWS, s + r), relative change of the plant where a controller doubles; the first is zero.
        thetas: (DRAWS, p), parameters of the fitted rig.
        sharp: Frequencies (Hz) at which the plant as measured is no smooth neighbour of the fitted one's.
    """

    rate: float
    injected: np.ndarray
    forced: np.ndarray
    plant: np.ndarray
    plant_forced: np.ndarray
    free: np.ndarray
    rest: np.ndarray
    change: np.ndarray
    thetas: np.ndarray
    sharp: np.ndarray

    def sensitivity(self, gains: PidGains, apart: float = 0.0, draws: int = DRAWS) -> np.ndarray:
        """S (draws, s) under gains; apart: log2 of the factor from recorded gains to these."""
        c = controller_response(gains, self._z(self.injected), 1 / self.rate)
        return 1 / (1 + c * self.plant[:draws] * (1 + apart * self.change[:draws, : self.injected.size]))

    def receptance(self, gains: PidGains, apart: float = 0.0, draws: int = DRAWS) -> np.ndarray:
        """Displacement per force (draws, r) of the closed loop, m/N."""
        c = controller_response(gains, self._z(self.forced), 1 / self.rate)
        plant = self.plant_forced[:draws] * (1 + apart * self.change[:draws, self.injected.size :])
        return self.free[:draws] / (1 + c * plant)

    def falls(self, gains: PidGains, draws: int = DRAWS) -> np.ndarray:
        """Factors (draws,) by which the gain may fall until L is -1 at rest; nan where rest needs no gain."""
        still = -(controller_response(gains, np.ones(1), 1 / self.rate).real * self.rest[:draws])
        return np.where(still > 0, still, np.nan)

    def _z(self, frequency: np.ndarray) -> np.ndarray:
        return np.exp(2j * np.pi * frequency / self.rate)


def louder(old: PidGains, new: PidGains, rate: float) -> float:
    """ln of the largest factor between two controllers' responses, at any frequency."""
    z = np.exp(2j * np.pi * np.geomspace(1e-5, 0.4, 60))
    one, other = (controller_response(g, z, 1 / rate) for g in (old, new))
    return float(np.abs(np.log(np.abs(other / one))).max())


def beside(own: GainSet, sets: Sequence[GainSet], rate: float) -> list[GainSet]:
    """A gain set and the others, which tell of its loop less: by what a plant may change from gains to gains."""
    return [
        own,
        *(_doubted(s, ELSEWHERE * (1 + louder(own.gains, s.gains, rate) / np.log(2))) for s in sets if s is not own),
    ]


def _doubted(s: GainSet, error: float) -> GainSet:
    """A gain set whose responses have a further relative error."""
    return replace(
        s,
        **{
            name: Response(c.frequency, c.value, c.variance + (error * np.abs(c.value)) ** 2)
            for name in ("plant", "receptance")
            if (c := getattr(s, name)) is not None
        },
    )


def distortion(rig: Rig, sets: Sequence[GainSet]) -> float:
    """Relative standard deviation by which a force that is not its tangent moves what lines show.

    What it adds at the lines is the same in every period, so no scatter shows it. It rises with the square of current
    and distance; in a pair of magnets the squares cancel.
    """
    if "pair" in rig.capabilities or not rig.bias_current:
        return BENT
    return BENT + SQUARE * max((s.current_rms for s in sets if s.current_rms > 0), default=0.0) / rig.bias_current


def carried(identified: IdentifiedRig, sets: Sequence[GainSet], seed: int, sharp: np.ndarray | None = None) -> Carried:
    """Draws from what a fitted rig and the recordings of some gain sets say together.

    Args:
        identified: The rig that was fitted to all recordings.
        sets: Those whose responses count.
        seed: Seed of the draws.
        sharp: Frequencies (Hz) at which other recordings have shown a sharp plant; None: those of these sets alone.
    """
    rng = np.random.default_rng((seed, 271828))
    rig, rate = identified.nominal, identified.nominal.control_rate
    injected, forced = _lines(rig, "current"), _lines(rig, "force")
    injected = np.round(np.concatenate([injected[0] * np.array(BELOW), injected]), 9)
    lowest = injected[len(BELOW)]
    injected = _finer(injected, identified.rig())
    plant = agreed([s.plant for s in sets if s.plant])
    shaken = [s for s in sets if s.receptance]
    wanted = np.unique(np.round(np.concatenate([injected, forced, *(s.receptance.frequency for s in shaken)]), 9))
    every = np.unique(np.concatenate([wanted, np.round(plant.frequency, 9)])) if plant else wanted
    thetas = np.vstack([identified.theta, identified.drawn(DRAWS - 1, rng)])
    lag = lags(identified.rig())
    models = [open_responses(identified.rig(theta), every) for theta in thetas]
    p, g = (np.array([m[k] for m in models]) for k in range(2))
    at = places(every, wanted)
    g = g[:, at]
    per_force = p[:, at] / g  # from command to force: smooth, whatever the rotor and its support do
    more, found = differences(plant, p, every, wanted, lag, rng, sharp) if plant else (0.0, np.empty(0))
    if plant:  # below the lowest line the plant hardly changes, and differs from the model as it does there
        under = wanted < lowest
        own = SMOOTH_ERROR * rng.standard_normal((DRAWS, 1))
        own[0] = 0.0
        more[:, under] = more[:, [places(wanted, lowest)]].real + own
    p = p[:, at] * (1 + more)
    z = np.exp(2j * np.pi * wanted / rate)
    if shaken:
        loops = [controller_response(s.gains, z, 1 / rate) for s in shaken]
        more, seen = differences(agreed(opened(shaken, loops, p[0], wanted)), g, wanted, wanted, lag, rng, sharp)
        g = g * (1 + more)
        # A draw whose plant is another one opens the measured receptance by another loop.
        mean = np.mean(loops, axis=0)
        g = g * (1 + mean * p) / (1 + mean * p[:1])
        if seen.size:
            at, value = _shaken_plant(shaken, loops, wanted, seen, per_force, rng)
            p[:, at], g[:, at] = value, value / per_force[:, at]
            injected, found = np.union1d(injected, seen), np.union1d(found, seen)
    bent = distortion(rig, sets) * smooth(wanted, DRAWS, SMOOTH_LENGTH, rng)
    bent[0] = 0.0
    p, g = p * (1 + bent), g * (1 + bent)
    change = ELSEWHERE * smooth(wanted, DRAWS, ELSEWHERE_LENGTH, rng)
    change[0] = 0.0
    i, f = places(wanted, injected), places(wanted, forced)
    return Carried(
        rate,
        injected,
        forced,
        p[:, i],
        p[:, f],
        g[:, f],
        p[:, i[0]].real,
        change[:, np.concatenate([i, f])],
        thetas,
        found,
    )


def _shaken_plant(
    shaken: Sequence[GainSet],
    loops: Sequence[np.ndarray],
    wanted: np.ndarray,
    sharp: np.ndarray,
    per_force: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Places (k,) of sharp force lines among those wanted, and the plant there (draws, k), m/A.

    A force shows a resonance too, and with it how the loop answers there: with H = G / (1 + C P) measured and P = A G,
    P = A H / (1 - C A H), where A leads from command to force.
    """
    parts = []
    for s, c in zip(shaken, loops, strict=True):
        kept = np.isin(np.round(s.receptance.frequency, 9), sharp)
        at = places(wanted, s.receptance.frequency[kept])
        a, h = per_force[0, at], s.receptance.value[kept]
        left = 1 - c[at] * a * h
        parts.append(Response(wanted[at], a * h / left, s.receptance.variance[kept] * np.abs(a / left**2) ** 2))
    plant = agreed(parts)
    at = places(wanted, plant.frequency)
    scatter = circular(rng, len(per_force), at.size) * np.sqrt(plant.variance)
    scatter[0] = 0.0
    return at, plant.value * per_force[:, at] / per_force[0, at] + scatter


def _finer(lines: np.ndarray, rig: Rig) -> np.ndarray:
    """Frequencies with more of them between where a curve through them misses a rig's plant, as at its resonances."""
    for _ in range(FINER):
        x = np.log(lines)
        between = (x[1:] + x[:-1]) / 2
        through = scipy.interpolate.CubicSpline(x, open_responses(rig, lines)[0])(between)
        true = open_responses(rig, np.exp(between))[0]
        uneven = np.abs(through - true) > UNEVEN * np.abs(true)
        lines = np.union1d(lines, np.round(np.exp(between[uneven]), 9))
    return lines


def _lines(rig: Rig, place: str) -> np.ndarray:
    e = rig.protocol.excitations
    return lines_at(e, place) * e[0].fundamental
