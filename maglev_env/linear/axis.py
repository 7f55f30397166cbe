"""One axis of the linearised rig in continuous time: every effect that has a linear part, as states."""

from dataclasses import dataclass, replace
from functools import lru_cache
from math import isfinite

import numpy as np

from maglev_env.experiment import Experiment, moving_mass, self_sensors
from maglev_env.loop.eddy import eddy_branches
from maglev_env.loop.effect import effect_value
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import ForceLaw, linearise
from selfsense.baseband import baseband

POSITION, VELOCITY = 0, 1  # the first two states; the last two columns are the held force and the held command


@dataclass(frozen=True)
class LinearAxis:
    """States of one axis, then its held force (N) and command (A): n of both together.

    rates (n, n): their derivatives, without what the other axis adds. current (n,): the coil's (A), pulling (n,): the
    one that makes force, reading (n,): the displacement read (m), before sensor_gain. driven (n,): what each derivative
    gains per unit of acceleration by the bearing.
    """

    rates: np.ndarray
    current: np.ndarray
    pulling: np.ndarray
    reading: np.ndarray
    driven: np.ndarray


def linear_axis(e: Experiment) -> LinearAxis:
    """The states of a one-axis experiment: position, velocity, then those of each effect that it has.

    Tangents: hysteresis for currents far below its width, where it takes its whole strength; friction about rest, where
    bristles are a spring in series with the slip; the magnets at the eccentricity and i = 0. Voltage limit, runout,
    pickup and unbalance have no linear part. The bearing (magnets, support and friction, and what the other axis'
    bearing does here) moves the probe's mount; the held force and the second body do not.
    """
    effects, mass = e.effects, moving_mass(e)
    amplifier = [t for t in (e.rig.amplifier_time_constant, effect_value(effects, "amplifier_lag")) if t > 0]
    a, b, read = _sensor(e)
    corner, order = effect_value(effects, "eddy_current"), effect_value(effects, "eddy_current", "order")
    direct, weights, speeds = _branches(corner, order) if isfinite(corner) else (1.0, (), ())
    branches = len(weights)
    ratio = _share(e, "support_resonance", "mass_ratio")
    coupling = _share(e, "sensor_resonance", "coupling") if e.sensor == "probe" else 0.0
    sticks = effect_value(effects, "friction", "presliding") > 0
    sizes = (2, len(amplifier), branches, sticks, 2 * (ratio > 0), 2 * (coupling != 0), len(b), 1, 1)
    _, lags, eddy, rubbed, body, mount, probe, force, command = _spans(sizes)
    n = command.stop
    rates, unit = np.zeros((n, n)), np.eye(n)
    driven, moved = unit[VELOCITY].copy(), unit[VELOCITY].copy()  # moved: by any force on the rotor

    current = unit[command.start]
    for state, lag in enumerate(amplifier, lags.start):
        rates[state] = (current - unit[state]) / lag
        current = unit[state]
    pulling = current
    if branches:
        rates[eddy] = speeds[:, None] * (current - unit[eddy])
        pulling = direct * current + weights @ unit[eddy]
    pulling = pulling - effect_value(effects, "hysteresis") * current

    rates[POSITION] = unit[VELOCITY]
    taken = 0.0 * current  # acceleration by the second body
    if ratio > 0:
        rates[body.start], returning = _mode(e, "support_resonance", unit[body])
        rates[body.stop - 1] = returning
        taken, moved[body.stop - 1], driven[body.stop - 1] = -ratio * returning, -1.0, -1.0
    if coupling:
        rates[mount.start], rates[mount.stop - 1] = _mode(e, "sensor_resonance", unit[mount])
        driven[mount.stop - 1] = -coupling
    gain, stiffness = _tangent(e)
    k = e.rig.support_stiffness * (1 + effect_value(effects, "support_stiffness")) + stiffness
    c = e.rig.support_damping + effect_value(effects, "damping")
    rub, slip, bristle = (effect_value(effects, "friction", key) for key in ("force", "velocity", "presliding"))
    held_back = 0.0 * current
    if bristle:
        rates[rubbed] = (unit[VELOCITY] - slip * unit[rubbed]) / bristle
        held_back = rub * unit[rubbed.start]
    else:
        c += rub / slip
    bearing = (gain * pulling - k * unit[POSITION] - c * unit[VELOCITY] - held_back) / mass
    rates += np.outer(driven, bearing) + np.outer(moved, unit[force.start] / mass + taken)

    seen = unit[POSITION] - (unit[mount.start] if coupling else 0.0)
    if len(b):
        rates[probe] = a @ unit[probe] + np.outer(b, seen)
        seen = read @ unit[probe]
    return LinearAxis(rates, current, pulling, seen, driven)


def cross_terms(e: Experiment, axis: int, other: Experiment) -> tuple[float, float, float, float]:
    """What the other axis (its one-axis experiment) does to this one, as `Cross.onto`; cross_coupling adds its share of
    the other's magnets as they pull at the centre, unsaturated."""
    stiffness, damping, gain, sensor = e.rig.cross.onto(axis)
    if ratio := effect_value(e.effects, "cross_coupling"):
        own_gain, own_stiffness = _changed(e, linearise(force_law(other.rig)))
        gain, stiffness = gain + ratio * own_gain, stiffness + ratio * own_stiffness
    return stiffness, damping, gain, sensor


def _tangent(e: Experiment) -> tuple[float, float]:
    """Actuator gain (N/A) and stiffness (N/m) of a one-axis experiment's magnets, every effect on them included."""
    if not e.rig.controlled:
        return 0.0, 0.0
    law = force_law(e.rig)
    if isinstance(law, ForceLaw):
        law = replace(law, saturation=effect_value(e.effects, "saturation"))
    return _changed(e, linearise(law, effect_value(e.effects, "eccentricity")))


def _changed(e: Experiment, tangent: tuple[float, float]) -> tuple[float, float]:
    """Actuator gain and stiffness with the effects that change them in proportion."""
    gain, stiffness = tangent
    return gain * (1 + effect_value(e.effects, "actuator_gain")), stiffness * (
        1 + effect_value(e.effects, "negative_stiffness")
    )


_branches = lru_cache(64)(eddy_branches)  # many lanes share their effect


def _share(e: Experiment, name: str, parameter: str) -> float:
    """How much of a resonance is there: 0 without the effect."""
    return effect_value(e.effects, name, parameter) if effect_value(e.effects, name) > 0 else 0.0


def _mode(e: Experiment, name: str, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of a second-order mode's position and velocity, given the rows that pick them; no forcing."""
    w = 2 * np.pi * effect_value(e.effects, name)
    damping = 2 * effect_value(e.effects, name, "damping_ratio") * w
    return states[1], -(w**2) * states[0] - damping * states[1]


def _sensor(e: Experiment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C from displacement to reading in continuous time; empty for a probe without lag."""
    if e.sensor != "probe":
        return baseband(self_sensors(e)[0])
    poles = [t for t in (e.rig.sensor_time_constant, effect_value(e.effects, "sensor_lag")) if t > 0]
    n = len(poles)
    rates = 1 / np.array(poles)
    return np.diag(rates[1:], -1) - np.diag(rates), np.eye(n)[:1].sum(axis=0) * rates, np.eye(n)[-1:].sum(axis=0)


def _spans(sizes: tuple[int, ...]) -> list[slice]:
    """Where blocks of these sizes lie one after the other."""
    ends = np.cumsum(sizes).tolist()
    return [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
