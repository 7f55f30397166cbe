"""Other force laws of the gap: against formulas written out, in Python and as pieces of the kernel."""

import re
from dataclasses import replace

import numpy as np
import pytest
from gap_laws import changed_law
from scipy.optimize import brentq

from maglev_env.experiment import Experiment
from maglev_env.kernel.lanes import lane_batch, structure_of
from maglev_env.lane_values import lane_values
from maglev_env.linear.loop import loop_response
from maglev_env.loop.actuator import current_scale
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.energy import coenergy
from maglev_env.loop.magnets.kinds import KINDS, force_law, geometric_law, inductance
from maglev_env.loop.magnets.law import _saturated, force, linearise, reshaped
from maglev_env.loop.mechanics import LIMIT_SQ
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_env.rig.self_sensor import rig_sensors
from maglev_lanes.layout import LANES, row

HYBRID = with_parameters(load_rig("hmb_free"), {"actuator_gain": None, "negative_stiffness": None})
BALL = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, turns=1000, pole_area=3e-4, bearings=2)
COIL = Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0)
RIGS = {
    "hybrid, gap": HYBRID,
    "hybrid, magnet": replace(HYBRID, flux_path="magnet"),
    "electromagnet pair": load_rig("eframe"),
    "electromagnet": BALL,
    "air coil": COIL,
    "iron coil": replace(
        COIL, force_exponent=2.5, force_constant=1e-5, pole_area=5e-5, magnet_area=8e-5, remanence=1.0
    ),
}
LAWS = [(0.4, 0.0), (0.0, 0.5), (-0.7, -0.3), (3.0, 2.0)]
GAINS = Gains(100.0, 0.0, 1.0)


@pytest.fixture(params=RIGS)
def raw(request):
    return RIGS[request.param]


def grid(rig):
    bias = abs(force_law(rig).bias_current)
    return np.meshgrid(np.linspace(-0.6, 0.6, 13) * rig.gap, np.linspace(-1.5, 1.5, 7) * bias)


def assert_same(found, expected, rtol=1e-11):
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def pulls(rig, effects, y, i):
    """The kernel's accelerations of a lane, as forces (N)."""
    e = Experiment(rig, GAINS, (), effects=effects)
    rows, s = lane_batch([e]).rows, structure_of(e)
    x = np.repeat(rows, LANES, axis=1).ravel()
    kind = KINDS[s.magnets]
    pull = kind.shaped_pull(s.saturating, s.steeper, s.shaped) if s.saturating or s.steeper else kind.pull
    scale = rig.mass * rig.control_rate**2
    return scale * np.vectorize(lambda y, i: pull(x, 0, y, i))(y, i)


@pytest.mark.parametrize(("exponent", "offset"), LAWS)
def test_another_law_is_the_formula_as_written(raw, exponent, offset):
    y, i = grid(raw)
    expected = changed_law(raw, exponent, offset)(y, i)
    assert_same(force(reshaped(force_law(raw), exponent, offset), y, i), expected)
    assert_same(pulls(raw, effect("force_law", exponent, offset=offset), y, i), expected, 1e-9)


@pytest.mark.parametrize(("exponent", "offset"), LAWS)
def test_at_the_resting_gap_only_the_stiffness_changes(raw, exponent, offset):
    law = force_law(raw)
    other, i = reshaped(law, exponent, offset), grid(raw)[1][:, 0]
    assert_same(force(other, 0.0, i), force(law, 0.0, i))
    assert linearise(other)[0] == pytest.approx(linearise(law)[0], rel=1e-12)
    assert linearise(other)[1] != pytest.approx(linearise(law)[1], rel=1e-3)


def test_calibration_and_changes_of_gain_and_stiffness_compose_with_another_law(raw):
    gain, stiffness = linearise(force_law(raw))
    rig = replace(raw, actuator_gain=1.3 * gain, negative_stiffness=0.7 * stiffness)
    geometry = changed_law(raw, 0.6, 0.2)
    y, i = grid(raw)
    a, b = 1.3 * 1.2, 0.7 * 0.9
    expected = b * geometry(y, 0.0 * i) + geometry(y, a * i) - geometry(y, 0.0 * i)
    changes = {**effect("force_law", 0.6, offset=0.2), **effect("negative_stiffness", -0.1)}
    assert_same(pulls(rig, changes, y, 1.2 * 1.3 * i), expected, 1e-9)  # the kernel's currents are calibrated


