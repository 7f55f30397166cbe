"""What a goal requires of a rotor, against a real state space from the equations of motion, and against simulations."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from rotor_state_space import RealLoop, real_loop

from maglev_env.loop.gains import Gains
from maglev_env.rig.goal import parse_goal
from maglev_env.rotor.identification import MODES, identify_runs
from maglev_env.rotor.lanes import Run
from maglev_env.rotor.large_signal import large_signal_quantities
from maglev_env.rotor.linear import sensitivity
from maglev_env.rotor.loop_quantities import PLANES, TOGETHER, linear_quantities
from maglev_env.rotor.operating_point import at_operating_point, by_direction, resting, sag
from maglev_env.rotor.parts import Rejection, Runout, Unbalance
from maglev_env.rotor.requirements import evaluate_goal, rotor_goal, worst
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.simulate import spin

PUMP = load_rotor("pump")
# Upright, so that x and y are alike; gains whose modes differ, and whose tilt depends on the speed.
UNLIKE = replace(
    PUMP,
    gravity=(0.0, 0.0, -9.80665),
    gains={"translation": Gains(9000.0, 1000.0, 7.0), "tilt": Gains(7000.0, 500.0, 4.0)},
)
REJECTING = replace(UNLIKE, rejection=Rejection(15.0))
CASES = [(UNLIKE, 0.0), (UNLIKE, 14_000.0), (REJECTING, 3000.0), (REJECTING, 14_000.0)]
F = np.geomspace(2.0, 9000.0, 3000)
WHOLE = (0.0, np.inf)


def independent(rotor: Rotor, rpm: float) -> RealLoop:
    axis = at_operating_point(rotor, rpm * np.pi / 30).axis
    return real_loop(rotor, rpm, axis.actuator_gain, axis.negative_stiffness)


def points(rotor: Rotor, rpm: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz), dense beside the speed, and points on the unit circle."""
    beside = rpm / 60 + np.linspace(-30, 30, 1000)
    f = np.union1d(F, beside[beside > 2.0])
    return f, np.exp(2j * np.pi * f / rotor.axis.control_rate)


@pytest.mark.parametrize(("rotor", "rpm"), CASES)
def test_sensitivity_and_margins_are_those_of_the_real_state_space(rotor, rpm):
    found = linear_quantities(rotor, rpm, WHOLE)
    _, z = points(rotor, rpm)
    s = independent(rotor, rpm).sensitivity(z)
    peak, disk = found["peak_sensitivity"], found["disk_margin"]
    assert peak.places == disk.places == (*PLANES, *MODES, TOGETHER)
    together = np.linalg.svd(s, compute_uv=False)[:, 0].max()
    offset = np.linalg.svd(s - np.eye(4) / 2, compute_uv=False)[:, 0].max()
    assert peak.values[0, -1] == pytest.approx(together, rel=2e-3)
    assert disk.values[0, -1] == pytest.approx(1 / offset, rel=2e-3)
    single = [s[:, i, i] for i in range(2)]
    if rotor.rejection is None:  # then a loop broken behind a controller is one broken ahead of it
        into = np.kron(np.eye(2), [[0.5, 0.5], [-0.5, 0.5]])
        modes = into @ s @ np.linalg.inv(into)
        single += [modes[:, i, i] for i in range(2)]
    phase = found["phase_margin"].values[0]
    for i, one in enumerate(single):
        assert peak.values[0, i] == pytest.approx(abs(one).max(), rel=1e-3)
        assert disk.values[0, i] == pytest.approx(1 / abs(one - 0.5).max(), rel=1e-3)
        loop = 1 / one - 1
        crossing = np.flatnonzero(np.diff(abs(loop) > 1))
        assert phase[i] == pytest.approx(np.degrees(abs(np.angle(-loop[crossing])).min()), abs=0.3)
    assert peak.values[0, -1] >= peak.values[0, :2].max() and disk.values[0, -1] <= disk.values[0, :2].min()


@pytest.mark.parametrize(("rotor", "rpm"), CASES)
def test_one_probes_gain_may_change_by_the_gain_margin_and_no_more(rotor, rpm):
    margin = linear_quantities(rotor, rpm, WHOLE)["gain_margin"].values[0, 0]
    loop = independent(rotor, rpm)

    def stable(factor: float) -> bool:
        return abs(np.linalg.eigvals(loop.closed(np.diag([factor, 1.0, 1.0, 1.0]))[0])).max() < 1

    inside, outside = ((share, 1 / share) for share in (0.99 * margin, 1.01 * margin))
    assert all(map(stable, inside)) and not all(map(stable, outside))


