"""What a goal measures, against python-control, plain matrices and theory; and what the known case must show."""

from dataclasses import replace

import control as ct
import numpy as np
import pytest
from control_loops import DT, control_loop
from pushed_rotor import GAIN, STIFFNESS, followed
from scipy.integrate import solve_ivp

from estimation.normal import NORMAL_95
from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import goal_of, with_goal
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.goal_score import met
from maglev_env.evaluation.requirements import NEAR, SETTLED, events_of, settling_time
from maglev_env.evaluation.worst import drawn_experiments
from maglev_env.experiment import protocol_experiment
from maglev_env.kernel.blocks import own_lanes
from maglev_env.kernel.events import Event, simulated_events
from maglev_env.loop.gains import Gains
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_env.task.protocol import env_protocol

RIG = load_rig("hmb_free")
STIFF = Gains(12000.0, 2000.0, 11.0)
GAINS = (RIG.gains, STIFF, Gains(10000.0, 2000.0, 8.0))
BALL = with_defaults(
    rig_from_toml(
        """schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = 0.0327
gap = 8e-3
clearance = 5e-3
bias_current = 0.85
force_length = 5.8e-3
amplifier_time_constant = 2e-3
sensor_time_constant = 3e-4
probe_gain = 1000.0
control_rate = 1000.0
""",
        "ball",
    )
)
EVERYTHING = """
    peak_sensitivity <= 3; phase_margin >= 30; gain_margin >= 2; disk_margin >= 0.4
    compliance <= 44.5e-6; stiffness >= 30e3; damping >= 20; displacement <= 0.3   # ISO 14839-2
    current_rms <= 0.5, noise_current <= 0.05, current_peak <= 1
    impulse_displacement <= 105e-6 after 1e-3, recovery_time <= 0.03 after 0.6, lift_off_time <= 0.03 from 60e-6
"""


def judged(goal, gains=GAINS, rig=RIG, **changes):
    own = with_goal(rig, goal)
    return evaluate([protocol_experiment(own, g, seed=i, **changes) for i, g in enumerate(gains)])


@pytest.fixture(scope="module")
def everything():
    return judged(EVERYTHING)


def test_margins_are_those_of_python_control(everything):
    for i, gains in enumerate(GAINS):
        loop = control_loop(protocol_experiment(RIG, gains))
        f = np.geomspace(5.0, 2000.0, 20000)
        s = 1 / (1 + loop(np.exp(2j * np.pi * f * DT)))
        found = {name: values[i] for name, values in everything.required.items()}
        assert found["peak_sensitivity"] == pytest.approx(np.abs(s).max(), rel=0.02)
        assert found["disk_margin"] == pytest.approx(1 / np.abs(s - 0.5).max(), rel=0.02)
        # The margins of an unstable plant are on both sides: python-control's own search finds the nearest of each.
        gain, phase, _, _, _, _ = ct.stability_margins(loop, returnall=True, method="frd")
        assert found["phase_margin"] == pytest.approx(np.abs(phase).min(), abs=1.0)
        nearest = min(max(g, 1 / g) for g in gain if g > 0)
        assert found["gain_margin"] == pytest.approx(nearest, rel=0.05)


def worst_compliance(gains):
    s = ct.tf("s")
    beside = 1 / (RIG.mass * s**2 + STIFFNESS) / (1 + RIG.sensor_time_constant * s)
    by_force = ct.sample_system(ct.ss(beside), DT, "zoh")
    z = np.exp(2j * np.pi * lines_at(RIG.protocol.excitations, "force") * DT)
    held = np.sinc(lines_at(RIG.protocol.excitations, "force") * DT)  # the estimator takes the converter's hold out
    return (np.abs(by_force(z) / (1 + control_loop(protocol_experiment(RIG, gains))(z))) / held).max()


def test_a_gain_margin_is_also_that_of_rest():
    """By the poles, all gains of this loop may fall by 1.60 only; no line holds the crossing, which is at rest."""
    found = judged("gain_margin >= 2, best noise_current near 0.02", [Gains(3330.0, 180.0, 4.98)])
    low, value, high = (float(f["gain_margin"][0]) for f in (found.required_low, found.required, found.required_high))
    assert value == pytest.approx(1.60, rel=0.04) and 0.98 * value < low < value and np.isnan(high)
    assert found.terms["gain_margin"][0] < 0.3


