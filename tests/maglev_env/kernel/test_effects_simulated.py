"""Every effect in the lane kernel: against a slow simulator written from the equations, closed forms, and itself."""

import pickle
from dataclasses import replace
from math import inf

import numpy as np
import pytest
from reference_effects import simulate_effects

from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig

LAGS = {**effect("delay", 61.7e-6), **effect("amplifier_lag", 3e-5), **effect("sensor_lag", 2e-5)}
NEUTRAL = {
    **effect("amplifier_voltage_limit", inf),
    **effect("eddy_current", inf),
    **effect("hysteresis", 0.0),
    **effect("eccentricity", 0.0),
    **effect("sensor_resonance", 0.0),
    **effect("runout", 0.0),
    **effect("pickup", 0.0),
    **effect("friction", 0.0),
    **effect("support_resonance", 0.0),
    **effect("unbalance", 0.0),
}
SMOOTH = {
    "eddy_current": effect("eddy_current", 300.0, order=0.6),
    "eccentricity": effect("eccentricity", 2e-5),
    "sensor_resonance": effect("sensor_resonance", 300.0, coupling=0.1),
    "sensor_resonance, fast": effect("sensor_resonance", 1500.0, coupling=0.1),
    "runout": effect("runout", 5e-6, harmonics=0.3, phase=0.4),
    "pickup": effect("pickup", 5e-6, harmonics=0.3, phase=0.4),
    "support_resonance": effect("support_resonance", 150.0, mass_ratio=0.2),
    "support_resonance, fast": effect("support_resonance", 800.0, mass_ratio=0.5),
    "unbalance": effect("unbalance", 1e-6, phase=0.3),
    "saturation": effect("saturation", 0.5),
    "friction": effect("friction", 0.2, velocity=0.01),
}
TOGETHER = {k: v for name, e in SMOOTH.items() if ", " not in name for k, v in e.items()} | LAGS
# What has a kink or a jump: error at one substep, and by how much four substeps must lessen it.
SHARP = {
    "hysteresis": (effect("hysteresis", 0.3, width=0.05), 5e-3, 8.0),
    "amplifier_voltage_limit": (effect("amplifier_voltage_limit", 0.08), 2e-2, 8.0),
    "friction": (effect("friction", 0.2, velocity=1e-4), 1e-4, 16.0),
}


# Other forms: the error, in one kernel with all of them.
ALL_FORMS = {**effect("friction", 0.0, presliding=1e-9), **effect("saturation", inf), **effect("hysteresis", 0.0)}
FORMS = {
    "a sharp knee, and the command saturates": (effect("saturation", 0.42, sharpness=10.0, command=0.15), 1e-4),
    "iron in series with the gap": (effect("saturation", 0.35, sharpness=3.0, creep=0.25), 1e-5),
    "the current saturates": (effect("saturation", inf, sharpness=1.5, current=0.1), 1e-2),
    "Bouc-Wen": (effect("hysteresis", 0.3, width=0.05, power=1.8, unloading=0.2), 2e-2),
    "two bodies": (
        effect("support_resonance", 60.0, mass_ratio=0.1, further_ratio=0.05, further_frequency=2.2), 1e-6,
    ),
    "two modes of a mount": (
        effect("sensor_resonance", 60.0, coupling=0.1, further_ratio=-0.4, further_frequency=2.2), 1e-6,
    ),
    "a body inside the mass": (effect("support_resonance", 150.0, mass_ratio=0.5, inside=0.8), 1e-6),
    "hysteresis under ripple": (effect("hysteresis", 0.3, width=0.05, ripple=20.0), 2e-2),
    "static friction": (
        effect("friction", 0.2, velocity=1e-4, presliding=2e-6, static=1.5, stribeck=2e-3, viscous=3.0), 1e-2,
    ),
    "gradual slip": (effect("friction", 0.2, velocity=1e-4, presliding=2e-6, static=1.2, gradual=0.8), 1e-2),
    "an overshooting amplifier, a plate of finite depth": (
        {**effect("amplifier_lag", 1e-4, feedback=0.6), **effect("eddy_current", 300.0, depth_hz=20.0)}, 1e-5,
    ),
    "a probe's filter of second order, on a mount": (
        {**effect("sensor_lag", 3e-4, feedback=0.8), **effect("sensor_resonance", 60.0, coupling=0.1)}, 1e-6,
    ),
    "a current loop with integral action, a plate of finite depth": (
        {**effect("amplifier_lag", 4e-4, feedback=0.1, lead=1.0), **effect("eddy_current", 300.0, depth_hz=20.0)}, 1e-5,
    ),
}  # fmt: skip