@pytest.mark.parametrize(("rotor", "rpm"), CASES)
def test_what_all_probes_read_may_change_at_once_within_the_disk_margin(rotor, rpm):
    loop, a = independent(rotor, rpm), linear_quantities(rotor, rpm, WHOLE)["disk_margin"].values[0, -1]

    def stable(factors: tuple[complex, ...]) -> bool:  # of planes a and b, on x + i y: a phase turns x into y
        f = np.diag(factors)
        probes = np.block([[f.real, -f.imag], [f.imag, f.real]])
        return bool(abs(np.linalg.eigvals(loop.closed(probes)[0])).max() < 1)

    def corners(margin: float) -> list[bool]:
        """Both planes at the ends of the disk, where its gain or its phase is largest."""
        gain, phase = (2 + margin) / (2 - margin), np.exp(2j * np.arctan(margin / 2))
        return [stable(pair) for pair in product((gain, 1 / gain, phase, 1 / phase), repeat=2)]

    assert 0.2 < a < 1.5 and all(corners(0.99 * a)) and not all(corners(1.4 * a))


@pytest.mark.parametrize(("rotor", "rpm"), CASES)
def test_compliance_without_the_notch(rotor, rpm):
    without = replace(rotor, rejection=None)
    axis = at_operating_point(rotor, rpm * np.pi / 30).axis
    loop = real_loop(without, rpm, axis.actuator_gain, axis.negative_stiffness)
    _, z = points(rotor, 0.0)
    moved, arm = loop.compliance(z), PUMP.planes.magnets[1]
    # Of a mode the largest over directions: of its x and y alone.
    expected = [np.linalg.svd(moved[:, i::2, i::2], compute_uv=False)[:, 0].max() * arm ** (2 * i) for i in range(2)]
    assert linear_quantities(rotor, rpm, WHOLE)["compliance"].values[0] == pytest.approx(expected, rel=2e-3)
    inside = linear_quantities(rotor, rpm, (10.0, 30.0))["compliance"].values[0]
    assert (inside < 0.8 * np.array(expected)).all()
    with pytest.raises(ValueError, match=r"compliance in 1\.\.1\.5 Hz"):
        linear_quantities(rotor, rpm, (1.0, 1.5))


def test_stiffness_and_damping_are_those_that_an_identification_finds():
    quiet = replace(UNLIKE, unbalance=Unbalance(), runout=Runout(), gravity=(0.0, 0.0, 0.0))
    one = linear_quantities(quiet, 0.0, WHOLE)
    found, arm = identify_runs([Run(quiet)]), PUMP.planes.magnets[1]
    for name in ("stiffness", "damping"):
        expected = getattr(found, name)[0] / [1, arm**2]
        assert one[name].values[0] == pytest.approx(expected, rel=0.06)  # weighted otherwise within the band
        assert abs(expected[0] / expected[1] - 1) > 0.15


def test_the_noise_current_is_the_simulated_one():
    still = replace(UNLIKE, unbalance=Unbalance(), runout=Runout(), gravity=(0.0, 0.0, 0.0))
    runs = [Run(still, v) for v in (0.0, 14_000.0)]
    simulated = spin(runs, 40_000, settle=4000).channels[:, 4:8].std(axis=-1).reshape(2, 2, 2).mean(axis=-1)
    for run, expected in zip(runs, simulated, strict=True):
        found = linear_quantities(still, run.speed_rpm, WHOLE)["noise_current"]
        assert found.places == PLANES and found.values[0] == pytest.approx(expected, rel=0.03)


def test_the_steps_of_a_converter_count_as_noise_of_the_same_power():
    """A step of q scatters by q / sqrt(12); it is the span of -range to range over the number of levels."""
    axis = replace(UNLIKE.axis, adc_bits=0, dac_bits=0, noise=replace(UNLIKE.axis.noise, displacement=0.0))
    step = (axis.voltage_range - -axis.voltage_range) / 2**9 / axis.probe_gain
    stepped = replace(UNLIKE, axis=replace(axis, adc_bits=9))
    noisy = replace(UNLIKE, axis=replace(axis, noise=replace(axis.noise, displacement=step / np.sqrt(12))))
    found, expected = (linear_quantities(one, 0.0, WHOLE)["noise_current"].values for one in (stepped, noisy))
    assert found == pytest.approx(expected, rel=1e-9) and (found > 0).all()