def test_the_worst_compliance_is_that_of_an_independent_loop(everything):
    for i, gains in enumerate(GAINS):
        worst = worst_compliance(gains)
        assert everything.required["compliance"][i] == pytest.approx(worst, rel=0.01)
        low, high = everything.required_low["compliance"][i], everything.required_high["compliance"][i]
        assert low < worst * 1.01 and high > worst * 0.99 and high < 1.1 * low


def test_the_large_signal_test_is_that_of_plain_matrices(everything):
    count, events = events_of(goal_of(with_goal(RIG, EVERYTHING)), protocol_experiment(RIG))
    assert count + sum(e.samples for e in events) <= 0.25 * 6 * RIG.control_rate
    for i, gains in enumerate(GAINS):
        found = {name: values[i] for name, values in everything.required.items()}
        pushed, _ = followed(RIG, gains, 2000, impulse=1e-3)
        assert found["impulse_displacement"] == pytest.approx(np.abs(pushed).max(), abs=2.5e-6)
        peaks = []
        for name, event in (("recovery_time", {"force": 0.6}), ("lift_off_time", {"start": 60e-6})):
            y, current = followed(RIG, gains, 1800, **event)
            band = max(SETTLED * np.abs(y).max(), NEAR * RIG.clearance)
            # A peak that just leaves the band in one of them may just stay inside in the other.
            wide, narrow = (
                np.flatnonzero(np.abs(y - y[-360:].mean()) > band * share).max() * DT for share in (1.2, 0.8)
            )
            assert wide - 1e-3 < found[name] < narrow + 1e-3
            peaks.append(np.abs(current).max())
        assert found["current_peak"] == pytest.approx(max(peaks), rel=0.25)


def test_the_noise_current_is_that_of_theory(everything):
    lsb = 2 * RIG.voltage_range / 2**RIG.adc_bits / RIG.probe_gain
    level = np.hypot(RIG.noise.displacement, lsb / np.sqrt(12))
    s = ct.tf("s")
    amplifier = ct.sample_system(ct.ss(1 / (1 + RIG.amplifier_time_constant * s)), DT, "zoh")
    plant = ct.sample_system(
        ct.ss(
            GAIN / (RIG.mass * s**2 + STIFFNESS) / (1 + RIG.amplifier_time_constant * s)
            / (1 + RIG.sensor_time_constant * s)
        ), DT, "zoh",
    )  # fmt: skip
    z = np.exp(1j * np.pi * (np.arange(4000) + 0.5) / 4000)
    for i, gains in enumerate(GAINS):
        loop = control_loop(protocol_experiment(RIG, gains))(z)
        response = loop / plant(z) * amplifier(z) / (1 + loop)
        rms = level * np.sqrt(np.mean(np.abs(response) ** 2))
        assert everything.required["noise_current"][i] == pytest.approx(rms, rel=0.12)


def test_stated_intervals_are_as_wide_as_repetitions_scatter():
    own = with_goal(replace(RIG, protocol=env_protocol(RIG, "quick")), "disk_margin >= 0.4, phase_margin >= 30")
    found = evaluate([protocol_experiment(own, STIFF, seed=i) for i in range(64)])
    for name in ("phase_margin", "disk_margin", "compliance", "noise_current"):
        half = (found.required_high[name] - found.required_low[name]).mean() / 2
        # What smoothing takes away is allowed for, and scatters less than it may be.
        assert 0.6 < half / (1.96 * found.required[name].std()) < 2.0, name


def test_margins_and_compliance_are_not_those_of_the_noise():
    """Against python-control: unsmoothed lines showed a peak |S| 2.3 % and a compliance 0.7 % too high."""
    found = judged("peak_sensitivity <= 3, disk_margin >= 0.5, best compliance near 2e-5", [STIFF] * 16).required
    loop = control_loop(protocol_experiment(RIG, STIFF))
    s = 1 / (1 + loop(np.exp(2j * np.pi * np.geomspace(5.0, 2000.0, 20000) * DT)))
    assert found["peak_sensitivity"].mean() == pytest.approx(np.abs(s).max(), rel=0.005)
    assert found["disk_margin"].mean() == pytest.approx(1 / np.abs(s - 0.5).max(), rel=0.005)
    assert found["compliance"].mean() == pytest.approx(worst_compliance(STIFF), rel=0.003)


