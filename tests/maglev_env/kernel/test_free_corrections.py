"""Free corrections: as formulas against numpy, and in the lane kernel against effects that they can stand for."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import protocol_experiment, without_noise
from maglev_env.kernel.lanes import lane_batch, structure_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.loop.effect import effect
from maglev_env.loop.free import element, places
from maglev_env.loop.free.element import SHARES
from maglev_env.loop.mechanics import V
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES as W

IDEAL = replace(without_noise(protocol_experiment(load_rig("hmb_free"))), periods=1, transient_periods=0)
NEUTRAL = effect("friction", 0.0)  # selects the flexible kernel
AT = np.array([*(-s for s in SHARES[::-1]), *SHARES])


def drawn(name, reach, values, **more):
    """A correction whose line goes through values (10,)."""
    return effect(name, reach, **dict(zip(element.LINE, map(float, values), strict=True)), **more)


def rows(effects):
    """Rows of a single lane, flat, as a piece takes them."""
    found = lane_batch([replace(IDEAL, effects=effects)]).rows[:, 0]
    return np.repeat(found, W)


def record(effects, samples=4000):
    return simulate_records([replace(IDEAL, effects=effects)], threads=1)[0][:3, :samples]


def test_the_line_is_the_interpolation_and_goes_on_straight():
    values = np.array([3.0, -1.0, 0.5, 0.4, 0.2, -0.3, 0.8, 0.6, 0.1, -2.0])
    x, v = rows(drawn("free_command", 0.2, values)), np.linspace(-0.19, 0.19, 41)
    at, through = np.insert(0.2 * AT, 5, 0.0), np.insert(values, 5, 0.0)
    found = [element.line(x, places.COMMAND_LINE, one) for one in v]
    np.testing.assert_allclose(found, np.interp(v, at, through), atol=1e-12)
    slope = (values[-1] - values[-2]) / 0.06
    assert element.line(x, places.COMMAND_LINE, 0.3) == pytest.approx(-2.0 + 0.1 * slope)


def test_a_memory_relaxes_and_plays():
    """A step relaxes as exponentials; a play follows only behind its half width."""
    x = rows(effect("free_reading", 1.0, time=1e-3, g1=1.0))
    read, q, dt = element.memory(element.START), places.READING_MEMORY, 1 / IDEAL.rig.control_rate
    found = []
    for _ in range(200):
        element.advance(x, q, 1.0, 1.0)
        found.append(read(x, q, 0.0, 0.0))
    np.testing.assert_allclose(found, 1 - np.exp(-np.arange(1, 201) * dt / 5e-3), atol=1e-12)
    element.advance(x, q, -3.0, 0.0)  # between samples nothing moves
    assert read(x, q, 0.0, 0.0) == found[-1]
    x = rows(effect("free_reading", 1.0, h2=1.0))
    states = []
    for v in [0.0, 1.0, 0.5, 0.2, -1.0]:
        element.advance(x, q, v, 1.0)
        states.append(read(x, q, v, 0.0))
    np.testing.assert_allclose(states, [0.0, 0.65, 0.65, 0.55, -0.65])


def test_the_gain_goes_with_place_and_speed():
    gains = drawn("free_gain", 1e-5, 0.1 * AT) | drawn("free_gain_velocity", 1e-2, -0.2 * abs(AT))
    x, h = rows(gains), 1 / IDEAL.rig.control_rate
    x[V] = 5e-3 * h
    assert places.pulling(element.START)(x, 0, 5e-6, 2.0) == pytest.approx(2.0 * (1 + 0.05 - 0.1))


# Each is another effect, exactly or as far as a sampled memory is one.
SAME = {
    "a gain": (effect("actuator_gain", 0.05), effect("free_current", 1.0, direct=0.05), 1e-6),
    "its line": (effect("actuator_gain", 0.05), drawn("free_current", 0.5, 0.025 * AT), 1e-6),
    "a probe": (effect("sensor_gain", 0.05), effect("free_reading", 1.0, direct=0.05), 1e-9),
    "damping": (effect("damping", 20.0), drawn("free_damper", 0.1, 2.0 * AT), 1e-9),
    "a dead band": (effect("deadband", 0.02), drawn("free_command", 0.1, -np.clip(0.1 * AT, -0.02, 0.02)), 1e-9),
    "two halves": (effect("asymmetric_gain", 0.1), drawn("free_current", 0.08, 0.008 * abs(AT)), 1e-9),
    "backlash": (effect("probe_backlash", 5e-7), effect("free_reading", 1e-5, direct=-1.0, h0=1.0), 1e-9),
    "a stop": (
        effect("soft_stop", 4.2e-6, stiffness=1e4),
        drawn("free_spring", 1e-5, 0.1 * np.sign(AT) * np.maximum(abs(AT) - 0.42, 0.0)),
        1e-9,
    ),
    "a drift": (effect("gain_drift", 0.5), effect("free_current", 1.0, rate=0.5), 1e-3),
    "a late command": (
        effect("amplifier_lag", 3e-4), effect("free_command", 1.0, direct=-1.0, time=3e-4, g0=1.0), 5e-3,
    ),
    "a late probe": (effect("sensor_lag", 1e-4), effect("free_reading", 1.0, direct=-1.0, time=1e-4, g0=1.0), 2e-2),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SAME)
def test_it_can_stand_for_an_effect(name):
    other, free, tolerance = SAME[name]
    plain, one, both = record(NEUTRAL), record(NEUTRAL | other), record(NEUTRAL | free)
    shown = [0] if name == "a late command" else [0, 1, 2]  # the lag's current is that behind the second pole
    off = abs(both - one).max(axis=1) / abs(one - plain).max(axis=1)
    assert off[shown].max() < tolerance


@pytest.mark.slow
def test_neutral_ones_change_nothing_and_without_them_nothing_is_compiled_in():
    free = effect("free_spring", 1e-4)
    e = replace(IDEAL, effects=NEUTRAL)
    assert structure_of(replace(e, effects=NEUTRAL | free)).free and not structure_of(e).free
    plain, found = record(NEUTRAL), record(NEUTRAL | free)
    assert (abs(found - plain) <= 1e-11 * abs(plain).max(axis=1, keepdims=True)).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "free",
    [
        *(effect(name, 1.0, direct=0.1, time=5e-4, g0=-0.3, g2=0.2) for name in ("free_command", "free_current")),
        effect("free_reading", 1.0, direct=0.1, time=5e-4, g0=-0.3, g2=0.2),
        effect("free_spring", 1.0, direct=1e3, time=5e-4, g0=-3e3, g2=2e3),
        drawn("free_damper", 1.0, 30.0 * AT),
    ],
    ids=lambda free: next(iter(free)),
)
def test_the_linear_loop_has_it(free):
    excited = Excitation("sphs", "current", 20.0, (1, 5, 20, 60, 150), 1e-4)
    e = replace(IDEAL, excitations=(excited,), periods=2, transient_periods=20, effects=free)
    found = simulate_statistics([e]).statistics
    linear, none = (loop_response(replace(e, effects=one), found.frequency).plant for one in (free, {}))
    change = abs(linear - none).max()
    assert change > 1e-2 * abs(none).max()
    assert (abs(found.mean[0, 0] / found.mean[0, 1] - linear) < 0.01 * change).all()
