"""The force laws against their equations, their energy, and the measured figures."""

import re
from dataclasses import replace

import numpy as np
import pytest
from reference_simulator import force_law as written_out

from maglev_env.loop.magnets.energy import coenergy
from maglev_env.loop.magnets.kinds import KINDS, force_law, inductance
from maglev_env.loop.magnets.law import force, linearise
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import load_rig
from selfsense.coil import MU_0, coil_inductance

RAW = {"actuator_gain": None, "negative_stiffness": None, "bearings": 1}
GRAVITY = 9.80665
HYBRID = with_parameters(load_rig("hmb_free"), RAW | {"bearings": 2})
BALL = Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4, bearings=2)
COIL = Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0)
CORED = replace(COIL, force_exponent=2.5, force_constant=1e-5, pole_area=5e-5, magnet_area=8e-5, remanence=1.0)
RIGS = {
    "hybrid, gap": HYBRID,
    "hybrid, magnet": replace(HYBRID, flux_path="magnet"),
    "electromagnet pair": load_rig("eframe"),
    "electromagnet": BALL,
    "air coil": COIL,
    "air coil, n = 1": replace(COIL, force_exponent=1.0, force_constant=1e-2),
    "iron coil": CORED,
}


def balancing_bias(rig):
    return KINDS[rig.magnet].balancing_bias(rig)


@pytest.fixture(params=RIGS)
def raw(request):
    return RIGS[request.param]


@pytest.fixture(params=[True, False], ids=["calibrated", "by geometry"])
def rig(request, raw):
    gain, stiffness = linearise(force_law(raw))
    return replace(raw, actuator_gain=1.7 * gain, negative_stiffness=0.6 * stiffness) if request.param else raw


def grid(rig, current=2.0):
    """Displacements up to 80 % of the gap and currents on both sides of the bias."""
    bias = abs(force_law(rig).bias_current)
    return np.meshgrid(np.linspace(-0.8, 0.8, 17) * rig.gap, np.linspace(-current, current, 9) * bias)


@pytest.mark.parametrize("flux_path", ["gap", "magnet"])
@pytest.mark.parametrize("calibrated", [True, False])
def test_the_law_is_the_equation_as_written(flux_path, calibrated):
    rig = with_parameters(load_rig("hmb_free"), {"flux_path": flux_path} | ({} if calibrated else RAW))
    y, i = np.meshgrid(np.linspace(-3e-4, 3e-4, 13), np.linspace(-2, 2, 9))
    np.testing.assert_allclose(force(force_law(rig), y, i), written_out(rig)(y, i), rtol=2e-7, atol=1e-9)


def test_one_pair_through_the_magnet_has_half_the_published_coefficients():
    rig = with_parameters(load_rig("hmb_free"), RAW | {"flux_path": "magnet"})
    gain, stiffness = linearise(force_law(rig))
    # eq 3.12 and 3.13 give 1.281 N/A and -12.49 N/mm: twice the derivatives of eq 3.10.
    assert gain == pytest.approx(0.640, abs=5e-4)
    assert stiffness == pytest.approx(-6243, abs=1)


def test_flux_through_the_gaps_alone_explains_the_measured_gain_and_inductance():
    rig = with_parameters(load_rig("hmb_free"), RAW)
    law = force_law(rig)
    bias = law.magnet_flux / (law.gap + law.magnet_gap)
    assert bias == pytest.approx(0.548, abs=5e-4)
    assert bias * rig.turns * rig.pole_area / rig.gap == pytest.approx(5.53, abs=5e-3)
    assert inductance(rig) == pytest.approx(0.571e-3, rel=1e-3)
    assert inductance(rig) == pytest.approx(rig.turns**2 * MU_0 * rig.pole_area / (2 * rig.gap))


def test_the_hybrid_law_hits_the_measured_coefficients():
    for flux_path in ("gap", "magnet"):
        law = force_law(with_parameters(load_rig("hmb_free"), {"flux_path": flux_path}))
        assert linearise(law) == (pytest.approx(5.7), pytest.approx(-12.5e3))


