"""Self-sensing in the loop: the lane kernel against a slow simulator on scipy's integrator, linear theory, itself."""

import json
import warnings
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from planar_rigs import UNLIKE
from reference_self_sensing import simulate as simulate_slowly
from typer.testing import CliRunner

from estimation.lines.frequency_response import frequency_response
from estimation.stability_margins import margin_arrays
from maglev_env.channels import NOISY
from maglev_env.design.defaults import with_defaults
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import (
    Experiment,
    axis_experiment,
    protocol_experiment,
    recorded_channels,
    self_sensors,
    without_noise,
)
from maglev_env.kernel.advance import kernel
from maglev_env.kernel.blocks import blocks_of
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.kernel.state import REGULAR, State
from maglev_env.linear.expected import expected_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.loop.self_sensing_pieces import SELF
from maglev_env.loop.self_sensor import SelfSensing
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.recording import read_recording, simulated_recording
from maglev_env.rig.excitation import Excitation, lines_at
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_env.rig.self_sensor import self_sensor
from maglev_lanes.layout import LANES
from maglev_workbench.cli import app
from selfsense import kernel_rows as rows
from selfsense.linear import tracking
from selfsense.supply import Supply

FREE, PER_AMPERE = load_rig("hmb_free"), 1 / 600  # m: where a change of the gap moves the ripple by 1 A
GAINS = {"kp": 0.5 * PER_AMPERE, "ki": 1e4 * PER_AMPERE}
RATE = SelfSensing().sample_rate
EVERY = Fraction(RATE / FREE.control_rate).denominator  # of so many control instants one has a current sample
DT = 1 / FREE.control_rate
BALL = """
schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.058
gap = 2e-3
turns = 300
pole_area = 3e-4
control_rate = 5000.0
coil_resistance = 2.0
amplifier_time_constant = 1e-4
[gains]
kp = 518.0
ki = 51.8
kd = 3.82
td = 1e-3
ti = 0.1
[self_sensing]
core_length = 5e-4
"""


def sensing(rig=FREE, **changes):
    """The rig with its [self_sensing] changed; estimator gains of the standard coil where none are given."""
    return replace(rig, self_sensing=SelfSensing(**(GAINS | changes)))


def excited(rig, force=1.0, current=0.1, **changes):
    """50 ms periods of force and injection on lines in turn."""
    excitations = (
        Excitation("sphs", "force", 20.0, tuple(range(1, 24, 2)), force, direction=30.0 * (rig.axes - 1)),
        Excitation("sphs", "current", 20.0, (2, 6, 10, 20, 40, 60, 80, 100), current, direction=50.0 * (rig.axes - 1)),
    )
    e = Experiment(rig, rig.gains, excitations, periods=2, transient_periods=0, sensor="self_sensing")
    return replace(e, **changes)


def quiet(e):
    """No noise, and converters so fine that a step of theirs is below what anything is compared to."""
    e = without_noise(e)
    return replace(e, rig=replace(e.rig, dac_bits=30))


def weaker(e, factor):
    return replace(e, excitations=tuple(replace(x, amplitude=x.amplitude * factor) for x in e.excitations))


def rms(x):
    return np.sqrt(np.mean(np.square(x)))


def channel(e, record, name):
    return record[recorded_channels(e).index(name)]


