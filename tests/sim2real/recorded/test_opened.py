"""The opened loop against the linear one, and its noise against the spread of many records."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, repeated, write

from maglev_env.experiment import axis_experiment, without_noise
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.loop.gains import Gains, LinearController
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.recorded.opened import by_rounding, loud_bands, noise_of, opened_loop
from sim2real.recorded.records import Record, read_records

FREE, RADIAL = load_rig("hmb_free"), load_rig("hmb_radial")
DRAWS = 40
FILTER = LinearController((60100.0, -60000.0), (1.0, -0.6))


def record_of(folder, rig, noise=True, **changes) -> Record:
    e = replace(planned(rig, names=("base",))[0].experiment, **changes)
    return read_records(write(folder, [("base", "fit", e if noise else without_noise(e))], rig.name))[1][0]


@pytest.fixture(scope="module")
def free(tmp_path_factory):
    return record_of(tmp_path_factory.mktemp("f") / "c", FREE)


@pytest.fixture(scope="module")
def radial(tmp_path_factory):
    return record_of(tmp_path_factory.mktemp("r") / "c", RADIAL)


def linear_channels(record: Record) -> tuple[np.ndarray, ...]:
    """Displacement, command and current (axes, n) that the closed loop has by the linear model."""
    e, axes = record.experiment, record.axes
    expected = expected_statistics(e, record.lines)
    reading, command = expected.mean[:axes], expected.mean[axes : 2 * axes]
    amplifier = [loop_response(axis_experiment(e, axis), record.frequency).amplifier for axis in range(axes)]
    return reading, command, np.array(amplifier) * command


@pytest.mark.parametrize(
    ("name", "gains"),
    [("free", FREE.gains), ("free", Gains(9e3, 1e4, 7.0, 1e-4)), ("free", FILTER), ("radial", RADIAL.gains),
     ("radial", (RADIAL.gains, replace(RADIAL.gains, kp=7e3))), ("radial", FILTER)],
)  # fmt: skip
def test_of_the_linear_loop_nothing_is_left(name, gains, request):
    base = request.getfixturevalue(name)
    e = replace(base.experiment, gains=gains)
    record = replace(base, experiment=e, waves={p: np.atleast_2d(e.waveform(p)) for p in base.waves})
    opened = opened_loop(record)
    displacement, command, current = linear_channels(record)
    left, added = opened.residuals(displacement, current), opened.driven(record)
    for found, own, size in zip(left, added, (displacement, current), strict=True):
        assert abs(found - own).max() < 1e-9 * abs(size).max()
    assert abs(added[0]).max() > 0.1 * abs(displacement).max()  # there was something to add
    assert abs(current - opened.amplifier * command).max() < 1e-12 * abs(current).max()


def test_of_a_small_simulated_loop_nothing_is_left(tmp_path):
    """At a thousandth of the amplitude the simulator is linear, its current sampled as the linear one's is."""
    parts = planned(FREE, names=("base",))[0].experiment.excitations
    record = record_of(tmp_path, FREE, False, excitations=tuple(replace(x, amplitude=x.amplitude / 1e3) for x in parts))
    opened = opened_loop(record)
    left = opened.residuals(record.mean("displacement"), record.mean("current"))
    for found, own in zip(left, opened.driven(record), strict=True):
        assert abs(found - own).max() < 2e-4 * abs(own).max()


def test_a_rig_without_magnets_has_its_plant_alone(tmp_path):
    record = record_of(tmp_path, load_rig("pedestal"), noise=False)
    opened = opened_loop(record)
    assert opened.outputs == ("plant",) and not opened.controller.any()
    assert (
        abs(opened.driven(record)[0] - linear_channels(record)[0]).max() < 1e-9 * abs(record.mean("displacement")).max()
    )


# Noise is drawn at the opened loop's own outputs and carried around the loop: then its size is known at every line.
def drawn(base: Record, rng, reading=5e-9, current=2e-5, force=0.0, periods=8, louder=1.0) -> Record:
    """A record of nothing but noise: of reading (m), current (A) and force (N) per line, standard deviations of a
    complex amplitude; louder: factor on each line's noise."""
    opened = opened_loop(base)
    shape = (periods, *opened.plant.shape)

    def white():
        return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)

    known = max(force, 1e-6) * white() * 0.1
    plant = (reading * white() + opened.receptance * force * white()) * louder
    displacement = plant / (1 + opened.plant * opened.controller)
    command = -opened.controller * displacement
    seen = opened.amplifier * command + current * white() * louder
    channels = {"displacement": displacement, "command": command, "current": seen, "force": known}
    return replace(base, periods=channels)


