"""The linear part of every effect, against its definition in continuous time, held and sampled by hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from effect_cases import ALL, COUPLED, EACH, FREE, MOUNT, OTHER_Y, SECOND_BODY
from scipy.linalg import expm
from scipy.signal import dlsim

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop, closed_loop_poles
from maglev_env.loop.eddy import BRANCHES, eddy_branches
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER, Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig

RATE = 20000.0
DT = 1 / RATE
ELECTROMAGNETS = replace(FREE, magnet="electromagnet_pair", bias_current=3.0, remanence=0.0, bounds={})
NO_LINEAR_PART = {
    **effect("runout", 1e-6),
    **effect("pickup", 1e-6),
    **effect("unbalance", 1e-6),
    **effect("amplifier_voltage_limit", 1.0),
}
NEUTRAL = {
    **effect("eddy_current", np.inf),
    **effect("hysteresis", 0.0),
    **effect("saturation", np.inf),
    **effect("eccentricity", 0.0),
    **effect("sensor_resonance", 100.0, coupling=0.0),
    **effect("friction", 0.0),
    **effect("support_resonance", 100.0, mass_ratio=0.0),
}
LINES = np.array([0.5, 20.0, 110.0, 181.0, 299.0, 330.0, 695.0, 3000.0, 9500.0])


def of(rig=FREE, effects=None, gains=FREE.gains):
    return Experiment(rig, gains, (), effects=effects or {})


eddy_once = cache(eddy_branches)


def branches(s, corner, order):
    """What the branches of the eddy currents make of a current, summed one by one."""
    direct, weights, rates = eddy_once(corner, order)
    return direct + sum(w * p / (s + p) for w, p in zip(weights, rates, strict=True))


def fractional(s, corner, order):
    """What they stand for."""
    return 1 / (1 + (s / (2 * np.pi * corner)) ** order)


def mode(values, s):
    """Natural frequency squared plus damping, and the whole characteristic polynomial, of a second-order mode."""
    w = 2 * np.pi * values["frequency"]
    held = w**2 + 2 * values["damping_ratio"] * w * s
    return held, held + s**2


def quotients(law, y, d_i=1e-3, d_y=1e-8):
    """df/di and -df/dy of a force law at y."""
    gain = (force(law, y, d_i) - force(law, y, -d_i)) / (2 * d_i)
    return gain, (force(law, y - d_y, 0.0) - force(law, y + d_y, 0.0)) / (2 * d_y)


def physical(s, rig, effects, cross, iron=branches):
    """Readings per command, readings per force, current per command of one complex s: definitions written out.

    rig: one-axis rigs; all matrices are [to, from] axis.
    """
    get = {name: values[next(iter(values))] for name, values in effects.items()}.get
    axes = range(len(rig))
    eye = np.eye(len(rig))
    mass = np.diag([r.mass * (1 + get("mass", 0.0)) for r in rig])
    gain, stiffness, far_gain, far_stiffness = np.zeros((4, len(rig), len(rig)))
    for i in axes:
        # Central differences of the force law itself; what reaches the other axis is that of the centred iron.
        law, y = force_law(rig[i]), get("eccentricity", 0.0)
        bent = replace(law, saturation=get("saturation", np.inf))
        gain[i, i], stiffness[i, i] = quotients(bent, y)
        far_gain[i, i], far_stiffness[i, i] = quotients(law, 0.0)
    change = 1 + get("actuator_gain", 0.0), 1 + get("negative_stiffness", 0.0)
    gain, stiffness, far_gain, far_stiffness = (
        matrix * factor for matrix, factor in zip((gain, stiffness, far_gain, far_stiffness), change * 2, strict=True)
    )
    damping = np.diag([r.support_damping + get("damping", 0.0) for r in rig])
    if "friction" in effects:
        slip, bristles = effects["friction"]["velocity"], effects["friction"]["presliding"]
        damping = damping + effects["friction"]["force"] / (slip + s * bristles) * eye
    mix, ratio = eye, get("cross_coupling", 0.0)
    if len(rig) == 2:
        swap = np.array([[0, 1], [1, 0]])
        gain = gain + ratio * swap @ far_gain + [[0, cross.gain_xy], [cross.gain_yx, 0]]
        stiffness = stiffness + ratio * swap @ far_stiffness + [[0, cross.stiffness_xy], [cross.stiffness_yx, 0]]
        damping = damping + np.array([[0, cross.damping_xy], [cross.damping_yx, 0]])
        mix = np.array([[1, cross.sensor_xy], [cross.sensor_yx, 1]])
    stiffness = stiffness + np.diag([r.support_stiffness * (1 + get("support_stiffness", 0.0)) for r in rig])
    amplifier = np.diag([1 / (1 + s * r.amplifier_time_constant) / (1 + s * get("amplifier_lag", 0.0)) for r in rig])
    amplifier = amplifier * np.exp(-s * get("delay", 0.0))
    eddy = effects.get("eddy_current")
    pulling = iron(s, eddy["corner_hz"], eddy["order"]) if eddy else 1.0
    pushed = gain @ amplifier * (pulling - get("hysteresis", 0.0))
    carried = mass * s**2
    if "support_resonance" in effects:
        held, whole = mode(effects["support_resonance"], s)
        carried = carried * (1 + effects["support_resonance"]["mass_ratio"] * held / whole)
    bearing = damping * s + stiffness
    receptance = np.linalg.inv(carried + bearing)
    moved = receptance @ np.concatenate([pushed, eye], axis=1)
    if "sensor_resonance" in effects:
        _, whole = mode(effects["sensor_resonance"], s)
        reaction = np.linalg.inv(mass) @ (np.concatenate([pushed, 0 * eye], axis=1) - bearing @ moved)
        moved = moved + effects["sensor_resonance"]["coupling"] / whole * reaction
    probe = [
        (1 + get("sensor_gain", 0.0)) / (1 + s * r.sensor_time_constant) / (1 + s * get("sensor_lag", 0.0)) for r in rig
    ]
    read = mix @ np.diag(probe) @ moved
    return read[:, : len(rig)], read[:, len(rig) :], amplifier


def sampled(f, rig, effects, cross=None, aliases=120, **kwargs):
    """What sampling and a hold make of `physical`: the sum over all images of f."""
    total = 0.0
    for image in range(-aliases, aliases + 1):
        s = 2j * np.pi * (f + image * RATE)
        held = (1 - np.exp(-2j * np.pi * f / RATE)) / s * RATE
        total = total + np.array(physical(s, rig, effects, cross, **kwargs)) * held
    return total


def check_held_and_sampled(e, rigs, tolerance, lines=LINES, **kwargs):
    response = loop_response(e, lines)
    n = len(rigs)
    matrices = {name: np.reshape(value, (-1, n, n)) for name, value in vars(response).items() if name != "frequency"}
    for i, f in enumerate(lines):
        plant, receptance, _ = sampled(f, rigs, e.effects, e.rig.cross, **kwargs)
        closed = np.linalg.inv(np.eye(n) + plant @ matrices["controller"][i]) @ receptance
        for got, expected in ((matrices["plant"][i], plant), (matrices["receptance"][i], closed)):
            assert (np.abs(got - expected) <= tolerance * np.abs(expected)).all(), f


@pytest.mark.parametrize("delay", [0.0, 61.7e-6])
@pytest.mark.parametrize("effects", [*EACH.values(), ALL], ids=[*EACH, "all"])
def test_every_effect_is_its_definition_held_and_sampled(effects, delay):
    # The images left out are below 1e-6 of the sum.
    check_held_and_sampled(of(effects={**effects, **effect("delay", delay)}), [FREE], 2e-6)


@pytest.mark.parametrize("name", [name for name in EACH if name != "nominal"])
def test_every_effect_changes_what_is_measured(name):
    plain, changed = loop_response(of(), LINES), loop_response(of(effects=EACH[name]), LINES)
    assert np.abs(changed.plant / plain.plant - 1).max() > 5e-3


@pytest.mark.parametrize("effects", [NO_LINEAR_PART, NEUTRAL], ids=["no linear part", "neutral"])
def test_effects_that_do_nothing_in_the_small_leave_the_loop_as_it_is(effects):
    rig = replace(FREE, coil_inductance=1e-3)
    plain, named = of(rig), of(rig, effects)
    np.testing.assert_array_equal(closed_loop_poles(named), closed_loop_poles(plain))
    np.testing.assert_array_equal(loop_response(named, LINES).plant, loop_response(plain, LINES).plant)


def test_the_fractional_lag_itself_is_met_within_a_third_of_a_percent_up_to_2_khz():
    lines = LINES[LINES < 2000]
    check_held_and_sampled(of(effects=EACH["eddy_current"]), [FREE], 4e-3, lines, iron=fractional)


def test_a_corner_of_eddy_currents_may_be_a_whole_number():
    """Its bytes were taken for those of a float, and the loop had no poles."""
    whole, real = (Experiment(FREE, FREE.gains, (), effects=effect("eddy_current", f)) for f in (1400, 1400.0))
    np.testing.assert_array_equal(closed_loop_poles(whole), closed_loop_poles(real))


@pytest.mark.parametrize("lags", [{}, effect("amplifier_lag", 3e-5)], ids=["one pole", "two poles"])
@pytest.mark.parametrize("delay", [0.0, 20e-6, 50e-6, 85e-6])
def test_the_amplifier_response_is_the_lag_held_and_sampled(lags, delay):
    e = of(effects={**EACH["eddy_current"], **lags, **effect("delay", delay)})
    got, rates = loop_response(e, LINES).amplifier, 1 / np.array([1e-4, *(x["time_constant"] for x in lags.values())])
    whole, part = int(delay / DT), delay % DT

    def step(t):
        """Current t after the command's step."""
        if len(rates) == 1:
            return 1 - np.exp(-rates[0] * t)
        p, q = rates
        return 1 - (q * np.exp(-p * t) - p * np.exp(-q * t)) / (q - p)

    # The pulse of a held command, added up with the phase of every sample that it came before.
    n = np.arange(400)
    pulse = step(np.maximum((n + 1) * DT - part, 0)) - step(np.maximum(n * DT - part, 0))
    expected = [pulse @ np.exp(-2j * np.pi * f * DT * (n + 1 + whole)) for f in LINES]
    np.testing.assert_allclose(got, expected, rtol=1e-9)


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (20e-6, 1), (50e-6, 1), (120e-6, 3)])
def test_without_a_pole_the_current_is_the_command_that_has_arrived(delay, samples):
    rig = replace(FREE, amplifier_time_constant=0.0)
    got = loop_response(of(rig, effect("delay", delay)), LINES).amplifier
    np.testing.assert_allclose(got, np.exp(-2j * np.pi * LINES * DT * samples), rtol=1e-9)
    both = loop_response(of(replace(COUPLED, amplifier_time_constant=0.0, per_axis={}), effect("delay", delay)), LINES)
    np.testing.assert_allclose(both.amplifier, got[:, None, None] * np.eye(2), atol=1e-9)


