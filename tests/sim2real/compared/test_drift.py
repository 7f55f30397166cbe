"""A gain that drifts over a recording: its rate is found, in noise there is none, and other trends are not named."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from campaigns import planned, repeated

from estimation.lines.periods import straightened
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.compared import drift as drift_module
from sim2real.compared.drift import FORM, Drift, _by_gain, _ringing, _slope, drift_of, with_drift
from sim2real.compared.point import Point, experiment_at, tolerances
from sim2real.compared.problem import assemble
from sim2real.recorded.drifting import steady, trend
from sim2real.recorded.records import read_records
from sim2real.recorded.wander import without_leak, without_wander
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

NOMINAL, SEEDS = Point({}, {}), range(12)


def problem(folder, effects=None, seeds=SEEDS):
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    e = replace(plan.experiment, effects=effects or {})
    return assemble(repeated(folder, [replace(e, seed=seed) for seed in seeds]))


def test_a_straight_line_is_taken_off():
    at, rng = np.arange(6.0), np.random.default_rng(1)
    noise = rng.standard_normal((6, 3)) + 1j * rng.standard_normal((6, 3))
    slope, rest = straightened(noise + np.multiply.outer(at, [1.0, 2j, -3.0]))
    own, alone = straightened(noise)
    np.testing.assert_allclose(slope - own, [1.0, 2j, -3.0], rtol=1e-12)
    np.testing.assert_allclose(rest, alone, atol=1e-12)
    expected = np.polyfit(at, noise[:, 0].real, 1)
    assert own[0].real == pytest.approx(expected[0])


def test_a_level_that_wanders_is_taken_off_and_one_that_stays_is_left_alone():
    rng, count, per_period = np.random.default_rng(2), 8, 500
    phase = 2 * np.pi * np.arange(count * per_period) / per_period
    steady = np.array([np.cos(phase) + 0.3, np.sin(3 * phase)]) + 0.1 * rng.standard_normal((2, phase.size))
    assert without_wander(steady, per_period) is steady
    ramp = 0.2 * np.linspace(-0.5, 0.5, phase.size)
    found = without_wander(steady + np.array([ramp, 0 * ramp]), per_period)
    np.testing.assert_array_equal(found[1], steady[1])
    assert np.abs(found[0] - steady[0]).max() < 0.02
    short = (steady + ramp)[:, : 2 * per_period]
    assert without_wander(short, per_period) is short


@pytest.mark.parametrize("shape", ["ramp", "warming"])
def test_lines_that_grow_leave_nothing_on_the_others(shape):
    """What is left of a slow exponential is what a straight line over all periods is off by within one."""
    count, per_period, lines = 6, 400, np.arange(1, 21)
    excited = np.isin(lines, [3, 7, 8, 15])
    t = (np.arange(count * per_period) + 0.5) / per_period
    growth = 1 + 0.02 * t if shape == "ramp" else 1 + 0.3 * (1 - np.exp(-t / 14))
    x = growth * sum(np.cos(2 * np.pi * k * t + k) for k in lines[excited])
    rng = np.random.default_rng(5)
    x = x[None] + 1e-5 * rng.standard_normal((2, x.size))
    spectra = 2 / per_period * np.fft.rfft(x.reshape(2, count, per_period))[..., lines].swapaxes(0, 1)
    found = without_leak({"displacement": spectra}, lines, excited, per_period)["displacement"]
    leak, left = abs(spectra.mean(0)[:, ~excited]).max(), abs(found.mean(0)[:, ~excited]).max()
    assert leak > 2e-3 and left < (5e-6 if shape == "ramp" else 1e-4)
    np.testing.assert_allclose(found.var(axis=0), spectra.var(axis=0), rtol=1e-9)


def test_steady_lines_and_transients_are_left_as_they_are():
    rng, lines, count = np.random.default_rng(6), np.arange(1, 31), 5
    excited = lines % 3 == 0
    for _ in range(300):
        noise = rng.standard_normal((count, 1, 30)) + 1j * rng.standard_normal((count, 1, 30))
        steady = {"displacement": 100.0 * excited + noise}
        assert without_leak(steady, lines, excited, 200) is steady
    rings = 30.0 * np.exp(-np.arange(count))[:, None, None] / (1 + 0.1j * lines)
    transient = {"displacement": steady["displacement"] + rings}
    assert without_leak(transient, lines, excited, 200) is transient


def test_noise_hardly_ever_seems_to_wander():
    """In white noise, whose level has the power of a line; without a tone in a thousand records."""
    rng = np.random.default_rng(4)
    for count in (3, 5):
        noise = rng.standard_normal((1000, count * 60))
        assert without_wander(noise, 60) is noise
    moved = noise + 3.0 * np.linspace(-0.5, 0.5, noise.shape[1])
    assert np.std(without_wander(moved, 60) - noise) < 0.3


def test_rates_of_recordings_are_weighed_by_their_variances(monkeypatch):
    """And by a share of the rate that a drift which is not steady may be off by, in each."""
    rates, sds = np.array([0.10, 0.13, 0.08]), np.array([0.002, 0.02, 0.01])
    rows = [(rate, sd, (rate / sd) ** 2, 1.0, 400.0) for rate, sd in zip(rates, sds, strict=True)]
    monkeypatch.setattr(drift_module, "_slope", lambda part, point: rows[part])
    found = drift_of(SimpleNamespace(parts=range(3)), NOMINAL)
    variances = sds**2 + (FORM * found.rate) ** 2
    assert found.rate == pytest.approx((rates / variances).sum() / (1 / variances).sum(), rel=1e-3)
    assert found.se == pytest.approx((1 / variances).sum() ** -0.5, rel=1e-3)
    assert found.left == pytest.approx((((rates - found.rate) ** 2) / variances).sum(), rel=1e-2)


def test_what_warms_up_is_one_drift_in_recordings_that_begin_at_different_times(monkeypatch):
    """Four seconds of an exponential of 1.5 s, and the same without the first one, each told to 3 %."""
    decay = np.exp(-np.arange(5) / 1.5)
    means = 1.5 * (decay[:-1] - decay[1:])  # of each second
    rates = [float(np.polyfit(np.arange(own.size), own, 1)[0]) for own in (means, means[1:])]
    assert rates[0] / rates[1] > 1.3

    def found(*rates):
        rows = [(rate, 0.03 * abs(rate), 1e3, 40.0, 400.0) for rate in rates]
        monkeypatch.setattr(drift_module, "_slope", lambda part, point: rows[part])
        return drift_of(SimpleNamespace(parts=range(len(rows))), NOMINAL)

    assert found(*rates).shown and found(*rates).left < 2.0
    assert found(rates[0], -rates[1]).left > 20.0  # one recording cools where the other warms up


def test_noise_that_is_told_from_few_lines_makes_large_trends_less_rare(monkeypatch):
    """By simulation: ratios of one normal number and the root mean square of others."""
    rng, few = np.random.default_rng(8), 12
    drawn = rng.standard_normal((200_000, few + 1))
    ratio = np.sort(drawn[:, 0] ** 2 / (drawn[:, 1:] ** 2).mean(axis=1))
    rate, most = float(ratio[-20]) ** 0.5, 0.1  # at the probability of FALSE_ALARM
    for freedom, size, shown in ((few, 1.2, True), (few, 0.8, False), (1e6, 0.8, True)):
        monkeypatch.setattr(drift_module, "_slope", lambda *_, a=rate * size * most, d=freedom: (a, most, 1.0, 1.0, d))
        assert drift_of(SimpleNamespace(parts=range(1)), NOMINAL).shown == shown


@pytest.mark.slow
def test_in_noise_there_is_no_drift_and_its_error_is_as_stated(tmp_path):
    found = problem(tmp_path)
    assert not drift_of(found, NOMINAL).shown
    slopes = [own for part in found.parts if (own := _slope(part, NOMINAL))]  # none where too few periods are steady
    z = np.array([rate / sd for rate, sd, *_ in slopes])
    assert len(z) > 0.8 * len(found.parts)
    assert 0.5 < np.std(z) < 1.6 and abs(z.mean()) < 3 / np.sqrt(len(z))


@pytest.mark.slow
def test_periods_that_a_slow_loop_still_reaches_have_no_trend(tmp_path):
    """At a point whose loop rings for long; at one that rings for all of the recording nothing is said."""
    found = problem(tmp_path, seeds=range(1))
    (part,) = found.parts
    poles = {lag: _ringing(part.record, Point({"amplifier_lag": {"time_constant": lag}}, {})) for lag in (0.0, 6e-4)}
    e = part.record.experiment
    slow = abs(closed_loop_poles(replace(e, effects=effect("amplifier_lag", 6e-4)))).max()
    lasting = np.log(3e-5) / np.log(slow) / e.samples_per_period - part.record.dropped
    assert poles[0.0] <= 1 < lasting <= poles[6e-4] < lasting + 1
    assert (_slope(part, Point({"amplifier_lag": {"time_constant": 6e-4}}, {})) is None) == (
        part.record.count - poles[6e-4] < 4
    )


@pytest.mark.slow
@pytest.mark.parametrize("rate", [0.0, 0.1])
def test_what_changes_along_the_gain_alone_is_a_drift_in_a_loop_that_may_ring_on(tmp_path, monkeypatch, rate):
    """A transient has slopes on all lines, and these are not those of another gain."""
    (part,) = problem(tmp_path, effect("gain_drift", rate) if rate else {}, range(1)).parts
    monkeypatch.setattr(drift_module, "_ringing", lambda record, point: record.count)
    slope = _slope(part, NOMINAL)
    assert (slope is None) == (rate == 0)
    assert slope is None or slope[0] == pytest.approx(rate, rel=0.2)


@pytest.mark.slow
def test_the_rate_of_a_drift_is_found_and_another_one_costs(tmp_path):
    """Of a gain that the kernel multiplies by 1 + rate t."""
    found = problem(tmp_path, effect("gain_drift", 0.1), range(3))
    drift = drift_of(found, NOMINAL)
    assert drift.shown and abs(drift.rate - 0.1) < 0.02 + 3 * drift.se and drift.left < 0.1 * drift.chi2
    assert drift.against(drift.rate, 0.0) == 0 and drift.against(0.0, 0.0) > 10
    assert drift.against(0.0, 1.0) < 0.1  # of a fit that tells nothing


@pytest.mark.slow
@pytest.mark.parametrize("settling", (0.0, 3.0))
def test_the_mean_over_periods_is_that_of_a_drift_that_is_simulated(tmp_path, settling):
    """The kernel's own drift over all periods, against the steady gain in its place; the drift alone moves the mean by
    many times as much."""
    found = problem(tmp_path, effect("gain_drift", 0.1, settling=settling), range(1))
    (part,) = found.parts
    drifting = Point({"gain_drift": {"rate": 0.1, "settling": settling}}, {})
    left, before = (found.data - found.simulate([p])[0] for p in (drifting, NOMINAL))
    assert np.vdot(before, before).real > 2 * np.vdot(left, left).real
    gain = steady(part.record, drifting.effects)["actuator_gain"]["change"]
    at = part.record.start + np.linspace(0, part.record.count / part.record.experiment.fundamental, 20001)
    assert gain == pytest.approx(np.mean(0.1 * (-np.expm1(-settling * at) / settling if settling else at)), rel=1e-3)
    slope = np.polyfit(at, -np.expm1(-settling * at) / settling if settling else at, 1)[0]
    assert trend(part.record, drifting.effects) == pytest.approx(0.1 * slope, rel=1e-2)
    h = Hypothesis(("actuator_gain",), {})
    (fit,) = begin([h], [np.zeros(1)], found.data, found.simulate)
    iterate([fit], found.data, found.simulate, 8)
    sd = h.coordinates[0].scale * np.sqrt(fit.covariance()[0, 0])
    assert h.coordinates[0].value(fit.u[0]) == pytest.approx(gain, abs=4 * sd + 0.03 * gain)


@pytest.mark.slow
def test_without_periods_a_drift_is_fitted_and_explains_nothing_where_there_is_none(tmp_path):
    """Another hand's rotor under noise; its gain falls off exponentially, by 2 % a second in the mean."""
    rng = np.random.default_rng(11)
    rig = draw_rig("rotor", rng)
    recording = Recording("one", "fit", Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"]),
                          draw_drive("noise", rig, False, 0.03, rng))  # fmt: skip
    lasting = recording.drive.wave.size / rig.parameters["control_rate"]
    own = {at.DRIFT: -0.05, at.DRIFT_TIME: 2.0}
    mean = -0.05 * (1 - np.exp(-lasting / 2.0)) / lasting
    for name, effects in (("still", {}), ("drifting", own)):
        made = simulate(Truth(rig, {"actuator_gain": 0.02}, effects), recording, 5)
        write_campaign(tmp_path / name, rig, "no_force", [Recorded(recording, True, made)])
        _, records = read_records(tmp_path / name)
        found = assemble(records)
        allowed, scales = tolerances(records[0].nominal), records[0].nominal.scales
        hypotheses = [Hypothesis(names, allowed, scales=scales) for names in ((), ("gain_drift",))]
        fits = begin(hypotheses, [np.zeros(h.size) for h in hypotheses], found.data, found.simulate)
        iterate(fits, found.data, found.simulate, 10)
        saved, rate = fits[0].cost - fits[1].cost, fits[1].hypothesis.coordinates[0].value(fits[1].u[0])
        if effects:
            assert rate == pytest.approx(mean, rel=0.15) and saved > 50
        else:
            assert saved < 12