def ratios(base: Record, count: int, seed: int, **options) -> np.ndarray:
    """|mean residual|^2 over its variance as told, (count, outputs, axes, n)."""
    opened, rng = opened_loop(base), np.random.default_rng(seed)
    found = []
    for _ in range(count):
        record = drawn(base, rng, **options)
        mean = opened.residuals(record.mean("displacement"), record.mean("current"))
        found.append(abs(mean) ** 2 / noise_of(record, opened) ** 2)
    return np.array(found)


@pytest.mark.parametrize(
    ("name", "options"),
    [("free", {}), ("free", {"periods": 4}), ("radial", {"force": 3e-3}), ("radial", {"force": 3e-3, "reading": 5e-8})],
)
def test_the_noise_is_the_spread_of_many_records(name, options, request):
    """White in the reading, and coloured by a force through a lightly damped support: every line has its own size."""
    base = request.getfixturevalue(name)
    found = ratios(base, DRAWS, 1, **options)
    freedom = 15 * (options.get("periods", 8) - 1)  # complex, pooled over 15 lines: the ratio is F distributed
    for output in (0, 1):
        assert abs(found[:, output].mean() - freedom / (freedom - 1)) < 0.02
    low = found[:, 0][..., base.frequency < 250].mean(axis=(0, 1))  # the support's resonance lies at 61 Hz
    assert abs(low - 1).max() < 5 / np.sqrt(DRAWS * base.axes)
    assert abs(np.mean(low) - freedom / (freedom - 1)) < 0.06


def test_the_noise_of_a_measured_force_is_added_where_it_drives(free):
    opened, on = opened_loop(free), free.driven["force"][0]
    quiet = replace(free, periods={k: v for k, v in free.periods.items() if k != "force"})
    own, less = noise_of(free, opened), noise_of(quiet, opened)
    np.testing.assert_array_equal(own[0, 0, ~on], less[0, 0, ~on])
    np.testing.assert_array_equal(own[1], less[1])
    added = (own**2 - less**2)[0, 0, on] / abs(opened.receptance[0, on]) ** 2
    expected = 4 / free.experiment.samples_per_period * 5e-3**2 / free.count  # white, 5 mN in every sample
    assert np.mean(added) == pytest.approx(expected, rel=0.3)


def test_a_line_of_its_own_noise_keeps_it_and_its_neighbours_theirs(free):
    louder = np.ones(free.lines.size)
    louder[100] = 40.0
    rng, opened, found = np.random.default_rng(5), opened_loop(free), []
    for _ in range(40):
        found.append(noise_of(drawn(free, rng, periods=8, louder=louder), opened)[0, 0] ** 2 * 8 / 5e-9**2)
    mean = np.mean(found, axis=0)
    assert mean[100] == pytest.approx(1600, rel=0.3)
    assert abs(np.delete(mean[80:121], 20) - 1).max() < 0.1


def test_converters_resolution_is_the_least_noise(free):
    """Where every period is alike, a line is known no better than the converters' steps."""
    alike = {k: v[:1] + 1e-13 * v for k, v in free.periods.items()}
    silent = replace(free.nominal, dac_bits=0)

    def sd(**changes):
        return noise_of(replace(free, periods=alike, nominal=replace(silent, **changes)), opened_loop(free))[:, 0]

    step = 20.0 / 2**16 / 8000.0  # of the ADC, in m; white over half of 5000 lines
    np.testing.assert_allclose(sd()[0], np.sqrt(step**2 / 12 * 4 / 5000), rtol=1e-3)
    np.testing.assert_allclose(sd(adc_bits=12)[0] / sd()[0], 16.0, rtol=1e-3)
    held = np.sqrt((20.0 / 2**14) ** 2 / 12 * 4 / 5000) * abs(opened_loop(free).amplifier[0])
    np.testing.assert_allclose(sd(dac_bits=14)[1], held, rtol=1e-3)
    np.testing.assert_array_less(sd()[0], 0.1 * noise_of(free, opened_loop(free))[0, 0])


