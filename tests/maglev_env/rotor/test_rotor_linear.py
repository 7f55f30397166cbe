"""The linear model against closed forms of rotor dynamics (Genta 2005), and against what is simulated."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from maglev_env.loop.gains import Gains, controller_response
from maglev_env.rotor.identification import Protocol, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.linear import (
    at_planes,
    closed_loop_poles,
    mechanics,
    probe_readings,
    sensitivity,
    unbalance_response,
    undamped_frequencies,
)
from maglev_env.rotor.parts import Runout, Unbalance
from maglev_env.rotor.rotor import load_rotor
from maglev_env.rotor.simulate import spin

PUMP = load_rotor("pump")
AXIS = replace(PUMP.axis, adc_bits=0, dac_bits=0, noise=replace(PUMP.axis.noise, displacement=0.0))
BODY, ARM = PUMP.body, PUMP.planes.magnets[1]
SPRING = 16_500.0


def on_springs(damping: float = 0.0):
    """The pump's rotor on springs (N/m) and dampers (N s/m) at its magnet planes alone."""
    still = replace(AXIS, actuator_gain=1e-6, negative_stiffness=-1e-9)
    off = {name: replace(g, kp=0.0, ki=0.0, kd=0.0) for name, g in PUMP.gains.items()}
    fluid = replace(PUMP.fluid, stiffness=SPRING, damping=damping)
    return replace(PUMP, axis=still, gains=off, fluid=fluid, gravity=(0.0, 0.0, 0.0), runout=Runout())


def conical(speed: float) -> tuple[float, float]:
    """Backward (negative) and forward conical whirl, rad/s: -I_t w^2 + I_p speed w + 2 k b^2 = 0."""
    half = BODY.polar_inertia * speed / (2 * BODY.transverse_inertia)
    root = np.sqrt(half**2 + 2 * SPRING * ARM**2 / BODY.transverse_inertia)
    return half - root, half + root


@pytest.mark.parametrize("rpm", [0.0, 7000.0, 14_000.0])
def test_whirl_frequencies_are_the_closed_form(rpm):
    speed = rpm * np.pi / 30
    bounce = np.sqrt(2 * SPRING / BODY.mass)
    expected = np.sort([-bounce, bounce, *conical(speed)]) / (2 * np.pi)
    found = undamped_frequencies(on_springs(), SPRING, speed)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("mode", [0, 1])
def test_simulated_whirl_has_those_frequencies(mode):
    speed = 14_000 * np.pi / 30
    start = np.zeros(10)
    start[1] = 1e-3  # tilted and let go: both whirls at once
    n = 40_000
    tilt = spin([Run(on_springs(), 14_000)], n, start=start).channels[0]
    z = (tilt[2] - tilt[0]) + 1j * (tilt[3] - tilt[1])
    spectrum = abs(np.fft.fft(z * np.hanning(n)))
    frequency = np.fft.fftfreq(n, 1 / AXIS.control_rate)
    wanted = conical(speed)[mode] / (2 * np.pi)
    side = np.flatnonzero(np.sign(frequency) == np.sign(wanted))
    i = side[spectrum[side].argmax()]
    left, peak, right = np.log(spectrum[i - 1 : i + 2])
    found = frequency[i] + 0.5 * (left - right) / (left - 2 * peak + right) * AXIS.control_rate / n
    assert found == pytest.approx(wanted, rel=2e-4)


def test_the_conical_critical_speed_is_raised_by_the_gyroscopic_moment():
    """Forward whirl meets the speed at the frequency at rest over sqrt(1 - I_p / I_t)."""
    at_rest = -conical(0.0)[0]
    expected = at_rest / np.sqrt(1 - BODY.polar_inertia / BODY.transverse_inertia)
    off = [
        undamped_frequencies(on_springs(), SPRING, v).max() - v / (2 * np.pi)
        for v in (0.999 * expected, 1.001 * expected)
    ]
    assert off[0] > 0 > off[1]


def test_unbalance_response_is_the_closed_form():
    """m e w^2 / (k - m w^2 + i w c) of the bounce, and the conical mode's with I_t - I_p in the place of m."""
    c = 8.0
    rotor = replace(on_springs(c), unbalance=Unbalance(3e-8, 2e-8, 40.0))
    speed = np.arange(1000, 14_001, 1000) * np.pi / 30
    bounce = 3e-8 * speed**2 / (2 * SPRING - BODY.mass * speed**2 + 2j * speed * c)
    stiff, damp = 2 * ARM**2 * SPRING, 2 * ARM**2 * c
    effective = BODY.transverse_inertia - BODY.polar_inertia
    turned = np.exp(1j * np.radians(40.0))
    tilt = 2e-8 * turned * speed**2 / (stiff - effective * speed**2 + 1j * speed * damp)
    q = unbalance_response(rotor, speed)
    np.testing.assert_allclose(q, np.stack([bounce, tilt, -1j * bounce, -1j * tilt], axis=1), rtol=1e-9)
    n = 2400
    found = spin([Run(rotor, v * 30 / np.pi) for v in speed], n, settle=48_000)
    t = (48_000 + np.arange(n)) / AXIS.control_rate
    once = 2 * (found.channels[:, :4] * np.exp(-1j * speed[:, None] * t)[:, None]).mean(axis=-1)
    lag = 1 + 1j * speed * AXIS.sensor_time_constant
    expected = q @ at_planes(*PUMP.planes.probes).T / lag[:, None]
    np.testing.assert_allclose(once, expected, rtol=5e-3, atol=1e-12)


