"""The lane kernel against a slow simulator on scipy's integrators, the analytic loop, and itself."""

from dataclasses import replace

import numpy as np
import pytest
from reference_simulator import simulate

from estimation.bands import sliding_bands
from estimation.lines.periods import line_statistics, period_spectra
from estimation.max_likelihood import maximum_likelihood
from maglev_env.channels import MEASURED
from maglev_env.evaluation.known_chain import force_statistics
from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.expected import expected_statistics
from maglev_env.loop.effect import effect, meaningful
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig import Noise, axis_rig
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES
from maglev_lanes.noise import line_noise, series_noise
from maglev_lanes.period_statistics import as_complex

ALL_EFFECTS = {
    **effect("delay", 61.7e-6),
    **effect("amplifier_lag", 3e-5),
    **effect("sensor_lag", 2e-5),
    **effect("actuator_gain", 0.1),
    **effect("negative_stiffness", -0.1),
    **effect("mass", 0.1),
    **effect("sensor_gain", 0.05),
    **effect("damping", 2.0),
    **effect("support_stiffness", 0.1),
}


def quick(rig_name="hmb_free", fundamental=20.0, **changes):
    """A short experiment: 50 ms periods, force and injection lines interleaved."""
    rig = load_rig(rig_name)
    excitations = (
        Excitation("sphs", "force", fundamental, tuple(range(1, 24, 2)), 1.0),
        Excitation("sphs", "current", fundamental, (2, 6, 10, 20, 40, 60, 80, 100), 0.1),
    )
    e = Experiment(rig, rig.gains, excitations if rig.controlled else excitations[:1], periods=4)
    return replace(e, **changes)


def scaled(e, factor):
    return replace(e, excitations=tuple(replace(x, amplitude=x.amplitude * factor) for x in e.excitations))


def with_all(e):
    """Every effect that is a plain parameter and has a meaning on the rig."""
    return replace(e, effects={name: v for name, v in ALL_EFFECTS.items() if meaningful(name, e.rig.capabilities)})


def ideal(e):
    return replace(without_noise(e), periods=1, transient_periods=0)