def test_an_engineer_prefers_the_loop_that_matching_calls_bad():
    matched = judged("match", GAINS[:2])
    assert matched.score[0] > 0.99 and matched.score[1] < 0.25 and not matched.required
    goal = goal_of(with_goal(RIG, "engineer"))
    wanted = judged("engineer", GAINS[:2])
    assert wanted.score[0] < 0.1 and wanted.score[1] > 0.8
    assert met(goal, wanted.required).tolist() == [False, True]
    plain = evaluate([protocol_experiment(RIG, g, seed=i) for i, g in enumerate(GAINS[:2])])
    assert np.array_equal(plain.score, matched.score)
    assert all(np.array_equal(plain.terms[name], matched.terms[name]) for name in plain.terms)


def test_a_rotor_that_does_not_lift_off_scores_little_but_not_nothing():
    # So near the pole a current of several amperes turns the flux there round, and pulls the rotor on.
    soft = Gains(3000.0, 100.0, 12.0)
    found = judged("lift_off_time <= 0.05 from 340e-6, best compliance near 1e-3", (STIFF, soft))
    assert np.isinf(found.required["lift_off_time"][0]) and found.feasible[0] and 0 < found.score[0] < 0.1
    assert found.required["lift_off_time"][1] < 0.05 and found.score[1] > 0.5


def test_a_goal_on_several_rigs_takes_the_worst_value_of_each_quantity():
    text = "peak_sensitivity <= 3, phase_margin >= 30, best compliance near 40e-6"
    rig = replace(RIG, protocol=env_protocol(RIG, "quick"))
    worst, own = judged(f"{text}, worst of 3 rigs", rig=rig), with_goal(rig, text)
    nominal = [protocol_experiment(own, g, seed=i) for i, g in enumerate(GAINS)]
    parts = [evaluate(e) for e in (nominal, *drawn_experiments(nominal, 3))]
    for name, of in (("peak_sensitivity", np.max), ("phase_margin", np.min), ("compliance", np.max)):
        assert np.array_equal(worst.required[name], of([p.required[name] for p in parts], axis=0))
    assert np.all(worst.score <= parts[0].score) and np.array_equal(worst.stiffness, parts[0].stiffness)


@pytest.mark.parametrize(
    ("goal", "words"),
    [
        ("recovery_time <= 4 after 0.5", "half of that"),
        ("lift_off_time <= 0.03 from 1e-3", "clearance is 0.00035 m"),
        ("compliance <= 1e-5 in 400..500", "excites 1 to 249 Hz"),
    ],
)
def test_a_goal_that_the_experiment_cannot_show_is_refused_in_words(goal, words):
    with pytest.raises(ValueError, match=words):
        judged(goal, GAINS[:1])


def test_margins_below_the_lines_are_not_known_and_missed():
    """A ball on weak gains has its margins near 1 Hz; lines from 5 Hz on show a calm loop with a gain margin of 11."""
    weak = Gains(88.2, 2.7, 1.24, 2.43e-3, 0.243)
    goal = "peak_sensitivity <= 3, phase_margin >= 30, gain_margin >= 1.5"
    slow = judged(goal, (weak,), BALL)
    assert slow.required["peak_sensitivity"][0] > 3 and slow.required["gain_margin"][0] < 1.3
    parts = tuple(
        replace(e, lines=tuple(k for k in e.lines if k >= 5)) if e.at == "current" else e
        for e in BALL.protocol.excitations
    )
    above = judged(goal, (weak,), replace(BALL, protocol=replace(BALL.protocol, excitations=parts)))
    assert np.isinf(above.required["peak_sensitivity"][0]) and above.score[0] < 1e-4
    assert not met(goal_of(with_goal(BALL, goal)), above.required)[0]