def test_what_is_required_holds_across_the_weight_and_along_it():
    """Seen on the softest gains for little noise: 1.9 was said of a tilt whose |S| is 4.7 across the weight."""
    soft = replace(PUMP, gains={"translation": Gains(3077.0, 100.0, 4.14), "tilt": Gains(3240.0, 104.0, 4.05)})
    assert abs(resting(soft)[2]) < 0.8 * abs(sag(soft)[2])
    for rpm, over in ((0.0, 1.002), (10_000.0, 1.1)):  # at speed the two are mixed, and neither is quite reached
        both = [one.axis for one in by_direction(soft, rpm * np.pi / 30)]
        loop = real_loop(soft, rpm, [one.actuator_gain for one in both], [one.negative_stiffness for one in both])
        s = loop.sensitivity(points(soft, rpm)[1])
        found = linear_quantities(soft, rpm, WHOLE)["peak_sensitivity"].values[0]
        for plane in range(2):
            true = max(abs(s[:, i, i]).max() for i in (plane, plane + 2))
            assert 0.998 * true < found[plane] < over * true
    assert found.max() > 4.5
    # An injection that turns sees the mean of both directions.
    seen = identify_runs([Run(soft)])
    for c, name in enumerate(soft.gains):
        both = [sensitivity(one, seen.frequency[c], 0.0)[:, c, c] for one in by_direction(soft, 0.0)]
        assert seen.peak_sensitivity[0, c] == pytest.approx(abs(np.mean(both, axis=0)).max(), rel=0.03), name


GOAL = parse_goal("impulse_displacement <= 1e-4 after 1e-4, recovery_time <= 0.02 after 0.4, "
                  "lift_off_time <= 0.03 from 1e-4, current_peak <= 1")  # fmt: skip


def test_small_blows_and_loads_are_the_linear_loops_answers_whatever_turns():
    axis = replace(PUMP.axis, adc_bits=0, dac_bits=0)
    rotor = replace(PUMP, axis=axis)  # unbalanced, and read with noise
    at = np.array([0.0, 9000.0])
    (found,) = large_signal_quantities(GOAL, [rotor], at, [(1,)], 1)
    rate = axis.control_rate
    for i, v in enumerate(at):
        loop = independent(rotor, v)
        struck, loaded = np.zeros((2, 4, round(0.06 * rate)))
        struck[0, 0], loaded[0] = 1e-4 * rate, 0.4
        y = loop.answer(struck)[:2]
        assert found["impulse_displacement"].values[i] == pytest.approx(abs(y).max(axis=1), rel=0.01)
        y = loop.answer(loaded)[:2]
        band = np.maximum(0.1 * abs(y).max(axis=1), 0.01 * axis.clearance)
        outside = abs(y - y[:, -240:].mean(axis=1, keepdims=True)) > band[:, None]
        expected = (y.shape[1] - outside[:, ::-1].argmax(axis=1)) / rate
        assert found["recovery_time"].values[i] == pytest.approx(expected, abs=5e-4)
    assert found["lift_off_time"].speeds == (0.0,) and (found["lift_off_time"].values > 0.002).all()
    assert (found["lift_off_time"].values < 0.03).all() and found["current_peak"].values.shape == (2, 2)
    # The coils lift with kp times the distance at the least, without a kick of the derivative.
    assert 0.7 < found["current_peak"].values[0].max() / (8000.0 * 1e-4) < 1.3


@pytest.mark.parametrize("at", [[0.0, 9000.0], [9000.0], [9000.0, 3000.0]])
def test_a_lift_off_draws_its_current_at_standstill_whatever_the_speeds(at):
    lift = "lift_off_time <= 0.03 from 1e-4, current_peak <= 1"
    struck = parse_goal(f"impulse_displacement <= 1e-4 after 1e-6, {lift}")
    for goal, speeds in ((parse_goal(lift), (0.0,)), (struck, (0.0, *sorted({*at} - {0.0})))):
        (found,) = large_signal_quantities(goal, [PUMP], np.array(at), [(1,)], 1)
        peak = found["current_peak"]
        assert peak.speeds == speeds and 0.7 < peak.values[0].max() / (8000.0 * 1e-4) < 1.3
        assert len(speeds) == 1 or (0.05 < peak.values[1:].max() < peak.values[0].max())  # of the unbalance


