"""PID gains with filters: each filter against scipy and its formula in s, the whole against its parts, the table."""

import tomllib
from functools import reduce
from operator import mul

import numpy as np
import pytest
import scipy

from maglev_env.loop.filtered_pid import FilteredPid, LeadLag, LowPass, Notch
from maglev_env.loop.gain_card import stated_gains
from maglev_env.loop.gains import GAIN_CARDS, Gains, as_table, controller_response, gain_values, with_gains
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.rig.controller_tables import controllers_from_table

DT = 5e-5
ROUNDED = 2e-4  # of nine poles near z = 1, whose polynomial cancels digits
FILTERS = {
    "notch": (Notch(650.0, 0.05, 0.4), lambda s: (s**2 + 0.02 * s + 1) / (s**2 + 0.4 * s + 1)),
    "lead-lag": (LeadLag(150.0, 4.0), lambda s: (1 + 2 * s) / (1 + s / 2)),
    "low-pass": (LowPass(3000.0, 0.6), lambda s: 1 / (s**2 + 1.2 * s + 1)),
}
WHOLE = FilteredPid(
    8000.0, 2000.0, 5.2, 2e-4, 0.05, Notch(120.0), Notch(650.0, 0.05), LeadLag(150.0, 4.0), LowPass(3000.0)
)


def on_circle(frequency):
    return np.exp(2j * np.pi * np.asarray(frequency) * DT)