# The kernel takes the gap between two current samples as a straight line; what that leaves falls with their square.
LOOPS = {
    "250 kHz": (lambda: excited(sensing(sample_rate=250e3)), 600, 1e-5),
    "500 kHz": (lambda: excited(sensing(sample_rate=500e3)), 600, 2.5e-6),
    "300 kHz": (lambda: excited(sensing(sample_rate=300e3)), 400, 7e-6),
    "PWM periods that begin between samples": (lambda: excited(sensing(sample_rate=165e3)), 400, 2.3e-5),
    "as it is shipped": (lambda: excited(FREE), 400, 1e-5),
    "late by one and a half samples, a second amplifier pole": (
        lambda: excited(sensing(sample_rate=250e3), effects=effect("delay", 75e-6) | effect("amplifier_lag", 3e-5)),
        400,
        1.2e-5,
    ),
    "dead time, and a bias that keeps the current's sign": (
        lambda: excited(replace(sensing(dead_time=1e-6), bias_current=1.0)),
        400,
        1e-5,
    ),
    "pair of electromagnets at 5 kHz": (
        lambda: excited(replace(load_rig("eframe"), self_sensing=SelfSensing(kp=0.09, ki=440.0)), 2.0, 0.05),
        120,
        3e-6,
    ),
    "one electromagnet with a core": (
        lambda: excited(
            replace(rig_from_toml(BALL, "ball"), self_sensing=SelfSensing(kp=0.23, ki=1100.0, core_length=5e-4)),
            0.05,
            0.01,
        ),
        120,
        4e-5,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", LOOPS)
def test_the_whole_loop_is_that_of_the_slow_simulator(case):
    make, samples, tolerance = LOOPS[case]
    e = quiet(make())
    slow, record = simulate_slowly(e, samples), simulate_records([e])[0][:, :samples]
    names = {"displacement": slow.reading, "position": slow.position, "command": slow.command, "current": slow.current}
    for name, expected in names.items():
        assert rms(channel(e, record, name) - expected) < tolerance * rms(expected), name
    assert rms(slow.reading - slow.position) > 300 * tolerance * rms(slow.position)  # the sensor is no mere wire


@pytest.mark.slow
def test_commands_pass_the_converter_count_for_count():
    e = quiet(excited(sensing()))
    e = replace(e, rig=replace(e.rig, dac_bits=14, rounds=True))
    slow, record = simulate_slowly(e, 200), simulate_records([e])[0][:, :200]
    # Later a command falls so close to the middle of two counts that 1e-10 m decide.
    np.testing.assert_allclose(channel(e, record, "command"), slow.command, rtol=0, atol=1e-12)
    assert rms(channel(e, record, "displacement") - slow.reading) < 1e-5 * rms(slow.reading)


def coil_currents(e, samples):
    """What flows in the kernel's coil at every control instant, A, and its gap, m."""
    (block,) = blocks_of([e], 1)
    state = State(block)
    structure = block.batch.structure
    step, switches = kernel(structure), structure.switches()
    out = np.empty(len(structure.channels) * LANES)
    seeds = np.ascontiguousarray(state.seeds[:, NOISY.index("displacement")]).reshape(-1)
    waves = [np.resize(e.waveform(place), samples) for place in ("force", "current", "reference")]
    found = np.empty((2, samples))
    for t in range(samples):
        linkage, gap, first, second = (
            state.axis_rows(SELF + row)[0, 0] for row in (rows.COIL, rows.GAP, rows.INVERSE_0, rows.INVERSE_1)
        )
        found[:, t] = linkage * (first + second * gap), gap
        clocks = t, state.timing, switches, REGULAR
        step(state.rows.reshape(-1), seeds, state.history, *clocks, *(w[t : t + 1] for w in waves), out)
    return found


def test_the_regulator_holds_the_mean_current_at_bias_and_control_current():
    e, samples = quiet(excited(sensing())), 300
    slow = simulate_slowly(e, samples)
    current, gap = coil_currents(e, samples)
    # 10 uA are a hundred-thousandth of the ripple.
    assert np.abs(current - slow.coil)[::EVERY].max() < 1e-5
    assert np.abs(e.rig.gap - gap - slow.position)[::EVERY].max() < 1e-9
    middle = slow.begin + 0.5 / 25e3
    t = np.minimum((middle / DT).astype(int), samples - 1)
    lag = np.exp(-(middle - t * DT) / e.rig.amplifier_time_constant)
    control = slow.command[t] + (slow.current[t] - slow.command[t]) * lag
    off = (slow.mean - e.rig.bias_current - control)[4:]  # the first periods bring the coil from rest to its bias
    # What remains: the amplifier's current is carried on in a straight line over the period, up to a sample ahead.
    assert rms(off) < 0.012 * rms(control) and np.abs(off).max() < 0.035 * rms(control)
    assert rms(control) > 0.1 and np.ptp(slow.duty) > 0.05


@pytest.fixture(scope="module")
def scored():
    """The protocol of hmb_free on the probe, and on self-sensing with the estimator that its TOML asks for."""
    return evaluate([protocol_experiment(FREE)]), evaluate([protocol_experiment(FREE, sensor="self_sensing")])


def test_it_levitates_through_the_protocol_almost_as_on_the_probe(scored):
    probe, sensed = scored
    assert sensed.feasible[0] and sensed.score[0] > 0.95
    assert sensed.stiffness[0] == pytest.approx(probe.stiffness[0], rel=0.01)
    assert sensed.damping[0] == pytest.approx(probe.damping[0], rel=0.1)
    assert sensed.margins["peak_sensitivity"][0] == pytest.approx(probe.margins["peak_sensitivity"][0], rel=0.1)
    assert sensed.gap_error_rms[0] < 0.01 * FREE.gap and sensed.gap_error_worst[0] < 0.05 * FREE.gap
    assert abs(sensed.gap_error_bias[0]) < 0.1 * sensed.gap_error_rms[0]
    assert 0.3 < sensed.added_phase[0] < 3 and 0.3 < sensed.margin_lost[0] < 3
    assert 0.8 < sensed.terms["gap_sensing"][0] < 0.99 and probe.terms["gap_sensing"][0] == 1
    for name in ("gap_error_rms", "gap_error_bias", "gap_error_worst", "added_phase", "margin_lost"):
        assert np.isnan(getattr(probe, name)).all(), name


def resistive(ohms, **changes):
    """The small noise-free protocol of hmb_free on a coil of some resistance, known to the estimator."""
    rig = replace(sensing(**changes), coil_resistance=ohms)
    return weaker(quiet(protocol_experiment(rig, sensor="self_sensing")), 0.2)


ESTIMATORS = (GAINS, {"kp": 0.2 * PER_AMPERE, "ki": 5e3 * PER_AMPERE}, {"kp": 0.0, "ki": 3e3 * PER_AMPERE})
ANALOG = {"forward_path": "analog", "kp": 0.2 * PER_AMPERE, "ki": 1e4 * PER_AMPERE}


@pytest.mark.slow
@pytest.mark.parametrize("ohms", [0.0, FREE.coil_resistance])
def test_the_sensitivity_is_that_of_the_linear_loop(ohms):
    experiments = [resistive(ohms, **gains) for gains in (*ESTIMATORS, ANALOG)]
    statistics = simulate_statistics(experiments).statistics.at_lines(lines_at(FREE.protocol.excitations, "current"))
    measured, _ = frequency_response(statistics, "command", "injection")
    f = statistics.frequency
    for e, s in zip(experiments, measured, strict=True):
        assert np.abs(s / loop_response(e, f).sensitivity - 1).max() < 5e-3
        on_probe = loop_response(replace(e, sensor="probe"), f).sensitivity
        assert np.abs(s / on_probe - 1).max() > 0.05


@pytest.mark.slow
def test_what_self_sensing_costs_is_the_lag_of_its_tracking_and_the_margin_of_the_probe():
    experiments = [resistive(0.0, **gains) for gains in ESTIMATORS]
    on_probe = replace(experiments[0], sensor="probe")
    sensed, probe = evaluate(experiments), evaluate([on_probe])
    f = lines_at(FREE.protocol.excitations, "current") * 1.0

    def linear_margin(e):
        return margin_arrays(f, loop_response(e, f).sensitivity[None])["phase_margin"][0]

    for i, e in enumerate(experiments):
        at = sensed.margins["phase_margin_frequency"][i]
        # Control instants fall behind the last current sample by 0 .. 7/8 of the time between two.
        late = 2 * np.pi * at * ((1 - 1 / EVERY) / 2 / RATE - FREE.sensor_time_constant)
        lag = np.degrees(late - np.angle(tracking(self_sensors(e)[0], at)))
        assert sensed.added_phase[i] == pytest.approx(lag, abs=0.002)
        lost = probe.margins["phase_margin"][0] - sensed.margins["phase_margin"][i]
        assert sensed.margin_lost[i] == pytest.approx(lost, abs=0.005)
        # The linear loop does not wait for the control instant: 0.07 degrees.
        assert sensed.margin_lost[i] == pytest.approx(linear_margin(on_probe) - linear_margin(e), abs=0.04)
        assert lag > 3


def still(gains=FREE.gains, ohms=FREE.coil_resistance, **estimator):
    """Half a second with next to no excitation: what moves the rotor is the loop itself."""
    rig = replace(sensing(**estimator), coil_resistance=ohms, gains=gains)
    return replace(weaker(quiet(excited(rig)), 1e-5), periods=10)


HF = {"ki": 2.4e4 * PER_AMPERE}
STABLE = {
    "preset": still(),
    "stiffness just above the negative one": still(Gains(2400.0, 2000.0, 5.2)),
    "little damping": still(Gains(8000.0, 2000.0, 2.2)),
    "much damping": still(Gains(8000.0, 2000.0, 60.0)),
    "slow estimator": still(kp=0.0, ki=2e3 * PER_AMPERE),
    "estimator just below its own border": still(kp=4.2 * PER_AMPERE, **HF),
}
UNSTABLE = {
    "stiffness just below the negative one": (still(Gains(2100.0, 0.0, 5.2)), None),
    "too little damping": (still(Gains(8000.0, 2000.0, 0.8), 0.0), 0.02),
    "too much damping": (still(Gains(8000.0, 2000.0, 90.0)), None),
    "too slow an estimator": (still(ohms=0.0, kp=0.05 * PER_AMPERE, ki=1e3 * PER_AMPERE), 0.02),
    "an integrating estimator too slow": (still(ohms=0.0, kp=0.0, ki=1.2e3 * PER_AMPERE), 0.02),
    "estimator just above its own border": (still(kp=4.6 * PER_AMPERE, **HF), None),
    "estimator far above it": (still(kp=8 * PER_AMPERE, **HF), None),
}


def growth(position):
    """Rate (1/s) of the rotor's swing from 0.1 to 3 µm."""
    swing = np.maximum.accumulate(np.abs(position[np.isfinite(position)]))
    begin, end = np.searchsorted(swing, [1e-7, 3e-6])
    window = 200
    logs = [np.log(rms(position[at : at + window])) for at in range(begin, end - window, 50)]
    return np.polyfit(np.arange(len(logs)) * 50 * DT, logs, 1)[0]


@pytest.mark.slow
def test_the_poles_say_which_loops_hold_the_rotor_and_how_fast_others_let_it_go():
    held = simulate_records(list(STABLE.values()))
    for (case, e), record in zip(STABLE.items(), held, strict=True):
        error = channel(e, record, "displacement") - channel(e, record, "position")
        first, last = (rms(error[s] - error[s].mean()) for s in (slice(1000, 3000), slice(-2000, None)))
        assert np.abs(closed_loop_poles(e)).max() < 1, case
        assert last < 1.1 * first < 2e-7 and np.abs(record[2, -1000:]).max() < 1e-6, case
        let_go = simulate_records([e for e, _ in UNSTABLE.values()])
    for (case, (e, tolerance)), record in zip(UNSTABLE.items(), let_go, strict=True):
        radius, position = np.abs(closed_loop_poles(e)).max(), channel(e, record, "position")
        error = channel(e, record, "displacement") - position
        assert radius > 1, case
        assert np.isnan(position[-1]) or rms(position[-1000:]) > 3e-5 or rms(error[-1000:]) > 3e-6, case
        if tolerance:
            assert growth(position) == pytest.approx(np.log(radius) / DT, rel=tolerance), case


def test_gap_errors_are_those_of_the_records():
    e = excited(FREE, periods=3, transient_periods=2)
    experiments = [replace(e, seed=seed) for seed in range(4)]
    errors = simulate_statistics(experiments).gap_error
    sides = set()
    for i, record in enumerate(simulate_records(experiments)):
        off = (channel(e, record, "displacement") - channel(e, record, "position"))[2 * e.samples_per_period :]
        expected = rms(off), off.mean(), np.abs(off).max()
        np.testing.assert_allclose([errors.rms[i], errors.bias[i], errors.worst[i]], expected, rtol=1e-9)
        assert errors.worst[i] > 2 * errors.rms[i] > 20 * abs(errors.bias[i])
        sides.add(off.max() > -off.min())
    assert sides == {True, False}  # the worst is on either side of zero
    on_probe = simulate_statistics([replace(e, sensor="probe")]).gap_error
    assert np.isnan([on_probe.rms, on_probe.bias, on_probe.worst]).all()
    fallen = replace(e, gains=Gains(500.0, 0.0, 0.2))
    assert np.isnan(simulate_statistics([fallen]).gap_error.rms[0])
    with pytest.raises(ValueError, match="touched down"):
        recorded(fallen)


def test_a_supply_weaker_than_believed_reads_the_gap_smaller_and_a_calibration_mends_it():
    e = quiet(excited(replace(sensing(), coil_resistance=0.0), periods=20))
    (good,) = self_sensors(e)
    weak = replace(good, supply=Supply(0.8 * 24.0))
    mended = replace(weak, scale=1 / 0.8, shift=good.gap * (1 - 1 / 0.8))
    experiments = [replace(e, sensor=(sensor,)) for sensor in (good, weak, mended)]
    for one, record in zip(experiments, simulate_records(experiments), strict=True):
        (sensor,) = one.sensor
        reading, position = (channel(one, record, name)[10_000:].mean() for name in ("displacement", "position"))
        estimate = sensor.supply.voltage / 24.0 * (good.gap - position)
        assert reading == pytest.approx(sensor.scale * (good.gap - estimate) + sensor.shift, abs=3e-8)
        assert channel(one, record, "displacement")[0] == sensor.shift
        # The loop holds the reading near zero: the rotor itself then leans by a quarter of the gap.
        leans = -0.25 * good.gap if sensor is weak else 0.0
        assert position == pytest.approx(leans, abs=0.1 * good.gap)
        bias = simulate_statistics([replace(one, transient_periods=10, periods=10)]).gap_error.bias[0]
        assert bias == pytest.approx(reading - position, abs=1e-11)


def test_an_estimated_gap_is_not_limited_by_the_probes_converter():
    e = quiet(excited(sensing(), offset=2e-5))
    deaf = replace(e, rig=replace(e.rig, voltage_range=0.125, amplifier_gain=80.0))  # 16 µm; as much current
    records = simulate_records([e, deaf])
    np.testing.assert_array_equal(*records)
    assert np.abs(channel(e, records[0], "displacement")).max() > 1.5 * deaf.rig.voltage_range / deaf.rig.probe_gain


def mixed():
    """Twenty unlike experiments: estimators, sample rates, supplies, seeds, gains."""
    e, made = excited(sensing()), []
    for i in range(LANES + 4):
        rate = (262.5e3, 237.5e3, 212.5e3)[i % 3]
        rig = sensing(sample_rate=rate, kp=(0.3 + 0.02 * i) * PER_AMPERE)
        (sensor,) = self_sensors(replace(e, rig=rig))
        sensor = replace(sensor, supply=replace(sensor.supply, voltage=24.0 - 0.2 * i))
        made.append(replace(e, rig=rig, sensor=(sensor,), gains=replace(FREE.gains, kp=8000.0 + 50 * i), seed=i))
    return made


def test_a_lane_has_the_same_bits_alone_among_others_and_on_any_number_of_threads():
    batch = mixed()
    together, serial = (simulate_statistics(batch, threads=n) for n in (2, 1))
    for name in ("mean", "covariance"):
        np.testing.assert_array_equal(getattr(together.statistics, name), getattr(serial.statistics, name))
    assert len(np.unique(together.gap_error.rms)) == len(batch)
    for i in (0, 1, LANES, len(batch) - 1):
        alone = simulate_statistics([batch[i]])
        np.testing.assert_array_equal(alone.statistics.mean[0], together.statistics.mean[i])
        for name in ("rms", "bias", "worst"):
            assert getattr(alone.gap_error, name)[0] == getattr(together.gap_error, name)[i]


def test_the_same_seed_gives_the_same_bits_and_another_another_noise():
    e = excited(FREE)
    one, again, other = simulate_records([replace(e, seed=seed) for seed in (1, 1, 2)])
    np.testing.assert_array_equal(one, again)
    assert (one[0] != other[0]).mean() > 0.99
    # The estimate's noise is that of the current reading: of one at 2 mA, 12 bits over +-5 A.
    (silent,) = simulate_records([without_noise(e)])
    noise = rms(one[0] - silent[0])
    assert 2e-7 < noise < 2e-6


@pytest.mark.slow
def test_finer_steps_and_a_faster_recording_change_next_to_nothing():
    e = quiet(excited(sensing()))
    coarse, fine = simulate_records([e])[0], simulate_records([replace(e, sample_rate=100e3)])[0]
    assert fine.shape == (5, 2 * 5000)
    np.testing.assert_array_equal(fine[:, ::5], simulate_records([e], substeps=5)[0])
    # The amplifier's current is carried on from a fifth of a control sample: the duty of a PWM period differs by that.
    for name, tolerance in (("position", 4e-6), ("displacement", 5e-5), ("command", 4e-4)):
        expected = channel(e, coarse, name)
        assert rms(channel(e, fine, name)[::5] - expected) < tolerance * rms(expected), name
    held = channel(e, fine, "command").reshape(-1, 5)
    np.testing.assert_array_equal(held, np.repeat(held[:, :1], 5, axis=1))
    assert (np.diff(channel(e, fine, "displacement")) != 0).mean() > 0.99


def test_probes_and_self_sensors_are_two_batches():
    e = excited(sensing())
    with pytest.raises(ValueError, match="share excitations, periods, offset, axes, rates and sensor"):
        simulate_statistics([e, replace(e, sensor="probe")])


PEDESTAL = load_rig("pedestal")
COIL_ON_MAGNET = """
schema = "maglev-rig/1"
name = "puck"
magnet = "magnet_coil"
[parameters]
mass = 0.05
gap = 1e-2
remanence = 1.0
magnet_length = 5e-3
force_constant = 1e-4
force_exponent = 2.0
"""
SENSOR = self_sensor(sensing())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda e: replace(e, sensor="eye"), ["sensor = 'eye'", "probe or self_sensing"]),
        (lambda e: replace(e, sensor=SENSOR), ["a tuple with a SelfSensor for each axis"]),
        (lambda e: replace(e, sensor=(SENSOR, SENSOR)), ["2 self-sensors", "one SelfSensor for each axis"]),
        (lambda e: replace(e, sensor=("probe",)), ["one SelfSensor for each axis"]),
        (lambda e: replace(e, effects=effect("sensor_lag", 1e-5)), ["sensor_lag", "leave it out"]),
        (lambda e: protocol_experiment(PEDESTAL, sensor="self_sensing"), ["pedestal", "magnet = 'none'", "probe"]),
        (lambda e: protocol_experiment(PEDESTAL, sensor=(SENSOR,)), ["pedestal", "no magnets", "use probe"]),
        (
            lambda e: replace(e, rig=rig_from_toml(COIL_ON_MAGNET, "puck")),
            ["puck", "magnet = 'magnet_coil'", "hybrid_pair", "use the probe"],
        ),
        (
            lambda e: replace(e, sensor=(replace(SENSOR, supply=Supply(states=3)),)),
            ["needs a supply of two states"],
        ),
        (lambda e: replace(e, rig=sensing(sample_rate=251327.4)), ["251327 Hz", "no ratio", "250 kHz for 25 kHz"]),
        (
            lambda e: simulate_records([replace(e, rig=replace(e.rig, control_rate=20003.7), excitations=(SLOW,))]),
            ["sample rate 262500 Hz", "control rate 20003.7 Hz", "change one"],
        ),
        (
            lambda e: replace(e, rig=replace(e.rig, self_sensing=SelfSensing(lag=0.1))),
            ["no PI gains", "0.1 degrees", "allow more lag"],
        ),
        (lambda e: replace(e, rig=replace(e.rig, coil_resistance=200.0)), ["decays", "sample faster"]),
    ],
)
def test_what_cannot_be_sensed_is_said_with_what_to_do(make, words):
    with pytest.raises(ValueError) as error:
        make(excited(sensing()))
    for word in words:
        assert word in str(error.value)


