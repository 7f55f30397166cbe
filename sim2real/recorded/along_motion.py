"""Gain and stiffness of the magnets along a recorded motion, where it is so large that they are not those at rest.

A recording is opened at the linear nominal loop (see `open_loop`): what is left of measured less simulated is then the
sensor's noise, if the plant is linear. The controller answers to that noise, and while a set-point step drives the
coil with twice its current, its answer pulls twice as much. Opened as if it had not, the residual contains low
frequencies that were never in the noise, and a fit takes them for damping or delay.

With e the reading and u the command (each measured less simulated), x what u does to the linear nominal plant, and g
and k what gain and stiffness along the motion have more than at rest, the force g i - k x that the linear plant lacks
is known from e alone. It is taken off, with the motion that it causes itself, to second order: g and k are those midway
between measured and simulated, because the squares of a noisy current have another mean than the square of the current
without noise. Where the rig is found
to be another one, its own magnets are followed (`AlongMotion.under`): while a step drives the coil with three times its
current, a gain that is a fifth larger than was taken off is error enough to name an asymmetry.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.signal

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.lane_values import lane_values
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, force

NOTABLE = 0.02  # rms change of gain or stiffness along the motion, of the value at rest, from which it is followed
STEP = 1e-4  # of gap and bias current, for derivatives of the force
NEAREST = 0.98  # of the gap: how near a reading, or the rotor of a simulation, may come to a magnet


@dataclass(frozen=True)
class Motion:
    """What was recorded of a motion.

    Args:
        driving: command or current, (axes, samples), A.
        reading: displacement, (axes, samples), m.
        held: whether the driving channel is held between samples.
        every: control samples for each of these samples.
    """

    driving: np.ndarray
    reading: np.ndarray
    held: bool
    every: int

    def at(self, samples: slice) -> "Motion":
        return replace(self, driving=self.driving[:, samples], reading=self.reading[:, samples])

    def halfway(self, driving: np.ndarray, reading: np.ndarray) -> "Motion":
        """The motion midway to another one, which is this less `driving` and `reading` (axes, samples)."""
        return replace(self, driving=self.driving - driving / 2, reading=self.reading - reading / 2)


@dataclass(frozen=True)
class AlongMotion:
    """What the magnets have more than at rest.

    Within a control step the current is a + (b - a) s(t), from a to b; `mean` and `square` are the means of s and s^2.

    Args:
        begin, end: gain at a and b, (axes, samples), N/A.
        stiffness: (axes, samples), N/m.
        mean, square: of s.
        lag: share of the way from a to b that is left at the end; None: b is the next sample's a.
        late: whole samples by which a command acts late.
        motion: along which they are.
    """

    begin: np.ndarray
    end: np.ndarray
    stiffness: np.ndarray
    mean: float
    square: float
    lag: float | None
    late: int
    motion: Motion

    def driven(self, command: np.ndarray) -> np.ndarray:
        """Mean force (..., axes, samples) over each control step that the linear plant lacks, N, by the current."""
        a, b = ends(command, self.lag, self.late)
        more, moved = self.end - self.begin, b - a
        return self.begin * a + self.mean * (self.begin * moved + more * a) + self.square * more * moved

    def at(self, samples: slice) -> "AlongMotion":
        """Gain and stiffness along some of the samples."""
        begin, end, stiffness = (v[:, samples] for v in (self.begin, self.end, self.stiffness))
        return replace(self, begin=begin, end=end, stiffness=stiffness, motion=self.motion.at(samples))

    def under(self, e: Experiment, motion: Motion | None = None) -> "AlongMotion":
        """What the magnets of another rig have more than at rest, along the same motion or along another one."""
        return _along(e, motion or self.motion)[0]


def ends(command: np.ndarray, lag: float | None, late: int) -> tuple[np.ndarray, np.ndarray]:
    """Current at the start of every control step, and where it goes within the step, (..., samples) each, A."""
    if late:
        command = np.concatenate([np.repeat(command[..., :1], late, axis=-1), command[..., :-late]], axis=-1)
    if lag is None:
        return command, np.concatenate([command[..., 1:], command[..., -1:]], axis=-1)
    if lag == 0:
        return command, command
    return scipy.signal.lfilter([0.0, 1 - lag], [1.0, -lag], command, axis=-1, zi=command[..., :1])[0], command


def currents(e: Experiment, motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Current at the start of every control step, and where it goes within the step, as `ends`, of the nominal rig."""
    return ends(motion.driving, _lag(e, motion), _late(e, motion))


