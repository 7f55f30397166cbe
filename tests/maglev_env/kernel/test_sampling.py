"""Recordings above and below the control rate, against the slow simulator and against each other."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from planar_rigs import COUPLED, EVERY_EFFECT, GAINS
from reference_simulator import simulate as simulate_slowly

from maglev_env.experiment import Experiment, sampling, without_noise
from maglev_env.kernel import state
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.recordings.recording import simulated_recording
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Noise
from maglev_env.rig.rig_file import load_rig

FREE = replace(load_rig("hmb_free"), protocol=None)


def oblique(rig=FREE, gains=None, **changes):
    """20 ms periods of force and injection; oblique on an x-y rig."""
    direction = (30.0, -50.0) if rig.axes == 2 else (0.0, 0.0)
    excitations = (
        Excitation("sphs", "force", 50.0, tuple(range(1, 20, 2)), 1.0, direction=direction[0]),
        Excitation("sphs", "current", 50.0, (2, 6, 10, 20, 40), 0.1, direction=direction[1]),
    )
    gains = gains or (GAINS if rig.axes == 2 else rig.gains)
    return replace(Experiment(rig, gains, excitations, periods=2, transient_periods=1), **changes)


def record(e, **options):
    return simulate_records([e], **options)[0]


@pytest.mark.parametrize("rig", [FREE, COUPLED], ids=["one axis", "x-y"])
def test_every_fifth_sample_of_five_per_control_sample_is_the_record_at_the_control_rate(rig):
    e = without_noise(oblique(rig))
    fine = record(replace(e, sample_rate=100e3))
    assert fine.shape == (4 * rig.axes, 3 * 2000)
    # Bit for bit with as many integration steps; with one step per sample there is its error between them.
    np.testing.assert_array_equal(fine[:, ::5], record(e, substeps=5))
    coarse = record(e)
    assert (np.abs(fine[:, ::5] - coarse).max(axis=1) < 1e-6 * np.abs(coarse).max(axis=1)).all()


def test_commands_and_forces_are_held_between_control_samples():
    fine = record(without_noise(oblique(COUPLED, sample_rate=100e3)))
    held = fine.reshape(4, 2, -1, 5)
    for channel in (1, 3):
        np.testing.assert_array_equal(held[channel], np.repeat(held[channel, ..., :1], 5, axis=-1))
    assert (np.diff(held[0], axis=-1) != 0).mean() > 0.99


NO_LAGS = replace(FREE, amplifier_time_constant=0.0, sensor_time_constant=0.0)
BETWEEN = {
    "one axis": (oblique(), 1e-8),
    "x-y, every effect": (oblique(COUPLED, effects=EVERY_EFFECT), 1e-8),
    # The current itself jumps, between two samples.
    "no lags, a late command": (oblique(NO_LAGS, effects=effect("delay", 33e-6)), 1e-6),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BETWEEN)
def test_samples_between_control_samples_are_those_of_a_tight_solve_ivp(case):
    e, tolerance = BETWEEN[case]
    e = without_noise(e)
    slow = simulate_slowly(e, 300, between=5)
    fast = record(replace(e, sample_rate=100e3)).reshape(4, e.rig.axes, -1)[..., :1500]
    for expected, got, name in zip(slow, fast, ("displacement", "command", "current"), strict=False):
        assert expected.shape[-1] == 1500
        error, rms = (np.sqrt(np.mean(x**2, axis=-1)) for x in (got - expected, np.atleast_2d(expected)))
        assert (error <= tolerance * rms).all(), name


@pytest.mark.parametrize("rig", [FREE, COUPLED], ids=["one axis", "x-y"])
@pytest.mark.parametrize("every", [2, 4])
def test_a_slower_record_is_every_nth_sample(rig, every):
    e = without_noise(oblique(rig))
    slow = record(replace(e, sample_rate=20e3 / every))
    np.testing.assert_array_equal(slow, record(e)[:, ::every])
    assert slow.shape[1] == 3 * 400 // every


def test_noise_in_the_loop_is_drawn_alike_below_the_control_rate():
    """The readings are the same; the noise of current and force readings is that of the samples recorded."""
    e = oblique(seed=4)
    slow, full = record(replace(e, sample_rate=5e3)), record(e)
    np.testing.assert_array_equal(slow[:2], full[:2, ::4])
    assert (slow[2:] != full[2:, ::4]).all(axis=1).any()


def test_every_sample_recorded_has_its_own_noise():
    noise = Noise(1e-5, 0.1, 0.01)
    rig = replace(load_rig("pedestal"), noise=noise, adc_bits=0, dac_bits=0, protocol=None)
    still = Excitation("sphs", "force", 50.0, (1,), 1e-12)
    for rate in (100e3, 20e3, 5e3):
        e = Experiment(rig, Gains(0.0, 0.0, 0.0), (still,), periods=40, sample_rate=rate)
        z = record(e)[[0, 2, 3]] / np.array([[1e-5], [0.01], [0.1]])
        n = z.shape[1]
        assert (np.abs(z.var(axis=1) - 1) < 4 * np.sqrt(2 / n)).all()
        assert (np.abs((z[:, 1:] * z[:, :-1]).mean(axis=1)) < 4.5 / np.sqrt(n)).all()


def test_a_finer_record_of_a_noisy_loop_is_another_draw_of_the_same_noise():
    e = oblique(seed=4, periods=20)
    fine, full = record(replace(e, sample_rate=100e3)), record(e)
    assert (fine[0, ::5] != full[0]).any()
    quiet = record(without_noise(e))[0]
    assert (fine[0, ::5] - quiet).std() == pytest.approx((full[0] - quiet).std(), rel=0.1)


@pytest.mark.parametrize("rate", [40e3, 5e3])
def test_the_record_ends_where_the_rotor_touches_down(rate):
    rig = replace(FREE, clearance=0.3e-3)
    e = without_noise(oblique(rig, Gains(500.0, 0.0, 0.2)))
    fine = record(replace(e, sample_rate=40e3))
    end = np.isfinite(fine[0]).sum()
    assert 0 < end < fine.shape[1] and np.isnan(fine[:, end:]).all()
    assert 0.25e-3 < np.abs(fine[0, end - 1]) < 0.3e-3
    got = record(replace(e, sample_rate=rate))
    finite = np.isfinite(got[0])
    assert abs(finite.sum() - end * rate / 40e3) <= 1 and not finite[finite.sum() :].any()


def test_a_touchdown_in_x_and_y_raises_no_warning(monkeypatch):
    def dirty(shape):
        array = aligned(shape)
        array.view(np.uint64)[...] = 0x7FF0000000000001  # signalling: every sum with it is an invalid operation
        return array

    aligned = state.aligned
    monkeypatch.setattr(state, "aligned", dirty)
    rig = replace(COUPLED, clearance=0.2e-3, noise=Noise(1e-6, 0.1, 0.01))
    e = oblique(rig, Gains(500.0, 0.0, 0.2), transient_periods=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        z = record(e)
        found = simulate_statistics([e])
    end = np.isfinite(z[0]).sum()
    assert 0 < end < e.samples_per_period and (np.isfinite(z) == (np.arange(z.shape[1]) < end)).all()
    assert (np.abs(np.diff(z[4:, :end])) > 0).mean() > 0.99  # with the noise of current and force up to it
    assert np.isfinite(found.touchdown_time).all() and np.isnan(found.statistics.mean).all()


def test_statistics_are_those_of_the_control_rate():
    e = oblique()
    plain, asked = simulate_statistics([e]), simulate_statistics([replace(e, sample_rate=5e3)])
    np.testing.assert_array_equal(plain.statistics.mean, asked.statistics.mean)


@pytest.mark.parametrize(
    ("rate", "pair"), [(20e3, (1, 1)), (100e3, (5, 1)), (40e3, (2, 1)), (5e3, (1, 4)), (20e3 / 3, (1, 3))]
)
def test_the_ratio_of_the_rates(rate, pair):
    assert sampling(rate, 20e3) == pair
    assert oblique(sample_rate=rate).recorded_rate == rate


@pytest.mark.parametrize("rate", [30e3, 50e3, 15e3, 20e3 * (1 + 1e-6)])
def test_rates_that_are_in_no_whole_ratio_are_refused(rate):
    with pytest.raises(ValueError, match=r"neither a multiple nor an integer fraction of control_rate = 20000 Hz"):
        oblique(sample_rate=rate)


def test_a_period_must_be_whole_samples_of_the_record():
    e = oblique(sample_rate=20e3 / 3)
    with pytest.raises(ValueError, match="whole number"):
        record(e)
    with pytest.raises(ValueError, match=r"share excitations.*rates"):
        simulate_records([oblique(), oblique(sample_rate=100e3)])


@pytest.mark.parametrize("rig", [FREE, COUPLED], ids=["one axis", "x-y"])
@pytest.mark.parametrize("rate", [100e3, 10e3])
def test_a_recording_carries_its_rate_and_the_held_injection(rig, rate):
    e = oblique(rig, sample_rate=rate)
    made = record(e)
    dataset = simulated_recording(e, made)
    assert dataset.attrs["sample_rate"] == rate and dataset.sizes["time"] == 3 * rate / 50
    np.testing.assert_allclose(dataset["time"].values, np.arange(3 * rate / 50) / rate, rtol=1e-12)
    # The command is the controller's and the injection's, both held: what is injected at a control sample lasts it.
    wave = np.atleast_2d(e.waveform("current"))
    for axis, suffix in enumerate(("_x", "_y") if rig.axes == 2 else ("",)):
        np.testing.assert_array_equal(dataset[f"displacement{suffix}"].values, made[axis])
        at = np.floor(np.arange(made.shape[1]) * 20e3 / rate + 1e-9).astype(int) % 400
        np.testing.assert_array_equal(dataset[f"injection{suffix}"].values, wave[axis][at])