CASES = {
    "nominal": lambda: ideal(protocol_experiment(load_rig("hmb_free"))),
    "large motion": lambda: scaled(ideal(protocol_experiment(load_rig("hmb_free"))), 3.0),
    "flux through the magnet": lambda: (lambda e: replace(e, rig=replace(e.rig, flux_path="magnet")))(
        ideal(protocol_experiment(load_rig("hmb_free")))
    ),
    "every effect": lambda: with_all(ideal(protocol_experiment(load_rig("hmb_free")))),
    "no lags, half a sample late": lambda: (
        lambda e: replace(
            e,
            rig=replace(e.rig, amplifier_time_constant=0.0, sensor_time_constant=0.0),
            effects=effect("delay", 25e-6),
        )
    )(ideal(protocol_experiment(load_rig("hmb_free")))),
    "on springs": lambda: ideal(protocol_experiment(axis_rig(load_rig("hmb_radial"), 0))),
    "no magnets": lambda: ideal(protocol_experiment(load_rig("pedestal"))),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_agrees_with_a_tight_solve_ivp_over_a_fifth_of_a_second(case):
    e, samples = CASES[case](), 4000
    displacement, command, current = simulate(e, samples)
    record = simulate_records([e])[0][:, :samples]
    for name, expected in (("displacement", displacement), ("command", command), ("current", current)):
        got = record[MEASURED.index(name)]
        rms = np.sqrt(np.mean(expected**2))
        # Required 5e-6; a timing slip of 1 ns would already show as 1e-6.
        assert np.sqrt(np.mean((got - expected) ** 2)) <= 5e-7 * rms, name


def test_integration_error_falls_with_the_fourth_power_of_the_step():
    e = ideal(protocol_experiment(load_rig("hmb_free")))
    runs = {n: simulate_records([e], substeps=n)[0][0, :4000] for n in (1, 2, 16)}
    coarse, fine = (np.abs(runs[n] - runs[16]).max() for n in (1, 2))
    assert 12 < coarse / fine < 20


@pytest.mark.parametrize("rig_name", ["hmb_free", "hmb_radial", "pedestal", "hmb_axial"])
@pytest.mark.parametrize("effects", [False, True], ids=["nominal", "every effect"])
def test_a_small_experiment_is_the_analytic_sampled_loop_at_every_line(rig_name, effects):
    e = without_noise(protocol_experiment(axis_rig(load_rig(rig_name), 0)))
    e = replace(scaled(e, 1e-3), transient_periods=3, periods=2)
    e = with_all(e) if effects else e
    got = simulate_statistics([e]).statistics
    expected = expected_statistics(e, got.lines)
    for channel in ("displacement", "command") if e.rig.controlled else ("displacement",):
        error = np.abs(got.amplitude(channel)[0] - expected.amplitude(channel))
        assert (error <= 1e-5 * np.abs(expected.amplitude(channel))).all(), channel


def test_half_the_step_moves_no_estimate_by_a_fiftieth_of_its_standard_error():
    noisy = protocol_experiment(load_rig("hmb_free"))
    noise = simulate_statistics([noisy]).statistics
    bands = sliding_bands(force_statistics(noise, noisy).frequency, 15.0, 12.0)
    estimates = []
    for substeps in (1, 2):
        s = simulate_statistics([without_noise(noisy)], substeps=substeps).statistics
        force = force_statistics(replace(s, covariance=noise.covariance), noisy)
        estimates.append(maximum_likelihood(force, bands, noisy.rig.mass, intervals=False))
    one, two = estimates
    assert (np.abs(one.stiffness - two.stiffness) < 0.02 * one.stiffness_se).all()
    assert (np.abs(one.damping - two.damping) < 0.02 * one.damping_se).all()


def test_a_lane_has_the_same_bits_alone_among_others_and_on_any_number_of_threads():
    gains = [Gains(8000 + 100 * i, 2000, 5.2) for i in range(2 * LANES + 5)]
    batch = [quick(gains=g, seed=i, effects=effect("delay", 3e-5) if i % 3 == 0 else {}) for i, g in enumerate(gains)]
    together = simulate_statistics(batch, threads=2)
    serial = simulate_statistics(batch, threads=1)
    np.testing.assert_array_equal(together.statistics.mean, serial.statistics.mean)
    for i in (0, 1, LANES, len(batch) - 1):
        alone = simulate_statistics([batch[i]])
        np.testing.assert_array_equal(alone.statistics.mean[0], together.statistics.mean[i])
        np.testing.assert_array_equal(alone.statistics.covariance[0], together.statistics.covariance[i])
        assert alone.peak_displacement[0] == together.peak_displacement[i]


def test_statistics_in_the_loop_equal_those_of_the_full_record():
    e = quick(seed=3)
    fast = simulate_statistics([e])
    record = simulate_records([e])[0]
    names = ("displacement", "command", "force")
    signals = np.stack([record[MEASURED.index(n)] for n in names]).reshape(3, -1, e.samples_per_period)
    lines = lines_at(e.excitations)
    kept = [period_spectra(signals[:, p], lines) for p in range(e.transient_periods, signals.shape[1])]
    slow = line_statistics(kept, e.fundamental, lines, names)
    scale = np.abs(slow.mean).max(axis=1, keepdims=True)
    assert (np.abs(fast.statistics.mean[0, :3] - slow.mean) < 1e-12 * scale).all()
    np.testing.assert_allclose(fast.statistics.covariance[0, :3, :3], slow.covariance, rtol=1e-6, atol=1e-24)
    steady = record[:, e.transient_periods * e.samples_per_period :]
    assert fast.peak_displacement[0] == np.abs(steady[0]).max()


def test_the_same_seed_gives_the_same_record_and_another_seed_another():
    a, b, c = (simulate_records([quick(seed=s)])[0] for s in (1, 1, 2))
    np.testing.assert_array_equal(a, b)
    assert (a[0] != c[0]).any()


def test_reading_noise_is_white_gaussian_and_independent_between_channels():
    rig = replace(load_rig("pedestal"), noise=Noise(1e-5, 0.1, 0.0), adc_bits=0)
    still = Excitation("sphs", "force", 1.0, (1,), 1e-12)
    e = Experiment(rig, rig.gains, (still,), periods=5, transient_periods=0, seed=7)
    records = simulate_records([e, replace(e, seed=8)])
    z = records[0][MEASURED.index("displacement")] / 1e-5
    f = records[0][MEASURED.index("force")] / 0.1
    other = records[1][MEASURED.index("displacement")] / 1e-5
    n = z.size
    for noise in (z, f):
        assert abs(noise.mean()) < 4 / np.sqrt(n)
        assert abs(noise.var() - 1) < 4 * np.sqrt(2 / n)
        assert abs((noise**4).mean() - 3) < 4 * np.sqrt(96 / n)
        autocorrelation = [np.mean(noise[lag:] * noise[:-lag]) for lag in range(1, 40)]
        assert np.abs(autocorrelation).max() < 4.5 / np.sqrt(n)
    for pair in (z * f, z * other):
        assert abs(pair.mean()) < 4 / np.sqrt(n)
    spectrum = np.abs(np.fft.rfft(z))[1:-1] ** 2 / n
    # Exponentially distributed: mean 1, standard deviation 1.
    assert abs(spectrum.mean() - 1) < 0.05 and abs(spectrum.std() - 1) < 0.05


def test_ideal_converters_have_no_range():
    """A rig whose bits are 0 is not held to a voltage_range that nobody stated: a ball moves by more than 1.25 mm."""
    quiet = without_noise(quick())
    narrow, wide = (
        simulate_records([replace(quiet, rig=replace(quiet.rig, adc_bits=0, dac_bits=0, **range_))])[0]
        for range_ in ({"voltage_range": 0.1, "probe_gain": 1e6}, {"voltage_range": 1e4, "probe_gain": 1e6})
    )
    assert np.abs(wide[MEASURED.index("displacement")]).max() > 0.1 / 1e6
    np.testing.assert_array_equal(narrow, wide)


def test_an_unstable_loop_touches_down_when_the_slow_simulator_does():
    # Well before the poles, where the law is singular and no integrator gets through.
    rig = replace(load_rig("hmb_free"), clearance=0.3e-3)
    e = without_noise(quick(gains=Gains(500.0, 0.0, 0.2), rig=rig))
    displacement, _, _ = simulate(e, 4000)
    assert displacement.size < 4000
    got = simulate_statistics([e, without_noise(quick())])
    assert abs(got.touchdown_time[0] * e.rig.control_rate - displacement.size) <= 1
    assert np.isnan(got.touchdown_time[1]) and np.isnan(got.statistics.mean[0]).all()
    record = simulate_records([e])[0]
    assert np.isfinite(record[0, : displacement.size - 1]).all() and np.isnan(record[0, displacement.size + 1 :]).all()


def test_a_batch_in_which_every_rotor_touches_down_is_a_result_and_no_error():
    falling = [quick(gains=Gains(500.0 + i, 0.0, 0.2), seed=i) for i in range(3)]
    got = simulate_statistics(falling)
    assert np.isfinite(got.touchdown_time).all() and np.isnan(got.statistics.mean).all()


@pytest.mark.parametrize("keep", [[True] * 20, [i % 3 > 0 for i in range(20)]])
def test_statistics_of_some_lines_and_channels_are_those_of_all(keep):
    # Two structures, so that the members of a block are no neighbours, and one that touches down.
    late = effect("delay", 5e-5)
    several = [quick(seed=i, effects=late if i % 2 else {}) for i in range(19)] + [quick(gains=Gains(500.0, 0.0, 0.2))]
    got = simulate_statistics(several)
    whole, names = got.statistics, ("command", "injection", "displacement")
    part = got.at_lines(whole.lines[1::2], names, np.array(keep))
    expected = whole.at_lines(whole.lines[1::2], names)
    assert part.channels == expected.channels and np.array_equal(part.frequency, expected.frequency)
    np.testing.assert_array_equal(part.mean, expected.mean[keep])
    np.testing.assert_array_equal(part.covariance, expected.covariance[keep])
    np.testing.assert_allclose(part.covariance, np.conj(part.covariance.swapaxes(1, 2)))


def test_converters_quantise_and_limit_as_stated():
    rig = load_rig("hmb_free")
    e = quick(rig=replace(rig, noise=Noise(), dac_bits=8, adc_bits=10))
    record = simulate_records([e])[0]
    volts = record[MEASURED.index("displacement")] * rig.probe_gain / (20 / 2**10)
    amperes = record[MEASURED.index("command")] / (20 / 2**8)
    np.testing.assert_allclose(volts, np.round(volts), atol=1e-9)
    np.testing.assert_allclose(amperes, np.round(amperes), atol=1e-9)
    assert np.unique(np.round(volts)).size > 5
    violent = scaled(quick(rig=replace(rig, noise=Noise(), clearance=0.34e-3)), 1e4)
    pushed = simulate_records([violent])[0][MEASURED.index("command")]
    assert np.nanmax(np.abs(pushed)) <= 10.0


def test_a_static_reference_moves_the_rotor_by_what_the_loop_gain_allows():
    e = scaled(without_noise(quick(offset=2e-5, periods=4, transient_periods=4)), 1e-6)
    settled = simulate_records([e])[0][MEASURED.index("displacement"), -1]
    gain = (e.gains.kp + e.gains.ki) * 5.7 / -12.5e3
    assert settled == pytest.approx(2e-5 * gain / (1 + gain), rel=0.02)


def test_experiments_that_do_not_fit_one_batch_are_refused():
    with pytest.raises(ValueError, match="share excitations"):
        simulate_statistics([quick(), quick(fundamental=10.0)])
    with pytest.raises(ValueError, match="at least two kept periods"):
        simulate_statistics([quick(periods=1)])
    with pytest.raises(ValueError, match="at least one experiment"):
        simulate_statistics([])


def test_noise_in_time_and_at_lines_is_the_same_noise():
    seed, n = np.uint64(12345), 4000
    lines = np.array([1, 7, 500, 1999])
    for period in (0, 3):
        series = series_noise(seed, 2.0, period, n)
        np.testing.assert_allclose(
            period_spectra(series[None], lines)[0],
            as_complex(line_noise(np.array([seed]), [2.0], period, n, lines))[0],
            atol=1e-13,
        )
        assert series.std() == pytest.approx(2.0, rel=4 / np.sqrt(2 * n))
    assert abs(np.mean(series_noise(seed, 1.0, 0, n) * series_noise(seed, 1.0, 1, n))) < 4 / np.sqrt(n)