SLOW = Excitation("sphs", "force", 20003.7 / 1000, (1, 2), 0.1)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("pwm = 1", ["unknown key 'pwm'", "pwm_frequency"]),
        ('pwm_frequency = "fast"', ["pwm_frequency = 'fast'", "not a finite number"]),
        ("pwm_frequency = -25e3", ["frequency = -25000.0", "positive"]),
        ("pwm_frequency = true", ["pwm_frequency = True"]),
        ("sample_rate = 40e3", ["rate = 40000 Hz", "twice the PWM frequency", "50000 Hz or faster"]),
        ("sample_rate = nan", ["sample_rate = nan"]),
        ("dead_time = 1e-5", ["dead_time = 1e-05", "a quarter of the PWM period"]),
        ("core_length = -1e-3", ["core_length = -0.001", "at least 0"]),
        ("adc_bits = 3", ["bits = 3", "4 to 24"]),
        ("adc_bits = 12.5", ["bits = 12.5", "4 to 24"]),
        ("current_range = 0.0", ["current_range = 0.0", "positive"]),
        ('forward_path = "optical"', ["forward_path = 'optical'", "digital or analog"]),
        ("kp = 1e-3", ["give both kp and ki, or neither"]),
        ("kp = -1e-3\nki = 1.0", ["kp = -0.001", "at least 0"]),
        ("kp = 1e-3\nki = 0.0", ["ki = 0", "positive"]),
        ("lag = 0.0", ["lag = 0", "positive"]),
        ("lag_frequency = -1.0", ["lag_frequency = -1", "positive"]),
    ],
)
def test_a_bad_table_of_self_sensing_is_refused_when_the_rig_is_read(line, words):
    with pytest.raises(ValueError) as error:
        rig_from_toml(f"{BALL}{line}\n".replace("core_length = 5e-4\n", ""), "ball.toml")
    for word in ("ball.toml", "[self_sensing]", *words):
        assert word in str(error.value)


