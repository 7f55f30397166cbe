"""Friction is shown by the limit of its force, and by nothing that is linear."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement.evidence import _without
from sim2real.judgement.meaning.within_reach import shows_limit
from sim2real.search.fitting import begin, differentiate, iterate
from sim2real.search.hypotheses import Hypothesis

MOTION = np.linspace(0.2, 2.0, 40) * 1e-6 * (1 + 0.3j)
NOISE = 1e-5
H = Hypothesis(("friction",), {})


def simulate(points):
    """Bristles that bend and then give way."""
    own = [p.effects.get("friction", {"force": 0.0, "presliding": 1.0}) for p in points]
    return np.array([f["force"] * MOTION / (f["presliding"] + abs(MOTION)) for f in own]) / NOISE


@pytest.mark.parametrize(
    "response, shown",
    [
        (0.05 * MOTION / (1e-6 + abs(MOTION)), True),
        (3e4 * MOTION, False),
        (3e4 * MOTION + 2e-3 * np.exp(1e7j * abs(MOTION)), False),  # and something that no friction explains
        (0.12 * MOTION / (8e-6 + abs(MOTION)), True),  # a small part is bent, and noise cannot have made it
        (0.12 * MOTION / (8e-6 + abs(MOTION)) + 2e-3 * np.exp(1e7j * abs(MOTION)), False),
    ],
)
def test_only_a_limit_that_the_motion_reaches_is_friction(response, shown):
    data = response / NOISE
    problem = SimpleNamespace(data=data, simulate=simulate)
    start = np.array([c.at({"force": 0.02, "velocity": 1e-3, "presliding": 2e-6}[c.parameter]) for c in H.coordinates])
    fits = begin([H], [start], data, simulate)
    iterate(fits, data, simulate, 30)
    differentiate(fits, data, simulate, True)
    nothing, asked = float(np.vdot(data, data).real), []
    assert fits[0].cost < 0.1 * nothing
    problem.simulate = lambda points: (asked.extend(points), simulate(points))[1]
    assert shows_limit(problem, fits[0], "friction", nothing) == shown
    (never, *_), fitted = asked, H.point(fits[0].u).effects["friction"] | {"stribeck": 2e-3}  # the default of the card
    ratios = {key: never.effects["friction"][key] / fitted[key] for key in fitted}
    assert ratios == pytest.approx(dict.fromkeys(fitted, ratios["force"])) and ratios["force"] > 10


@pytest.mark.parametrize("presliding", [4e-4, 1e-3])
def test_a_limit_near_the_end_of_its_range_is_not_shown_by_that(presliding):
    """At 1 mm, where the range ends, it cannot be tried farther away: bristles that bend by 2 um are a spring."""
    data = simulate([SimpleNamespace(effects={"friction": {"force": 1e3 * presliding, "presliding": presliding}})])[0]
    fitted = {"force": 1e3 * presliding, "velocity": 1e-2, "presliding": presliding}
    fits = begin([H], [np.array([c.at(fitted[c.parameter]) for c in H.coordinates])], data, simulate)
    differentiate(fits, data, simulate, True)
    problem = SimpleNamespace(data=data, simulate=simulate)
    assert not shows_limit(problem, fits[0], "friction", float(np.vdot(data, data).real))


def test_a_fit_without_derivatives_is_not_asked():
    (fresh,) = begin([H], [np.zeros(3)], MOTION, simulate)
    assert shows_limit(SimpleNamespace(), fresh, "friction", 1.0)


CURRENT = np.linspace(0.02, 0.2, 40) * (1 + 0.3j)
LAGS = Hypothesis(("hysteresis",), {})


def lagging(points):
    """A share of the current that lags more, the nearer the current comes to the width."""
    own = [p.effects.get("hysteresis", {"strength": 0.0, "width": 1.0}) for p in points]
    return np.array([f["strength"] * CURRENT / (1 + abs(CURRENT) / f["width"]) for f in own]) / NOISE


@pytest.mark.parametrize("width, shown", [(0.1, True), (300.0, False)])
def test_only_a_width_that_the_current_reaches_is_hysteresis(width, shown):
    data = lagging([SimpleNamespace(effects={"hysteresis": {"strength": 0.1, "width": width}})])[0] + 0.3
    start = np.array([c.at({"strength": 0.05, "width": 1.0}[c.parameter]) for c in LAGS.coordinates])
    fits = begin([LAGS], [start], data, lagging)
    iterate(fits, data, lagging, 30)
    differentiate(fits, data, lagging, True)
    problem = SimpleNamespace(data=data, simulate=lagging)
    assert shows_limit(problem, fits[0], "hysteresis", float(np.vdot(data, data).real)) == shown


COMMAND = np.linspace(0.05, 1.0, 60)
BAND = Hypothesis(("deadband",), {})


def left(points):
    """What a dead band leaves of each command, in the mean of edges that are smeared as by a normal number."""
    own = [p.effects.get("deadband", {"half_width": 0.0, "rounding": 0.0}) for p in points]
    edges = [(f["half_width"], f["rounding"]) for f in own]
    lost = [0.5 * (np.hypot(COMMAND + h, r) - np.hypot(COMMAND - h, r)) for h, r in edges]
    return (COMMAND - np.array(lost)).astype(complex) / 1e-4


@pytest.mark.parametrize("half_width, rounding, shown", [(0.02, 0.05, True), (0.1, 20.0, False)])
def test_only_a_band_whose_edges_the_command_reaches_is_a_dead_band(half_width, rounding, shown):
    """Edges rounded over far more than any command make of a dead band a smaller gain."""
    truth = SimpleNamespace(effects={"deadband": {"half_width": half_width, "rounding": rounding}})
    data = left([truth])[0]
    start = np.array(
        [c.at({"half_width": half_width, "rounding": 0.8 * rounding}[c.parameter]) for c in BAND.coordinates]
    )
    fits = begin([BAND], [start], data, left)
    iterate(fits, data, left, 30)
    differentiate(fits, data, left, True)
    nothing = float(np.sum(abs(data - left([SimpleNamespace(effects={})])[0]) ** 2))
    assert shows_limit(SimpleNamespace(data=data, simulate=left), fits[0], "deadband", nothing) == shown


def test_friction_alone_is_weighed_against_damping_as_beside_a_damping_that_does_nothing():
    cost = {(): 1e5, ("damping",): 700.0, ("friction",): 599.3, ("friction", "damping"): 598.2, ("mass",): 5e4}

    def of(*names):
        found = next((cost[own] for own in cost if set(own) == set(names)), None)
        return None if found is None else SimpleNamespace(fit=SimpleNamespace(cost=found))

    candidates = [SimpleNamespace(effects=own) for own in cost]
    attribution = SimpleNamespace(
        candidates=candidates, of=of, without=lambda i, name: of(*(set(candidates[i].effects) - {name})).fit.cost
    )
    assert _without(attribution, 2, "friction") == _without(attribution, 3, "friction") == 700.0
    del cost["damping",]
    assert _without(attribution, 2, "friction") == 1e5