def test_linearisation_is_the_derivative(rig):
    law, d = force_law(rig), 1e-30
    gain, stiffness = linearise(law)
    assert force(law, 0.0, 1j * d).imag / d == pytest.approx(gain, rel=1e-12)
    assert force(law, 1j * d, 0.0).imag / d == pytest.approx(-stiffness, rel=1e-12)
    if rig.actuator_gain is not None:
        assert (gain, stiffness) == (pytest.approx(rig.actuator_gain), pytest.approx(rig.negative_stiffness))


def test_calibration_scales_the_current_and_the_force_without_it(raw):
    gain, stiffness = linearise(force_law(raw))
    law = force_law(replace(raw, actuator_gain=1.7 * gain, negative_stiffness=0.6 * stiffness))
    by_geometry = force_law(raw)
    y, i = grid(raw, 0.5)
    at_rest = force(by_geometry, y, 0.0)
    expected = 0.6 * at_rest + force(by_geometry, y, 1.7 * i) - at_rest
    np.testing.assert_allclose(force(law, y, i), expected, rtol=1e-12, atol=1e-12 * abs(expected).max())


def constant(rig):
    return rig.bearings * MU_0 * rig.turns**2 * rig.pole_area / 4


def test_an_electromagnet_pair_pulls_by_the_squares_of_current_over_gap():
    rig = replace(load_rig("eframe"), bearings=3)
    y, i = grid(rig)
    upper, lower = (rig.bias_current + i) / (rig.gap - y), (rig.bias_current - i) / (rig.gap + y)
    expected = constant(rig) * (upper**2 - lower**2)
    np.testing.assert_allclose(force(force_law(rig), y, i), expected, rtol=1e-12, atol=1e-13 * abs(expected).max())


def test_the_e_frame_cannot_carry_its_platform():
    rig = load_rig("eframe")
    assert constant(rig) * (rig.bias_current / rig.gap) ** 2 == pytest.approx(0.294, abs=5e-4)
    gain, stiffness = linearise(force_law(rig))
    assert (gain, stiffness) == (pytest.approx(3.921, abs=5e-4), pytest.approx(-1176.2, abs=0.05))


def test_an_electromagnet_carries_its_ball():
    law, weight = force_law(BALL), BALL.mass * GRAVITY
    bias = BALL.gap * np.sqrt(weight / constant(BALL))
    assert law.bias_current == pytest.approx(bias, rel=1e-14) == balancing_bias(BALL)
    y, i = grid(BALL)
    expected = constant(BALL) * ((bias + i) / (BALL.gap - y)) ** 2 - weight
    np.testing.assert_allclose(force(law, y, i), expected, rtol=1e-12, atol=1e-12 * weight)
    assert linearise(law)[1] == pytest.approx(-2 * weight / BALL.gap, rel=1e-12)


@pytest.mark.parametrize("rig", [COIL, CORED], ids=["air", "iron"])
def test_a_coil_carries_its_magnet(rig):
    law, weight = force_law(rig), rig.mass * GRAVITY
    mu_m = rig.recoil_permeability * MU_0
    source = rig.remanence * rig.magnet_length / mu_m
    reluctance = rig.magnet_length * rig.pole_area / (mu_m * rig.magnet_area)

    def attraction(y):
        return rig.pole_area / (2 * MU_0) * (source / (2 * (rig.gap - y) / MU_0 + reluctance)) ** 2

    bias = (weight - attraction(0)) * rig.gap**rig.force_exponent / rig.force_constant
    assert law.bias_current == pytest.approx(bias, rel=1e-12)
    y, i = grid(rig)
    coil = rig.force_constant * (bias + i) / (rig.gap - y) ** rig.force_exponent
    expected = coil + attraction(y) - weight
    np.testing.assert_allclose(force(law, y, i), expected, rtol=1e-12, atol=1e-12 * weight)