@pytest.mark.slow
def test_the_nominal_residual_of_no_effect_is_chi_square(tmp_path):
    """Of 48 simulated records: mean one, variance of an exponential, and a total within what noise allows.

    In the current the command's own noise runs over from period to period: in periods of a quarter of a second its
    spread shows some 5 % more than their mean has.
    """
    e = planned(FREE, names=("base",))[0].experiment
    records = repeated(tmp_path, [replace(e, periods=8, seed=s) for s in range(48)])
    problem = assemble(records)
    power = (abs(problem.data - problem.simulate([Point({}, {})])[0]) ** 2 / 2).reshape(48, -1)
    output = problem.output.reshape(48, -1)[0]
    assert abs(power[:, output == 0].mean() - 1) < 0.025
    assert 0.9 < power[:, output == 1].mean() < 1.01
    totals = power[:, output == 0].sum(axis=1)
    count = (output == 0).sum()
    assert abs(totals - count).max() < 4 * np.sqrt(count)
    assert np.std(totals, ddof=1) == pytest.approx(np.sqrt(count), rel=0.35)
    assert power[:, output == 0].var() == pytest.approx(1.0, abs=0.15)


def test_loud_bands_are_those_that_something_unsynchronised_drives(radial):
    opened, rng = opened_loop(radial), np.random.default_rng(3)
    for _ in range(12):
        assert loud_bands(drawn(radial, rng), opened) == []
        assert loud_bands(drawn(radial, rng, force=3e-3), opened) == []
    band = (radial.frequency > 130) & (radial.frequency < 155)
    for _ in range(5):
        found = loud_bands(drawn(radial, rng, louder=np.where(band, 4.0, 1.0)), opened)
        assert found and all(lo < 160 and hi > 125 and chi2 > 100 for lo, hi, chi2 in found)


@pytest.mark.parametrize("drifting", [False, True])
def test_a_first_period_that_is_not_looked_at_has_no_freedom(radial, drifting):
    """Of the same periods, with one before them that may hold a transient or without it."""
    opened, band = opened_loop(radial), (radial.frequency > 130) & (radial.frequency < 155)
    every = drawn(radial, np.random.default_rng(5), periods=5, louder=np.where(band, 4.0, 1.0))
    rest = replace(every, dropped=1, periods={name: values[1:] for name, values in every.periods.items()})
    found = loud_bands(replace(every, dropped=0), opened, drifting)
    assert found and found == loud_bands(rest, opened, drifting)


def test_a_loud_resonance_is_no_loud_band(radial):
    opened, rng = opened_loop(radial), np.random.default_rng(4)
    assert not any(loud_bands(drawn(radial, rng, force=2e-2), opened) for _ in range(5))


@pytest.mark.slow
def test_a_transient_that_was_kept_is_no_loud_band(tmp_path):
    e = planned(FREE, names=("gains",), seed=107)[0].experiment
    records = repeated(tmp_path, [replace(e, seed=s) for s in range(32)])
    assert not any(loud_bands(record, opened_loop(record)) for record in records)


@pytest.mark.parametrize("steps", [2.0, 5.0, 40.0])
def test_what_a_coarse_converter_makes_of_a_slow_motion_lies_on_few_lines(steps):
    """Against motions that are rounded: as white noise over all lines it would be told too small by far."""
    n, lines, found = 8192, np.arange(1, 41), []
    turn = 2 * np.pi * np.outer(np.arange(1, 21), np.arange(n)) / n
    for seed in range(60):
        motion = np.cos(turn + np.random.default_rng(seed).uniform(0, 2 * np.pi, 20)[:, None]).sum(axis=0)
        motion *= steps / motion.std()
        amplitudes = 2 / n * np.fft.rfft(np.round(motion) - motion)[lines]
        found.append(np.mean(abs(amplitudes) ** 2) / by_rounding(np.round(motion), 1.0, n))
    assert 0.75 < np.mean(found) < 1.3
    assert steps > 5 or by_rounding(np.round(motion), 1.0, n) > 6 * 4 / 12 / n


def test_noise_beyond_the_step_of_a_converter_is_rounded_like_white_noise():
    values = np.round(np.random.default_rng(0).normal(0.0, 3.0, 8192))
    assert by_rounding(values, 1.0, 2048) == pytest.approx(4 / 12 / 2048)
    assert by_rounding(values, 0.0, 2048) == 0.0
