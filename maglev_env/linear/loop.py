"""Exact sampled-data frequency responses of the linearised loop: the result of a small experiment without noise."""

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.plant import continuous_plant, sampled
from maglev_env.loop.effect import effect_value, split_delay
from maglev_env.loop.gains import INPUTS, controller_response, of_axis


@dataclass(frozen=True)
class LoopResponse:
    """Responses of the sampled loop: complex (n,), or (n, 2, 2) on an x-y rig with indices [to, from] axis.

    Where the controller reads the coil's current, that loop is closed in all of them: the loop is broken at the
    reading.

    Args:
        frequency: (n,), Hz.
        controller: from the negative reading to the command, A/m; of a filter of the error from the error.
        plant: from command to displacement reading, m/A.
        receptance: from the held force to the reading in closed loop, m/N.
        force_to_command: from the held force to the command in closed loop, A/N.
        loop_gain: controller * plant.
        sensitivity: 1 / (1 + loop_gain), from an error of the reading to the reading; without a current that is read
            also the response command / injection.
        amplifier: from command to the coil's current at the control samples, A/A, including the delay. Without an
            amplifier pole it is the delay in samples, rounded up.
        from_reference: from the reference to the command with the loop open at the reading, A/m.
        from_injection: likewise from the injection, A/A; 1 if the current is not read.
    """

    frequency: np.ndarray
    controller: np.ndarray
    plant: np.ndarray
    receptance: np.ndarray
    force_to_command: np.ndarray
    loop_gain: np.ndarray
    sensitivity: np.ndarray
    amplifier: np.ndarray
    from_reference: np.ndarray
    from_injection: np.ndarray

    def __repr__(self) -> str:
        f = self.frequency
        return f"<LoopResponse at {f.size} frequencies, {f.min(initial=np.inf):g} to {f.max(initial=0.0):g} Hz>"


def loop_response(experiment: Experiment, frequency: np.ndarray) -> LoopResponse:
    """Responses of the linearised rig with its effects, exactly discretised and closed by its controllers.

    Args:
        experiment: with rig, effects, sensor and gains; its excitations are not used.
        frequency: (n,), Hz.
    """
    axes, dt = experiment.rig.axes, 1 / experiment.rig.control_rate
    z = np.exp(2j * np.pi * np.asarray(frequency, dtype=float) * dt)
    controls = np.zeros((len(INPUTS), len(z), axes, axes), complex)
    for (k, of), axis in product(enumerate(INPUTS), range(axes)):
        controls[k, :, axis, axis] = controller_response(of_axis(experiment.gains, axis), z, dt, of)
    m, c, current = continuous_plant(experiment)
    a, b_force, b_old, b_new = sampled(experiment, m)
    n, (whole, fraction) = len(a), split_delay(experiment.effects, dt)
    from_states = _resolvent(a, np.concatenate([c, current[:, :n]]), z)
    late = z[:, None, None] ** float(-whole) * repeated(effect_value(experiment.effects, "dropped_samples"), z)
    from_command = late * (from_states @ b_new + (from_states @ b_old) / z[:, None, None])
    plant, amplifier = from_command[:, :axes], from_command[:, axes:]
    # Without an amplifier pole the current jumps with the command: at a sample it has its new value only if the delay
    # is a whole number of samples.
    amplifier = amplifier + current[:, n + axes :] * (late / z[:, None, None] if fraction else late)
    injected = np.linalg.inv(np.eye(axes) + controls[INPUTS.index("current")] @ amplifier)
    referred, controller = (injected @ controls[INPUTS.index(of)] for of in ("reference", "reading"))
    loop = controller @ plant
    sensitivity = np.linalg.inv(np.eye(axes) + loop)
    receptance = np.linalg.inv(np.eye(axes) + plant @ controller) @ from_states[:, :axes] @ b_force
    found = (
        controller, plant, receptance, -controller @ receptance, loop, sensitivity, amplifier, referred, injected
    )  # fmt: skip
    return LoopResponse(np.asarray(frequency), *(m[:, 0, 0] if axes == 1 else m for m in found))


def repeated(lost: float, z: np.ndarray) -> np.ndarray:
    """Expected response (n, 1, 1) at z (n,) from the command to what acts; the last one replaces those that are lost.

    Args:
        lost: probability with which a command is lost.
        z: e^(j w dt).
    """
    return ((1 - lost) / (1 - lost / z))[:, None, None]


def _resolvent(a: np.ndarray, rows: np.ndarray, z: np.ndarray) -> np.ndarray:
    """rows (z - A)^-1 at every z (f,), shape (f, rows, n).

    A Schur decomposition makes A triangular once, so that each frequency needs a back substitution only; unlike an
    eigendecomposition it is accurate for any A.
    """
    a, _, _, scale, _ = scipy.linalg.lapack.dgebal(
        a, scale=1
    )  # balancing: states of very different size would lose accuracy
    triangular, basis = scipy.linalg.schur(a, output="complex")
    wanted = (rows * scale) @ basis
    solved = np.empty((len(a), len(z), len(rows)), complex)
    for j in range(len(a)):
        before = np.einsum("i,ifr->fr", triangular[:j, j], solved[:j])
        solved[j] = (wanted[:, j] + before) / (z - triangular[j, j])[:, None]
    return np.moveaxis(solved, 0, 2) @ basis.conj().T / scale