def test_the_table_of_a_rig_says_how_its_coils_sense():
    table = 'sample_rate = 200e3\npwm_frequency = 20e3\nforward_path = "analog"\nadc_bits = 0\nkp = 0.1\nki = 9.0\n'
    rig = rig_from_toml(BALL + table, "ball")
    sensor = self_sensor(rig)
    assert (sensor.supply.frequency, sensor.supply.voltage, sensor.supply.states) == (20e3, rig.supply_voltage, 2)
    assert (sensor.acquisition.rate, sensor.acquisition.bits) == (200e3, 0)
    assert (sensor.estimator.kp, sensor.estimator.ki, sensor.estimator.path.rms) == (0.1, 9.0, True)
    assert (sensor.coil.turns, sensor.coil.core_length, sensor.coil.magnet_emf) == (300, 5e-4, 0.0)
    assert sensor.estimator.coil == replace(sensor.coil, bias_field=0.0)
    drawn = replace(rig, gap=2.2e-3, clearance=2.2e-3, supply_voltage=20.0, turns=310.0)
    other = self_sensor(drawn, nominal=rig)
    assert other.estimator == sensor.estimator and other.gap == rig.gap
    assert (other.coil.turns, other.supply.voltage) == (310.0, 20.0)
    # A magnet's flux through the coil, N A B, drops as the gap widens: by its field over its way in air and magnet.
    flux = 0.5 * 0.7 * 5e-3 / 1.05
    way = 0.35e-3 + 0.5 * 5e-3 * 39.27e-6 / (1.05 * 34.715e-6)
    assert SENSOR.coil.magnet_emf == pytest.approx(90 * 39.27e-6 * flux / way**2, rel=1e-12)
    assert SENSOR.coil.bias_field == pytest.approx(flux / way, rel=1e-12)