def ideal(rig_name="hmb_free", axis=None, **changes):
    rig = load_rig(rig_name)
    e = without_noise(protocol_experiment(rig if axis is None else axis_rig(rig, axis)))
    return replace(e, periods=1, transient_periods=0, speed_rpm=6000.0, **changes)


def records(e, samples, substeps=1):
    """Readings, commands and currents, (3, axes, samples)."""
    found = simulate_records([e], substeps, threads=1)[0]
    return found[: 3 * e.rig.axes, :samples].reshape(3, e.rig.axes, samples)


KNOWN = {}  # what was simulated slowly without effects, by experiment: many of them share it


def slowly(e, samples):
    """Readings, commands and currents by the slow simulator."""
    key = pickle.dumps((e, samples))
    if key not in KNOWN:
        KNOWN[key] = np.array(simulate_effects(e, samples))
    return KNOWN[key]


def worst_error_of_change(e, with_effects, without, samples, substeps, max_step=inf):
    """Largest error of what the effects change, over the largest change, of any channel."""
    after = np.array(simulate_effects(replace(e, effects=with_effects), samples, max_step=max_step))
    before = slowly(replace(e, effects=without), samples)
    change = np.abs(after - before).max(axis=2)
    errors = []
    for s in substeps:
        found, plain = (records(replace(e, effects=effects), samples, s) for effects in (with_effects, without))
        errors.append((np.abs(found - plain - (after - before)).max(axis=2) / change).max())
    return errors, (change / np.abs(before).max(axis=2)).min()


@pytest.mark.slow
@pytest.mark.parametrize("case", ("one axis", "its lags", "x-y", "no magnets"))
def test_a_lane_whose_effects_are_all_neutral_is_the_nominal_one(case):
    name = {"x-y": "hmb_radial", "no magnets": "pedestal"}.get(case, "hmb_free")
    neutral = NEUTRAL
    if case == "no magnets":
        neutral = {k: NEUTRAL[k] for k in ("sensor_resonance", "runout", "pickup", "friction", "support_resonance")}
    e = ideal(name, effects=LAGS if case == "its lags" else {})
    other = replace(e, effects={**e.effects, **neutral})
    assert structure_of(other).flexible and not structure_of(e).flexible
    plain, found = simulate_records([e])[0], simulate_records([other])[0]
    rms = np.sqrt((plain**2).mean(axis=1, keepdims=True))
    assert (np.abs(found - plain) <= 1e-11 * rms).all()


@pytest.mark.slow
def test_without_poles_in_both_chains_neutral_effects_change_nothing_either():
    rig = replace(load_rig("hmb_free"), amplifier_time_constant=0.0, sensor_time_constant=0.0)
    late = effect("delay", 25e-6)
    e = replace(ideal(), rig=replace(rig, adc_bits=0, dac_bits=0, noise=ideal().rig.noise), effects=late)
    plain, found = (simulate_records([x])[0] for x in (e, replace(e, effects={**late, **NEUTRAL})))
    assert (np.abs(found - plain) <= 1e-10 * np.sqrt((plain**2).mean(axis=1, keepdims=True))).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
def test_a_smooth_effect_is_what_the_equations_say(name):
    e = ideal("hmb_radial", axis=0) if name == "saturation" else ideal()  # whose kernel other tests have compiled
    (error,), change = worst_error_of_change(e, SMOOTH[name], {}, 150, [1])
    assert change > 1e-3
    assert error < 5e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", SHARP)
def test_a_sharp_effect_converges_on_what_the_equations_say(name):
    effects, first, factor = SHARP[name]
    (one, four), change = worst_error_of_change(ideal(), effects, {}, 120, [1, 4], max_step=5e-6)
    assert change > 0.1
    assert one < first and four < one / factor


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMS)
def test_another_form_is_what_the_equations_say(name):
    effects, tolerance = FORMS[name]
    (error,), change = worst_error_of_change(ideal(), {**ALL_FORMS, **effects}, ALL_FORMS, 40, [1], max_step=2e-5)
    assert change > 1e-3
    assert error < tolerance


