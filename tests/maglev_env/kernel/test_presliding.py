"""Friction that sticks: against solve_ivp, the closed forms of Dahl's loop and of small motions, and its limits."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from reference_effects import simulate_effects
from scipy.integrate import solve_ivp

from maglev_env.experiment import Experiment, protocol_experiment, without_noise
from maglev_env.kernel.lanes import structure_of
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.loop.mechanics import (
    PER_BEND,
    ROOTED,
    SLIP_SQ,
    STATIC,
    STEADY,
    deflect_bristles,
    deflect_bristles_shaped,
)
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

MASS, SPRING, DAMPER = 0.08, 2e4, 1.0
LEVEL = 0.05  # N


def sprung(amplitude, lines=(1, 3, 7), fundamental=20.0, damper=DAMPER, **friction):
    """A mass on a spring, pushed by a force of so many N, its friction of LEVEL unless another force is given."""
    rig = replace(load_rig("pedestal"), mass=MASS, support_stiffness=SPRING, support_damping=damper, adc_bits=0)
    pushed = Excitation("sphs", "force", fundamental, lines, amplitude)
    effects = effect("friction", **{"force": LEVEL, **friction}) if friction else {}
    return without_noise(Experiment(rig, NO_CONTROLLER, (pushed,), 1, effects=effects))


def moved(e, substeps=1, samples=None):
    return simulate_records([e], substeps, threads=1)[0][0, :samples]


def exact(e, samples):
    """Displacement of a `sprung` mass by the bristles' own equation, its force held between samples."""
    f, rate = e.effects["friction"], e.rig.control_rate
    wave, state, found = np.ravel(e.waveform("force")), np.zeros(3), []

    def slopes(t, s, push):
        y, v, z = s
        force = f["force"] / f["presliding"] * z
        return [
            v,
            (push - SPRING * y - DAMPER * v - force) / MASS,
            v - np.hypot(v, f["velocity"]) * z / f["presliding"],
        ]

    for push in wave[:samples]:
        found.append(state[0])
        run = solve_ivp(
            slopes, (0, 1 / rate), state, "DOP853", rtol=1e-10, atol=[1e-16, 1e-13, 1e-16], args=(push,),
            max_step=0.25 / rate,
        )  # fmt: skip
        state = run.y[:, -1]
    return np.array(found)


# Amplitude of the push; the velocity below which bristles creep, and their way: through sliding and sticking, stuck for
# most of the time, and stiff bristles under a large force.
@pytest.mark.slow
@pytest.mark.parametrize(
    "amplitude, friction",
    [
        (0.2, {"velocity": 1e-3, "presliding": 1e-6}),
        (0.06, {"velocity": 1e-5, "presliding": 1e-6}),
        (0.5, {"force": 0.3, "velocity": 1e-5, "presliding": 3e-7}),
    ],
)
def test_stick_slip_agrees_with_a_tight_solve_ivp_and_converges_on_it(amplitude, friction):
    e = sprung(amplitude, fundamental=50.0, **friction)
    expected = exact(e, 400)
    without = moved(sprung(amplitude, fundamental=50.0), samples=400)
    rms = np.sqrt(np.mean(expected**2))
    one, four = (np.sqrt(np.mean((moved(e, s, 400) - expected) ** 2)) / rms for s in (1, 4))
    assert np.sqrt(np.mean((without - expected) ** 2)) > 0.2 * rms
    assert one < 2e-4 and four < one / 8


@pytest.mark.slow
def test_a_coupled_levitated_x_y_rig_sticks_in_either_axis_as_the_equations_say():
    e = protocol_experiment(load_rig("hmb_radial"))
    rig = replace(e.rig, cross=Cross(300.0, -200.0, 1.0, -2.0, 0.3, -0.2, 0.02, -0.03))
    lags = {**effect("delay", 61.7e-6), **effect("support_resonance", 150.0, mass_ratio=0.2)}
    e = replace(without_noise(replace(e, rig=rig)), periods=1, transient_periods=0)
    e = replace(e, effects={**lags, **effect("friction", 0.2, velocity=1e-4, presliding=1e-6)})
    expected = np.array(simulate_effects(e, 100, max_step=1e-5))
    plain = np.array(simulate_effects(replace(e, effects=lags), 100))
    change = np.abs(expected - plain).max(axis=2, keepdims=True)
    for substeps, tolerance in ((1, 5e-4), (2, 1e-4)):
        found = simulate_records([e], substeps, threads=1)[0][:6, :100].reshape(3, 2, 100)
        assert (np.abs(found - expected) < tolerance * change).all()
    assert (change > 0.1 * np.abs(plain).max(axis=2, keepdims=True)).all()


def test_small_motions_feel_a_spring_that_creeps():
    """About rest: LEVEL over the presliding, in series with a damper of LEVEL over the velocity."""
    presliding, velocity, push = 1e-6, 1e-4, 1e-6
    e = replace(sprung(push, (1,), 100.0, 5.0, presliding=presliding, velocity=velocity), transient_periods=60)
    n = e.samples_per_period
    found = np.fft.rfft(moved(e)[-n:])[1] * 2 / n
    s = 2j * np.pi * 100.0
    held = np.exp(-0.5 * s / e.rig.control_rate) * np.sinc(100.0 / e.rig.control_rate)
    drive = np.fft.rfft(np.ravel(e.waveform("force")))[1] * 2 / n * held
    stiffness = SPRING + 5.0 * s + MASS * s**2
    bristles = LEVEL * s / (velocity + presliding * s)
    assert found == pytest.approx(drive / (stiffness + bristles), rel=1e-3)
    assert abs(LEVEL / presliding / stiffness) > 1  # the bristles carry more than the spring does
    assert abs(bristles / (LEVEL / presliding)) == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("push, ratio", [(0.03, (0.2, 1.0)), (0.2, (1.0, 6.0)), (3.0, (20.0, 60.0))])