@pytest.mark.parametrize(("change", "share"), [(0.3, -0.5), (0.3, 0.4), (0.3, 1.0), (-0.25, 1.0)])
def test_a_change_of_stiffness_may_come_with_another_distance(raw, change, share):
    """As the law says at a displacement that is larger by a factor, with the rest of the change at i = 0."""
    y, i = grid(raw)
    y, factor, raw_force = 0.5 * y, (1 + change) ** share, changed_law(raw, 0.0, 0.0)
    expected = (1 + change) / factor * raw_force(factor * y, 0.0 * i)
    expected = expected + raw_force(factor * y, i) - raw_force(factor * y, 0.0 * i)
    effects = effect("negative_stiffness", change, distance_share=share)
    assert_same(pulls(raw, effects, y, i), expected, 1e-9)
    (law,) = lane_values([Experiment(raw, GAINS, (), effects=effects)]).laws
    gain, stiffness = linearise(force_law(raw))
    assert linearise(law) == pytest.approx((gain, stiffness), rel=1e-9)  # the lanes scale the stiffness


@pytest.mark.parametrize(("change", "share"), [(0.3, 1.0), (0.3, 0.4), (-0.25, 1.0)])
def test_a_change_of_gain_may_scale_the_force(raw, change, share):
    """The current that pulls is larger by one factor, and what it adds to the pull at rest by the other."""
    y, i = grid(raw)
    geometry, scaled = changed_law(raw, 0.0, 0.0), (1 + change) ** (1 - share) * i
    resting = geometry(y, 0.0 * i)
    expected = resting + (1 + change) ** share * (geometry(y, scaled) - resting)
    effects = effect("actuator_gain", change, force_share=share)
    values = lane_values([Experiment(raw, GAINS, (), effects=effects)])
    assert_same(current_scale(values), (1 + change) ** (1 - share), 1e-12)
    assert_same(pulls(raw, effects, y, scaled), expected, 1e-9)
    (law,) = values.laws
    assert linearise(law) == pytest.approx(linearise(force_law(raw)), rel=1e-9)  # the lanes scale the gain
    more = 0.0 if KINDS[raw.magnet].pair else 0.2 * raw.mass * raw.gravity
    heavier = pulls(raw, {**effects, **effect("mass", 0.2)}, y, scaled)
    assert_same(1.2 * heavier, expected - more, 1e-9)


@pytest.mark.parametrize("saturation", [np.inf, 0.4])
@pytest.mark.parametrize(("exponent", "offset"), LAWS)
def test_linearisation_is_the_derivative_anywhere(raw, exponent, offset, saturation):
    law = reshaped(force_law(raw), exponent, offset)
    if KINDS[raw.magnet].pair:
        law = replace(law, saturation=saturation)
    for y in (0.0, 0.2 * raw.gap, -0.4 * raw.gap):
        gain, stiffness = linearise(law, y)
        d = 1e-30
        assert np.imag(force(law, y, 1j * d)) / d == pytest.approx(gain, rel=1e-10)
        assert np.imag(force(law, y + 1j * d, 0.0)) / d == pytest.approx(-stiffness, rel=1e-10)


def test_the_linear_loop_of_an_eccentric_rotor_has_another_gain_by_another_law():
    e = Experiment(HYBRID, GAINS, (), effects={**effect("force_law", 2.0), **effect("eccentricity", 1e-4)})
    static = loop_response(e, np.array([1e-3])).plant[0].real
    f, d = changed_law(HYBRID, 2.0, 0.0), 1e-8
    gain = (f(1e-4, 1e-4) - f(1e-4, -1e-4)) / 2e-4
    stiffness = (f(1e-4 - d, 0.0) - f(1e-4 + d, 0.0)) / (2 * d)
    assert static == pytest.approx(gain / stiffness, rel=1e-5)


def test_saturation_and_another_exponent_act_together_in_the_kernel():
    law = replace(reshaped(force_law(HYBRID), 1.5, 0.4), saturation=0.5)
    y, i = grid(HYBRID)
    effects = {**effect("force_law", 1.5, offset=0.4), **effect("saturation", 0.5)}
    assert_same(pulls(HYBRID, effects, y, i), force(law, y, i), 1e-9)
    assert_same(pulls(HYBRID, effect("saturation", np.inf), y, i), force(force_law(HYBRID), y, i), 1e-11)