def recorded(e):
    return simulated_recording(e, simulate_records([e])[0])


def test_a_recording_has_the_true_displacement_and_the_gap_that_the_loop_ran_on():
    e = excited(FREE)
    data, record = recorded(e), simulate_records([e])[0]
    assert set(data.data_vars) == {"displacement", "command", "current", "force", "injection", "gap_estimate"}
    np.testing.assert_array_equal(data["displacement"], channel(e, record, "position"))
    np.testing.assert_array_equal(data["gap_estimate"], FREE.gap - channel(e, record, "displacement"))
    assert json.loads(data.attrs["experiment"])["sensor"] == "self_sensing" and data["gap_estimate"].units == "m"
    # The command follows the estimate, not the position: nothing but converter and start lies between.
    off = FREE.gap - data["gap_estimate"] - data["displacement"]
    assert 1e-7 < rms(off) < 2e-6
    assert json.loads(recorded(replace(e, sensor="probe")).attrs["experiment"])["sensor"] == "probe"


@pytest.mark.parametrize("data_format", ["npz", "mat", "csv"])
def test_a_campaign_is_read_back_bit_for_bit(tmp_path, data_format):
    e = excited(FREE)
    data = recorded(e)
    write_campaign(tmp_path, "hmb_free", {}, [("run", "fit", data, e)], data_format)
    campaign = load_campaign(tmp_path)
    back = read_recording(campaign, campaign.recordings[0])
    assert set(back.data_vars) == set(data.data_vars) and campaign.recordings[0].gains == FREE.gains
    for name in data.data_vars:
        np.testing.assert_array_equal(back[name], data[name])


