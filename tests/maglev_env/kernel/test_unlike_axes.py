"""Corners where two axes differ, rates and touchdowns meet, or masses change: what must hold there too."""

from dataclasses import replace

import numpy as np
import pytest
from controller_cases import BALL, pushed
from planar_loops import check_every_line, small
from planar_rigs import COUPLED, FREE, UNLIKE, axes_of, oblique
from reference_simulator import simulate

from maglev_env.experiment import Experiment, axis_experiment, without_noise
from maglev_env.kernel.simulate import simulate_records
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Noise
from maglev_env.rig.rig_file import load_rig

BARE = replace(load_rig("hmb_free"), axes=2, protocol=None)


def error(e, samples=400):
    slow = np.array(simulate(e, samples)).reshape(3, e.rig.axes, -1)
    fast = simulate_records([e])[0].reshape(4, e.rig.axes, -1)[:3, :, : slow.shape[-1]]
    return np.sqrt(np.mean((fast - slow) ** 2, axis=-1) / np.mean(slow**2, axis=-1)).max()


def test_smaller_gap_in_y():
    rig = replace(BARE, per_axis={"y": {"gap": 0.2e-3}})
    push = Excitation("sphs", "force", 50.0, (1, 3, 5), 0.5, direction=90.0)
    e = without_noise(Experiment(rig, (BARE.gains, Gains(500.0, 0.0, 0.2)), (push,), periods=3))
    y = axes_of(simulate_records([e])[0])[0, 1]
    assert np.nanmax(np.abs(y)) < 0.2e-3


@pytest.mark.parametrize("every", [2, 4])
def test_slower_record_with_a_touchdown(every):
    rig = replace(load_rig("hmb_free"), clearance=0.3e-3, protocol=None)
    x = (
        Excitation("sphs", "force", 50.0, tuple(range(1, 20, 2)), 1.0),
        Excitation("sphs", "current", 50.0, (2, 6, 10, 20, 40), 0.1),
    )
    e = without_noise(Experiment(rig, Gains(500.0, 0.0, 0.2), x, periods=3))
    full, slow = (simulate_records([replace(e, sample_rate=r)])[0] for r in (20e3, 20e3 / every))
    np.testing.assert_array_equal(slow, full[:, ::every])


@pytest.mark.parametrize("rate", [0, 0.0, float("inf")])
def test_sample_rate(rate):
    with pytest.raises(ValueError, match="sample_rate"):
        replace(oblique(FREE), sample_rate=rate)


@pytest.mark.parametrize(
    "per_axis",
    [
        {"z": {"mass": 1.0}},
        {"y": {"masss": 1.0}},
        {"y": {"mass": -1.0}},
        {"y": {"control_rate": 1e4}},
        {"y": {"clearance": 1e-4}},
    ],
    ids=str,
)
def test_per_axis_is_checked_without_a_toml_too(per_axis):
    with pytest.raises(ValueError):
        replace(BARE, per_axis=per_axis)


@pytest.mark.parametrize("count", [1, 3])
def test_one_controller_or_two(count):
    with pytest.raises(ValueError):
        replace(oblique(FREE), gains=(FREE.gains,) * count)


def test_cross_gain_at_2_khz():
    check_every_line(small(COUPLED, lines=(2, 6, 10, 20, 40)))  # 9.5e-5 at 2 kHz; with gain_xy = 0 below 3e-6


@pytest.mark.parametrize("own", [{"probe_gain": 2000.0}, {"probe_gain": 16000.0}], ids=str)
def test_expected_covariance_with_the_converter_of_y(own):
    rig = replace(FREE, per_axis={"y": own}, adc_bits=12, dac_bits=0, noise=Noise(1e-6))
    e = Experiment(rig, FREE.gains, (Excitation("sphs", "force", 2.0, (1,), 1e-3, direction=30.0),))
    both = expected_statistics(e, np.arange(10, 90)).covariance
    alone = expected_statistics(axis_experiment(e, 1), np.arange(10, 90)).covariance
    np.testing.assert_allclose(both[1, 1].real, alone[0, 0].real, rtol=1e-9)