# A ball whose coil's inductance was measured: L0 + L1 / (1 + x / a), L0 + L1 exp(-x / a), and a fitted power.
L1, A, WEIGHT = 60e-3, 2.5e-3, 0.058 * 9.80665
PLAIN = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, turns=1000, pole_area=3e-4)
MEASURED = {
    "inductance": ({"force_constant": L1 * A / 2, "gap_offset": A}, lambda x: L1 / (2 * A) / (1 + x / A) ** 2),
    "exponential": ({"force_constant": L1 / (2 * A), "force_length": A}, lambda x: L1 / (2 * A) * np.exp(-x / A)),
    "power": ({"force_constant": 2e-7, "force_exponent": 3.1}, lambda x: 2e-7 * x**-3.1),
}


@pytest.mark.parametrize("name", MEASURED)
def test_an_electromagnet_pulls_as_it_was_measured(name):
    stated, per_square = MEASURED[name]
    rig = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, **stated)
    law, bias = force_law(rig), np.sqrt(WEIGHT / per_square(4e-3))
    assert law.bias_current == pytest.approx(bias, rel=1e-12)
    y, i = grid(rig)
    expected = per_square(4e-3 - y) * (bias + i) ** 2 - WEIGHT
    assert_same(force(law, y, i), expected)
    assert_same(pulls(rig, {}, y, i), expected, 1e-9)
    assert structure_of(Experiment(rig, GAINS, ())).steeper == (name != "inductance")
    # The same with the constant from the bias instead.
    known = {key: value for key, value in stated.items() if key != "force_constant"}
    assert_same(
        force(force_law(Rig("ball", "electromagnet", 0.058, gap=4e-3, bias_current=bias, **known)), y, i), expected
    )
    # The force is the slope of the co-energy.
    slope = np.imag(coenergy(law, y + 1e-30j, i)) / 1e-30
    assert_same(slope, expected, 1e-9)
    calibrated = replace(rig, actuator_gain=2.0, negative_stiffness=-300.0)
    assert linearise(force_law(calibrated)) == (pytest.approx(2.0), pytest.approx(-300.0))


def test_the_bias_alone_gives_the_constant():
    rig = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, bias_current=0.8)
    gain, stiffness = linearise(force_law(rig))
    assert (gain, stiffness) == (pytest.approx(2 * WEIGHT / 0.8), pytest.approx(-2 * WEIGHT / 4e-3))
    text = 'schema = "maglev-rig/1"\nname = "b"\nmagnet = "electromagnet"\n[parameters]\nmass = 0.058\ngap = 4e-3\n'
    assert force_law(rig_from_toml(text + "bias_current = 0.8\n", "rig.toml")) == force_law(rig)


def test_the_effect_makes_the_inductance_law_of_the_plain_one():
    plain = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, bias_current=0.8)
    other = replace(plain, gap_offset=A)
    y, i = grid(plain)
    assert_same(force(reshaped(force_law(plain), 0.0, A / 4e-3), y, i), force(force_law(other), y, i))
    # An exponential law is the limit of a large offset, with an exponent in proportion.
    decaying = replace(plain, force_length=A)
    for offset, within in ((20.0, 3e-2), (100.0, 6e-3)):
        near = reshaped(force_law(plain), 4e-3 / A * (1 + offset) - 2, offset)
        assert_same(force(near, y, i), force(force_law(decaying), y, i), within)


def test_a_pair_with_another_exponent_has_no_coenergy_in_closed_form():
    with pytest.raises(ValueError, match="closed form"):
        coenergy(reshaped(geometric_law(HYBRID), 0.1, 0.0), 0.0, 0.0)
    with pytest.raises(ValueError, match="closed form"):
        coenergy(
            reshaped(geometric_law(replace(PLAIN, turns=1.0, bias_current=1.0, force_length=A)), 0.1, 0.0), 0.0, 0.0
        )