def test_a_cycle_takes_the_energy_of_dahls_loop(push, ratio):
    """4 F (A - z tanh(A / z)) between turning points +-A: nearly nothing of a small motion, 4 F A of full sliding."""
    z = 1e-6
    damper = 5.0
    e = replace(sprung(push, (1,), 200.0, damper, presliding=z, velocity=1e-5), transient_periods=60)
    n = e.samples_per_period
    wave, cycle = np.ravel(e.waveform("force")), moved(e)[-n - 1 :]
    speed = np.fft.rfft(cycle[1:]) * np.arange(n // 2 + 1) * 2j * np.pi * 200.0 * (2 / n)
    taken = np.sum(np.roll(wave, 1) * np.diff(cycle))  # the force is held: its work is exact
    taken -= damper * np.sum(np.abs(speed) ** 2) / 2 / 200.0
    reach = 0.5 * (cycle.max() - cycle.min())
    assert ratio[0] < reach / z < ratio[1]
    assert taken == pytest.approx(4 * LEVEL * (reach - z * np.tanh(reach / z)), rel=5e-3)


@pytest.mark.slow
def test_friction_of_the_least_presliding_slides_as_without():
    """What differs falls with the presliding, and the rest with the step: such bristles act a quarter of it late."""
    off = {}
    for substeps in (1, 4):
        rubbed = moved(sprung(0.3, velocity=5e-3), substeps)
        effect_of_it = np.abs(rubbed - moved(sprung(0.3), substeps)).max()
        for z in (1e-9, 1e-7):
            other = moved(sprung(0.3, velocity=5e-3, presliding=z), substeps)
            off[z, substeps] = np.abs(other - rubbed).max() / effect_of_it
    assert off[1e-9, 1] < 5e-3 and off[1e-9, 4] < 0.3 * off[1e-9, 1]
    assert off[1e-9, 4] < 0.2 * off[1e-7, 4]


@pytest.mark.parametrize("force", [1.0, 1e3])
def test_bristles_far_too_stiff_for_the_step_hold_the_mass_fast(force):
    """Neither blow up nor chatter: it stays where so stiff a spring leaves it."""
    found = moved(replace(sprung(0.5, velocity=1e-5, force=force, presliding=1e-9), transient_periods=20))
    assert np.abs(found).max() < 1e-7


def test_lanes_that_stick_have_a_kernel_of_their_own_and_leave_the_others_alone():
    stuck, slid, neutral = sprung(0.2, presliding=1e-6), sprung(0.2, velocity=1e-3), sprung(0.2, force=0.0)
    assert structure_of(stuck).sticking and structure_of(slid) == structure_of(neutral)
    together = simulate_records([slid, stuck, neutral], threads=2)
    for e, found in zip((slid, stuck, neutral), together, strict=True):
        assert np.array_equal(simulate_records([e], threads=1)[0], found, equal_nan=True)
    assert np.array_equal(moved(replace(slid, effects=effect("friction", LEVEL))), together[0, 0])


@pytest.mark.parametrize(("deflect", "level"), [(deflect_bristles, 1.0), (deflect_bristles_shaped, 1.5)])
def test_bristles_that_slide_at_the_slip_velocity_bend_by_its_share_of_their_level(deflect, level):
    """v / sqrt(v^2 + slip^2) is 1 / sqrt(2) there: the smoothing of Coulomb's law, with static friction and without."""
    memory = np.zeros(2000)
    memory[SLIP_SQ], memory[PER_BEND], memory[STATIC], memory[STEADY] = 2.0**2, 1e9, 0.5, 1.0
    assert deflect(memory, 0, 0.0, 0.5 * 2.0) == pytest.approx(level / 2**0.5)  # half a step's motion


def test_a_fully_gradual_slip_is_that_of_many_springs_that_slip_one_after_another():
    """Springs of equal stiffness that slip at 0 .. 1, moved to and fro between ends at which all of them slide."""
    slips, memory = (np.arange(2000) + 0.5) / 2000, np.zeros(2000)
    memory[PER_BEND], memory[STEADY] = 2**0.5, 1e-3
    memory[ROOTED] = (1 - memory[STEADY]) / memory[STEADY]
    ends, stretched, bent, found = (2.5, 0.0, 2.5), np.zeros(slips.size), 0.0, []
    for begin, end in pairwise((0.0, *ends)):
        for moved in np.full(50, (end - begin) / 50):
            stretched = np.clip(stretched + moved, -slips, slips)
            bent = deflect_bristles_shaped(memory, 0, bent, moved)
            found.append((bent, stretched.sum() / slips.sum()))
    bends, springs = np.transpose(found[50:])  # from rest, a spring does not yield to what it was bent before
    assert np.ptp(springs) > 1.99 and np.abs(bends - springs).max() < 2e-3


def test_absent_presliding_is_zero_and_bounds_are_stated():
    assert effect("friction", 0.1)["friction"]["presliding"] == 0.0
    with pytest.raises(ValueError, match=r"friction.presliding = 1e-12 is outside 1e-09 .. 0.001 m"):
        effect("friction", 0.1, presliding=1e-12)
