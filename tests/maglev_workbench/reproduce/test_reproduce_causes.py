"""The program of Appendix C and the causes of the published stiffness, against closed forms and other solvers."""

from functools import lru_cache

import numpy as np
import pytest

from estimation.multisine.sphs import crest_factor, sphs, synthesise
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.reproduce.chapters.causes import Cause, causes, radial_responses
from maglev_workbench.commands.reproduce.chapters.coefficients.appendix_c import SUBTRACTED
from maglev_workbench.commands.reproduce.chapters.coefficients.five_coefficients import (
    five_coefficients,
    three_coefficients,
)
from maglev_workbench.commands.reproduce.registry import HOME, chosen

FREQUENCY = np.arange(1.0, 251.0)
BANDS = np.array([[65.0, 80.0], [230.0, 245.0]])
W = 2 * np.pi * FREQUENCY


@lru_cache
def outcome(name, seed=0):
    return chosen([name])[0].run(seed)


def found(name, row):
    (value,) = [r.found for r in outcome(name).rows if r.name == row]
    return value


def two_axes(stiffness, damping, angle, mass):
    """Response (2, n) of two coupled axes to a force at an angle (degrees), line by line."""
    force = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    dynamic = [stiffness + 1j * w * damping - mass * w**2 * np.eye(2) for w in W]
    return np.array([np.linalg.solve(d, force) for d in dynamic]).T


def test_the_program_finds_a_rig_that_one_excitation_does_tell():
    """Axes so unlike that x and y do not move as one; a wrong mass scales all of it by the ratio of the masses."""
    k, c = np.array([[2.2e5, -4e4], [3e4, 1.1e5]]), np.array([[66.0, -28.0], [26.0, 40.0]])
    response = two_axes(k, c, 30.0, 0.92)
    for mass, ratio in ((0.92, 1.0), (0.7907, 0.7907 / 0.92)):
        fit = five_coefficients(FREQUENCY, response, mass, BANDS)
        for b in range(len(BANDS)):
            assert fit.stiffness[b] == pytest.approx(ratio * k, rel=1e-5)
            assert fit.damping[b] == pytest.approx(ratio * c, rel=1e-3)
        assert fit.angle == pytest.approx(30.0, abs=1e-4)
        assert fit.input == pytest.approx(ratio * np.array([[np.cos(np.pi / 6), np.sin(np.pi / 6)]] * 2), rel=1e-5)
        assert (fit.goodness_of_fit > 1 - 1e-9).all() and fit.stiffness_significant.all()


def test_goodness_of_fit_and_significance_are_those_that_appendix_c_writes_out():
    rng = np.random.default_rng(3)
    response = two_axes(np.diag([2e5, 1.5e5]), np.diag([60.0, 30.0]), 45.0, 0.92)
    response = response + 2e-8 * (rng.normal(size=response.shape) + 1j * rng.normal(size=response.shape))
    fit = five_coefficients(FREQUENCY, response, 0.92, BANDS[:1])
    inside = (FREQUENCY >= 65) & (FREQUENCY <= 80)
    rows, target = [], []
    for w, gx, gy in zip(W[inside], *response[:, inside], strict=True):
        rows += [[gx.real, gy.real, -w * gx.imag, -w * gy.imag, -1.0], [gx.imag, gy.imag, w * gx.real, w * gy.real, 0]]
        target += [0.92 * w**2 * gx.real, 0.92 * w**2 * gx.imag]
    rows, target = np.array(rows), np.array(target)
    scale = np.abs(rows).max(axis=0)
    values = np.linalg.lstsq(rows / scale, target, rcond=None)[0] / scale
    n = len(target) // 2
    rss = np.sum((target - rows @ values) ** 2)
    gof = np.sqrt(1 - (2 * n - 1) * rss / ((2 * n - 5) * np.sum((target - target.mean()) ** 2)))
    inverse = np.linalg.inv((rows / scale).T @ (rows / scale)) / np.outer(scale, scale)
    t = values / np.sqrt(rss / (2 * n - 5) * np.diag(inverse))
    assert fit.stiffness[0, 0] == pytest.approx(values[:2], rel=1e-6)
    assert fit.damping[0, 0] == pytest.approx(values[2:4], rel=1e-6)
    assert fit.goodness_of_fit[0, 0] == pytest.approx(gof, rel=1e-9)
    assert fit.stiffness_significant[0, 0].tolist() == (np.abs(t[:2]) >= 2).tolist()
    assert fit.damping_significant[0, 0].tolist() == (np.abs(t[2:4]) >= 2).tolist()