def test_two_free_masses_have_the_poles_that_their_spring_gives():
    rig = replace(load_rig("pedestal"), support_stiffness=0.0, support_damping=0.0, sensor_time_constant=0.0)
    values = SECOND_BODY["support_resonance"]
    poles = closed_loop_poles(of(rig, SECOND_BODY, NO_CONTROLLER))
    # Reduced mass: the frequency on a free mover is root(1 + mu) that on a held one, and so is the damping ratio.
    w = 2 * np.pi * values["frequency"] * np.sqrt(1 + values["mass_ratio"])
    ratio = values["damping_ratio"] * np.sqrt(1 + values["mass_ratio"])
    expected = np.exp(w * (-ratio + 1j * np.sqrt(1 - ratio**2)) * DT)
    for pole in (expected, np.conj(expected)):
        assert np.abs(poles - pole).min() < 1e-12
    # And the two together do not move by themselves: a double pole, which rounding splits.
    assert np.sum(np.abs(poles - 1) < 1e-5) == 2


@pytest.mark.parametrize("share", [1.0, 0.25, 0.0])
def test_at_a_standstill_the_mount_gives_way_to_what_it_feels_of_the_support(share):
    rig = load_rig("pedestal")
    values = {**MOUNT["sensor_resonance"], "support_share": share}
    got = loop_response(of(rig, {"sensor_resonance": values}, NO_CONTROLLER), np.array([1e-3])).receptance[0]
    # The bearing pushes the mover with -1 N, so its reaction moves the mount by k / (m W^2).
    given_way = share * values["coupling"] / rig.mass / (2 * np.pi * values["frequency"]) ** 2
    assert got == pytest.approx(1 / rig.support_stiffness - given_way, rel=1e-4)