@pytest.mark.slow
def test_the_bounds_hold_a_resonance_that_lies_between_the_lines():
    """Seen: |S| of 3.0 with an interval of 6 %, where the loop has 86.

    And a phase margin of 32 degrees, where it has 0.7.
    """
    effects = {
        "delay": {"time": 150e-6},
        "support_resonance": {"frequency": 600.0, "damping_ratio": 0.005, "mass_ratio": 0.2},
    }
    sharp, plain = Gains(6500.0, 160.0, 8.7, 156e-6), Gains(6400.0, 250.0, 5.2, 1e-4)
    goal = "peak_sensitivity <= 3, phase_margin >= 30, gain_margin >= 2, disk_margin >= 0.3"
    e = judged(goal, (sharp, plain), effects=effects)
    assert e.required["peak_sensitivity"][0] < 3.1  # what the lines show
    assert e.between_lines["peak_sensitivity"][0] == pytest.approx(86, rel=0.03)
    assert e.between_lines["peak_frequency"][0] == pytest.approx(665, abs=1)
    assert e.required_high["peak_sensitivity"][0] == e.between_lines["peak_sensitivity"][0]
    for name, most in (("phase_margin", 1.0), ("gain_margin", 1.1), ("disk_margin", 0.02)):
        assert e.required_low[name][0] == e.between_lines[name][0] < most < e.required[name][0]
    half = NORMAL_95 * e.peak_sensitivity_se[0]
    assert e.margins["peak_sensitivity"][0] + half >= 0.99 * e.between_lines["peak_sensitivity"][0]
    assert "between_lines_peak_sensitivity" in e.to_xarray()
    free = judged(goal, GAINS[:1])
    assert all(np.isnan(values).all() for values in free.between_lines.values())


def test_a_ball_lifts_off_from_below_without_any_current():
    """Before its coil pulls as much as it weighs it falls a little, as far as the integrated balance of forces says."""
    e = protocol_experiment(BALL, BALL.gains)
    _, lifted = simulated_events(own_lanes([e]), 10, [Event("lift_off", 2e-3, 400)], threads=1)
    y, current = lifted[0, :, 0]
    assert y[0] == pytest.approx(-2e-3, abs=2e-4) and current[0] == pytest.approx(-BALL.bias_current)
    assert current[1] > -BALL.bias_current and abs(y[-100:].mean()) < 1e-4

    def rate(_, x):  # under the command of the first sample alone, the ball at rest below
        at, speed, i = x
        pull = BALL.mass * 9.80665 * (1 + i / BALL.bias_current) ** 2 * np.exp(at / BALL.force_length)
        return speed, pull / BALL.mass - 9.80665, (BALL.gains.kp * 2e-3 - i) / BALL.amplifier_time_constant

    after = solve_ivp(rate, (0.0, 2e-3), (-2e-3, 0.0, -BALL.bias_current), rtol=1e-9).y
    assert current[2] == pytest.approx(after[2, -1], abs=0.1) and y[2] == pytest.approx(after[0, -1], abs=2e-4)


def test_a_narrower_band_of_rest_waits_for_a_later_swing():
    """A swing of 9 % of the peak from 0.6 to 0.7 s lies inside of the band of 10 %, and outside of one of 8 %."""
    t = np.arange(1000) * 1e-3
    y = np.where(t < 0.3, 1.0, np.where((t >= 0.6) & (t < 0.7), 0.09, 0.0))[None]
    assert settling_time(y, np.zeros(1), 1e-3) == pytest.approx([0.3], abs=2e-3)
    assert settling_time(y, np.zeros(1), 1e-3, 0.8) == pytest.approx([0.7], abs=2e-3)


@pytest.mark.slow
def test_each_axis_has_to_meet_a_goal():
    """One axis is noisy and well damped, the other one calm with little margin: both are said of the rig."""
    rig = load_rig("hmb_radial")
    noisy, calm = replace(rig.gains, kd=1.6 * rig.gains.kd), replace(rig.gains, kd=0.7 * rig.gains.kd)
    goal = "phase_margin >= 20, best noise_current near 1e-3"
    apart, *alike = (judged(goal, [gains], rig=rig).required for gains in ((noisy, calm), noisy, calm))
    noise, margin = (
        np.array([found[name][0] for found in (apart, *alike)]) for name in ("noise_current", "phase_margin")
    )
    assert noise[0] == pytest.approx(noise[1:].max(), rel=0.1) and noise[1] > 1.2 * noise[2]
    assert margin[0] == pytest.approx(margin[1:].min(), rel=0.1) and margin[1] > 1.2 * margin[2]