@pytest.mark.parametrize(("shown", "rate", "cost"), [(True, 0.1, 0.0), (True, 0.0, 100.0), (False, 0.0, 0.0)])
def test_a_rate_is_held_against_that_of_the_periods(shown, rate, cost):
    drift = Drift(0.1, 0.01, 100.0, 0.0, shown)
    assert drift.against(rate, 0.0) == pytest.approx(cost)


def test_trends_of_noise_scatter_as_they_are_said_to(tmp_path, monkeypatch):
    """What all trends weigh beyond their expectation, of trends twice as powerful as their noise."""
    (part,), rng, found = problem(tmp_path, seeds=(0,)).parts, np.random.default_rng(9), []
    slopes, variance = drift_module.trends(part.record, part)
    for _ in range(200):
        drawn = rng.standard_normal(slopes.shape) + 1j * rng.standard_normal(slopes.shape)
        monkeypatch.setattr(drift_module, "trends", lambda *_, drawn=drawn: (drawn * np.sqrt(variance), variance))
        found.append(_slope(part, NOMINAL))
    rate, error, beyond, scatter, _ = np.array(found).T
    assert beyond.std() / 2 == pytest.approx(scatter[0], rel=0.2)
    assert rate.std() / 2**0.5 == pytest.approx(error[0], rel=0.12)


