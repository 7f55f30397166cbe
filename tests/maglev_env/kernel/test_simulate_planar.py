"""The lane kernel in x and y: against a slow simulator, against one axis at a time, and against itself."""

from dataclasses import fields, replace

import numpy as np
import pytest
from planar_rigs import COUPLED, CROSS, EVERY_EFFECT, FREE, GAINS, OTHER_Y, UNLIKE, axes_of, oblique
from reference_simulator import simulate

from maglev_env.experiment import Experiment, axis_experiment, channels_of, without_noise
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES


def check_against_the_slow_simulator(e, samples, tolerance):
    e = without_noise(e)
    slow = simulate(e, samples)
    assert slow[0].shape == (2, samples)
    fast = axes_of(simulate_records([e])[0])[..., :samples]
    for expected, got, name in zip(slow, fast, ("displacement", "command", "current"), strict=False):
        error = np.sqrt(np.mean((got - expected) ** 2, axis=1))
        assert (error <= tolerance * np.sqrt(np.mean(expected**2, axis=1))).all(), name
    return slow


@pytest.mark.slow
@pytest.mark.parametrize("share", [f.name for f in fields(Cross)])
def test_each_cross_term_alone_is_what_the_equations_say(share):
    e = oblique(replace(UNLIKE, cross=Cross(**{share: getattr(CROSS, share)})))
    with_term = check_against_the_slow_simulator(e, 200, 1e-6)
    without = simulate(without_noise(replace(e, rig=UNLIKE)), 200)
    # It acts on its own axis far above the tolerance; what the other axis gets back is nothing.
    axis = 0 if share.endswith("xy") else 1
    change = np.abs(with_term[0] - without[0]).max(axis=1) / np.abs(without[0]).max(axis=1)
    assert change[axis] > 1e-3 and change[1 - axis] < 1e-9, change


@pytest.mark.slow
def test_a_coupled_rig_of_unlike_axes_agrees_with_a_tight_solve_ivp():
    check_against_the_slow_simulator(oblique(COUPLED, offset=1e-5), 800, 5e-7)


@pytest.mark.slow
def test_large_motion_agrees_with_a_tight_solve_ivp():
    displacement, _, _ = check_against_the_slow_simulator(oblique(COUPLED, 8.0), 800, 5e-7)
    assert np.hypot(*displacement).max() > 0.3 * FREE.gap


@pytest.mark.slow
def test_every_effect_in_both_axes_agrees_with_a_tight_solve_ivp():
    check_against_the_slow_simulator(oblique(COUPLED, effects=EVERY_EFFECT), 800, 5e-7)


@pytest.mark.slow
def test_delayed_commands_without_lags_agree_with_a_tight_solve_ivp():
    quick = {"amplifier_time_constant": 0.0, "sensor_time_constant": 0.0}
    rig = replace(COUPLED, **quick, per_axis={"y": OTHER_Y | quick})
    # The command jumps inside a step: the least smooth motion there is.
    check_against_the_slow_simulator(oblique(rig, effects=effect("delay", 61.7e-6)), 800, 2e-6)


@pytest.mark.slow
def test_a_rig_without_magnets_agrees_with_a_tight_solve_ivp():
    rig = replace(
        load_rig("pedestal"), axes=2, protocol=None, per_axis={"y": {"support_stiffness": 120e3, "mass": 0.9}}
    )
    cross = Cross(stiffness_xy=2e4, stiffness_yx=-1e4, damping_xy=30.0, damping_yx=-40.0, sensor_xy=0.1)
    slow = simulate(oblique(replace(rig, cross=cross)), 800)
    fast = axes_of(simulate_records([without_noise(oblique(replace(rig, cross=cross)))])[0])
    error = np.sqrt(np.mean((fast[0] - slow[0]) ** 2, axis=1))
    assert (error <= 5e-7 * np.sqrt(np.mean(slow[0] ** 2, axis=1))).all()
    assert not fast[1:3].any()


def test_two_halves_of_a_step_are_sixteen_times_as_exact():
    e = without_noise(oblique(COUPLED, 4.0))
    runs = {n: axes_of(simulate_records([e], substeps=n)[0])[0] for n in (1, 2, 8)}
    coarse, fine = (np.abs(runs[n] - runs[8]).max(axis=1) for n in (1, 2))
    assert (coarse > 12 * fine).all() and (coarse < 20 * fine).all()


def test_a_record_holds_channel_after_channel_with_x_before_y():
    e = without_noise(oblique(UNLIKE))
    names = channels_of(UNLIKE)
    assert names[:4] == ("displacement_x", "displacement_y", "command_x", "command_y") and len(names) == 8
    record = simulate_records([e])[0]
    (force,) = (x for x in e.excitations if x.at == "force")
    wave = np.tile(force.waveform(20000.0), 2)
    np.testing.assert_allclose(record[names.index("force_x")], wave * np.cos(np.pi / 6), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record[names.index("force_y")], wave * np.sin(np.pi / 6), rtol=1e-12, atol=1e-15)


def along_the_axes(rig, axis=None):
    """Force and current in x and in y on interleaved lines, with noise and converters; or one axis of it."""
    kinds = (("force", (1, 5, 9), 0.5, 0.0), ("force", (3, 7, 11), 1.0, 90.0))
    kinds += (("current", (2, 6, 20), 0.1, 90.0), ("current", (4, 8, 40), 0.07, 0.0))
    excitations = tuple(Excitation("sphs", at, 50.0, lines, peak, direction=d) for at, lines, peak, d in kinds)
    whole = Experiment(rig, GAINS, excitations, periods=4, offset=1e-5, seed=(3, 4))
    if axis is None:
        return whole
    own = tuple(replace(x, direction=0.0) for x in excitations if x.direction == 90.0 * axis)
    return replace(axis_experiment(whole, axis), excitations=own, offset=0.0 if axis else 1e-5)


