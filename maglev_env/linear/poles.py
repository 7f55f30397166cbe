"""The linearised sampled loop in state space, and its poles."""

from collections.abc import Mapping, Sequence

import numpy as np

from maglev_env.experiment import Experiment, self_sensors
from maglev_env.kept import by_value
from maglev_env.linear.plant import discrete_plant
from maglev_env.loop.effect import Effects, effect_value, split_delay
from maglev_env.loop.gains import NO_CONTROLLER, of_axis, realised_together, states_of
from maglev_env.rig.rig import Rig
from selfsense.baseband import growth_rate
from selfsense.sensor import SelfSensor


def closed_loop_poles(experiment: Experiment, plant: tuple[np.ndarray, ...] | None = None) -> np.ndarray:
    """Poles (z-plane) of the linearised sampled loop, which is stable if all are inside the unit circle.

    With self-sensing the baseband model of the sensor is used; the growth of an estimator that is unstable by itself is
    added as a pole.

    Args:
        experiment: with rig, effects, sensor and gains.
        plant: its `discrete_plant`, if it has been computed already.

    Returns:
        Complex, (poles,).
    """
    poles = np.linalg.eigvals(closed_loop(experiment, plant)[0])
    return np.concatenate([poles, _growing(experiment)])


def pole_radii(experiments: Sequence[Experiment]) -> np.ndarray:
    """The largest magnitude (n,) of each experiment's `closed_loop_poles`."""
    return np.array([np.abs(poles).max() for poles in all_poles(experiments)])


def all_poles(experiments: Sequence[Experiment], without: int | None = None) -> list[np.ndarray]:
    """The `closed_loop_poles` of each experiment.

    Args:
        experiments: Any.
        without: An axis (0 or 1) whose controller shall not see the displacement: the poles of the loop broken there.
    """
    # Together with all others that have the same plant, and controllers of the same order.
    alike: dict[tuple, list[int]] = {}
    for i, e in enumerate(experiments):
        effects = tuple((name, *values.items()) for name, values in e.effects.items())
        states = [states_of(of_axis(e.gains, axis), 1 / e.rig.control_rate) for axis in range(e.rig.axes)]
        alike.setdefault((id(e.rig), id(e.sensor), effects, tuple(e.apart.items()), *states), []).append(i)
    found: list[np.ndarray] = [np.empty(0)] * len(experiments)
    for members in alike.values():
        first = experiments[members[0]]
        stacked = [
            realised_together([of_axis(experiments[i].gains, axis) for i in members], 1 / first.rig.control_rate)
            for axis in range(first.rig.axes)
        ]
        a, b_force, b_old, b_new, c, current = _plant(first.rig, first.effects, first.sensor, first.apart)
        if without is not None:
            c = np.where(np.arange(len(c))[:, None] == without, 0.0, c)
        growth, loops = _growing(first), _closed(first, (a, b_force, b_old, b_new, c, current), stacked)[0]
        for i, poles in zip(members, np.linalg.eigvals(loops), strict=True):
            found[i] = np.concatenate([poles, growth])
    return found


@by_value(16)
def _plant(
    rig: Rig, effects: Effects, sensor: str | tuple[SelfSensor, ...], apart: Mapping[str, float]
) -> tuple[np.ndarray, ...]:
    """The `discrete_plant` of experiments that differ in controllers alone."""
    return discrete_plant(Experiment(rig, NO_CONTROLLER, (), effects=effects, sensor=sensor, apart=apart))


def _growing(e: Experiment) -> list[float]:
    """Poles by the growth of self-sensing estimators that are unstable by themselves."""
    growth = (growth_rate(sensor) for sensor in self_sensors(e))
    return [float(np.exp(rate / e.rig.control_rate)) for rate in growth if rate >= 0]


def closed_loop(
    experiment: Experiment, plant: tuple[np.ndarray, ...] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The linearised sampled loop from the held force of each axis (N) to its displacement reading (m).

    Args:
        experiment: with rig, effects, sensor and gains.
        plant: its `discrete_plant`, if it has been computed already.

    Returns:
        State-space matrices A (s, s), B (s, axes) and C (axes, s).
    """
    dt = 1 / experiment.rig.control_rate
    controllers = [realised_together([of_axis(experiment.gains, axis)], dt) for axis in range(experiment.rig.axes)]
    loops, from_force, to_reading = _closed(experiment, plant or discrete_plant(experiment), controllers)
    return loops[0], from_force, to_reading


def _closed(
    experiment: Experiment, plant: tuple[np.ndarray, ...], controllers: Sequence[tuple[np.ndarray, ...]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `closed_loop`, with A (n, s, s) of n controllers: of every axis, the stacked matrices of `realised`."""
    a, b_force, b_old, b_new, c, current = plant
    delay, _ = split_delay(experiment.effects, 1 / experiment.rig.control_rate)
    lost = effect_value(experiment.effects, "dropped_samples")
    n, axes, count = len(a), len(c), len(controllers[0][0])
    # States: plant, controllers, then the last delay + 1 commands of every axis, newest first.
    held = n + sum(k[2].shape[1] for k in controllers)
    size = held + (delay + 1) * axes
    m = np.zeros((count, size, size))
    m[:, :n, :n] = a
    command = np.zeros((count, axes, size))
    first = n
    for axis, (ka, kb, kc, kd) in enumerate(controllers):
        own = slice(first, first + kc.shape[1])
        read = -np.stack([c[axis], current[axis]])
        m[:, own, own], m[:, own, :n] = ka, kb[..., 1:] @ read
        command[:, axis, own], command[:, axis, :n] = kc, kd[:, 1:] @ read
        first = own.stop
    stored = np.eye(size)[held:]
    if lost:  # the expected command: in its place the one before it may act again
        command = (1 - lost) * command + lost * stored[:axes]
    # Commands now, one sample ago, ...
    commands = np.concatenate([command, np.broadcast_to(stored, (count, *stored.shape))], axis=1)
    m[:, :n] += b_new @ commands[:, delay * axes : (delay + 1) * axes]
    m[:, :n] += b_old @ commands[:, (delay + 1) * axes :][:, :axes]
    m[:, held:] = commands[:, : (delay + 1) * axes]
    from_force, to_reading = np.zeros((size, axes)), np.zeros((axes, size))
    from_force[:n], to_reading[:, :n] = b_force, c
    return m, from_force, to_reading
