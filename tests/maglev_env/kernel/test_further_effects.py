"""The effects of loop.further in the lane kernel: against a slow simulator, closed forms, and what they must not do."""

from dataclasses import replace

import numpy as np
import pytest
from reference_effects import simulate_effects
from scipy import stats

from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop
from maglev_env.loop.effect import effect
from maglev_env.loop.further.command_path import LOGISTIC, left_of
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

IDEAL = replace(without_noise(protocol_experiment(load_rig("hmb_free"))), periods=1, transient_periods=0)
NEUTRAL = {**effect("asymmetric_gain", 0.0), **effect("eddy_current", 3e3)}
ALONE = {
    "asymmetric_gain": (effect("asymmetric_gain", 0.2), 2e-3),
    "gain_drift": (effect("gain_drift", 3.0, depth=0.1, frequency=40.0, phase=0.4), 1e-3),
    "cubic_spring": (effect("cubic_spring", 1e14), 5e-6),
    "soft_stop": (effect("soft_stop", 3e-6, stiffness=1e4), 1e-3),
    "soft_stop, round": (effect("soft_stop", 3e-6, stiffness=1e4, steepness=1.5), 1e-4),
    "soft_stop above": (effect("soft_stop", 3e-6, stiffness=1e4, steepness=1.5, side=1.0), 1e-4),
    "soft_stop, harder below": (effect("soft_stop", 3e-6, stiffness=1e4, side=-0.6), 1e-4),
    "foreign_vibration": (effect("foreign_vibration", 0.1, frequency=37.0, phase=0.3), 1e-5),
    "deadband": (effect("deadband", 0.02), 1e-5),
    "dropped_samples": (effect("dropped_samples", 0.3), 5e-5),
    "probe_backlash": (effect("probe_backlash", 2e-7), 1e-4),
    "probe_backlash, spread": (effect("probe_backlash", 2e-7, spread=0.6), 1e-4),
}


def record(effects, samples, e=IDEAL):
    return simulate_records([replace(e, effects=effects)], threads=1)[0][:3, :samples]


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONE)
def test_it_is_what_the_equations_say(name):
    effects, tolerance = ALONE[name]
    samples, with_eddy = 150, {**NEUTRAL, **effects}
    after, before = (np.array(simulate_effects(replace(IDEAL, effects=x), samples))[:, 0] for x in (with_eddy, NEUTRAL))
    change = np.abs(after - before).max(axis=1, keepdims=True)
    assert (change > 1e-3 * np.abs(before).max(axis=1, keepdims=True)).all()
    found = record(with_eddy, samples) - record(NEUTRAL, samples)
    assert (np.abs(found - (after - before)) / change).max() < tolerance


@pytest.mark.slow
@pytest.mark.parametrize("effects", [effect("gain_drift", 3.0), effect("free_command", 1.0, rate=0.5)])
def test_what_grows_with_time_grows_on_both_axes(effects):
    """Pushed along one axis alone, a rotor of two axes moves as along the other one."""
    along = [
        replace(
            IDEAL,
            rig=replace(IDEAL.rig, axes=2),
            effects=effects,
            excitations=tuple(replace(drive, direction=d) for drive in IDEAL.excitations),
        )
        for d in (0.0, 90.0)
    ]
    x, y = (simulate_records([own], threads=1)[0][:, :4000] for own in along)
    moved = np.abs(x[:6]).max()
    assert moved > 0 and np.abs(x[:6] - y[:6].reshape(3, 2, -1)[:, ::-1].reshape(6, -1)).max() < 1e-9 * moved


@pytest.mark.slow
def test_neutral_ones_change_nothing_and_without_them_nothing_is_compiled_in():
    neutral = effect("asymmetric_gain", 0.0)
    e = replace(IDEAL, effects=effect("friction", 0.0))
    assert structure_of(replace(e, effects={**e.effects, **neutral})).further and not structure_of(e).further
    plain, found = record(e.effects, 4000), record({**e.effects, **neutral}, 4000)
    assert (np.abs(found - plain) <= 1e-11 * np.abs(plain).max(axis=1, keepdims=True)).all()