def test_the_command_line_records_on_self_sensing(tmp_path):
    words = "simulate --rig hmb_free --fundamental 20 --excite force=1:23:2@1 --excite current=2:20:4@0.1 --periods 2"
    for sensor in ("self_sensing", "probe"):
        out = str(tmp_path / sensor)
        result = CliRunner().invoke(app, [*words.split(), "--sensor", sensor, "--out", out])
        assert result.exit_code == 0, result.output
        campaign = load_campaign(out)
        data = read_recording(campaign, campaign.recordings[0])
        assert ("gap_estimate" in data) == (sensor == "self_sensing")
    result = CliRunner().invoke(app, [*words.split(), "--sensor", "eye", "--out", str(tmp_path / "eye")])
    assert result.exit_code != 0 and "eye" in result.output and "self_sensing" in result.output


PLANAR = replace(load_rig("hmb_radial"), protocol=None)


@pytest.mark.slow
def test_each_axis_senses_its_own_gap():
    e = excited(PLANAR, seed=3)
    x, y = (axis_experiment(e, axis) for axis in range(2))
    both, alone = simulate_records([e])[0].reshape(5, 2, -1), [simulate_records([own])[0] for own in (x, y)]
    for axis in range(2):
        scale = np.abs(alone[axis]).max(axis=1, keepdims=True)
        assert (np.abs(both[:, axis] - alone[axis]) < 1e-9 * scale).all()
    assert rms(both[0, 0] - both[2, 0]) > 1e-7 < rms(both[0, 1] - both[2, 1])
    data = recorded(e)
    for name in ("displacement", "gap_estimate"):
        assert {f"{name}_x", f"{name}_y"} <= set(data.data_vars)
    sensors = self_sensors(e)
    weak = replace(sensors[1], supply=Supply(0.9 * 24.0))
    leaning = replace(e, sensor=(sensors[0], weak))
    other = simulate_records([leaning])[0].reshape(5, 2, -1)
    np.testing.assert_array_equal(other[:, 0], both[:, 0])
    alone = simulate_records([axis_experiment(leaning, 1)])[0]
    assert (np.abs(other[:, 1] - alone) < 1e-9 * np.abs(alone).max(axis=1, keepdims=True)).all()
    found = simulate_statistics([e, leaning]).gap_error
    assert found.rms[1] > 10 * found.rms[0]
    assert found.bias[1] == pytest.approx((alone[0] - alone[2]).mean(), rel=1e-9)


