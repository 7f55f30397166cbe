"""The score of a rotor against its definition, and its independence of the others in the batch."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.gains import Gains
from maglev_env.rotor.evaluation import RotorEvaluation, evaluate_rotors, rotor_target
from maglev_env.rotor.identification import Protocol
from maglev_env.rotor.linear import at_planes, closed_loop_poles, unbalance_response
from maglev_env.rotor.parts import Runout, Unbalance
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.run_up import run_up, seeds_of

PUMP = load_rotor("pump")
PRESET = Gains(8000.0, 2000.0, 5.2)
SPEEDS = np.array([0.0, 4000.0, 8000.0, 14_000.0])
TOP = 14_000 * np.pi / 30


def with_gains(translation: Gains, tilt: Gains) -> Rotor:
    return replace(PUMP, gains={"translation": translation, "tilt": tilt})


ROTORS = [
    PUMP,
    with_gains(Gains(1500.0, 2000.0, 5.2), PRESET),  # less than the negative stiffness, and leaning on the magnets
    with_gains(PRESET, Gains(8000.0, 2000.0, 0.1)),  # a tilt without damping
    replace(PUMP, unbalance=Unbalance(1.8e-5)),
    with_gains(Gains(9000.0, 500.0, 6.0), Gains(7000.0, 1000.0, 4.0)),
]
TARGET = rotor_target(PUMP, [0.0, 14_000.0])


def evaluated(rotors: list[Rotor], seed: int | list = 3, **more) -> RotorEvaluation:
    return evaluate_rotors(rotors, SPEEDS, seed=seed, target=TARGET, **more)


@pytest.fixture(scope="module")
def found() -> RotorEvaluation:
    return evaluated(ROTORS)


def same(one: RotorEvaluation, i: int, other: RotorEvaluation, j: int) -> bool:
    arrays = [(getattr(e, n)[k] for e, k in ((one, i), (other, j))) for n in ("score", "pole_radius", "touchdown_time")]
    arrays += [(getattr(e.run_up, n)[k] for e, k in ((one, i), (other, j))) for n in ("peak", "once", "coil_rms")]
    arrays += [(e.identified(n)[k] for e, k in ((one, i), (other, j))) for n in ("stiffness", "damping_se")]
    arrays += [(e.identification[1].sensitivity[1][k] for e, k in ((one, i), (other, j)))]
    arrays += [(e.terms["damping"][k] for e, k in ((one, i), (other, j)))]
    return all(np.array_equal(a, b, equal_nan=True) for a, b in arrays)


def test_a_rotor_scores_the_same_wherever_it_stands_among_however_many_and_on_any_threads(found):
    turned = evaluated(ROTORS[::-1], threads=2)
    assert all(same(found, i, turned, len(ROTORS) - 1 - i) for i in range(len(ROTORS)))
    assert same(found, 4, evaluated([ROTORS[4]], threads=1), 0)
    seeded = evaluated([PUMP, ROTORS[4]], seed=[(7, 1), 3])
    assert same(found, 4, seeded, 1) and not same(found, 0, seeded, 0)


@pytest.mark.slow
def test_more_runs_than_are_identified_together_come_back_in_order():
    rotors = [ROTORS[4 * (i % 2)] for i in range(40)]
    many = evaluate_rotors(rotors, SPEEDS[::3], seed=list(range(40)), target=TARGET)
    for i in (0, 31, 32, 39):
        assert same(many, i, evaluate_rotors(rotors[i : i + 1], SPEEDS[::3], seed=i, target=TARGET), 0)


def test_the_score_is_the_weighted_geometric_mean_of_the_worst_terms(found):
    for i in (0, 4):
        k, c, ms = (found.identified(name)[i] for name in ("stiffness", "damping", "peak_sensitivity"))
        off_k, off_c = abs(np.log(k / TARGET.stiffness)).max(), abs(np.log(c / TARGET.damping)).max()
        over = max(0.0, ms.max() / PUMP.axis.target.peak_sensitivity - 1)
        peak, current = found.run_up.peak[i].max(), found.run_up.coil_rms[i].max()
        expected = {
            "stiffness": 1 / (1 + (off_k / 0.1) ** 2),
            "damping": 1 / (1 + (off_c / 0.2) ** 2),
            "peak_sensitivity": 1 / (1 + (over / 0.2) ** 2),
            "displacement": 1 / (1 + (peak / (0.3 * PUMP.axis.clearance)) ** 4),
            "current": 1 / (1 + (current / PUMP.axis.target.current_limit) ** 2),
            "gap_sensing": 1.0,
        }
        assert {name: values[i] for name, values in found.terms.items()} == pytest.approx(expected, rel=1e-12)
        weights = np.array([0.30, 0.20, 0.30, 0.10, 0.05, 0.05])
        assert found.score[i] == pytest.approx(np.prod(np.array(list(expected.values())) ** weights), rel=1e-12)
    assert found.score[0] > 0.95 > found.score[4] > 0.1


def test_the_targets_are_what_the_preset_gains_give():
    # Static stiffness of a proportional loop is kp ki_force + k_s; the band's lies above it by what kd's lag adds.
    axis = PUMP.axis
    static = axis.actuator_gain * 8000.0 + axis.negative_stiffness
    translation, tilt = TARGET.stiffness[0]
    assert 1.0 < translation / static < 1.3
    # Planes of magnets and probes give the tilt's: the same springs, at their arms.
    magnets, probes = PUMP.planes.magnets[1], PUMP.planes.probes[1]
    static_tilt = axis.actuator_gain * 8000.0 * magnets * probes + axis.negative_stiffness * magnets**2
    assert 1.0 < tilt / static_tilt < 1.3
    assert abs(np.log(TARGET.stiffness[1] / TARGET.stiffness[0])).max() < 0.05
    assert (TARGET.damping > 0).all()
    assert rotor_target(PUMP, [0.0, 14_000.0]) is TARGET  # kept


def test_poles_and_zones(found):
    for i in (0, 1):
        radii = [abs(closed_loop_poles(ROTORS[i], speed)).max() for speed in (0.0, TOP)]
        assert found.pole_radius[i] == pytest.approx(radii, rel=1e-12)
    ratio = found.peak_displacement / PUMP.axis.clearance
    assert found.displacement_zone.tolist() == [
        "ABCD"[int(np.searchsorted((0.3, 0.4, 0.5), r, "right"))] for r in ratio
    ]
    assert set(found.displacement_zone) >= {"A", "D"}
    assert found.sensitivity_zone[[0, 2]].tolist() == ["A", ""]
    assert found.peak_sensitivity[0] < 3.0 and np.isnan(found.peak_sensitivity[2])


def test_an_unstable_loop_and_a_touchdown_score_nothing(found):
    assert found.feasible.tolist() == [True, False, False, False, True]
    assert (found.score[1:4] == 0).all()
    assert found.pole_radius[1].min() > 1 and np.isnan(found.touchdown_time[1])  # unstable, and yet in the air
    assert found.touchdown_speed[2] == 0.0 and 0 < found.touchdown_time[2] < 0.6


def test_too_much_unbalance_touches_down_from_the_speed_on_at_which_it_reaches_the_clearance(found):
    heavy = ROTORS[3]
    q = unbalance_response(heavy, SPEEDS[1:] * np.pi / 30)
    reach = abs(q @ at_planes(*heavy.planes.magnets).T).max(axis=1) / heavy.axis.clearance
    assert reach[0] < 0.5 and reach[1] > 1.1
    assert found.touchdown_speed[3] == 8000.0 and found.pole_radius[3].max() < 1
    assert found.run_up.peak[3, 2].min() >= heavy.axis.clearance > 2 * found.run_up.peak[3, :2].max()
    known = ~np.isnan(found.identified("stiffness")[3])
    assert known.tolist() == [[True, True], [False, False]]
    assert np.isnan(found.terms["stiffness"][3]) and not found.feasible[3]


def test_a_touchdown_that_only_the_injection_brings_about_counts():
    loud = Protocol(amplitude=3.0)
    one = evaluated([PUMP], protocol=loud)
    assert not one.run_up.touched_down.any()
    assert one.touchdown_time[0] == pytest.approx(6 / loud.fundamental) and one.touchdown_speed[0] == 0.0
    assert one.score[0] == 0 and not one.feasible[0]


def test_without_a_target_every_rotor_has_its_own():
    rotors = [ROTORS[4], PUMP]
    own = evaluate_rotors(rotors, SPEEDS[:1], seed=3)
    assert own.id_speeds.tolist() == [0.0] and (own.terms["stiffness"] > 0.9).all()
    for i, rotor in enumerate(rotors):
        alone = evaluate_rotors([rotor], SPEEDS[:1], seed=3, target=rotor_target(rotor, [0.0]))
        assert own.score[i] == pytest.approx(alone.score[0], rel=1e-12)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="at least one"):
        evaluate_rotors([])
    with pytest.raises(ValueError, match="must all act"):
        evaluate_rotors([PUMP, replace(PUMP, gains={"a": PRESET, "b": PRESET})])
    with pytest.raises(ValueError, match="id_speeds"):
        evaluate_rotors([PUMP], id_speeds=[np.nan])
    with pytest.raises(ValueError, match=r"^speeds"):
        evaluate_rotors([PUMP], [np.inf])
    with pytest.raises(ValueError, match=r"target: .* \[0.0\] rpm"):
        evaluate_rotors([PUMP], [0.0], target=TARGET)
    with pytest.raises(ValueError, match="2 seeds for 1"):
        run_up([PUMP], SPEEDS, [1, 2])
    with pytest.raises(ValueError, match="do not hold it up"):
        rotor_target(ROTORS[1], [0.0])
    assert seeds_of((1, 2), 2) == [(1, 2), (1, 2)] and seeds_of([5, (6, 7)], 2) == [(5,), (6, 7)]


def quiet() -> Rotor:
    """The pump without noise, converters and all that turns; no weight, but for what a test gives it."""
    axis = replace(PUMP.axis, adc_bits=0, dac_bits=0, noise=replace(PUMP.axis.noise, displacement=0.0))
    return replace(PUMP, axis=axis, unbalance=Unbalance(), runout=Runout(), gravity=(0.0, 0.0, 0.0))


def test_the_radial_peak_is_how_far_the_rotor_is_from_the_centre_in_whatever_direction():
    # One m/s2 on the springs of both bearings: their controllers' gain at rest and the magnets' own stiffness.
    axis, gains = PUMP.axis, PUMP.gains["translation"]
    sag = PUMP.body.mass / (axis.actuator_gain * (gains.kp + gains.ki) + axis.negative_stiffness)
    pulls = [(0.6, 0.8, 0.0), (-0.8, 0.6, 0.0), (0.0, -1.0, 0.0)]
    found = run_up([replace(quiet(), gravity=pull) for pull in pulls], [0.0])
    assert found.peak == pytest.approx(np.full((3, 1, 2), sag), rel=1e-3)


def test_the_axial_probe_reads_how_the_rotor_swings_and_how_its_face_tilts():
    # Let go beside its place of rest g / w^2, an undamped mass swings about that as far: 12 times at 50 Hz.
    w = 2 * np.pi * 50.0
    spring = PUMP.body.mass * w**2 / 2  # of each bearing
    axial = replace(PUMP.axial, displacement=(0.0, 1e-4), force=(0.0, -spring * 1e-4), damping=0.0)
    swings = run_up([replace(quiet(), axial=axial, gravity=(0.0, 0.0, -0.2))], [0.0])
    assert swings.once[0, 0] == pytest.approx([0.0, 0.0, 0.2 / w**2], rel=1e-4, abs=1e-12)
    # A couple unbalance tilts the face that the probe looks at, away from the axis.
    rpm = np.array([6000.0, 12_000.0])
    tilted = replace(quiet(), unbalance=Unbalance(couple=2e-8))
    tilt = abs(unbalance_response(tilted, rpm * np.pi / 30)[:, 1])
    assert run_up([tilted], rpm).once[0, :, 2] == pytest.approx(PUMP.axial.probe_radius * tilt, rel=0.01)