@pytest.mark.slow
def test_commands_are_dropped_with_their_probability_and_the_same_in_every_run():
    """A repeated command shows as a current that goes on along its exponential; noise makes every command another."""
    rig = replace(protocol_experiment(load_rig("hmb_free")).rig, adc_bits=0, dac_bits=0)
    rig = replace(rig, noise=replace(rig.noise, current=0.0), amplifier_time_constant=1e-6)  # the current is what acts
    e, p = replace(IDEAL, rig=rig, seed=3), 0.2
    dropped = effect("dropped_samples", p)
    first, again = record(dropped, 8000, e), record(dropped, 8000, e)
    assert np.array_equal(first, again)
    acts = first[2, 1:]  # a sample later than the command
    repeated = np.isclose(acts[1:], acts[:-1], rtol=0, atol=1e-6)
    assert repeated.mean() == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / repeated.size))
    command = first[1, 1:-1]
    np.testing.assert_allclose(acts[1:][~repeated], command[~repeated], atol=1e-6)


@pytest.mark.slow
def test_the_linear_loop_has_the_expected_response_of_dropped_samples():
    """Against the simulation without noise, at the lines; and so has the closed loop as states."""
    excited = Excitation("sphs", "current", 20.0, (1, 5, 20, 60, 150), 1e-4)
    e = replace(IDEAL, excitations=(excited,), periods=2, transient_periods=20, effects=effect("dropped_samples", 0.4))
    found = simulate_statistics([e]).statistics
    response = loop_response(e, found.frequency)
    np.testing.assert_allclose(found.mean[0, 0] / found.mean[0, 1], response.plant, rtol=2e-4)
    none = loop_response(replace(e, effects={}), found.frequency)
    z = np.exp(2j * np.pi * found.frequency / e.rig.control_rate)
    np.testing.assert_allclose(response.plant / none.plant, 0.6 / (1 - 0.4 / z), rtol=1e-9)
    a, b, c = closed_loop(e)
    receptance = [(c @ np.linalg.solve(one * np.eye(len(a)) - a, b))[0, 0] for one in z]
    np.testing.assert_allclose(receptance, response.receptance, rtol=1e-6)


def test_a_dead_band_is_sharp_or_rounded_about_as_by_gaussian_noise():
    """max and min without rounding; with it the mean over noise of this standard deviation, to a part of the width."""
    u, h, sd = np.linspace(-1, 1, 401), 0.3, 0.2
    left = np.vectorize(left_of)
    np.testing.assert_allclose(left(u, h, 0.0, 1e15), np.maximum(u - h, 0) + np.minimum(u + h, 0), atol=1e-15)
    noise = sd * stats.norm.ppf((np.arange(2000) + 0.5) / 2000)
    mean = (np.maximum(u[:, None] + noise - h, 0) + np.minimum(u[:, None] + noise + h, 0)).mean(axis=1)
    assert np.abs(left(u, h, LOGISTIC * sd, 1 / LOGISTIC / sd) - mean).max() < 0.02 * h
    assert np.abs(left(u, h, 0.0, 1e15) - mean).max() > 0.25 * h


@pytest.mark.slow
def test_a_dead_band_has_the_textbook_describing_function():
    """Sine of a command through it, by the current at the line: 1 - (2 / pi) (asin r + r sqrt(1 - r^2)), r = h / U."""
    rig = replace(IDEAL.rig, amplifier_time_constant=1e-6)
    excited = Excitation("sphs", "current", 20.0, (1,), 0.2)
    quiet = replace(IDEAL, rig=rig, excitations=(excited,), periods=2, transient_periods=20)
    found = simulate_records([replace(quiet, effects=effect("deadband", 0.02))])[0]
    command, current = (np.fft.rfft(found[c, -1000:])[1] for c in (1, 2))
    r = 0.02 / (abs(command) / 500)
    expected = 1 - 2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r * r))
    assert r < 0.5
    assert abs(current / command) == pytest.approx(expected, rel=0.02)


def test_a_hardening_spring_without_magnets_rings_at_the_frequency_of_duffing():
    """Amplitude and frequency by the first harmonic: w^2 = w0^2 + 3/4 k3 A^2 / m, forced at a single line far below."""
    rig = without_noise(Experiment(load_rig("pedestal"), NO_CONTROLLER, ())).rig
    push = 1.0
    low = Excitation("sphs", "force", 1.0, (1,), push)
    e = Experiment(rig, NO_CONTROLLER, (low,), 1, 3, effects=effect("cubic_spring", 1e16))
    y = simulate_records([e])[0][0, -int(rig.control_rate) :]
    force = rig.support_stiffness * y + 1e16 * y**3  # far below the resonance the springs alone carry the force
    cubed = 1e16 * np.abs(y).max() ** 2 / rig.support_stiffness
    assert cubed > 0.02
    assert np.abs(force).max() == pytest.approx(push, rel=5e-3)
