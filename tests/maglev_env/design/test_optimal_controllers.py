"""LQG and H-infinity controllers against equations, grids and python-control; and what no controller betters."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from maglev_env.design.h_infinity import ROLL, SLACK, STIFF, HInfinityWeights, h_infinity
from maglev_env.design.linear_limits import (
    least_current,
    least_peak,
    linear_limits,
    samples_of_delay,
    zeros_outside,
)
from maglev_env.design.lqg import LqgWeights, drifting, feedback, lqg, riccati
from maglev_env.design.state_space_filter import state_space_filter
from maglev_env.experiment import Experiment
from maglev_env.linear.control_systems import to_control
from maglev_env.linear.loop import loop_response
from maglev_env.linear.open_loop import balanced, open_loop
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.linear.reduced import reduced
from maglev_env.rig.rig_file import load_rig

RIGS = {name: load_rig(name) for name in ("hmb_free", "eframe")}
LQG = LqgWeights(2e5, 1e-11, 0.5, 5.0)
H_INFINITY = HInfinityWeights(2e4, 1e-5, 10.0, 400.0)


def bare(rig="hmb_free", gains=None, **effects):
    own = RIGS[rig]
    return Experiment(own, gains or own.gains, (), effects={n: {"time": v} for n, v in effects.items()})


def grid(rig, n=4000):
    return np.geomspace(1e-5, 0.4999, n) * rig.control_rate


@pytest.mark.parametrize("rig", RIGS)
def test_lqg_gains_solve_their_riccati_equations(rig):
    plant = balanced(open_loop(bare(rig)))
    a, b, c = drifting(plant, LQG)
    x = riccati(a, b, c.T @ c, LQG.command)
    k = feedback(a, b, x, LQG.command)
    closed = a - b @ k
    # Independent of the solver: the cost of the closed loop by its Lyapunov equation is that of the equation.
    cost = scipy.linalg.solve_discrete_lyapunov(closed.T, c.T @ c + LQG.command * k.T @ k)
    np.testing.assert_allclose(cost, x, rtol=1e-5, atol=1e-6 * np.abs(x).max())
    assert np.abs(np.linalg.eigvals(closed)).max() < 1
    for step in np.eye(len(a)):  # no other gain is better
        for sign in (0.01, -0.01):
            other = k * (1 + sign * step)
            moved = a - b @ other
            worse = scipy.linalg.solve_discrete_lyapunov(moved.T, c.T @ c + LQG.command * other.T @ other)
            assert np.trace(worse) >= np.trace(x) * (1 - 1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("effects", [{}, {"delay": 130e-6}])
def test_the_lqg_loop_has_the_margins_that_python_control_finds(effects):
    control = pytest.importorskip("control")
    plant = open_loop(bare(**effects))
    e = bare(gains=state_space_filter(*lqg(plant, LQG), plant.dt), **effects)
    assert np.abs(closed_loop_poles(e)).max() < 1
    modelled, controller, _ = to_control(e)
    _, phase, disk, _, _, _ = control.stability_margins(controller * modelled)
    s = loop_response(e, grid(e.rig)).sensitivity
    assert np.abs(s).max() == pytest.approx(1 / disk, rel=1e-3)
    loop = 1 / s - 1
    crossed = np.flatnonzero(np.diff(np.abs(loop) > 1))
    own = np.degrees(np.abs(np.angle(-loop[crossed]))).min()
    assert own == pytest.approx(abs(phase), abs=0.5)


@pytest.mark.parametrize(("rig", "effects"), [("hmb_free", {}), ("hmb_free", {"delay": 130e-6}), ("eframe", {})])
def test_the_norm_of_h_infinity_is_that_of_its_loop_over_all_frequencies(rig, effects):
    pytest.importorskip("slycot")
    plant, w = open_loop(bare(rig, **effects)), H_INFINITY
    (a, b, c, d), norm = h_infinity(plant, w)
    e = bare(rig, state_space_filter(a, b[:, 0], c[0], float(d[0, 0]), plant.dt), **effects)
    assert np.abs(closed_loop_poles(e)).max() < 1
    f = grid(e.rig)
    r = loop_response(e, f)
    s = 2j / plant.dt * np.tan(np.pi * f * plant.dt)  # the mapped frequency
    low, high = 2 * np.pi * w.stiff_below, 2 * np.pi * w.quiet_above
    of_motion = (s + low) / (s + low / STIFF)
    of_command = w.command * (1 + s / high) / (1 + s / (ROLL * high))
    by_force = w.force * r.receptance
    sent = -r.controller
    whole = np.array([
        [of_motion * by_force, of_motion * r.sensitivity],
        [of_command * sent * by_force, of_command * sent * r.sensitivity],
    ])  # fmt: skip
    largest = np.linalg.svd(np.moveaxis(whole, -1, 0), compute_uv=False)[:, 0].max()
    assert norm / SLACK * 0.97 < largest <= norm * 1.001


def test_no_other_controller_has_a_smaller_norm():
    """The least norm of a loop that nothing else weighs is that of Nevanlinna and Pick."""
    pytest.importorskip("slycot")
    plant = open_loop(bare(delay=1e-3))
    least = least_peak(plant, 0.0, 1.0)
    norms = [h_infinity(plant, HInfinityWeights(1e2 * s, 1e-7 * s, 0.1, 2e3))[1] for s in (10.0, 1.0)]
    assert SLACK * least <= norms[1] < norms[0] and norms[1] == pytest.approx(SLACK * least, rel=0.08)


@pytest.mark.parametrize("effects", [{}, {"delay": 75e-6}, {"delay": 310e-6}])
def test_the_least_complementary_sensitivity_is_that_of_the_formula_for_one_pole(effects):
    plant = open_loop(bare(**effects))
    (p,) = (one for one in np.linalg.eigvals(plant.a) if abs(one) > 1)
    zeros = zeros_outside(plant)
    formula = abs(p) ** samples_of_delay(plant) * np.prod([abs((1 - z.conj() * p) / (p - z)) for z in zeros])
    assert least_peak(plant, 1.0, 0.0) == pytest.approx(formula, rel=1e-6)


def test_limits_are_bettered_by_no_controller_and_tighten_with_the_delay():
    rig = RIGS["hmb_free"]
    near, far = (linear_limits(open_loop(bare(delay=d)), 0.5e-6) for d in (50e-6, 500e-6))
    assert far["peak_sensitivity"] > near["peak_sensitivity"] > 1
    assert far["noise_current"] > near["noise_current"] > 0
    assert all(far[name] < near[name] for name in ("phase_margin", "gain_margin", "disk_margin"))
    plant = open_loop(bare(delay=500e-6))
    for force in (1e3, 1e4, 1e5):
        for command in (1e-12, 1e-10, 1e-8):
            weights = LqgWeights(force, command, 0.1, 5.0)
            e = bare(gains=state_space_filter(*lqg(plant, weights), plant.dt), delay=500e-6)
            s = loop_response(e, grid(rig, 800)).sensitivity
            assert np.abs(s).max() > far["peak_sensitivity"] and 1 / np.abs(s - 0.5).max() < far["disk_margin"]


def test_the_least_noise_current_is_approached_by_lqg_and_by_no_other_controller():
    plant = open_loop(bare())
    least, found = least_current(plant), []
    for force, command in ((1e3, 1e-10), (1e0, 1e-6), (1e-1, 1e-5)):
        e = bare(gains=state_space_filter(*lqg(plant, LqgWeights(force, command, 1e-6, 5.0)), plant.dt))
        f = (np.arange(20_000) + 0.5) / 40_000 * e.rig.control_rate
        r = loop_response(e, f)
        found.append(np.sqrt(np.mean(np.abs(r.amplifier * r.controller * r.sensitivity) ** 2)))
    assert found[0] > found[1] > least * 0.9999 and found[2] == pytest.approx(least, rel=0.05)


def test_a_filter_that_would_lose_its_digits_is_refused():
    a = np.diag(1 - 1e-3 * np.arange(1, 9))
    with pytest.raises(ValueError, match="loses its digits"):
        state_space_filter(a, np.ones(8), np.ones(8), 1.0, 1e-5)


def test_lost_commands_are_part_of_the_open_loop():
    e = replace(bare(), effects={"dropped_samples": {"probability": 0.2}})
    plant = open_loop(e)
    z = np.exp(2j * np.pi * np.array([10.0, 300.0, 4000.0]) * plant.dt)
    own = [(plant.reading @ np.linalg.solve(one * np.eye(len(plant.a)) - plant.a, plant.command))[0, 0] for one in z]
    np.testing.assert_allclose(own, loop_response(e, np.array([10.0, 300.0, 4000.0])).plant, rtol=1e-9)
    flown = [
        (plant.current @ np.linalg.solve(one * np.eye(len(plant.a)) - plant.a, plant.command) + plant.jump)[0, 0]
        for one in z
    ]
    np.testing.assert_allclose(flown, loop_response(e, np.array([10.0, 300.0, 4000.0])).amplifier, rtol=1e-9)


def test_a_reduced_plant_has_the_responses_and_the_unstable_pole_of_the_whole():
    e = replace(bare(), effects={"eddy_current": {"corner_hz": 30.0}})
    whole, few = open_loop(e), reduced(open_loop(e), 1e-5)
    assert len(few.a) < len(whole.a)
    radii = [np.abs(np.linalg.eigvals(plant.a)).max() for plant in (whole, few)]
    assert radii[1] == pytest.approx(radii[0], rel=1e-9)
    z = np.exp(2j * np.pi * np.geomspace(1e-4, 0.1, 50))
    for name in ("command", "force"):
        full, short = (
            np.array([(p.reading @ np.linalg.solve(x * np.eye(len(p.a)) - p.a, getattr(p, name)))[0, 0] for x in z])
            for p in (whole, few)
        )
        np.testing.assert_allclose(np.abs(short - full).max(), 0.0, atol=4e-3 * np.abs(full).max())