def _lag(e: Experiment, motion: Motion) -> float | None:
    """Share of the way to a command that is left at the end of its step; None where nothing holds it."""
    dt, constant = motion.every / e.rig.control_rate, e.rig.amplifier_time_constant
    return None if not motion.held else float(np.exp(-dt / constant)) if constant else 0.0


def _late(e: Experiment, motion: Motion) -> int:
    """Whole samples by which a command acts late."""
    return round(effect_value(e.effects, "delay") * e.rig.control_rate / motion.every)


def along_motion(e: Experiment, motion: Motion) -> AlongMotion | None:
    """Gain and stiffness along a recorded motion.

    Args:
        e: the nominal experiment that is simulated.
        motion: of the record, under the current that drives the magnets: as it was recorded, or the command that the
            controller makes of the readings.

    Returns:
        None where they are those at rest.
    """
    if not e.rig.controlled:
        return None
    found, notable = _along(e, motion)
    return found if notable else None


def _along(e: Experiment, motion: Motion) -> tuple[AlongMotion, bool]:
    """What the magnets have more along a motion, and whether it is notable."""
    rig, dt, u, y = e.rig, motion.every / e.rig.control_rate, motion.driving, motion.reading
    lag, late = _lag(e, motion), _late(e, motion)
    a, b = ends(u, lag, late)
    place = np.clip(y, -NEAREST * rig.gap, NEAREST * rig.gap)
    next_place = np.concatenate([place[:, 1:], place[:, -1:]], axis=1)
    begin, end, stiffness = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)
    notable = False
    for axis in range(rig.axes):
        law = law_along(e, axis)
        gain, held_by = slopes(law, 0.0, 0.0)
        begin[axis], at_begin = slopes(law, place[axis], a[axis])
        end[axis], at_end = slopes(law, next_place[axis], b[axis])
        stiffness[axis] = (at_begin + at_end) / 2 - held_by
        begin[axis] -= gain
        end[axis] -= gain
        changes = np.mean(end[axis] ** 2) / gain**2, np.mean(stiffness[axis] ** 2) / held_by**2 if held_by else 0.0
        notable |= bool(max(changes) > NOTABLE**2)
    mean, square = (0.5, 1 / 3) if lag is None else (1.0, 1.0)
    if lag:
        decay = rig.amplifier_time_constant / dt
        left, left_squared = decay * (1 - lag), decay / 2 * (1 - lag**2)
        mean, square = 1 - left, 1 - 2 * left + left_squared
    return AlongMotion(begin, end, stiffness, mean, square, lag, late, motion), notable


def law_along(e: Experiment, axis: int) -> ForceLaw | SingleSidedLaw:
    """The force law of an axis with what changes its gain, its stiffness and its shape."""
    values = lane_values([axis_experiment(e, axis)])
    (law,), more = values.laws, [1 + float(values.effect(name)[0]) for name in ("actuator_gain", "negative_stiffness")]
    if law is None:
        raise ValueError(f"rig {e.rig.name}: there is no magnet along whose motion anything could change")
    return replace(law, gain_scale=law.gain_scale * more[0], stiffness_scale=law.stiffness_scale * more[1])


def slopes(law: ForceLaw | SingleSidedLaw, y: np.ndarray | float, i: np.ndarray | float) -> tuple:
    """Actuator gain (N/A) and stiffness (N/m) at a displacement and a current, by central differences."""
    h, d = STEP * law.gap, STEP * (abs(law.bias_current) or 1.0)
    gain = (force(law, y, i + d) - force(law, y, i - d)) / (2 * d)
    return gain, -(force(law, y + h, i) - force(law, y - h, i)) / (2 * h)