def test_a_blow_that_throws_a_rotor_onto_its_bearing_misses_by_far():
    hard = parse_goal("impulse_displacement <= 1e-4 after 0.05")
    (found,) = large_signal_quantities(hard, [PUMP], np.array([0.0]), [(1,)], 1)
    assert np.isinf(found["impulse_displacement"].values).all()


def test_the_score_is_that_of_the_worst_speed_mode_and_plane():
    text = "peak_sensitivity <= 2.4, phase_margin >= 30, displacement <= 0.3, best noise_current near 0.02"
    goal, weak = rotor_goal(PUMP, text), replace(PUMP, gains=dict.fromkeys(MODES, Gains(1500.0, 2000.0, 5.2)))
    heavy = replace(PUMP, unbalance=Unbalance(1.8e-5))
    speeds = np.array([0.0, 14_000.0])
    found = evaluate_goal([UNLIKE, weak, heavy], goal, speeds, seed=3)
    assert found.feasible.tolist() == [True, False, False] and (found.score[1:] == 0).all()
    assert np.isfinite(found.touchdown_time[2])
    by_name = found.found[0]
    value, speed, place = worst(by_name["peak_sensitivity"], "peak_sensitivity")
    assert value == by_name["peak_sensitivity"].values.max() == found.required("peak_sensitivity")[0]
    assert (speed, place) == (14_000.0, TOGETHER)
    least, _, place = worst(by_name["phase_margin"], "phase_margin")
    assert least == np.nanmin(by_name["phase_margin"].values) and place == "tilt"
    misses = {"peak_sensitivity": np.log(value / 2.4), "phase_margin": np.log(30 / least)}
    for name, x in misses.items():
        assert found.terms[name][0] == pytest.approx(1 / (1 + 0.01 * np.logaddexp(0, x / 0.01) / 0.05))
    noise = 1 / (1 + found.required("noise_current")[0] / 0.02)
    assert found.score[0] == pytest.approx(
        np.prod([found.terms[r.name][0] for r in goal.requirements]) * (1 + noise) / 2
    )
    assert by_name["displacement"].values == pytest.approx(found.run_up.peak[0] / PUMP.axis.clearance)
    alone = evaluate_goal([UNLIKE], goal, speeds, seed=3)
    assert alone.score[0] == found.score[0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("peak_sensitivity <= 3, worst of 8 rigs", "leave it out for a rotor"),
        ("lift_off_time <= 0.03 from 1e-3", "clearance is 0.00035 m"),
        ("peak <= 3", "no quantity 'peak'"),
    ],
)
def test_goals_that_a_rotor_cannot_have(text, words):
    with pytest.raises(ValueError, match=words):
        rotor_goal(PUMP, text)


def test_engineer_has_the_limits_of_the_rotors_own_mass():
    def limits(rotor: Rotor) -> dict[str, float]:
        return {r.name: r.limit for r in rotor_goal(rotor, "engineer").requirements}

    half = replace(PUMP, body=replace(PUMP.body, mass=PUMP.body.mass / 2))
    assert limits(half)["compliance"] == pytest.approx(2 * limits(PUMP)["compliance"], rel=0.01)
    assert limits(PUMP)["compliance"] == pytest.approx(44.5e-6)


def test_the_current_includes_what_carries_the_weight():
    """At rest the balance of forces gives it, with the pull of the negative stiffness where the rotor sags to."""
    gain, spring = PUMP.axis.actuator_gain, -PUMP.axis.negative_stiffness
    whole = PUMP.gains["translation"].kp + PUMP.gains["translation"].ki
    still = PUMP.moving_mass * 9.80665 * whole / (gain * whole - spring)
    goal = parse_goal("current_rms <= 1, best noise_current near 0.02")
    found = evaluate_goal([PUMP], goal, np.array([0.0])).found[0]
    noise = found["noise_current"].values[0]
    assert found["current_rms"].values[0] == pytest.approx(np.hypot(still, noise), rel=0.02)
