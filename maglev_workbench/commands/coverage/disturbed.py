"""Periodic experiments as they are recorded: excitations of a stated power, and what disturbs a record as noise."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.kernel.blocks import prepared
from maglev_env.kernel.driven import Drive
from maglev_env.kernel.replay import replayed
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.effect import Effects
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig

CREST = 3.5  # of most multisines with random phases
RESONANCE, QUALITY = 90.0, 20.0  # of the floor, Hz: a noise that differs tenfold inside a band
SPEEDS = (6000.0, 8000.0)  # rpm
# Grade G2.5 of ISO 21940-11 for 80 g at 7,000 rpm, and a surface that is round to some micrometres.
ROTOR: Effects = {"unbalance": {"moment": 2.7e-7}, "runout": {"amplitude": 2e-6}}


def of_power(e: Excitation, amplitude: float, rig: Rig) -> Excitation:
    """An excitation with the rms of a crest factor of CREST; its own peak would give each draw another power."""
    rms = float(np.sqrt(np.mean(e.waveform(rig.control_rate) ** 2)))
    return replace(e, amplitude=e.amplitude * amplitude / CREST / rms)


@dataclass(frozen=True)
class Disturbed:
    """What disturbs a recording as noise does; the response without it is the truth.

    Args:
        floor: rms of a force from the floor, which resonates at 90 Hz, N.
        clock: share by which the recorder's clock is fast.
        turning: whether an unbalanced rotor turns, at a speed of each draw's own.
    """

    floor: float = 0.0
    clock: float = 0.0
    turning: bool = False

    def channels(self, e: Experiment) -> Mapping[str, np.ndarray]:
        """Channels of one recording, (samples,) each, by name."""
        rng = np.random.default_rng(e.seed)
        if self.turning:
            e = replace(e, effects={**e.effects, **ROTOR}, speed_rpm=float(rng.uniform(*SPEEDS)))
        if self.floor:
            return self._shaken(e, rng)
        recording = simulated_recording(e, simulate_records([e], threads=1)[0])
        found = {str(name): recording[name].values for name in recording.data_vars}
        if not self.clock:
            return found
        ticks = np.arange(next(iter(found.values())).size)
        return {name: scipy.interpolate.CubicSpline(ticks, x)(ticks * (1 - self.clock)) for name, x in found.items()}

    def _shaken(self, e: Experiment, rng: np.random.Generator) -> Mapping[str, np.ndarray]:
        rig, count = e.rig, e.periods + e.transient_periods
        white = rng.standard_normal(count * e.samples_per_period)
        force = scipy.signal.lfilter(*scipy.signal.iirpeak(RESONANCE, QUALITY, rig.control_rate), white)
        waves = {place: np.tile(e.waveform(place), count) for place in ("force", "current", "reference")}
        shaken = waves | {"force": waves["force"] + self.floor * force / force.std()}
        run = replayed(prepared([e]), [Drive(e, shaken)], threads=1)[0][0]
        displacement, current, command = run[:, 0]
        return {
            "displacement": displacement,
            "command": command,
            "current": current + rig.noise.current * rng.standard_normal(current.size),
            "force": waves["force"] + rig.noise.force * rng.standard_normal(current.size),
            "injection": waves["current"],
        }


QUIET = Disturbed()