def test_a_mount_that_feels_all_forces_moves_as_the_rotor_is_accelerated():
    """Then the reading is that of the rotor times one filter, whether the magnets or a force from outside move it."""
    rig, f = load_rig("pedestal"), np.array([20.0, 55.0, 90.0])
    values = {**MOUNT["sensor_resonance"], "outside_share": 1.0}
    with_mount, without = (
        loop_response(of(rig, effects, NO_CONTROLLER), f).receptance for effects in ({"sensor_resonance": values}, {})
    )
    s = 2j * np.pi * f
    _, whole = mode(values, s)
    np.testing.assert_allclose(with_mount / without, 1 + values["coupling"] * s**2 / whole, rtol=1e-3)


def test_hysteresis_takes_its_share_of_a_small_current():
    plain, held = loop_response(of(), LINES), loop_response(of(effects=EACH["hysteresis"]), LINES)
    np.testing.assert_allclose(held.plant, 0.8 * plain.plant, rtol=1e-9)
    np.testing.assert_allclose(held.amplifier, plain.amplifier, rtol=1e-9)


def test_a_mount_on_a_base_that_swings_too_is_two_modes_of_a_mount():
    """The base moves by the reaction and the mount by the base: a product of two modes is the difference of both."""
    rig, f = load_rig("pedestal"), np.array([20.0, 44.0, 75.0, 100.0, 150.0])
    s, mount, base, coupling = 2j * np.pi * f, 2 * np.pi * 60.0, 2 * np.pi * 130.0, 0.1
    values = {"frequency": 60.0, "damping_ratio": 1e-3, "coupling": coupling * base**2 / (base**2 - mount**2)}
    values |= {"further_ratio": -1.0, "further_frequency": 130.0 / 60.0, "further_damping": 1e-3}
    found, plain = (
        loop_response(of(rig, effects, NO_CONTROLLER), f).receptance for effects in ({"sensor_resonance": values}, {})
    )
    bearing = -(rig.support_stiffness + rig.support_damping * s) * plain / rig.mass
    moved = coupling * base**2 / ((s**2 + base**2) * (s**2 + mount**2)) * bearing
    np.testing.assert_allclose(found, plain + moved, atol=0.01 * abs(moved).max())