@pytest.mark.parametrize("name", FILTERS)
def test_a_filter_is_the_bilinear_transform_prewarped_at_its_frequency(name):
    one, in_s = FILTERS[name]
    b, a = one.filter(DT)
    w = 2 * np.pi * one.frequency
    # Coefficients in s from the formula over w: scipy's transform at the rate that maps this frequency on itself.
    size = len(b)
    s = np.linspace(1.0, 2.0, 2 * size - 1)
    rows = np.hstack([s[:, None] ** np.arange(size), -in_s(s)[:, None] * s[:, None] ** np.arange(1, size)])
    found = np.linalg.lstsq(rows, in_s(s), rcond=None)[0]
    above, below = found[:size][::-1], np.concatenate([found[size:][::-1], [1.0]])
    powers = w ** -np.arange(size)[::-1].astype(float)
    expected = scipy.signal.bilinear(above * powers, below * powers, w / (2 * np.tan(w * DT / 2)))
    np.testing.assert_allclose(b, expected[0], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(a, expected[1], rtol=1e-6, atol=1e-9)
    at = np.polyval(b, on_circle(one.frequency)) / np.polyval(a, on_circle(one.frequency))
    assert at == pytest.approx(in_s(1j), rel=1e-12)
    assert np.polyval(b, 1.0) / np.polyval(a, 1.0) == pytest.approx(1.0)
    assert np.abs(np.roots(a)).max() < 1


def test_a_notch_is_as_deep_and_as_wide_as_it_says():
    one = Notch(650.0, 0.01, 0.2)
    f = np.linspace(500.0, 800.0, 30001)
    passed = np.abs(np.polyval(one.filter(DT)[0], on_circle(f)) / np.polyval(one.filter(DT)[1], on_circle(f)))
    assert f[passed.argmin()] == pytest.approx(650.0, abs=0.05) and passed.min() == pytest.approx(0.01, rel=1e-4)
    assert np.ptp(f[passed < np.sqrt(0.5)]) == pytest.approx(0.2 * 650.0, rel=0.02)


def test_a_lead_leads_most_at_its_frequency():
    b, a = LeadLag(150.0, 4.0).filter(DT)
    f = np.linspace(100.0, 200.0, 10001)
    phase = np.angle(np.polyval(b, on_circle(f)) / np.polyval(a, on_circle(f)))
    assert f[phase.argmax()] == pytest.approx(150.0, rel=1e-2) and phase.max() == pytest.approx(np.arcsin(3 / 5))


def test_without_filters_it_is_the_plain_pid():
    z, gains = on_circle(np.geomspace(0.1, 9000.0, 50)), Gains(8000.0, 2000.0, 5.2, 2e-4, 0.05)
    own = FilteredPid(8000.0, 2000.0, 5.2, 2e-4, 0.05)
    np.testing.assert_allclose(controller_response(own, z, DT), controller_response(gains, z, DT), rtol=1e-9)
    identity = with_gains(WHOLE, notch_depth=1.0, notch2_depth=1.0, lead_lag_ratio=1.0, low_pass=None)
    np.testing.assert_allclose(controller_response(identity, z, DT), controller_response(gains, z, DT), rtol=ROUNDED)


def test_the_whole_is_the_product_of_its_parts():
    z = on_circle(np.geomspace(0.1, 9000.0, 50))
    parts = [np.polyval(b, z) / np.polyval(a, z) for b, a in (one.filter(DT) for one in WHOLE.filters.values())]
    plain = controller_response(Gains(8000.0, 2000.0, 5.2, 2e-4, 0.05), z, DT)
    np.testing.assert_allclose(controller_response(WHOLE, z, DT), reduce(mul, parts, plain), rtol=ROUNDED)
    assert WHOLE.filter(DT).order == 9 and WHOLE.filter(DT).of_error


def test_every_number_is_a_gain_with_its_card():
    values = gain_values(WHOLE)
    assert values["notch2_frequency"] == 650.0 and values["low_pass_damping"] == 0.707 and len(values) == 15
    assert [GAIN_CARDS[name] for name in values] == [card for _, _, card in stated_gains(WHOLE)]
    changed = with_gains(WHOLE, kp=1.0, notch_depth=0.3, notch2_depth=0.4)
    assert (changed.kp, changed.notch.depth, changed.notch2.depth) == (1.0, 0.3, 0.4)
    assert changed.notch.frequency == 120.0 and changed.low_pass == WHOLE.low_pass
    with pytest.raises(ValueError, match=r'notch_frequency: .* of the form "filtered_pid", which has no such gain'):
        with_gains(FilteredPid(1.0, 0.0, 0.0), notch_frequency=3.0)


def test_it_is_written_to_a_file_and_read_back():
    text = "\n".join(f"{name} = {toml_value(value)}" for name, value in as_table(WHOLE).items())
    assert controllers_from_table(tomllib.loads(text), "gains") == WHOLE


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"notch": {}}, r"gains.notch: frequency missing"),
        ({"notch": {"frequency": 650.0, "q": 3.0}}, r"gains.notch: unknown key 'q'"),
        ({"notch": {"frequency": 650.0, "depth": -0.1}}, "notch: depth = -0.1"),
        ({"low_pass": {"frequency": "fast"}}, "low-pass: frequency = 'fast' is not a finite number"),
        ({"td": 0.0}, "td = 0.0 s must be positive"),
    ],
)
def test_what_is_no_controller_is_refused_by_name(table, words):
    with pytest.raises(ValueError, match=words):
        controllers_from_table({"form": "filtered_pid", "kp": 1.0, "ki": 0.0, "kd": 0.1, **table}, "gains")


def test_a_filter_beyond_half_the_control_rate_is_refused():
    with pytest.raises(ValueError, match="a notch at 10000 Hz does not lie below half of the control rate of 20000 Hz"):
        FilteredPid(1.0, 0.0, 0.0, notch=Notch(10_000.0)).filter(DT)


def test_a_recursion_that_its_coefficients_do_not_hold_is_refused():
    slow = FilteredPid(8000.0, 2000.0, 5.2, notch=Notch(2.0), notch2=Notch(1.0), low_pass=LowPass(4.0))
    with pytest.raises(ValueError, match="the filters lie too far below the control rate of 20000 Hz"):
        slow.filter(DT)
    assert slow.filter(1e-2).order == 8
