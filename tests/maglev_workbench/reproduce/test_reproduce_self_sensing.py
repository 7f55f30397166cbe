"""The items of chapter 6: published figures against closed forms, scipy and simulations that the items do not use."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from estimation.multisine.sphs import crest_factor, harmonic_range, sphs, synthesise
from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import protocol_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig_file import load_rig
from maglev_env.rotor.rotor import load_rotor
from maglev_env.rotor.run_up import run_up
from maglev_workbench.commands.reproduce.chapters.self_sensed import pump_on_coils
from maglev_workbench.commands.reproduce.chapters.self_sensed import self_sensing_dynamic as dynamic
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing import ITEMS
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_circuit import DISPLACEMENT, OUTPUT
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_demodulation import sampled_duty
from maglev_workbench.commands.reproduce.chapters.self_sensed.self_sensing_sensor import (
    designed_for,
    dissertation_sensor,
    lines_figure,
)
from maglev_workbench.commands.runup.study import slowest
from selfsense.linear import tracking

GAP = 0.35e-3
INDUCTANCE = 4e-7 * np.pi * 90**2 * 39.27e-6 / (2 * GAP)


@cache
def outcome(name):
    return next(item for item in ITEMS if item.name == name).run(0)


def found(name, row):
    return next(r for r in outcome(name).rows if r.name == row)


def test_items_have_names_of_their_own_and_sources_in_chapter_6():
    assert len({item.name for item in ITEMS}) == len(ITEMS) == 9
    assert all("6." in item.source or item.source.startswith("7.2") for item in ITEMS)


@pytest.mark.parametrize("name", [item.name for item in ITEMS if item.name != "lowest-rate"])
def test_an_item_gives_finite_rows_a_plot_and_notes(name):
    result = outcome(name)
    assert all(np.isfinite(row.found) for row in result.rows)
    assert len({row.name for row in result.rows}) == len(result.rows)
    assert len(result.plots) == 1 and result.plots[0][1].data and result.notes
    # Whoever is told that a figure does not agree is told why.
    assert all(row.reason for row in result.rows if row.agrees is False)


def test_the_sensor_is_the_one_of_the_published_simulation():
    _, sensor = dissertation_sensor()
    assert sensor.acquisition.rate == 250e3 and sensor.acquisition.bits == 0 and sensor.acquisition.noise == 0
    assert (sensor.supply.frequency, sensor.supply.voltage, sensor.coil.back_emf) == (25e3, 24.0, False)
    assert float(sensor.coil.inductance(sensor.gap)) == pytest.approx(INDUCTANCE)


def filtered(duty, rate):
    """Mean of rectifier and low-pass behind the high-pass of App. D, by scipy, over eq 6.20."""
    samples = round(4e-3 * rate)
    cycles = 25e3 * (np.arange(samples) + 1) / rate
    part, slope = cycles % 1, 24.0 / INDUCTANCE / 25e3
    # The integral of +-1 with the duty: whole periods, and what follows them.
    current = slope * (np.floor(cycles) * (2 * duty - 1) + np.minimum(part, duty) - np.maximum(part - duty, 0))
    wh, wl = 2 * np.pi * 15e3, 2 * np.pi * 5e3
    ripple = lfilter(*bilinear([1, 0, 0], [1, 2**0.5 * wh, wh**2], rate), current)
    mean = lfilter(*bilinear([wl**2], [1, 2**0.5 * wl, wl**2], rate), np.abs(ripple))
    eq_6_20 = duty * (1 - duty) * 24.0 / 25e3 / INDUCTANCE
    return mean[-round(10 * rate / 25e3) :].mean() / eq_6_20


def test_the_ripple_is_half_of_eq_6_20_by_scipys_filters_too():
    assert found("half-ripple", "mean rectified ripple over eq 6.20, closed form").found == pytest.approx(0.5)
    triangle = np.abs(np.linspace(-1, 1, 200_001))
    assert np.abs(triangle - triangle.mean()).mean() == pytest.approx(triangle.mean() / 2, rel=1e-4)
    duties = np.arange(0.35, 0.651, 0.05)
    coarse = [filtered(d, 250e3) for d in (0.35, 0.4, 0.45, 0.5, 0.55)]
    assert found("half-ripple", "the same by the filters of App. D, duty 0.5").found == pytest.approx(
        filtered(0.5, 250e3), abs=2e-4
    )
    fine = [filtered(d, 2.5e6) for d in duties]
    for at, values in (("2.5 MHz", fine), ("250 kHz", None)):
        low, high = (found("half-ripple", f"{end} at {at}, duty 0.35 to 0.65").found for end in ("smallest", "largest"))
        if values is not None:
            assert (low, high) == pytest.approx((min(values), max(values)), abs=5e-4)
        else:
            assert (low, high) == pytest.approx((0.4942, 0.5246), abs=2e-4)
            assert low - 2e-3 < min(coarse) and max(coarse) < high + 2e-3


def test_eq_6_25_hardly_moves_the_duty_and_edges_on_samples_corrupt_the_reading():
    swing = 2 * np.pi * 100 * INDUCTANCE * 0.2 / (2 * 24.0)
    assert found("forward-path", "swing of the duty by eq 6.25").found == pytest.approx(swing)
    # The mean over a period of -(gap + motion sin) (2 swing cos)^2 is -gap 2 swing^2.
    exact = found("forward-path", "that swing: mean error by alpha (1 - alpha)").found
    assert exact == pytest.approx(-1e6 * GAP * 2 * swing**2, rel=1e-3)
    at_half, rms, on_samples = (
        found("forward-path", row).found
        for row in (
            "constant duty: error, rms",
            "that swing, exact edges: error, rms",
            "that swing, edges on samples: error, rms",
        )
    )
    assert rms < 1.3 * at_half and on_samples == pytest.approx(8.21, abs=0.05)
    agrees = {row.name: row.agrees for row in outcome("forward-path").rows if row.agrees is not None}
    assert [name for name, agreed in agrees.items() if not agreed] == ["that swing, exact edges: error, rms"]
    # alpha (1 - alpha) of 0.6 is 4 % less than of 0.5: 14 µm of the gap's 350, for half of the time.
    largest = found("forward-path", "that swing, edges on samples: largest error").found
    assert 14 < largest < 1.05 * 400 * 0.04 + 3
    assert found("forward-path", "constant duty: lag at 100 Hz").found == pytest.approx(1.80, abs=0.01)
    assert found("forward-path", "swing 0.1: mean error").found == pytest.approx(-9.31, abs=0.02)


def test_the_sampled_duty_is_a_multiple_of_a_tenth_and_the_estimator_does_not_mind():
    _, sensor = dissertation_sensor()
    read = sampled_duty(sensor)
    rms = {m: np.sqrt(np.mean((read.sampled[m] - read.gap) ** 2)) for m in read.sampled}
    assert rms["demodulated"] > 5 * rms["estimated"]
    same = np.abs(read.sampled["estimated"] - read.exact["estimated"]).max()
    assert same < 0.5e-6 < 5e-6 < np.abs(read.sampled["demodulated"] - read.exact["demodulated"]).max()


def test_the_estimator_follows_ten_times_better_and_is_only_late():
    rms = found("estimator-tracking", "duty 0.5 ± 0.1: estimator's error, rms").found
    lag = found("estimator-tracking", "estimator's lag at 100 Hz").found
    assert rms == pytest.approx(50 / 2**0.5 * np.radians(lag), rel=0.01)
    assert found("estimator-tracking", "of it without the lag").found < rms / 20
    assert found("estimator-tracking", "forward path's error over the estimator's").found == pytest.approx(
        10.17, abs=0.1
    )
    assert found("estimator-tracking", "edges on samples: the forward path's over it").found > 5
    assert found("estimator-tracking", "forward path's error, rms").found == pytest.approx(10.54, abs=0.03)


def test_little_lag_and_much_margin_are_two_designs():
    assert found("estimator-response", "lag at 4 kHz").agrees
    assert found("estimator-response", "bandwidth, -3 dB").found == pytest.approx(13.0, abs=0.1)
    assert found("estimator-response", "phase margin with that lag").found == pytest.approx(15.4, abs=0.1)
    assert found("estimator-response", "smallest lag at 4 kHz with 83° of margin").found == pytest.approx(52.9, abs=0.2)
    assert found("estimator-response", "peak of estimated over true gap").found == pytest.approx(4.40, abs=0.05)
    assert found("estimator-response", "largest departure of the simulation from the linear model").found < 5e-3


def test_the_stated_band_pass_has_its_gain_and_width_but_not_its_edges():
    # |H| of an analog band-pass is 3 dB down where Q (f / f0 - f0 / f) = +-1.
    half = 1 / (2 * 0.83)
    edges = [25 * (np.sqrt(1 + half**2) + s * half) for s in (-1, 1)]
    for row, expected in zip(("lower edge of a stage", "upper edge of a stage"), edges, strict=True):
        assert found("band-pass", row).found == pytest.approx(expected, rel=2e-3)
        assert found("band-pass", row).agrees is False
    assert (
        found("band-pass", "width of a stage, -3 dB").agrees and found("band-pass", "gain of a stage at 25 kHz").agrees
    )
    assert found("band-pass", "lower edge of both stages").found == pytest.approx(17.1, abs=0.1)
    # Harmonics of a triangle through both stages, against its rms value.
    n = np.arange(1, 40, 2)
    stage = 1.15 / np.hypot(1, 0.83 * (n - 1 / n))
    harmonics = 8 / np.pi**2 / n**2
    expected = np.sqrt(np.sum((harmonics * stage**2) ** 2) / 2) * np.sqrt(3)
    assert found("band-pass", "rms output over the ripple's rms").found == pytest.approx(expected, rel=1e-3)


def test_table_6_1_is_better_than_its_text():
    kept = DISPLACEMENT <= 0.49
    slope, offset = np.polyfit(DISPLACEMENT[kept], OUTPUT[kept], 1)
    off = np.abs(OUTPUT - slope * DISPLACEMENT - offset)[kept].max() / (slope * 0.49)
    gain, error = (found("static-calibration", f"{n} up to saturation") for n in ("gain", "linearity error"))
    assert gain.found == pytest.approx(slope) == pytest.approx(449.19, abs=0.01) and gain.agrees is False
    assert error.found == pytest.approx(100 * off) == pytest.approx(0.390, abs=1e-3)
    with_it = found("static-calibration", "gain with the point at 0.55 mm")
    assert with_it.found == pytest.approx(np.polyfit(DISPLACEMENT[:12], OUTPUT[:12], 1)[0]) and with_it.agrees
    assert found("static-calibration", "linear up to").found == 0.49
    assert found("static-calibration", "simulated estimator: gain").found == pytest.approx(1.0, abs=1e-3)
    assert found("static-calibration", "simulated estimator: linear up to").found == pytest.approx(0.70)


def test_the_simulated_estimator_does_not_lag_as_the_measured():
    lag, delay = found("dynamic-calibration", "lag at 150 Hz"), found("dynamic-calibration", "delay of that lag")
    assert delay.published == pytest.approx(555.6, abs=0.1) and lag.agrees is False and delay.agrees is False
    assert lag.found == pytest.approx(2.43, abs=0.02) == pytest.approx(360 * 150 * delay.found * 1e-6, rel=0.02)
    assert found("dynamic-calibration", "the same with gains for 18° at 4 kHz").found == pytest.approx(2.10, abs=0.02)
    assert found("dynamic-calibration", "dip of the phase at 75 Hz").found < 0.01
    noisy, half = (
        found("dynamic-calibration", row).found
        for row in ("with noise: delay", "with noise: half the 95 % interval of it")
    )
    assert abs(noisy - delay.found) < 2 * half < 10


def test_noise_over_signal_uses_the_crest_factor_of_the_motion():
    wave = synthesise(sphs(harmonic_range(1, 150), 2000), 2000)
    assert crest_factor(wave) == pytest.approx(dynamic.CREST, rel=0.02)


def test_an_integral_gain_that_lags_as_measured_has_the_published_margin():
    crossover, margin = (
        found("dynamic-calibration", row).found
        for row in ("its crossover", "analog path with 30° at 150 Hz: phase margin")
    )
    assert margin == pytest.approx(83.45, abs=0.1)
    # By hand: 90 degrees of an integrator, less what the low frequencies are late by: sqrt(2) / w of the averaging, the
    # envelope's 2 Q / w of either band-pass stage, and half a sample of 4 us.
    late = 2**0.5 / (2 * np.pi * 5e3) + 2 * 2 * 0.83 / (2 * np.pi * 25e3) + 2e-6
    assert margin == pytest.approx(90 - 360 * crossover * late, abs=0.1)
    assert np.degrees(np.arctan(150 / crossover)) == pytest.approx(30, abs=1)
    level = found("dynamic-calibration", "its level at 150 Hz").found
    assert level == pytest.approx(20 * np.log10(np.cos(np.radians(30))), abs=0.4) and level < -0.8
    at = [found("dynamic-calibration", f"its margin if averaged at {f} kHz").found for f in (2, 20)]
    assert at[0] < margin < at[1] and at == pytest.approx([76.5, 86.8], abs=0.1)


def test_the_measured_delay_is_the_levitation_loops_margin():
    margin = found("dynamic-calibration", "delay margin of hmb_free levitated with a probe").found
    assert margin == pytest.approx(563.7, abs=1)
    # A loop that is on the verge: with that delay L passes through -1.
    f = np.geomspace(60, 300, 4000)
    sensitivity = loop_response(protocol_experiment(with_defaults(load_rig("hmb_free"))), f).sensitivity
    loop = (1 / sensitivity - 1) * np.exp(-2j * np.pi * f * margin * 1e-6)
    assert np.abs(1 + loop).min() < 0.01 < 0.05 < np.abs(1 / sensitivity).min()
    assert dynamic.right_most_pole(None) == pytest.approx(-42.8, abs=0.5)
    pole = found("dynamic-calibration", "right-most pole of hmb_free levitated by that slow estimator").found
    assert -10 < pole < 10


def test_a_design_lags_as_asked():
    _, sensor = dissertation_sensor()
    lags = [-np.degrees(np.angle(tracking(s, np.array([4e3]))[0])) for s in (sensor, designed_for(sensor, 18.0))]
    assert lags == pytest.approx([35, 18], abs=0.1)


def test_a_published_line_is_drawn_dotted():
    figure = lines_figure("x", "y", [("published: a", [1, 2], [0, 0]), ("ours", [1, 2, 3], [0, 1, 2])])
    assert [trace.line.dash for trace in figure.data] == ["dot", None]


@pytest.mark.slow
def test_the_lowest_rate_is_a_matter_of_gains():
    result = outcome("lowest-rate")
    assert found("lowest-rate", "gains for 18° at 4 kHz and the most margin").found == 105
    assert found("lowest-rate", "gains for 83° of margin").found == 55
    assert found("lowest-rate", "gains found to stop where the published do").found == 165
    assert found("lowest-rate", "their lag at 4 kHz").found == pytest.approx(17.8, abs=0.3)
    assert found("lowest-rate", "their phase margin at 250 kHz").found == pytest.approx(5.9, abs=0.3)
    assert found("lowest-rate", "gains at the limit of 165 kHz: largest phase margin").found < 9
    # Edge by edge, not by the linear model.
    assert "settles at 165 kHz and swings at 160 kHz" in result.notes[1]
    assert all(np.isfinite(row.found) for row in result.rows) and result.plots[0][1].data


@pytest.mark.slow
def test_the_pump_runs_up_on_its_coils_and_loses_its_damping_at_the_lag_that_is_told():
    outcome = pump_on_coils.ITEM.run(0)
    rows = {row.name: row.found for row in outcome.rows}
    assert all(np.isfinite(found) for found in rows.values()) and all(row.reason for row in outcome.rows)
    assert rows["touchdowns from 0 to 14,000 rpm"] == rows["touchdowns with 30° at 150 Hz at softer gains"] == 0
    assert 25 < rows["lag at 150 Hz that takes all damping at 14,000 rpm"] < 30
    rotor = replace(load_rotor("pump"), sensor="self_sensing")
    lag = pump_on_coils.largest_lag(rotor)
    just = [pump_on_coils.late_by(rotor, lag + off) for off in (-1.0, 1.0)]
    assert [pump_on_coils.lag_of(one) - lag for one in just] == pytest.approx([-1, 1], abs=1e-3)
    # A probe's first-order lag of the same angle, at the coils, loses its damping at nearly the same one.
    probe = replace(load_rotor("pump"), planes=replace(rotor.planes, probes=rotor.planes.magnets))
    late = replace(probe.axis, sensor_time_constant=np.tan(np.radians(lag)) / (2 * np.pi * 150))
    assert abs(slowest(replace(probe, axis=late), 14_000.0)) < 10
    up = run_up(just, np.array([14_000.0]))
    assert up.touched_down[:, 0].tolist() == [False, True]
    table = outcome.tables[1]
    assert [row[1] for row in table.rows] == ["0 of 3"] * len(pump_on_coils.WRONG)