@pytest.mark.slow
def test_ripple_does_to_hysteresis_what_noise_in_the_current_does_in_the_mean():
    """Noise of the reading, through the controller, against a ripple as fast as this noise moves the current."""
    rig = load_rig("hmb_free")
    excited = Excitation("sphs", "current", 20.0, (1, 3, 5, 9, 15, 25), 0.15)
    quiet = without_noise(Experiment(rig, rig.gains, (excited,), periods=2, transient_periods=20))
    noise = replace(quiet.rig.noise, displacement=4e-7)
    noisy = replace(quiet, rig=replace(quiet.rig, noise=noise), periods=200)
    current = simulate_records([replace(noisy, excitations=(replace(excited, amplitude=1e-9),), periods=5)])[0][2]
    ripple = float(np.abs(np.diff(current)).mean() * rig.control_rate)

    def change(e, **form):
        effects = ({}, effect("hysteresis", 0.3, width=0.03, **form))
        none, held = (simulate_statistics([replace(e, effects=own)]).statistics.mean[0, 0] for own in effects)
        return held - none

    expected = change(noisy)
    plain, rippled = (np.linalg.norm(change(quiet, **form) - expected) for form in ({}, {"ripple": ripple}))
    assert plain > np.linalg.norm(expected) and rippled < 0.2 * np.linalg.norm(expected)


@pytest.mark.slow
@pytest.mark.parametrize("shares", [(0.0, 0.0), (0.6, 0.0), (1.0, 1.0), (0.3, 0.4)])
def test_a_mount_that_feels_other_forces_is_what_the_equations_say(shares):
    support, outside = shares
    e, felt = ideal("hmb_radial", axis=0), effect("sensor_resonance", 300.0, coupling=0.1)
    other = effect("sensor_resonance", 300.0, coupling=0.1, support_share=support, outside_share=outside)
    turning = {**ALL_FORMS, **effect("unbalance", 1e-5, phase=0.3)}
    errors, change = worst_error_of_change(e, {**turning, **other}, {**turning, **felt}, 40, [1, 2])
    assert change > 1e-4
    assert errors[0] < 2e-5 and errors[1] < errors[0] / 3


@pytest.mark.slow
@pytest.mark.parametrize("substeps, tolerance", [(1, 1e-6), (2, 1e-7)])
def test_a_coupled_x_y_rig_with_every_smooth_effect_agrees_with_a_tight_solve_ivp(substeps, tolerance):
    rig = replace(load_rig("hmb_radial"), cross=Cross(300.0, -200.0, 1.0, -2.0, 0.3, -0.2, 0.02, -0.03))
    effects = {**TOGETHER, **effect("cross_coupling", 0.3), **effect("negative_stiffness", 0.1), **effect("mass", 0.05)}
    e = replace(ideal("hmb_radial"), effects=effects)
    e = replace(e, rig=replace(e.rig, cross=rig.cross))
    expected = np.array(simulate_effects(e, 100))
    scale = np.abs(expected).max(axis=2, keepdims=True)
    assert (np.abs(records(e, 100, substeps) - expected) < tolerance * scale).all()


@pytest.mark.slow
def test_cross_coupling_alone_needs_no_flexible_kernel():
    e = replace(ideal("hmb_radial"), effects={**effect("cross_coupling", 0.3), **effect("actuator_gain", 0.1)})
    assert structure_of(e).coupled and not structure_of(e).flexible
    expected = np.array(simulate_effects(e, 100))
    plain = records(replace(e, effects=effect("actuator_gain", 0.1)), 100)
    change = np.abs(expected - plain).max(axis=2, keepdims=True)
    assert (np.abs(records(e, 100) - expected) < 1e-5 * change).all()
    assert (change > 1e-3 * np.abs(plain).max(axis=2, keepdims=True)).all()


@pytest.mark.slow
@pytest.mark.parametrize("corner, order", [(200.0, 0.5), (2000.0, 0.8)])
def test_eddy_currents_lag_as_the_fractional_filter_at_every_line(corner, order):
    """Displacement over command with and without them is the filter alone, whatever the loop does."""
    excited = Excitation("sphs", "current", 20.0, (1, 2, 5, 10, 20, 35), 1e-3)
    e = replace(ideal(), excitations=(excited,), periods=2, transient_periods=100)  # the slowest branch takes 5 s
    found = simulate_statistics([e, replace(e, effects=effect("eddy_current", corner, order=order))]).statistics
    response = found.mean[:, 0] / found.mean[:, 1]
    expected = 1 / (1 + (1j * found.frequency / corner) ** order)
    ratio = response[1] / response[0] / expected
    # The branches stand for the filter to 0.3 % and 0.2 degrees.
    np.testing.assert_allclose(np.abs(ratio), 1.0, rtol=0, atol=3e-3)
    np.testing.assert_allclose(np.degrees(np.angle(ratio)), 0.0, rtol=0, atol=0.2)