def test_a_further_body_adds_its_dynamic_mass():
    two = {"frequency": 60.0, "damping_ratio": 0.03, "mass_ratio": 0.1}
    two |= {"further_ratio": 0.05, "further_frequency": 2.2, "further_damping": 0.01}
    s = 2j * np.pi * LINES[LINES < 1000.0]
    found = loop_response(of(effects={"support_resonance": two}), LINES[LINES < 1000.0])
    carried = 1.0
    for values in (two, {"frequency": 132.0, "damping_ratio": 0.01, "mass_ratio": 0.05}):
        held, whole = mode(values, s)
        carried = carried + values["mass_ratio"] * held / whole
    plain = loop_response(of(), LINES[LINES < 1000.0])
    bearing = FREE.support_damping * s + FREE.support_stiffness + linearise(force_law(FREE))[1]
    expected = plain.plant * (FREE.mass * s**2 + bearing) / (FREE.mass * s**2 * carried + bearing)
    np.testing.assert_allclose(found.plant, expected, rtol=1e-6)


def test_a_body_inside_the_stated_mass_is_a_mode_beside_the_motion_of_the_whole():
    # A rotor that bends, as modal analysis has it: the whole mass moves, and a mode of the free rotor is added.
    body = {"frequency": 60.0, "damping_ratio": 0.03, "mass_ratio": 0.6, "inside": 1.0}
    s = 2j * np.pi * LINES[LINES < 1000.0]
    found = loop_response(of(effects={"support_resonance": body}), LINES[LINES < 1000.0])
    grown = 1.6  # mover and body against each other, beside the body alone
    w, ratio = 2 * np.pi * 60.0 * np.sqrt(grown), 0.03 * np.sqrt(grown)
    compliance = (1 / s**2 + 0.6 / (s**2 + 2 * ratio * w * s + w**2)) / FREE.mass
    plain = loop_response(of(), LINES[LINES < 1000.0])
    bearing = FREE.support_damping * s + FREE.support_stiffness + linearise(force_law(FREE))[1]
    expected = plain.plant * (FREE.mass * s**2 + bearing) / (1 / compliance + bearing)
    np.testing.assert_allclose(found.plant, expected, rtol=1e-6)