def test_a_free_input_makes_any_stiffness_fit_where_the_mass_rules():
    """Without noise the truth is found; with a little, m w^2 of the band, and the fit stays almost perfect."""
    k, c, m = 1.3e5, 30.0, 0.92
    g = 1 / (k + 1j * W * c - m * W**2)
    exact = three_coefficients(FREQUENCY, g, m, BANDS)
    assert exact[0] == pytest.approx(k, rel=1e-6) and exact[1] == pytest.approx(c, rel=1e-5)
    assert exact[2] == pytest.approx(1.0, rel=1e-6)
    noise = 0.3 * np.abs(g[FREQUENCY == 240])
    rng = np.random.default_rng(1)
    loud = three_coefficients(FREQUENCY, g + noise * np.exp(2j * np.pi * rng.random(len(g))), m, BANDS[1:])
    middle = m * (2 * np.pi * 237.5) ** 2
    assert loud[0, 0] == pytest.approx(middle, rel=0.05) and abs(loud[2, 0]) < 0.1 and loud[3, 0] > 0.99


@pytest.mark.slow
def test_the_rows_of_appendix_c():
    item = "appendix-c"
    rows = outcome(item).rows
    assert all(np.isfinite(row.found) for row in rows) and all(row.reason for row in rows if row.agrees is False)
    assert {row.again for row in rows} <= {"", *HOME}
    ends = [found(item, f"largest stiffness, {mass}") for mass in ("0.92 kg", "the program's 0.7907 kg")]
    # Both are m w^2 of the last bands, as far as the noise lets them come, less the spring.
    assert (ends[1] + 1e-3 * SUBTRACTED) / (ends[0] + 1e-3 * SUBTRACTED) == pytest.approx(0.7907 / 0.92, rel=0.01)
    assert 1500 < ends[0] < 1e-3 * (0.92 * (2 * np.pi * 250) ** 2 - SUBTRACTED)
    assert -1e-3 * SUBTRACTED < found(item, "least stiffness") < -80
    assert found(item, "goodness of fit from 40 to 250 Hz, least") > 0.99
    doubled = found(item, "the same with y doubled, as the program prints")
    assert doubled == pytest.approx(np.degrees(np.arctan(2.0)), abs=0.2)
    s = 2j * np.pi * 242.5
    controller = 8000 + 5.2 * s / (1 + 1e-4 * s) + 2000 / (1 + 0.0318 * s)
    reach = found(item, "largest force of the loop per displacement at 242 Hz")
    assert reach == pytest.approx(5.7e-3 * abs(controller), rel=0.01)


def test_the_joint_is_two_bodies_on_springs():
    """The response through the joint against the same two bodies, solved as a matrix at some lines."""
    cause = next(one for one in causes() if one.joint)
    rigid = radial_responses(Cause("rigid", noise=0.0), 0)
    joined = radial_responses(Cause("joined", noise=0.0, joint=cause.joint), 0)
    rig, w = load_rig("hmb_radial"), 2 * np.pi * rigid.frequency
    alone = rigid.repeats[0, 0] * 2**0.5
    spring = rig.support_stiffness + 1j * w * rig.support_damping
    bearing = 1 / alone + 0.92 * w**2 - spring
    link = 0.13 * (2 * np.pi * cause.joint) ** 2
    for i in (0, 71, 200, 249):
        pedestal, rotor = spring[i] - 0.79 * w[i] ** 2 + link, bearing[i] - 0.13 * w[i] ** 2 + link
        expected = np.linalg.solve(np.array([[pedestal, -link], [-link, rotor]]), [1.0, 0.0])[1]
        assert joined.repeats[0, 0, i] * 2**0.5 == pytest.approx(expected, rel=1e-6)
    assert np.abs(joined.repeats[0, 0, 241]) > 2 * np.abs(rigid.repeats[0, 0, 241])  # near the joint's mode


@pytest.mark.slow
def test_no_cause_gives_all_and_noise_gives_what_theory_says():
    result = outcome("stiffness-causes")
    assert found("stiffness-causes", "causes that give all 10") == 0
    assert len(result.tables) == 4 and len(result.plots) == 5
    radial, axial = ({line[0]: line for line in table.rows} for table in result.tables[:2])
    # Eq 4.13 under white noise, by hand: rho k + (1 - rho) m w^2 in the last band of the axial rig.
    f = np.arange(239.0, 250.0)
    w2, m, k = (2 * np.pi * f) ** 2, 0.13, 2471.0
    force = 0.15 / crest_factor(synthesise(sphs(np.arange(1, 251), 20000), 20000)) * np.sqrt(2 / 250)
    sigma = 12.5e-6 * np.sqrt(4 / (20000 * 5)) / force
    power = 1 / (k - m * w2) ** 2
    limit = np.sum(k * power + m * w2 * sigma**2) / np.sum(power + sigma**2)
    loud = axial["noise of 12.5 µm, the 100 mV of 4.4.3"]
    assert float(loud[2].strip("()")) == pytest.approx(limit * 1e-3, rel=0.15)
    # A ripple at 5 kHz adds nothing to the probe's own noise.
    quiet = radial["noise of 0.5 µm, the stated resolution"]
    ripple = radial["current ripple: 100 mV at 25 kHz, read at 20 kHz"]
    assert float(ripple[6].strip("()")) == pytest.approx(float(quiet[6].strip("()")), rel=0.15)