def test_weight_of_a_heavier_rotor_below_a_calibrated_magnet():
    gain, stiffness = linearise(force_law(BALL))
    e = pushed(replace(BALL, actuator_gain=gain, negative_stiffness=0.6 * stiffness), 0.05)
    assert error(replace(e, effects=effect("mass", 0.05))) < 1e-5  # 0.4: only 60 % of the extra weight acts


def test_axis_experiment_keeps_the_sign():
    e = oblique(UNLIKE)
    for axis in (0, 1):
        for at in ("force", "current", "reference"):
            np.testing.assert_allclose(
                axis_experiment(e, axis).waveform(at), e.waveform(at)[axis], rtol=1e-9, atol=1e-15
            )


def test_seeds_of_axes_are_not_those_of_other_experiments():
    e = replace(oblique(FREE), seed=3)
    other = replace(e, seed=(3, 1))
    y, x = axis_experiment(e, 1).seed, axis_experiment(other, 0).seed  # (3, 1) and (3, 1, 0)
    assert y != x
    a, b = (np.random.SeedSequence(s).generate_state(3, np.uint64) for s in (y, x))
    assert (a != b).any()


def test_a_finer_record_with_noise_is_the_same_experiment():
    e = replace(oblique(FREE), seed=4)
    np.testing.assert_array_equal(
        simulate_records([replace(e, sample_rate=100e3)])[0][:4, ::5], simulate_records([e], substeps=5)[0][:4]
    )


@pytest.mark.parametrize(
    "own", [{"flux_path": "magnet"}, {"adc_bits": 10}, {"dac_bits": 0}, {"clearance": 1e-4}], ids=str
)
def test_what_belongs_to_the_whole_rig_is_refused_for_one_axis(own):
    with pytest.raises(ValueError, match=rf"\[axis.y\]: unknown key '{next(iter(own))}'"):
        replace(BARE, per_axis={"y": own})


def test_axes_whose_magnets_and_probes_differ_move_as_rigs_of_one_axis_each():
    """Without a coupling each axis is a rig of its own, whose gain, stiffness and probe are off by half the difference
    more than both are."""
    apart = {"actuator_gain": 0.06, "negative_stiffness": -0.08, "sensor_gain": 0.02}
    push = Excitation("sphs", "force", 50.0, (1, 3, 5), 0.05, direction=30.0)
    both = effect("actuator_gain", -0.03)
    e = without_noise(Experiment(BARE, BARE.gains, (push,), periods=2, effects=both, apart=apart))
    found = axes_of(simulate_records([e])[0])
    for axis in range(2):
        own = axis_experiment(replace(e, apart={}), axis)
        off = {name: (axis - 0.5) * more for name, more in apart.items()}
        off["actuator_gain"] = 0.97 * (1 + off["actuator_gain"]) - 1
        effects = {name: {"change": change} for name, change in off.items()}
        alone = simulate_records([replace(own, effects=effects)])[0]
        np.testing.assert_allclose(found[:, axis], alone, rtol=1e-9, atol=1e-15)
        assert not np.allclose(found[:, axis], simulate_records([own])[0], rtol=1e-3)
    unlike, alike = (closed_loop_poles(one) for one in (e, replace(e, apart={})))
    parts = [closed_loop_poles(axis_experiment(e, axis)) for axis in range(2)]
    np.testing.assert_allclose(np.sort(abs(unlike)), np.sort(abs(np.concatenate(parts))), rtol=1e-9, atol=1e-12)
    assert not np.allclose(np.sort(abs(unlike)), np.sort(abs(alike)), rtol=1e-4)


def test_an_axis_differs_no_more_than_its_effect_can():
    e = Experiment(BARE, BARE.gains, (), effects=effect("actuator_gain", -0.5), apart={"actuator_gain": 3.0})
    assert [axis_experiment(e, axis).effects["actuator_gain"]["change"] for axis in range(2)] == [-0.9, 0.25]


@pytest.mark.parametrize("apart", [{"mas": 0.1}, {"delay": 0.1}, {"mass": "x"}])
def test_what_cannot_differ_between_axes_is_refused(apart):
    with pytest.raises(ValueError, match="of a rig with two axes, give by which share one of"):
        Experiment(BARE, BARE.gains, (), apart=apart)
    with pytest.raises(ValueError, match="of a rig with two axes"):
        Experiment(load_rig("hmb_free"), BARE.gains, (), apart={"mass": 0.1})
