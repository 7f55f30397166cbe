"""Gain and stiffness of the magnets along a recorded motion, where it is so large that they are not those at rest.

A recording is opened at the linear nominal loop (see `open_loop`): what is left of measured less simulated is then the
sensor's noise, if the plant is linear. The controller answers to that noise, and while a set-point step drives the
coil with twice its current, its answer pulls twice as much. Opened as if it had not, the residual contains low
frequencies that were never in the noise, and a fit takes them for damping or delay.

With e the reading and u the command (each measured less simulated), x what u does to the linear nominal plant, and g
and k what gain and stiffness along the motion have more than at rest, the force g i - k x that the linear plant lacks
is known from e alone. It is taken off, with the motion that it causes itself, to second order.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.signal

from maglev_env.experiment import Experiment
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import ForceLaw, SingleSidedLaw, force
from maglev_env.rig.rig import axis_rig

NOTABLE = 0.02  # rms change of gain or stiffness along the motion, of the value at rest, from which it is followed
STEP = 1e-4  # of gap and bias current, for derivatives of the force
NEAREST = 0.98  # of the gap: how near a reading, or the rotor of a simulation, may come to a magnet


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
    """

    begin: np.ndarray
    end: np.ndarray
    stiffness: np.ndarray
    mean: float
    square: float
    lag: float | None
    late: int

    def driven(self, command: np.ndarray) -> np.ndarray:
        """Mean force (..., axes, samples) over each control step that the linear plant lacks, N, by the current."""
        a, b = ends(command, self.lag, self.late)
        more, moved = self.end - self.begin, b - a
        return self.begin * a + self.mean * (self.begin * moved + more * a) + self.square * more * moved

    def at(self, samples: slice) -> "AlongMotion":
        """Gain and stiffness along some of the samples."""
        begin, end, stiffness = (v[:, samples] for v in (self.begin, self.end, self.stiffness))
        return AlongMotion(begin, end, stiffness, self.mean, self.square, self.lag, self.late)


def ends(command: np.ndarray, lag: float | None, late: int) -> tuple[np.ndarray, np.ndarray]:
    """Current at the start of every control step, and where it goes within the step, (..., samples) each, A."""
    if late:
        command = np.concatenate([np.repeat(command[..., :1], late, axis=-1), command[..., :-late]], axis=-1)
    if lag is None:
        return command, np.concatenate([command[..., 1:], command[..., -1:]], axis=-1)
    if lag == 0:
        return command, command
    return scipy.signal.lfilter([0.0, 1 - lag], [1.0, -lag], command, axis=-1, zi=command[..., :1])[0], command


def along_motion(
    e: Experiment, channels: Mapping[str, np.ndarray], source: str | None, held: bool, every: int
) -> AlongMotion | None:
    """Gain and stiffness along a recorded motion.

    Args:
        e: the nominal experiment that is simulated.
        channels: displacement, and the command or current of `source`, -> (axes, samples).
        source: the channel that drives the magnets; None: it is not known.
        held: whether it is held between samples.
        every: control samples for each of these samples.

    Returns:
        None where they are those at rest.
    """
    rig, dt = e.rig, every / e.rig.control_rate
    if source is None or not rig.controlled:
        return None
    late = round(effect_value(e.effects, "delay") / dt)
    lag = None if not held else float(np.exp(-dt / rig.amplifier_time_constant)) if rig.amplifier_time_constant else 0.0
    u, y = channels[source], channels["displacement"]
    a, b = ends(u, lag, late)
    place = np.clip(y, -NEAREST * rig.gap, NEAREST * rig.gap)
    next_place = np.concatenate([place[:, 1:], place[:, -1:]], axis=1)
    begin, end, stiffness = np.zeros_like(u), np.zeros_like(u), np.zeros_like(u)
    notable = False
    for axis in range(rig.axes):
        law = force_law(axis_rig(rig, axis))
        gain, held_by = _slopes(law, 0.0, 0.0)
        begin[axis], at_begin = _slopes(law, place[axis], a[axis])
        end[axis], at_end = _slopes(law, next_place[axis], b[axis])
        stiffness[axis] = (at_begin + at_end) / 2 - held_by
        begin[axis] -= gain
        end[axis] -= gain
        changes = np.mean(end[axis] ** 2) / gain**2, np.mean(stiffness[axis] ** 2) / held_by**2 if held_by else 0.0
        notable |= max(changes) > NOTABLE**2
    if not notable:
        return None
    mean, square = (0.5, 1 / 3) if lag is None else (1.0, 1.0)
    if lag:
        decay = rig.amplifier_time_constant / dt
        left, left_squared = decay * (1 - lag), decay / 2 * (1 - lag**2)
        mean, square = 1 - left, 1 - 2 * left + left_squared
    return AlongMotion(begin, end, stiffness, mean, square, lag, late)


def _slopes(law: ForceLaw | SingleSidedLaw, y: np.ndarray | float, i: np.ndarray | float) -> tuple:
    """Actuator gain (N/A) and stiffness (N/m) at a displacement and a current, by central differences."""
    h, d = STEP * law.gap, STEP * (abs(law.bias_current) or 1.0)
    gain = (force(law, y, i + d) - force(law, y, i - d)) / (2 * d)
    return gain, -(force(law, y + h, i) - force(law, y - h, i)) / (2 * h)