@pytest.mark.slow
def test_tones_keep_their_phase_over_a_million_steps():
    """On a rig without a controller the reading is the motion plus the tones; two periods of transient count too."""
    rig = without_noise(Experiment(load_rig("pedestal"), NO_CONTROLLER, ())).rig
    e = Experiment(rig, NO_CONTROLLER, (Excitation("sphs", "force", 0.2, (1,), 1e-9),), 8, speed_rpm=2999.7)
    e = replace(e, transient_periods=2)
    a, q = 1e-6, 0.4
    effects = {
        **effect("runout", a, harmonics=q, phase=0.7),
        **effect("pickup", a, frequency=49.987, harmonics=q, phase=-1.1),
    }
    plain, found = (simulate_records([replace(e, effects=x)])[0, 0] for x in ({}, effects))
    t = np.arange(len(plain)) / rig.control_rate
    expected = 0.0
    for turn, phase in ((2 * np.pi * 2999.7 / 60, 0.7), (2 * np.pi * 49.987, -1.1)):
        expected = expected + sum(q ** (n - 1) * np.cos(n * (turn * t + phase)) for n in (1, 2, 3))
    assert len(t) >= 1_000_000
    np.testing.assert_allclose((found - plain) / a, expected, rtol=0, atol=1e-8)


def test_lanes_of_unlike_effects_share_one_kernel_and_keep_their_bits():
    e = ideal()
    every = [replace(e, effects={**NEUTRAL, **x}) for x in (*SMOOTH.values(), *(s[0] for s in SHARP.values())) if
             "saturation" not in x]  # fmt: skip
    assert len({structure_of(x) for x in every}) == 1
    some = [*every[:3], replace(every[3], effects={**every[3].effects, **LAGS}), *every[4:]]
    together = simulate_records(some, threads=2)
    for i in (2, 3, 11):
        assert np.array_equal(simulate_records([some[i]], threads=1)[0], together[i], equal_nan=True)


@pytest.mark.slow
def test_self_sensing_with_neutral_effects_is_self_sensing_without():
    e = replace(ideal(), sensor="self_sensing")
    neutral = {k: v for k, v in NEUTRAL.items() if k not in ("sensor_resonance", "runout", "pickup")}
    plain, found = (records(replace(e, effects=x), 2000) for x in ({}, neutral))
    assert np.abs(found - plain).max() <= 1e-9 * np.abs(plain).max()


@pytest.mark.slow
def test_self_sensing_reads_the_gap_about_the_magnets_centre():
    """The coil sees the gap between itself and the rotor: an eccentric magnet is not seen as a displacement of it."""
    e = replace(ideal(), sensor="self_sensing", effects=effect("eccentricity", 2e-5))
    found = simulate_records([e])[0]
    off = found[0, 4000:] - found[2, 4000:]  # reading less position
    plain = simulate_records([replace(e, effects={})])[0]
    assert np.mean(off) - np.mean(plain[0, 4000:] - plain[2, 4000:]) == pytest.approx(2e-5, rel=0.05)


@pytest.mark.parametrize("name", ("sensor_gain", "sensor_lag", "sensor_resonance", "runout", "pickup"))
def test_effects_of_the_probe_are_refused_with_self_sensing(name):
    value = 100.0 if name == "sensor_resonance" else 1e-6
    with pytest.raises(ValueError, match=f"effect {name} is the probe's"):
        replace(ideal(), sensor="self_sensing", effects=effect(name, value))


@pytest.mark.slow
def test_an_eccentric_rotor_touches_down_before_it_meets_a_pole():
    far = replace(ideal(), effects=effect("eccentricity", 0.999e-3))
    found = simulate_statistics([replace(far, periods=2)])
    assert found.touchdown_time[0] < 1e-3


@pytest.mark.parametrize(("eccentricity", "meets"), [(0.235e-3, True), (0.15e-3, False)])
def test_poles_that_are_nearer_are_met_earlier(eccentricity, meets):
    """A pull that grows by half because the magnets are nearer: two thirds of the gap of 0.35 mm are left."""
    nearer = effect("negative_stiffness", change=0.5, distance_share=1.0) | effect("eccentricity", eccentricity)
    found = simulate_statistics([replace(ideal(), effects=nearer, periods=2)])
    assert (found.touchdown_time[0] < 2e-4) == meets
