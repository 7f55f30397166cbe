"""Gains and delays of one or two inputs: recovered, with errors that are those of their scatter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.redundancy.cause import causes
from maglev_env.redundancy.explained import _row, explained
from maglev_env.redundancy.rows import LEVEL, Row, fit, low_pass

RATE, N, P = 1000.0, 80, 6
F = np.linspace(2, 300, N)


def spectra(rng, size=1.0):
    return size * np.exp(2j * np.pi * rng.uniform(size=N))


def noisy(rng, mean, sd, periods=P):
    return mean + sd * (rng.normal(size=(periods, N)) + 1j * rng.normal(size=(periods, N))) / np.sqrt(2)


@pytest.mark.parametrize(("gain", "delay"), [(1.0, 0.0), (2.0, 1.0), (-0.5, -3.3), (9.81, 10.0)])
def test_a_gain_and_a_delay_are_recovered(gain, delay):
    rng = np.random.default_rng(1)
    x = spectra(rng)
    y = gain * x * np.exp(-2j * np.pi * F * delay / RATE)
    found = fit(noisy(rng, y, 1e-3), [np.tile(x, (P, 1))], F, RATE, True)
    assert found.gain[0] == pytest.approx(gain, rel=0.01)
    assert found.delay[0] * RATE == pytest.approx(delay, abs=0.02) and found.misfit < 0.01


def test_two_inputs_are_told_apart():
    rng = np.random.default_rng(2)
    a, b = spectra(rng), spectra(rng)
    y = 1.5 * a * np.exp(-2j * np.pi * F * 2 / RATE) - 0.7 * b
    found = fit(noisy(rng, y, 0.01), [np.tile(a, (P, 1)), np.tile(b, (P, 1))], F, RATE, True)
    assert found.gain == pytest.approx([1.5, -0.7], rel=0.02)
    assert found.delay * RATE == pytest.approx([2.0, 0.0], abs=0.05)


@pytest.mark.parametrize("sd", [0.05, 0.5])
def test_the_errors_are_those_of_the_scatter_and_a_null_raises_no_alarm(sd):
    scores, alarms = [], 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        x = spectra(rng)
        found = fit(noisy(rng, x, sd), [np.tile(x, (P, 1))], F, RATE, True)
        scores.append([(found.gain[0] - 1) / found.gain_se[0], found.delay[0] / found.delay_se[0]])
        row = Row("r", {"a": 1, "b": -1}, found.gain[0], found.gain_se[0], 0.0, "b", found.delay[0], found.delay_se[0])
        alarms += row.off
    spread = np.std(scores, axis=0)
    assert (spread > 0.75).all() and (spread < 1.25).all()  # the model's 1 % per line makes errors a little larger
    assert alarms == 0 and np.abs(scores).max() < LEVEL


@pytest.mark.parametrize("periods", [2, 3, 5])
def test_few_periods_of_noise_alone_are_no_misfit_and_no_gain(periods):
    """The mean of 1 over a variance by P periods is (P - 1) / (P - 2): 5 % of noise had been a misfit of up to 5 %."""
    misfits, scores = [], []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = spectra(rng)
        found = fit(noisy(rng, x, 0.05 * np.sqrt(periods), periods), [np.tile(x, (periods, 1))], F, RATE, True)
        misfits.append(found.misfit)
        scores.append((found.gain[0] - 1) / found.gain_se[0])
    assert np.mean(np.square(misfits)) < 0.02**2 and 0.7 < np.std(scores) < 1.3


def test_a_low_pass_is_told_from_a_delay_and_on_which_side_it_is():
    rng = np.random.default_rng(3)
    x = np.tile(spectra(rng), (P, 1))
    pole = 1 / (1 + 2j * np.pi * F / 300)
    for out, source, sign in ((x * pole, x, 1), (x, x * pole, -1)):
        y = noisy(rng, out, 1e-3)
        misfit = fit(y, [source], F, RATE, True).misfit
        lag, _ = low_pass(y, source, F, RATE, True, misfit)
        assert misfit > 0.05 and lag == pytest.approx(sign / 300, rel=0.1)


def test_nothing_is_said_of_too_few_lines_or_without_power():
    x = np.ones((P, N), complex)
    assert fit(x[:, :4], [x[:, :4]], F[:4], RATE, True) is None
    assert fit(x, [0 * x], F, RATE, True) is None


def test_one_line_tells_no_delay():
    """A sine whose phase is off by a third of a degree would be a delay of a sample at a thousandth of the rate."""
    rng, t, length = np.random.default_rng(3), np.arange(16_384) / RATE, 1024
    window = np.hanning(length + 1)[:-1]

    def segments(x):
        cut = np.stack([x[s : s + length] for s in range(0, x.size - length + 1, length // 2)])
        return np.fft.rfft(cut * window, axis=-1)[:, 1:250]

    frequency = np.arange(1, 250) * RATE / length
    sine, white = np.sin(2 * np.pi * 3.1 * t), rng.normal(size=t.size)
    for drive, told in ((sine, False), (white, True)):
        out = np.roll(drive, 1) + 1e-3 * rng.normal(size=t.size)
        found = fit(segments(out), [segments(drive)], frequency, RATE, False)
        assert found.gain[0] == pytest.approx(1.0, abs=0.01)
        assert (found.time(0) is not None) == told
    assert found.time(0) * RATE == pytest.approx(1.0, abs=0.01)


def test_a_mass_makes_nothing_late():
    powers = {"displacement": 1, "current": -1, "mass": 1}
    known = Row("newton current", powers, 1.04, 1e-3, 0.1, "the current", -5e-4, 1e-6, 3e-4)
    assert known.delay_off() and not known.gain_off()
    assert not {cause.name for cause in causes([known], RATE)} & {"mass"}
    heavier = replace(known, gain=1.5, delay=0.0)
    assert "mass" in {cause.name for cause in causes([heavier], RATE)}


def test_of_two_channels_of_which_one_is_late_a_sentence_says_what_to_check():
    late = Row("amplifier", {"current": 1, "command": -1}, 1.0, 0.001, 0.1, "the command", 3 / RATE, 1e-6, 1e-4,
               delay_effects=("delay",))  # fmt: skip
    said = _row(SimpleNamespace(rate=RATE, recording="run"), late).message
    assert "late by 3 samples against the command: check when each is sampled; it may be an effect (delay): run" in said


def test_a_mass_that_a_row_alone_tells_is_known_as_the_row_is_and_makes_nothing_early():
    """A mass of half the true one was 0.537 +- 0.005 times it: a row's noise is no measure of the stiffness in it."""
    powers = {"displacement": 1, "current": -1, "mass": 1}
    wrong = Row("newton current", powers, 0.537, 0.002, 0.4, "the current", -1e-7 / RATE, 1e-9 / RATE, 0.0)
    held = [
        Row("controller", {"command": 1, "displacement": -1}, 1.0, 1e-3, 0.01, "the controller"),
        Row("amplifier", {"current": 1, "command": -1}, 1.0, 1e-3, 0.01, "the command"),
    ]
    view = SimpleNamespace(rate=RATE, recording="run", columns={}, recorded={"displacement"}, gains=None)
    (found,) = explained(view, [wrong, *held])
    assert found.channel == "mass" and "what is stated is 0.537 +- 0.1 times what is shown" in found.message
    assert found.interval[0] < 0.5 < found.interval[1] and "early" not in found.message
    told = replace(wrong, notes={"mass": 0.501, "mass_se": 0.01})
    assert "0.501 +- 0.02 times" in explained(view, [told, *held])[0].message


def test_what_a_stated_peak_confirms_is_not_accused_of_the_average_of_two_rows_that_disagree():
    """A probe gain of 1.25 times the stated one was "force: factor 0.968 +- 0.003", which nothing in the file shows."""
    newton = Row("newton force", {"displacement": 1, "force": -1, "mass": 1}, 1.364, 0.002, 0.3, "the force on 0.5 kg")
    peak = Row("designed force", {"force": 1}, 1.0, 0.001, 0.02, "its stated peak")
    assert {cause.name for cause in causes([newton, peak], RATE)} == {"displacement", "mass"}
    view = SimpleNamespace(rate=RATE, recording="run", columns={}, recorded={"displacement", "force"}, gains=None)
    found = explained(view, [newton, peak])[0]
    assert found.channel.startswith("displacement") and found.interval[0] < 1.25 < found.value < found.interval[1]