@pytest.mark.slow
def test_coupled_unlike_axes_are_the_analytic_loop():
    cross = Cross(300.0, -200.0, 0.3, -0.2, 0.1, -0.05, 0.02, -0.01)
    rig = replace(sensing(UNLIKE, kp=0.8 * PER_AMPERE, ki=1.5e4 * PER_AMPERE), cross=cross, coil_resistance=0.0)
    e = replace(weaker(quiet(excited(rig)), 0.05), periods=2, transient_periods=4)
    got = simulate_statistics([e]).statistics
    expected = expected_statistics(e, got.lines)
    assert "position_y" in got.channels
    for name in ("displacement_x", "displacement_y", "command_x", "command_y"):
        mine, theirs = got.amplitude(name)[0], expected.amplitude(name)
        assert np.abs(mine - theirs).max() < 0.02 * np.abs(theirs).max(), name


@pytest.mark.slow
def test_a_planar_rig_is_scored_on_self_sensing_by_its_worse_axis():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = evaluate([protocol_experiment(load_rig("hmb_radial"), sensor="self_sensing", seed=2)])
    assert found.feasible[0] and found.score[0] > 0.5
    assert found.gap_error_rms[0] < 0.02 * FREE.gap and np.isfinite([found.added_phase[0], found.margin_lost[0]]).all()


def test_default_gains_and_protocol_levitate_a_single_electromagnet_on_self_sensing():
    rig = with_defaults(replace(rig_from_toml(BALL, "ball"), gains=None))
    assert np.abs(closed_loop_poles(protocol_experiment(rig, sensor="self_sensing"))).max() < 1