def test_inductance_and_self_sensing_need_the_turns_and_take_the_gap_offset():
    rig = Rig("ball", "electromagnet", mass=0.058, gap=4e-3, bias_current=0.8, gap_offset=A)
    for asked in (lambda: inductance(rig), lambda: rig_sensors(rig)):
        with pytest.raises(ValueError, match="turns is missing"):
            asked()
    pair = replace(load_rig("hmb_free"), turns=1.0)
    for asked in (lambda: inductance(pair), lambda: rig_sensors(pair)):
        with pytest.raises(ValueError, match="turns is missing"):
            asked()
    known = replace(PLAIN, gap_offset=A)
    assert inductance(known, 1e-3) == pytest.approx(4e-7 * np.pi * 1000**2 * 3e-4 / (2 * (3e-3 + A)))
    assert rig_sensors(known)[0].coil.inductance(4e-3) == pytest.approx(inductance(known))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"force_length": A, "force_exponent": 2.0}, "force_exponent beside force_length"),
        ({"force_length": A, "gap_offset": A}, "gap_offset beside force_length"),
        (
            {"force_exponent": 3.0},
            "force_constant is missing: turns and pole_area give the pull for force_exponent = 2",
        ),
        ({"force_length": A}, "force_constant is missing"),
        ({"turns": 1.0}, "bias_current is missing: nothing says how hard the electromagnet pulls"),
        ({"force_constant": 1e-4, "bearings": 2}, "bearings = 2: the force_constant is that of all coils"),
        ({"force_constant": 1e-4, "bias_current": 0.1}, "correct force_constant, gap or mass"),
        ({"force_constant": 1e-20}, "A would balance the weight"),
    ],
)
def test_an_electromagnet_that_is_not_one_law_is_refused(changes, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        replace(PLAIN, **changes)


@pytest.mark.parametrize(
    ("rig", "name", "value"), [(HYBRID, "force_constant", 1.0), (HYBRID, "gap_offset", 1e-3), (COIL, "force_length", A)]
)
def test_a_parameter_of_another_magnet_is_refused(rig, name, value):
    with pytest.raises(ValueError, match=f"{name} belongs to magnet = .*'electromagnet'"):
        replace(rig, **{name: value})


@pytest.mark.parametrize(
    "effects, nearest",
    [
        (effect("force_law", 0.0, offset=-0.5), 0.5),
        (effect("negative_stiffness", 1.0, distance_share=1.0), 0.5),
        (effect("negative_stiffness", -0.75, distance_share=-0.5), 0.5),
        (effect("negative_stiffness", -0.5, distance_share=1.0), 1.0),
    ],
)
def test_contact_is_before_a_shorter_magnetic_gap(effects, nearest):
    """Beyond a pole the formula of the pull changes its sign."""
    e = Experiment(BALL, GAINS, (), effects=effects)
    assert lane_batch([e]).rows[row(LIMIT_SQ), 0] == pytest.approx((0.999 * nearest * BALL.gap) ** 2)


@pytest.mark.parametrize(("sharpness", "creep"), [(2.0, 0.0), (3.0, 0.0), (6.0, 0.0), (3.0, 0.25)])
def test_a_knee_of_any_sharpness_has_the_slopes_of_its_force(sharpness, creep):
    bent = replace(force_law(load_rig("hmb_free")), saturation=0.5, sharpness=sharpness, creep=creep)
    gain, stiffness = linearise(bent)
    h = 1e-7  # m, and A: small beside gap and bias
    assert gain == pytest.approx((force(bent, 0.0, h) - force(bent, 0.0, -h)) / (2 * h), rel=1e-6)
    assert -stiffness == pytest.approx((force(bent, h, 0.0) - force(bent, -h, 0.0)) / (2 * h), rel=1e-6)


@pytest.mark.parametrize("gap_share", [0.6, 1.0, 1.4])
def test_a_knee_that_creeps_is_iron_in_series_with_the_gap(gap_share):
    """The iron needs a field strength that goes as B^5. The law is solved for B by search, from .1 to 30 knees."""
    pair = replace(load_rig("eframe"), bearings=1)
    own, iron = force_law(pair), 0.2 * pair.gap
    # Knee and sharpness as they fit best; beyond the knee neither plays a part.
    bent = replace(own, saturation=1.42, sharpness=2.17, creep=0.2)
    still = replace(bent, creep=0.0)
    x, strays = gap_share * pair.gap, []
    for asked in np.geomspace(0.1, 30.0, 12):  # T m per gap length at rest: half of mu_0 times the ampere-turns
        drive = asked * pair.gap
        field = brentq(lambda b, drive=drive: x * b + iron * b**5 - drive, 0.0, drive / x)
        found = [_saturated(drive / x, x, law) ** 0.5 / field for law in (bent, still)]
        assert found[0] == pytest.approx(1.0, abs=0.035)
        strays.append(abs(found[1] - 1))
    assert max(strays) > 0.4
