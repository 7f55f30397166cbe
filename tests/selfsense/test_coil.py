"""The switched coil against closed forms, scipy's integrator, a sheet's diffusion, and its own energy."""

from dataclasses import replace

import numpy as np
import pytest
from reference_coil import Sheet, drive_at_samples, reference_current

from selfsense.coil import MU_0, Coil, coil_inductance
from selfsense.demodulation import ripple_amplitude
from selfsense.kernel_rows import EDDY_RATES, EDDY_WEIGHTS
from selfsense.sensor import Estimator, SelfSensor
from selfsense.simulate import simulate
from selfsense.supply import Acquisition, Supply

COIL = Coil(turns=90, pole_area=39.27e-6, resistance=2.0)
CORED = replace(COIL, core_length=2e-5)
GAP = 0.35e-3
RIPPLE = 24.0 * 40e-6 / (2 * COIL.inductance(GAP))  # A, peak to peak at half duty: what errors are told in


def sensor(coil=COIL, supply=None, rate=250e3, gap=GAP):
    believed = Coil(90, 39.27e-6, 2.0)
    return SelfSensor(
        coil, supply or Supply(), Acquisition(rate), Estimator(believed, 24.0, 0.0, 0.0, (2e-5, 0.7e-3)), gap
    )


def times(s, periods):
    return np.arange(1, round(periods * s.acquisition.rate / s.supply.frequency) + 1) / s.acquisition.rate


def compare(s, gap, drive, periods):
    """Errors of current (over the ripple) and switching voltage, and the simulated current (A)."""
    gap = gap(times(s, periods))
    current, switching = reference_current(s, gap, drive)
    sensed = simulate([s], gap, drive_at_samples(s, len(gap), drive))
    return (sensed.current[0] - current) / RIPPLE, sensed.switching[0] - switching, sensed.current[0]


def sine(t):
    return GAP + 50e-6 * np.sin(2 * np.pi * 200 * t)


def ramp(t):
    return GAP - 0.1 * t


def still(t):
    return GAP + 0 * t


def swing(k):
    return 0.1 + 0.35 * np.sin(2 * np.pi * 300 * k / 25e3)


@pytest.mark.parametrize(("states", "drive"), [*((2, d) for d in (-0.6, -0.3, 0.0, 0.1, 0.6)), (3, 0.3), (3, -0.55)])
def test_ripple_without_resistance_is_the_triangle_of_eq_6_15(states, drive):
    """Edges fall on samples (40 a period), so a line through the samples is the current itself."""
    supply, coil = Supply(states=states), replace(CORED, resistance=0.0)
    current = simulate([sensor(coil, supply, rate=1e6)], np.full(800, GAP), drive).current[0]
    alpha = (1 + drive) / 2 if states == 2 else abs(drive)
    inductance = MU_0 * 90**2 * 39.27e-6 / (2e-5 + 2 * GAP)
    mean_slope = drive * 24.0 / inductance
    fine = np.linspace(400, 440, 100_001) / 40
    ripple = np.interp(fine, np.arange(1, 801) / 40, current) - mean_slope * 40e-6 * fine
    height = (2 if states == 2 else 1) * 24.0 * 40e-6 / inductance * alpha * (1 - alpha)
    assert np.ptp(ripple) == pytest.approx(height, rel=1e-9)
    ripple -= np.trapezoid(ripple, fine)
    rectified = np.trapezoid(np.abs(ripple), fine)
    assert rectified == pytest.approx(height / 4, rel=1e-6)
    assert rectified == pytest.approx(ripple_amplitude(coil, supply, GAP, drive), rel=1e-6)
    if states == 2:
        eq_6_20 = alpha * (1 - alpha) * 24.0 * 40e-6 / coil.constant * (2e-5 + 2 * GAP)
        assert rectified == pytest.approx(eq_6_20 / 2, rel=1e-6)


@pytest.mark.parametrize("rate", [250e3, 165e3, 62.5e3])
@pytest.mark.parametrize("states", [2, 3])
@pytest.mark.parametrize("gap", [sine, ramp])
@pytest.mark.parametrize(
    ("coil", "tolerance"),  # at 250 kHz: the flux linkage's step is of second order, the current's exact
    [(COIL, 1e-5), (replace(CORED, magnet_emf=30.0), 1e-5), (replace(COIL, back_emf=False), 1e-9)],
    ids=["back_emf", "magnet", "eq_6_13"],
)
def test_current_follows_the_circuit_equation(coil, tolerance, gap, states, rate):
    s = sensor(coil, Supply(states=states), rate)
    error, switching, _ = compare(s, gap, swing, periods=30)
    assert np.abs(error).max() < tolerance * (250e3 / rate) ** 2
    np.testing.assert_allclose(switching, 0.0, atol=1e-11)