def test_a_magnet_that_its_coils_iron_would_lift_is_pushed_away():
    rig = with_parameters(CORED, {"gap": 5e-3, "pole_area": 3e-4, "magnet_area": 3e-4})
    law = force_law(rig)
    assert law.bias_current == balancing_bias(rig) < 0
    assert abs(force(law, 0.0, 0.0)) < 1e-12 * law.weight
    assert linearise(law)[1] > 0
    with pytest.raises(ValueError, match=r"negative_stiffness .* not unstable"):
        replace(rig, negative_stiffness=-10.0)


def test_a_given_bias_must_carry_the_weight_within_one_percent():
    heavy = {"mass": 1.06, "gap": 1e-3, "turns": 200.0, "pole_area": 260e-6}
    with pytest.raises(ValueError) as error:
        Rig("eframe", "electromagnet", **heavy, bias_current=0.3)
    for word in ("0.3 A pulls 0.294 N", "gap 1 mm", "weight is 10.4 N", "(1.78 A)", "turns, pole_area, gap or mass"):
        assert word in str(error.value)
    bias = balancing_bias(BALL)  # the pull goes with its square
    kept = force_law(replace(BALL, bias_current=1.0045 * bias))
    assert kept.bias_current == 1.0045 * bias and 0.008 < force(kept, 0.0, 0.0) / kept.weight < 0.01
    for factor in (0.99, 1.01):
        with pytest.raises(ValueError, match="leave bias_current out"):
            replace(BALL, bias_current=factor * bias)
    with pytest.raises(ValueError, match="correct force_constant, force_exponent, gap or mass"):
        replace(COIL, bias_current=1.02 * balancing_bias(COIL))


