"""Errors under mismatch against the closed form of the converged gap, the linear tracking, and the duty's cosine."""

from dataclasses import replace

import numpy as np
import pytest

from selfsense.coil import Coil
from selfsense.forward_path import AnalogPath
from selfsense.linear import tracking
from selfsense.robustness import expected_gap, mismatches, robustness
from selfsense.sensor import Estimator, SelfSensor
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0, core_length=20e-6)
PULL = 600.0  # A/m: of the amplitude by the gap
ESTIMATOR = Estimator(COIL, 24.0, 1.9 / PULL, 2.2e4 / PULL, (0.02e-3, 0.7e-3))
SENSOR = SelfSensor(COIL, Supply(), Acquisition(), ESTIMATOR, 0.35e-3)
ANALOG = replace(SENSOR, estimator=replace(ESTIMATOR, path=AnalogPath(), kp=0.5 / PULL, ki=1.2e4 / PULL))


def drifting(sensor):
    """10.5 samples per PWM period: an edge falls half a sample further on every other time."""
    return replace(sensor, acquisition=replace(sensor.acquisition, rate=262.5e3))


@pytest.fixture(scope="module")
def digital():
    return {row.name: row for row in robustness(mismatches(SENSOR))}


@pytest.fixture(scope="module")
def analog():
    return {row.name: row for row in robustness(mismatches(drifting(ANALOG)))}


def test_the_table_holds_every_mismatch(digital):
    assert len(digital) == 12
    table = mismatches(SENSOR, change=0.1)
    assert table["pole area -10%"].coil.pole_area == pytest.approx(0.9 * COIL.pole_area)
    assert table["voltage +10%"].supply.voltage == pytest.approx(26.4)
    assert all(sensor.estimator == ESTIMATOR for sensor in table.values())


def test_what_a_wrong_pole_area_does_by_hand():
    """A coil of 0.8 of the area ripples as one at 1.25 of the gap and half core: 1.25 x 360 - 10 µm."""
    assert expected_gap(mismatches(SENSOR)["pole area -20%"], 0.35e-3) == pytest.approx(440e-6)


@pytest.mark.parametrize("path", ["digital", "analog"])
def test_static_errors_are_those_of_the_closed_form(path, digital, analog):
    """Left over: the resistance and, at ten samples per period, what edges on samples make of it."""
    rows, offset, gain = (digital, 0.7e-6, 4e-3) if path == "digital" else (analog, 0.15e-6, 2e-3)
    for name, row in rows.items():
        if path == "digital" and name == "eddy currents":
            continue
        # The closed form takes a sheet's reluctance at the PWM frequency alone; its harmonics are worth 0.3 µm.
        near, slope = (0.45e-6, 3e-3) if name == "eddy currents" else (offset, gain)
        assert row.offset == pytest.approx(row.expected_offset, abs=near), name
        assert row.gain == pytest.approx(row.expected_gain, abs=slope), name
    assert abs(rows["eddy currents"].expected_offset) > 25e-6
    assert rows["eddy currents"].expected_gain < 1 - 4e-3


def test_a_saturated_core_shifts_the_gap_by_its_slope():
    strong = mismatches(drifting(ANALOG), bias_field=1.0)["saturation"]
    (row,) = robustness({"saturation": strong}, amplitude=5e-6, duty=1e-3)
    assert row.expected_offset == pytest.approx(9 * 10e-6 * (2 / 3) ** 8)
    assert row.offset == pytest.approx(row.expected_offset, rel=0.05)


def test_the_moving_duty_is_suppressed_ten_times_and_three_with_every_mismatch(digital, analog):
    assert digital["as believed"].suppression > 10
    assert digital["as believed"].duty_suppression > 100
    for rows in (digital, analog):
        for name, row in rows.items():
            if rows is digital and name == "eddy currents":
                continue
            assert row.suppression > 3, name
            assert row.duty_suppression > 10, name


def test_eddy_currents_need_samples_that_drift_against_the_switching(digital):
    """Ten samples per period take the jump at an edge all or not at all; at 10.5 the estimate averages it."""
    locked, eddy = digital["eddy currents"], mismatches(drifting(SENSOR))["eddy currents"]
    (row,) = robustness({"eddy currents": eddy})
    assert locked.suppression < 3
    assert row.suppression > 5
    assert row.offset == pytest.approx(row.expected_offset, abs=4e-6)


def test_the_error_left_as_believed_is_the_lag_of_the_tracking(digital):
    row, lag = digital["as believed"], abs(1 - tracking(SENSOR, 100.0))
    assert row.estimator == pytest.approx(50e-6 / np.sqrt(2) * lag, rel=0.02)
    assert row.estimator == pytest.approx(row.raw, rel=1e-3)


def test_the_demodulator_errs_with_the_fundamental_of_the_duty():
    """A band-pass keeps the ripple's fundamental, which falls with the cosine of a quarter turn of the drive."""
    swing = 0.2 * np.cos(np.linspace(0, 2 * np.pi, 1000))
    expected = 360e-6 * np.sqrt(np.mean((1 - np.cos(np.pi / 2 * swing)) ** 2))
    (row,) = robustness({"fine": replace(ANALOG, acquisition=Acquisition(rate=1e6))})
    assert row.demodulator_duty == pytest.approx(expected, rel=0.05)


def test_a_calibration_takes_back_offset_and_gain(digital):
    row = digital["pole area -20%"]
    assert row.raw > 80e-6
    assert row.estimator == pytest.approx(digital["as believed"].estimator, rel=0.01)


def test_bad_input():
    with pytest.raises(ValueError, match="need a core"):
        mismatches(replace(SENSOR, coil=replace(COIL, core_length=0.0)))
    with pytest.raises(ValueError, match="three: the supply has 3 states"):
        robustness({"three": replace(SENSOR, supply=Supply(states=3))})
    with pytest.raises(ValueError, match="duty = 0"):
        robustness({"believed": SENSOR}, duty=0.0)
    with pytest.raises(ValueError, match="amplitude = 0"):
        robustness({"believed": SENSOR}, amplitude=0.0)
    with pytest.raises(ValueError, match="believed: frequency = 9000"):
        robustness({"believed": SENSOR}, frequency=9000.0)
    narrow = replace(SENSOR, estimator=replace(ESTIMATOR, gap_range=(0.02e-3, 0.38e-3)))
    with pytest.raises(ValueError, match="narrow: the estimate runs into the end"):
        robustness({"narrow": narrow})