def test_voltages_of_the_motion_are_far_above_those_tolerances():
    gap = ramp(times(sensor(), 30))
    coils = [COIL, replace(COIL, back_emf=False), replace(COIL, magnet_emf=30.0)]
    current = simulate([sensor(c) for c in coils], gap, 0.3).current / RIPPLE
    assert np.abs(current[1:] - current[0]).max(axis=1).min() > 0.03


@pytest.mark.parametrize("rate", [250e3, 165e3, 62.5e3])
@pytest.mark.parametrize("states", [2, 3])
@pytest.mark.parametrize("bias", [-0.15, 0.0, 0.15])
def test_dead_time_follows_the_sign_of_the_current_at_each_edge(bias, states, rate):
    s = sensor(supply=Supply(states=states, dead_time=1e-6), rate=rate)

    def drive(k):
        return bias + 0.25 * np.sin(2 * np.pi * 300 * k / 25e3)

    error, switching, current = compare(s, sine, drive, periods=90)
    assert np.abs(error).max() < 1e-5 * (250e3 / rate) ** 2
    np.testing.assert_allclose(switching, 0.0, atol=1e-11)
    if bias == 0:
        assert (current < -0.3).any() and (current > 0.3).any()
    plain = replace(s, supply=replace(s.supply, dead_time=0.0))
    drives = drive_at_samples(s, len(current), drive)
    without = simulate([plain], sine(times(s, 90)), drives).current[0]
    assert np.abs(without - current).max() > 0.02 * RIPPLE


@pytest.mark.parametrize(("states", "level"), [(2, -1.0), (2, 1.0), (3, -1.0), (3, 0.0), (3, 1.0)])
def test_without_a_pulse_there_is_no_dead_time(level, states):
    """A leg that does not switch loses nothing: full drive is the whole voltage, no drive of three states none."""
    s = sensor(supply=Supply(states=states, dead_time=2e-6))
    drive = np.where(np.arange(400) < 200, -level or 0.4, level)  # the current still flows the other way at first
    switching = simulate([s], np.full(400, GAP), drive).switching[0, 210:]
    np.testing.assert_allclose(switching.reshape(-1, 10).mean(axis=1), level, atol=1e-12)


@pytest.mark.parametrize(("low", "high", "error"), [(0.0, 1.0, 1e-4), (1.0, 50.0, 2.5e-3), (50.0, 300.0, 0.016)])
def test_eddy_modes_stand_for_z_coth_z(low, high, error):
    """High s tau counts less: the ripple's harmonics fall."""
    s = 1j * np.linspace(low + 1e-9, high, 500)
    z = np.sqrt(s)
    modes = 1 + sum(w * s / (s + rate) for w, rate in zip(EDDY_WEIGHTS, EDDY_RATES, strict=True))
    found = np.abs(modes * np.tanh(z) / z - 1).max()
    assert error / 3 < found < error
    assert sum(w / rate for w, rate in zip(EDDY_WEIGHTS, EDDY_RATES, strict=True)) == pytest.approx(1 / 3, abs=1e-9)


@pytest.mark.parametrize("frequency", [250.0, 25e3, 1e6])
def test_the_reference_sheet_diffuses_as_z_coth_z(frequency):
    coil = replace(CORED, lamination=0.23e-3)
    s = 2j * np.pi * frequency
    z = np.sqrt(s * MU_0 * 5000 * 2e6) * 0.115e-3
    assert coil.diffusion_time == pytest.approx(1.662e-4, rel=1e-3)
    assert Sheet(coil).reluctance(s) == pytest.approx(z / np.tanh(z), rel=1e-6)


# Largest and rms error over the ripple: of the four modes above 0.1 mm, of the step below.
@pytest.mark.parametrize(
    ("lamination", "largest", "rms"), [(0.1e-3, 5e-5, 2e-5), (0.23e-3, 3e-4, 1e-4), (0.35e-3, 1.5e-3, 3e-4)]
)
@pytest.mark.parametrize("gap", [still, sine])
def test_current_of_a_laminated_core(gap, lamination, largest, rms):
    s = sensor(replace(CORED, lamination=lamination))
    error, _, current = compare(s, gap, swing, periods=15)
    assert np.abs(error).max() < largest and error.std() < rms
    without = simulate([sensor(CORED)], gap(times(s, 15)), drive_at_samples(s, 150, swing)).current[0]
    assert np.abs(without - current).max() > 20 * largest * RIPPLE