def test_the_speed_of_an_unstable_loop_shows_in_poles_and_lanes():
    weak = {name: replace(g, kp=1500.0) for name, g in PUMP.gains.items()}  # less than the negative stiffness
    rotor = replace(PUMP, axis=AXIS, gains=weak)
    assert abs(closed_loop_poles(rotor)).max() > 1 > abs(closed_loop_poles(replace(PUMP, axis=AXIS))).max()
    assert np.isfinite(spin([Run(rotor)], 10_000).first_contact[0]).any()


def test_poles_do_not_depend_on_the_coordinates_of_equal_controllers():
    planes = replace(PUMP, gains=dict(zip("ab", PUMP.gains.values(), strict=True)))
    for speed in (0.0, 1500.0):
        found, expected = (np.sort(abs(closed_loop_poles(r, speed))) for r in (planes, PUMP))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("names", [("translation", "tilt"), ("a", "b")])
def test_identified_coefficients_and_peaks_are_the_linear_models(names):
    gains = dict(zip(names, (Gains(8000.0, 2000.0, 5.2), Gains(8000.0, 2000.0, 5.2)), strict=True))
    rotor = replace(PUMP, axis=AXIS, gains=gains, unbalance=Unbalance(), runout=Runout(), gravity=(0.0, 0.0, 0.0))
    protocol = Protocol(amplitude=0.002, band=(75.0, 92.0))
    rpm = (0.0, 14_000.0)
    found = identify_runs([Run(rotor, v) for v in rpm], protocol)
    dt = 1 / AXIS.control_rate
    for i, v in enumerate(rpm):
        speed = v * np.pi / 30
        for c in range(2):
            frequency = found.frequency[c]
            forward = sensitivity(rotor, frequency, speed)[:, c, c]
            assert abs(found.sensitivity[c][i] - forward).max() < 2e-3
        # Dynamic stiffness of the loop: what holds the mode at w beside its own inertia, fitted over the band.
        model = mechanics(rotor)
        for mode in range(2):
            lines = protocol.lines[mode] if "tilt" in names else np.union1d(*protocol.lines)
            f = lines * protocol.fundamental
            f = f[(f >= protocol.band[0]) & (f <= protocol.band[1])]
            w, z = 2 * np.pi * f, np.exp(2j * np.pi * f * dt)
            control = controller_response(gains[names[0]], z, dt)
            hold = (1 - np.exp(-1j * w * dt)) / (1j * w * dt)
            path = hold / (1 + 1j * w * AXIS.amplifier_time_constant) / (1 + 1j * w * AXIS.sensor_time_constant)
            gain = model.drive[mode] @ model.probes[:, mode]
            dynamic = model.stiffness[mode, mode] + gain * control * path
            assert found.stiffness[i, mode] == pytest.approx(dynamic.real.mean(), rel=5e-3)
            assert found.damping[i, mode] == pytest.approx((dynamic.imag / w).mean(), rel=1e-2)


def test_ladder_of_speeds_splits_conical_whirl_evenly():
    """Forward minus backward is I_p / I_t times the speed, at any speed."""
    ratio = BODY.polar_inertia / BODY.transverse_inertia
    for low, high in pairwise((2000.0, 8000.0, 14_000.0)):
        splits = []
        for v in (low, high):
            f = undamped_frequencies(on_springs(), SPRING, v * np.pi / 30)
            splits.append(f.sum())  # the bounce's two cancel
        assert splits[1] - splits[0] == pytest.approx(ratio * (high - low) / 60, rel=5e-3)


def test_probes_read_a_turning_rotor_behind_their_lag():
    """A forward orbit with a tilt, and the runout, behind a first-order low-pass of 1 ms: closed form at each plane."""
    lag, speeds = 1e-3, np.array([100.0, 1000.0])
    rotor = replace(PUMP, axis=replace(PUMP.axis, sensor_time_constant=lag))
    orbit, tilt = 1e-5 * np.exp(0.3j), 2e-4
    q = np.array([[orbit, tilt, -1j * orbit, -1j * tilt]] * 2)
    found = probe_readings(rotor, q, speeds)
    for i, speed in enumerate(speeds):
        size, turned = 1 / np.hypot(1, speed * lag), np.exp(-1j * np.arctan(speed * lag))
        for plane in range(2):
            runout = rotor.runout.amplitude[plane] * np.exp(1j * np.radians(rotor.runout.phase[plane]))
            x = (orbit + rotor.planes.probes[plane] * tilt + runout) * size * turned
            assert found[i, 2 * plane : 2 * plane + 2] == pytest.approx([x, -1j * x], rel=1e-9)


def test_a_fluid_moves_along_with_the_rotor():
    """Translation on two springs in each direction: sqrt(2 k / (m + m_a))."""
    wet = replace(on_springs(), fluid=replace(PUMP.fluid, added_mass=0.5 * BODY.mass, added_inertia=0.0))
    expected = np.sqrt(2 * SPRING / (1.5 * BODY.mass)) / (2 * np.pi)
    assert np.abs(undamped_frequencies(wet, SPRING) - expected).min() < 1e-9 * expected