def test_noise_at_a_narrow_resonance_of_the_plant_is_no_trend(tmp_path):
    """What the noise of the current does there stands ten times above that at the lines beside it."""
    (part,), rng = problem(tmp_path, seeds=(0,)).parts, np.random.default_rng(4)
    record, line = part.record, part.record.frequency.size // 2
    plant = np.full_like(part.opened.plant, abs(part.opened.plant[..., line]).max())
    plant[..., line] *= 10
    narrow = replace(part, opened=replace(part.opened, plant=plant, outputs=("plant",)))
    shape, weights = record.periods["displacement"].shape, []
    for _ in range(200):
        noise = rng.standard_normal(shape) + 1j * rng.standard_normal(shape)
        periods = {"displacement": plant * noise / (1 + plant * part.opened.controller)}
        slopes, variance = drift_module.trends(replace(record, periods=periods), narrow)
        weights.append(2 * abs(slopes[0, 0]) ** 2 / variance[0, 0])
    mean = np.mean(weights, axis=0)  # of chi-squares with two degrees of freedom
    assert np.delete(mean, line).mean() == pytest.approx(2.0, rel=0.1)
    assert mean[line] < 5.0  # by the variance of that line alone, which few periods tell, it would be 3 or 4


def test_the_derivative_by_the_gain_is_that_at_a_gain_within_its_tolerance(tmp_path):
    """Against differences of the tolerance's own move, to which a drift by the same share adds."""
    (part,) = problem(tmp_path, seeds=(0,)).parts
    for change in (0.0, 0.009, 0.03, -0.03):
        less, more = ((1 + change) * (1 + step) - 1 for step in (-0.002, 0.002))
        low, high = part.predictor([Point({}, {"actuator_gain": moved}) for moved in (less, more)])
        found, expected = _by_gain(part, Point({}, {"actuator_gain": change})), (high - low) / 0.004
        assert abs(found - expected).max() < 0.03 * abs(expected).max(), change


