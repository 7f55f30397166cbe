"""What an effect costs at parameters that contradict its name."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.loop.effect import effect
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.judgement.meaning.outside_meaning import NO_RESONANCE, meaningless_cost
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import FORM_SHARE, Hypothesis, coordinates_of

RIG = load_rig("hmb_free")
DAMPED = Hypothesis(("damping",), {}, scales=RIG.scales)
(COEFFICIENT,) = DAMPED.coordinates


def fitted(coefficient: float, slope: float):
    """A fit of the damping alone to a response that is proportional to it, with `slope` per N s/m."""
    x = np.linspace(1.0, 2.0, 7) * (1 + 0.5j)

    def simulate(points):
        return np.array([slope * p.effects.get("damping", {}).get("coefficient", 0.0) * x for p in points])

    data = slope * coefficient * x
    fits = begin([DAMPED], [np.array([COEFFICIENT.at(0.1)])], data, simulate)
    iterate(fits, data, simulate, 10)
    differentiate(fits, data, simulate, True)
    return fits[0], slope**2 * float(np.vdot(x, x).real)


def test_a_support_that_drives_the_rotor_costs_what_the_fit_loses_without_damping():
    rig = replace(RIG, support_damping=0.3)
    fit, per_square = fitted(-0.8, 9.0)
    assert meaningless_cost(fit, rig, 1e-4, 1.0) == pytest.approx(0.5**2 * per_square, rel=1e-6)
    assert meaningless_cost(fit, replace(RIG, support_damping=0.9), 1e-4, 1.0) == 0.0  # less than stated, but some
    assert meaningless_cost(fitted(0.8, 9.0)[0], rig, 1e-4, 1.0) == 0.0


@pytest.mark.parametrize("name", ["support_resonance", "sensor_resonance"])
def test_a_mode_without_a_resonance_is_none(name):
    """One that does not ring, or at the end of what can be fitted, where nothing of its frequency is seen."""
    h = Hypothesis((name,), {}, scales=RIG.scales)
    damping, frequency = ([c.parameter for c in h.coordinates].index(p) for p in ("damping_ratio", "frequency"))
    most = h.coordinates[frequency].high
    for ratio, at, cost in (
        (0.9 * NO_RESONANCE, 0.9 * most, 0.0), (1.1 * NO_RESONANCE, 0.9 * most, np.inf),
        (0.9 * NO_RESONANCE, most, np.inf),
    ):  # fmt: skip
        u = np.array([c.at(max(c.low, 0.01) if c.scale is None else 0.01) for c in h.coordinates])
        u[damping], u[frequency] = np.log(ratio), np.log(at)
        (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
        assert meaningless_cost(fit, RIG, 1e-4, 1.0) == cost


@pytest.mark.parametrize(
    ("ratio", "times", "cost"), [(-1.8, 0.95, np.inf), (1.8, 0.95, 0.0), (-1.8, 2.0, 0.0), (-0.5, 1.3, np.inf)]
)
def test_two_modes_that_take_each_other_back_are_none(ratio, times, cost):
    """As they were found of a cable that creeps; a further mode of the same sign, or far from the first, is one."""
    own = {"damping_ratio": 0.15, "coupling": -0.05}
    further = {"further_ratio": ratio, "further_frequency": times, "further_damping": 0.2}
    mode = effect("sensor_resonance", 20.0)["sensor_resonance"] | own | further
    hypothesis = SimpleNamespace(point=lambda u: Point({"sensor_resonance": mode}, {}), effects=("sensor_resonance",))
    hypothesis.coordinates = ()
    assert meaningless_cost(SimpleNamespace(hypothesis=hypothesis, u=np.zeros(0)), RIG, 1e-4, 1.0) == cost


@pytest.mark.parametrize("distance, cost", [(1e-9, np.inf), (1e-6, np.inf), (5e-6, 0.0)])
def test_a_stop_that_touches_wherever_the_rotor_is_is_none(distance, cost):
    h = Hypothesis(("soft_stop",), {}, scales=RIG.scales)
    values = {"distance": distance, "stiffness": 1e3}
    u = np.array([c.at(values.get(c.parameter, max(c.low, 1.0))) for c in h.coordinates])
    (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
    assert meaningless_cost(fit, RIG, 1e-4, 1.0) == cost


def test_a_fit_keeps_a_stop_within_the_motion_and_what_has_a_sign_free():
    scales = replace(RIG.scales, motion=1e-4)
    bounds = {c.parameter: (c.low, c.high) for c in coordinates_of("soft_stop", scales)}
    assert bounds["distance"] == (pytest.approx(2e-6), 0.1)
    for name in ("gain_drift", "asymmetric_gain", "negative_stiffness", "soft_stop"):
        others = ((c, p) for c, p in zip(coordinates_of(name, scales), coordinates_of(name, RIG.scales), strict=True))
        assert all(c == p for c, p in others if c.parameter != "distance")


@pytest.mark.parametrize(
    "rig, field, knee, cost",
    [("hmb_free", 1.5, None, 0.0), ("hmb_free", 40.0, None, np.inf), ("hmb_free", 100.0, 2.0, 0.0)],
)
def test_iron_that_saturates_far_above_every_field_does_not(rig, field, knee, cost):
    """The magnets of this rig make 0.4 T in their gaps. With a knee of the current the field's is at its bound."""
    h = Hypothesis(("saturation",), {}, scales=RIG.scales)
    h = h if knee is None else replace(h, shaped=("saturation",))
    u = np.zeros(h.size)
    u[: len(h.coordinates)] = [c.at(field) for c in h.coordinates]
    if knee is not None:
        at = len(h.coordinates) + h.calibrated.index("saturation.current")
        u[at] = 1 / (knee * h.shapes["saturation.current"].parameter.shape)
    (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
    assert meaningless_cost(fit, load_rig(rig), 1e-5, 0.1) == cost


def test_an_effect_of_which_nothing_was_fitted_means_what_it_says():
    """The knee of a single magnet is a form of the effect, and a fit that touched down has not got so far."""
    ball = Rig("ball", "electromagnet", mass=0.05, gap=8e-3, clearance=8e-3, force_constant=3.6e-5, gap_offset=6e-3)
    h = Hypothesis(("saturation",), {}, scales=ball.scales)
    (fit,) = begin([h], [np.zeros(h.size)], np.zeros(3, complex), lambda p: np.zeros((len(p), 3), complex))
    assert h.coordinates == () and meaningless_cost(fit, ball, 1e-4, 1.0) == 0.0


@pytest.mark.parametrize(("share", "cost"), [(-1.0, np.inf), (-0.95, np.inf), (0.7, 0.0), (0.2, 0.0), (1.0, np.inf)])
def test_a_zero_of_the_current_that_is_off_by_nearly_all_of_the_bias_is_none(share, cost):
    """One magnet of the pair would have hardly any field, of its current or of its permanent magnet."""
    h = Hypothesis(("actuator_offset",), {}, scales=RIG.scales)
    (c,) = h.coordinates
    u = np.array([c.at(share * RIG.scales.bias)])
    (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
    assert meaningless_cost(fit, RIG, 1e-4, 1.0) == cost


def test_the_bias_of_a_single_magnet_is_the_current_that_carries_the_weight():
    """Its rig need not state it. Beyond it the fit of a controller that nobody stated finds any zero of the current."""
    ball = Rig("ball", "electromagnet", mass=0.05, gap=8e-3, clearance=8e-3, force_constant=3.6e-5, gap_offset=6e-3)
    carries = 0.014 * np.sqrt(0.05 * ball.gravity / 3.6e-5)
    h = Hypothesis(("actuator_offset",), {}, scales=ball.scales)
    (c,) = h.coordinates
    assert (c.low, c.high) == pytest.approx((-carries, carries), rel=1e-6)
    (fit,) = begin([h], [np.array([c.at(-2.59)])], np.zeros(3, complex), lambda p: np.zeros((len(p), 3), complex))
    assert meaningless_cost(fit, ball, 1e-4, 1.0) == np.inf


@pytest.mark.parametrize(("shorter", "cost"), [(0.0, 0.0), (0.1, 0.0), (0.3, np.inf)])
def test_a_lag_that_is_mostly_dead_time_is_a_delay(shorter, cost):
    """Of 100 us of a second pole 40 are taken for dead time; the first pole may be shorter than its 100 us."""
    dead, rig = 0.4, replace(RIG, amplifier_time_constant=1e-4)
    h = Hypothesis(("amplifier_lag",), {"amplifier_time_constant": 0.1}, scales=rig.scales)
    (c,) = h.coordinates
    u = np.array([c.at(1e-4), -10 * shorter, dead / FORM_SHARE])
    point = h.point(u)
    assert point.effects["delay"]["time"] == pytest.approx(dead * 1e-4)
    assert point.changes["amplifier_time_constant"] == pytest.approx(-shorter)
    (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
    assert meaningless_cost(fit, rig, 1e-4, 1.0) == cost


@pytest.mark.parametrize("offset, cost", [(-0.8, np.inf), (-0.7, 0.0), (20.0, 0.0)])
def test_a_pull_without_an_end_before_the_magnet_is_none(offset, cost):
    """A law far from its pole is an exponential one, which magnets have; with its pole inside the gap it is none."""
    h = Hypothesis(("force_law",), {}, scales=RIG.scales)
    values = {"offset": offset, "exponent": -1.3}
    u = np.array([c.at(values[c.parameter]) for c in h.coordinates])
    (fit,) = begin([h], [u], np.zeros(3, complex), lambda points: np.zeros((len(points), 3), complex))
    assert meaningless_cost(fit, RIG, 1e-4, 1.0) == cost