@pytest.mark.parametrize(
    ("rig", "changes", "words"),
    [
        (HYBRID, {"remanence": 0.0}, "remanence: a hybrid pair needs"),
        (BALL, {"remanence": 1.0}, "remanence = 1.0 T: an electromagnet has no permanent magnet"),
        (BALL, {"gravity": 0.0}, "gravity = 0: electromagnet pulls one way only"),
        (COIL, {"gravity": 0.0}, "gravity = 0: magnet_coil pulls one way only"),
        (BALL, {"flux_path": "magnet"}, "flux_path = 'magnet' belongs to the hybrid_pair"),
        (BALL, {"axes": 2}, "axes = 2: one electromagnet carries a weight along one axis"),
        (BALL, {"turns": 1.0, "pole_area": 1e-9, "mass": 10.0}, "A would balance the weight at gap 10 mm"),
        (BALL, {"force_constant": 1e-8}, "bearings = 2: the force_constant is that of all coils"),
        (COIL, {"force_constant": None}, "force_constant is missing"),
        (COIL, {"force_exponent": None}, "force_exponent is missing"),
        (COIL, {"force_exponent": 0.5}, "force_exponent = 0.5"),
        (COIL, {"bearings": 2}, "bearings = 2"),
        (RIGS["electromagnet pair"], {"bias_current": 0.0}, "bias_current: an electromagnet_pair needs one"),
    ],
)
def test_a_magnet_that_cannot_work_is_refused(rig, changes, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        replace(rig, **changes)


def test_force_is_the_slope_of_the_coenergy(rig):
    law, d = force_law(rig), 1e-30
    y, i = grid(rig)
    slope = np.imag(coenergy(law, y + 1j * d, i)) / d
    expected = force(law, y, i)
    np.testing.assert_allclose(slope, expected, rtol=1e-10, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize("name", ["electromagnet pair", "electromagnet"])
def test_coenergy_bends_with_current_as_the_coils_inductance(name):
    rig = replace(RIGS[name], bearings=3)
    law, y = force_law(rig), np.linspace(-0.8, 0.8, 9) * rig.gap
    gaps = (rig.gap - y, rig.gap + y) if name == "electromagnet pair" else (rig.gap - y,)
    expected = rig.bearings * sum(coil_inductance(gap, rig.turns, rig.pole_area) for gap in gaps)
    # The co-energy is a parabola in the current: its second difference at any step is the derivative.
    bend = coenergy(law, y, 1.0) - 2 * coenergy(law, y, 0.0) + coenergy(law, y, -1.0)
    np.testing.assert_allclose(bend, expected, rtol=1e-9)


def test_coenergy_of_a_coil_is_smooth_in_its_exponent():
    y, i = grid(COIL)
    near, one = (force_law(replace(RIGS["air coil, n = 1"], force_exponent=n)) for n in (1 + 1e-9, 1.0))
    np.testing.assert_allclose(coenergy(near, y, i), coenergy(one, y, i), rtol=1e-6, atol=1e-8)


def test_inductance_is_that_of_the_gap_and_constant_below_a_coil():
    y = np.linspace(-0.8, 0.8, 5) * BALL.gap
    np.testing.assert_allclose(inductance(BALL, y), coil_inductance(BALL.gap - y, 1000, 3e-4))
    np.testing.assert_array_equal(inductance(replace(COIL, coil_inductance=0.02), y), np.full(5, 0.02))
    with pytest.raises(ValueError, match="coil_inductance is missing"):
        inductance(COIL)
    with pytest.raises(ValueError, match="has no coil"):
        inductance(load_rig("pedestal"))


def test_force_is_the_work_of_the_field_when_flux_runs_through_the_magnet():
    # One circuit, one gap pair: f dy = -d(field energy) at constant flux; by co-energy, f = dW'/dy at constant current.
    rig = with_parameters(load_rig("hmb_free"), RAW | {"flux_path": "magnet"})
    law = force_law(rig)
    mu_m = rig.recoil_permeability * MU_0
    source = rig.remanence * rig.magnet_length / mu_m
    reluctance = rig.magnet_length / (mu_m * rig.magnet_area)

    def co_energy(y, i):
        upper = 0.5 * (rig.turns * (rig.bias_current + i) + source) ** 2
        lower = 0.5 * (rig.turns * (rig.bias_current - i) + source) ** 2
        gaps = [2 * (rig.gap - y) / (MU_0 * rig.pole_area), 2 * (rig.gap + y) / (MU_0 * rig.pole_area)]
        return upper / (gaps[0] + reluctance) + lower / (gaps[1] + reluctance)

    for y, i in [(0.0, 0.1), (5e-5, -0.3), (-1e-4, 0.5)]:
        d = 1e-8
        work = (co_energy(y + d, i) - co_energy(y - d, i)) / (2 * d)
        # D eq 3.10 counts the pull of one gap of each circuit; the work counts both.
        assert 2 * force(law, y, i) == pytest.approx(work, rel=1e-6)
        assert 2 * coenergy(law, y, i) == pytest.approx(co_energy(y, i), rel=1e-12)


def test_a_rig_without_magnets_has_no_law():
    with pytest.raises(ValueError, match="no force law"):
        force_law(load_rig("pedestal"))


def test_a_pair_without_turns_is_as_strong_as_its_gain_says():
    gap, bias, gain = 0.8e-3, 1.5, 60.0
    rig = Rig("pair", "electromagnet_pair", mass=3.2, gap=gap, bias_current=bias, actuator_gain=gain)
    # C ((I + i)^2 / (g - y)^2 - (I - i)^2 / (g + y)^2) with 4 C I / g^2 = gain (Schweitzer and Maslen 2009).
    c = gain * gap**2 / (4 * bias)
    y, i = np.meshgrid(np.linspace(-0.5, 0.5, 7) * gap, np.linspace(-0.9, 0.9, 7) * bias)
    expected = c * ((bias + i) ** 2 / (gap - y) ** 2 - (bias - i) ** 2 / (gap + y) ** 2)
    np.testing.assert_allclose(force(force_law(rig), y, i), expected, rtol=1e-9, atol=1e-9)


def test_a_pair_of_unknown_strength_and_a_gain_without_magnet_are_refused():
    with pytest.raises(ValueError, match="turns: nothing says how strong"):
        Rig("pair", "electromagnet_pair", mass=1.0, bias_current=1.0)
    for name, value in (("actuator_gain", 42.0), ("negative_stiffness", -1e3)):
        with pytest.raises(ValueError, match=f"{name} is a magnet's"):
            Rig("bare", "none", mass=1.0, **{name: value})