@pytest.mark.parametrize("rate", [250e3, 165e3])
def test_current_of_a_saturating_core(rate):
    s = sensor(replace(CORED, saturation_field=1.4, bias_field=0.8), rate=rate)
    error, _, current = compare(s, sine, swing, periods=20)
    assert np.abs(error).max() < 4e-5 * (250e3 / rate) ** 2
    samples = times(s, 20)
    drive = drive_at_samples(s, len(samples), swing)
    without = simulate([sensor(CORED, rate=rate)], sine(samples), drive).current[0]
    assert np.abs(without - current).max() > 0.01 * RIPPLE


def test_current_of_a_laminated_and_saturating_core_between_samples():
    s = sensor(replace(CORED, saturation_field=1.4, bias_field=0.548, lamination=0.23e-3, magnet_emf=10.0), rate=165e3)
    error, _, _ = compare(s, sine, swing, periods=15)
    assert np.abs(error).max() < 3e-4


def test_thin_sheets_and_sparse_samples_leave_the_modes_settled():
    """Modes far faster than a sample: z coth z is 1 + s tau / 3, a current that goes with the voltage on the flux."""
    plain = replace(CORED, resistance=0.0)
    thin = replace(plain, lamination=2e-6)
    current = simulate([sensor(c, rate=62.5e3) for c in (thin, plain)], np.full(500, GAP)).current
    volts = np.tile([24.0, -24.0, 24.0, -24.0, -24.0], 100)  # at 0.4, 0.8, 0.2, 0.6 and 1 of a period
    eddy = CORED.core_length / CORED.constant * thin.diffusion_time / 3 * volts
    np.testing.assert_allclose(current[0] - current[1], eddy, rtol=1e-3)


def test_energy_of_one_period_is_loss_field_and_work():
    """V i dt = R i^2 dt + d(L i^2 / 2) + i^2 dL / 2: the motion takes the last, here two thirds of what is supplied."""
    balance = {}
    for back_emf in (True, False):
        s = sensor(replace(COIL, back_emf=back_emf), rate=5e6)
        gap = GAP + 100e-6 * np.sin(2 * np.pi * 2000 * times(s, 50))
        sensed = simulate([s], gap, 0.3)
        i, gap, volts = sensed.current[0, -201:], gap[-201:], 24.0 * sensed.switching[0, -200:]
        inductance = MU_0 * 90**2 * 39.27e-6 / (2 * gap)
        mean, mean_square = (i[1:] + i[:-1]) / 2, (i[1:] ** 2 + i[:-1] ** 2) / 2
        supplied = (volts * mean).sum() / 5e6
        stored = (inductance[-1] * i[-1] ** 2 - inductance[0] * i[0] ** 2) / 2
        work = (mean_square * np.diff(inductance)).sum() / 2
        balance[back_emf] = (supplied - 2.0 * mean_square.sum() / 5e6 - stored - work) / supplied
        assert abs(work / supplied) > 0.5
    assert abs(balance[True]) < 1e-6
    assert abs(balance[False]) > 0.5  # eq 6.13 makes energy out of motion


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"turns": 0}, "coil: turns = 0 must be positive"),
        ({"turns": None}, "coil: turns = None is not a finite number"),
        ({"pole_area": -1e-5}, "coil: pole_area = -1e-05 must be positive"),
        ({"pole_area": "39"}, "coil: pole_area = '39' is not a finite number"),
        ({"resistance": -1.0}, "coil: resistance = -1 must be at least 0"),
        ({"resistance": True}, "coil: resistance = True is not a finite number"),
        ({"core_length": float("nan")}, "coil: core_length = nan is not a finite number"),
        ({"magnet_emf": float("inf")}, "coil: magnet_emf = inf is not a finite number"),
        ({"core_length": 1e-5, "saturation_field": 0.0}, "coil: saturation_field = 0 must be positive"),
        ({"core_length": 1e-5, "lamination": -1e-4}, "coil: lamination = -0.0001 must be at least 0"),
        ({"lamination": 1e-4}, "need a core: give core_length"),
        ({"core_length": 1e-5, "saturation_field": 1.4, "back_emf": False}, "with the back-EMF: set back_emf"),
    ],
)
def test_bad_coils_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(COIL, **changes)


def test_the_inductance_is_the_measured_one_and_falls_off_with_the_gap():
    """0.57 mH of 90 turns at 0.35 mm (D 3.3.2); half at twice the gap, four times with twice the turns."""
    at = coil_inductance(0.35e-3, 90, 39.27e-6)
    assert at == pytest.approx(0.57e-3, rel=0.005)
    assert coil_inductance(0.7e-3, 90, 39.27e-6) == pytest.approx(at / 2, rel=1e-12)
    assert coil_inductance(0.35e-3, 180, 39.27e-6) == pytest.approx(4 * at, rel=1e-12)