@pytest.mark.parametrize("rate", (0.1, -0.2))
@pytest.mark.parametrize(
    "point",
    (NOMINAL, Point({}, {"actuator_gain": 0.02}), Point({"actuator_gain": {"change": 0.3, "force_share": 0.5}}, {})),
)
def test_a_drift_beside_a_fitted_gain_leaves_its_mean_and_has_the_rate_relative_to_it(tmp_path, rate, point):
    """Over the periods of the recording, of which the gain at the begin of the drift is no part."""
    (part,) = problem(tmp_path, seeds=(0,)).parts
    e, r = part.record.experiment, part.record
    found = experiment_at(e, with_drift(point, rate, [r])).effects
    at = r.start + np.linspace(0, r.count / e.fundamental, 1001)
    gains = (1 + found["actuator_gain"]["change"]) * (1 + found["gain_drift"]["rate"] * at)
    fitted = 1 + experiment_at(e, point).effects.get("actuator_gain", {}).get("change", 0.0)
    assert gains.mean() == pytest.approx(fitted, rel=1e-9)
    assert np.polyfit(at, gains, 1)[0] / gains.mean() == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize("rate", (-30.0, 30.0))
@pytest.mark.parametrize("change", (-0.1, 0.1))
def test_a_drift_that_no_effect_can_be_is_the_steepest_that_is_one(tmp_path, rate, change):
    (part,) = problem(tmp_path, seeds=(0,)).parts
    for point in (Point({}, {"actuator_gain": change}), Point(effect("actuator_gain", change), {})):
        found = with_drift(point, rate, [part.record])
        assert abs(experiment_at(part.record.experiment, found).effects["gain_drift"]["rate"]) <= 10