def test_under_ripple_hysteresis_takes_its_share_of_a_fast_current_alone():
    slow = LINES[LINES < 1000.0]  # beyond, the sampled loop makes images of the lag
    held = loop_response(of(effects=effect("hysteresis", 0.2, width=0.05, ripple=20.0)), slow)
    lag = 0.05 / 20.0 * 2j * np.pi * slow
    np.testing.assert_allclose(held.plant, (1 - 0.2 * lag / (1 + lag)) * loop_response(of(), slow).plant, rtol=1e-6)


@pytest.mark.parametrize("offset", [0.0, 8e-5])
@pytest.mark.parametrize("saturation", [0.5, 0.8, np.inf])
@pytest.mark.parametrize(
    "rig",
    [FREE, replace(FREE, flux_path="magnet"), ELECTROMAGNETS],
    ids=["gap", "magnet", "electromagnets"],
)
def test_a_saturated_law_is_its_definition_and_its_tangent_the_difference_quotient(rig, saturation, offset):
    law = replace(force_law(rig), saturation=saturation)

    def fields(y, i):
        for gap, sign in ((law.gap - y, 1), (law.gap + y, -1)):
            coil = law.coil_flux / (gap + law.coil_gap)
            yield law.magnet_flux / (gap + law.magnet_gap) + coil * (law.bias_current + sign * law.gain_scale * i)

    def bent(b):
        return b**2 / np.sqrt(1 + b**4 / saturation**4)

    y, i = 5e-5 + offset, 0.3
    (up, low), (up_0, low_0) = fields(y, i), fields(y, 0.0)
    expected = law.stiffness_scale * (bent(up_0) - bent(low_0)) + bent(up) - bent(up_0) - bent(low) + bent(low_0)
    assert force(law, y, i) == pytest.approx(law.area * expected, rel=1e-12)
    gain, stiffness = linearise(law, offset)
    d_i, d_y = 1e-4, 1e-9
    assert gain == pytest.approx((force(law, offset, d_i) - force(law, offset, -d_i)) / (2 * d_i), rel=1e-7)
    assert stiffness == pytest.approx(
        -(force(law, offset + d_y, 0) - force(law, offset - d_y, 0)) / (2 * d_y), rel=1e-5
    )
    unbent = linearise(replace(law, saturation=np.inf), offset)
    assert np.isinf(saturation) or (gain < 0.97 * unbent[0] and stiffness > 0.97 * unbent[1])


@pytest.mark.parametrize("name", ["eframe", "ball"])
def test_a_single_sided_law_at_an_offset_is_its_difference_quotient(name):
    ball = Rig("ball", "magnet_coil", mass=0.02, gap=5e-3, clearance=1e-3, turns=1.0, pole_area=3e-4, magnet_area=3e-4,
               remanence=1.0, magnet_length=2e-3, force_constant=2e-6, force_exponent=2.2)  # fmt: skip
    law, d_i, d_y = force_law(load_rig("eframe") if name == "eframe" else ball), 1e-4, 1e-9
    y = 0.2 * law.gap
    gain, stiffness = linearise(law, y)
    assert gain == pytest.approx((force(law, y, d_i) - force(law, y, -d_i)) / (2 * d_i), rel=1e-7)
    assert stiffness == pytest.approx(-(force(law, y + d_y, 0) - force(law, y - d_y, 0)) / (2 * d_y), rel=1e-5)