@pytest.mark.slow
def test_without_coupling_each_axis_has_the_bits_of_a_rig_of_one_axis():
    e = along_the_axes(UNLIKE)
    record, together = axes_of(simulate_records([e])[0]), simulate_statistics([e])
    alone = [simulate_statistics([along_the_axes(UNLIKE, axis)]) for axis in (0, 1)]
    for axis in (0, 1):
        own = along_the_axes(UNLIKE, axis)
        np.testing.assert_array_equal(record[:, axis], simulate_records([own])[0])
        lines = lines_at(own.excitations)
        both = together.statistics.at_lines(lines)
        mean, covariance = both.mean[0].reshape(4, 2, -1), both.covariance[0].reshape(4, 2, 4, 2, -1)
        np.testing.assert_array_equal(mean[:, axis], alone[axis].statistics.mean[0])
        np.testing.assert_array_equal(covariance[:, axis, :, axis], alone[axis].statistics.covariance[0])
    assert together.current_rms == alone[1].current_rms > alone[0].current_rms
    kept = record[0, :, e.samples_per_period :]
    assert together.peak_displacement == pytest.approx(np.hypot(*kept).max(), rel=1e-14)
    # The two axes' noise is not the same noise.
    still = simulate_records([replace(e, excitations=tuple(replace(x, amplitude=1e-12) for x in e.excitations))])[0]
    assert abs(np.corrcoef(axes_of(still)[3])[0, 1]) < 0.1


def test_an_oblique_excitation_acts_on_each_axis_by_its_component():
    places = (("force", (1, 3, 5), 3.0, 30.0), ("current", (2, 6, 20), 0.1, 70.0), ("reference", (4, 8), 2e-6, 10.0))
    excitations = tuple(Excitation("sphs", at, 50.0, lines, peak, direction=d) for at, lines, peak, d in places)
    e = without_noise(Experiment(UNLIKE, GAINS, excitations, periods=2))
    record = axes_of(simulate_records([e])[0])
    for axis, share in enumerate((np.cos, np.sin)):
        own = tuple(
            replace(x, amplitude=float(x.amplitude * share(np.deg2rad(x.direction))), direction=0.0)
            for x in excitations
        )
        alone = simulate_records([replace(axis_experiment(e, axis), excitations=own)])[0]
        np.testing.assert_allclose(record[:, axis], alone, rtol=0, atol=1e-12 * np.abs(alone).max())
    turned = replace(e, excitations=tuple(replace(x, direction=x.direction + 180) for x in excitations))
    # A pair of magnets pulls as much one way as the other.
    np.testing.assert_allclose(axes_of(simulate_records([turned])[0]), -record, rtol=0, atol=1e-12)


def cold(seed, coupled, **changes):
    rig = replace(UNLIKE, cross=CROSS) if coupled else UNLIKE
    gains = (Gains(8000.0 + 50 * seed, 2000.0, 5.2), GAINS[1])
    return replace(along_the_axes(rig), gains=gains, seed=seed, **changes)


@pytest.mark.slow
def test_a_lane_has_the_same_bits_alone_among_others_in_any_order_and_on_any_number_of_threads():
    batch = [cold(i, coupled=i % 3 > 0) for i in range(2 * LANES + 3)]
    together = simulate_statistics(batch, threads=2)
    serial, reverse = simulate_statistics(batch, threads=1), simulate_statistics(batch[::-1], threads=2)
    for name in ("mean", "covariance"):
        found = getattr(together.statistics, name)
        assert np.isfinite(found).all()
        np.testing.assert_array_equal(found, getattr(serial.statistics, name))
        np.testing.assert_array_equal(found, getattr(reverse.statistics, name)[::-1])
        for i in (0, 1, LANES + 1, len(batch) - 1):
            np.testing.assert_array_equal(getattr(simulate_statistics([batch[i]]).statistics, name)[0], found[i])
    np.testing.assert_array_equal(together.peak_displacement, reverse.peak_displacement[::-1])
    np.testing.assert_array_equal(together.current_rms, serial.current_rms)


def leaving(rig, direction):
    """A weakly held rotor pushed away in a direction."""
    force = Excitation("sphs", "force", 50.0, (1, 3, 5), 0.5, direction=direction)
    weak = Gains(500.0, 0.0, 0.2)
    return without_noise(Experiment(rig, weak, (force,), periods=4, transient_periods=0))


@pytest.mark.slow
@pytest.mark.parametrize("direction", [0.0, 45.0, 200.0])
def test_the_rotor_touches_down_when_its_radius_reaches_the_clearance(direction):
    # Well before the poles, where no integrator gets through.
    cross = Cross(sensor_xy=0.05)
    rig = replace(FREE, clearance=0.3e-3, cross=cross, sensor_time_constant=1e-6, probe_gain=1000.0)
    e = leaving(rig, direction)
    displacement, _, _ = simulate(e, 1600)
    samples = displacement.shape[1]
    assert 50 < samples < 1600
    record = axes_of(simulate_records([e])[0])[0]
    time = simulate_statistics([e]).touchdown_time[0]
    # The last instant inside is one step before the reference finds the rotor outside.
    assert time * 20000 == pytest.approx(samples - 1, abs=1e-6)
    assert np.isfinite(record[:, : samples - 1]).all() and np.isnan(record[:, samples - 1 :]).all()
    x, y = record[:, : samples - 1]
    radius = np.hypot(x - 0.05 * y, y)  # the readings, unmixed
    assert radius[-1] < rig.clearance < radius[-1] + 2 * np.diff(radius[-2:])[0]
    if direction == 45.0:
        assert np.abs(displacement).max() < 0.75 * rig.clearance