def rates(x, u, force, values):
    """Derivatives of y, v, coil current, branches, body r r', mount w w', probe: one axis, written as equations."""
    y, v, i, branch, (r, rv), (w, wv), z = x[0], x[1], x[2], x[3 : 3 + BRANCHES], x[-5:-3], x[-3:-1], x[-1]
    direct, weights, speeds = eddy_once(400.0, 0.6)
    body, mount = SECOND_BODY["support_resonance"], MOUNT["sensor_resonance"]
    gain, stiffness, mass = values
    pull = direct * i + weights @ branch - 0.2 * i
    bearing = (gain * pull - stiffness * y - FREE.support_stiffness * y - (FREE.support_damping + 10.0) * v) / mass
    w_b, w_m = 2 * np.pi * body["frequency"], 2 * np.pi * mount["frequency"]
    back = w_b**2 * r + 2 * body["damping_ratio"] * w_b * rv
    a = bearing + force / mass + body["mass_ratio"] * back
    mounted = -(w_m**2) * w - 2 * mount["damping_ratio"] * w_m * wv - mount["coupling"] * bearing
    probed = (y - w - z) / FREE.sensor_time_constant
    return np.concatenate([[v, a, (u - i) / 1e-4], speeds * (i - branch), [rv, -a - back, wv, mounted, probed]])


def test_the_closed_loop_is_the_continuous_system_stepped_densely():
    """Twenty exact substeps to a sample, the command changing at the fifth of the next but one sample."""
    names = ("eddy_current", "hysteresis", "friction", "support_resonance", "sensor_resonance")
    effects = {**{name: EACH[name][name] for name in names}, **effect("delay", 1.25 * DT)}
    e = of(effects=effects, gains=Gains(9000.0, 2000.0, 8.0))
    values = (*linearise(force_law(FREE)), FREE.mass)
    n, g = 3 + BRANCHES + 5, e.gains
    columns = [rates(x, 0.0, 0.0, values) for x in np.eye(n)]
    columns += [rates(np.zeros(n), 1.0, 0.0, values), rates(np.zeros(n), 0.0, 1.0, values)]
    step = expm(np.pad(np.array(columns).T, ((0, 2), (0, 0))) * DT / 20)[:n]
    drive = np.random.default_rng(1).normal(size=600)
    x, lag, leak, commands, expected = np.zeros(n), 0.0, 0.0, [0.0, 0.0, 0.0], []
    for pushed in drive:
        error = -x[-1]
        expected.append(x[-1])
        commands.append(g.kp * error + g.kd * (error - lag) / g.td + g.ki * leak)
        lag, leak = (error + (s - error) * np.exp(-DT / t) for s, t in ((lag, g.td), (leak, g.ti)))
        for sub in range(20):
            x = step @ np.concatenate([x, [commands[-2] if sub >= 5 else commands[-3], pushed]])
    a, b, c = closed_loop(e)
    _, got, _ = dlsim((a, b, c, np.zeros((1, 1)), DT), drive[:, None])
    np.testing.assert_allclose(got[:, 0], expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(closed_loop_poles(e)).max() < 1 and np.abs(expected[-100:]).max() > 1e-6


@pytest.mark.parametrize("effects", [{}, effect("cross_coupling", 0.3), {**ALL, **effect("cross_coupling", -0.2)}],
                         ids=["nominal", "cross_coupling", "all"])  # fmt: skip
def test_two_coupled_axes_are_their_definition_held_and_sampled(effects):
    e = of(COUPLED, {**effects, **effect("delay", 61.7e-6)})
    check_held_and_sampled(e, [FREE, replace(FREE, **OTHER_Y)], 1e-5)
