"""Forms of effects: coordinates, their priors and cost, and when another form replaces the plain one."""

from dataclasses import dataclass, replace
from math import inf, log
from types import SimpleNamespace

import numpy as np
import pytest

from maglev_env.loop.card import SMALL_ROTOR
from maglev_env.loop.effect import EFFECTS, effect, effect_value, shaped
from maglev_env.rig.rig import Rig
from sim2real.compared.point import Point
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis, coordinates_of, single_effects
from sim2real.search.shapes import shapes_of
from sim2real.search.shaping import of_any_form
from sim2real.search.shaping import shaped as in_other_forms
from sim2real.search.starts import starts, starts_elsewhere

PAIR = replace(SMALL_ROTOR, lacks=frozenset({"iron"}))
SATURATION = Hypothesis(("saturation",), {}, scales=PAIR)


@dataclass(frozen=True)
class Bench:
    """What a curve through a knee at `field` of some sharpness gives, with noise of variance one."""

    data: np.ndarray

    def simulate(self, points):
        return np.array([curve(p.effects) for p in points])


def curve(effects):
    x = np.linspace(0.1, 3.0, 40)
    knee, n = effect_value(effects, "saturation"), effect_value(effects, "saturation", "sharpness")
    return 200 * x / (1 + (x / knee) ** n) ** (1 / n) + 0j


def bench(seed, **form):
    noise = np.random.default_rng(seed).standard_normal((2, 40))
    return Bench(curve(effect("saturation", 1.2, **form)) + noise[0] + 1j * noise[1])


def plain_fit(b):
    fits = begin([SATURATION], [np.array([log(1.0)])], b.data, b.simulate)
    iterate(fits, b.data, b.simulate, 20)
    return fits[0]


@pytest.mark.parametrize("sharpness", (2.0, 12.0))
def test_another_form_keeps_the_name_and_leaves_the_noise(sharpness):
    b = bench(1, sharpness=sharpness)
    plain = plain_fit(b)
    (found,) = in_other_forms(b, 1e6, [plain], 1)
    assert plain.cost > 1000 and found.cost < 130
    at = found.hypothesis.point(found.u).effects["saturation"]
    assert at["sharpness"] == pytest.approx(sharpness, rel=0.1) and at["field"] == pytest.approx(1.2, rel=0.02)
    assert found.hypothesis.effects == ("saturation",) and found.occam > 2


def test_the_plain_form_stays_where_it_made_the_data():
    for seed in range(5):
        b = bench(seed)
        plain = plain_fit(b)
        assert in_other_forms(b, 1e6, [plain], 1) == [plain]


def test_an_interval_covers_whatever_the_form():
    """Knees of any sharpness in noise that hardly tells them; the plain formula's interval misses a third."""
    rng, hits = np.random.default_rng(5), {"plain": [], "any": []}
    (sharp,) = (s for s in shapes_of("saturation", PAIR) if s.key == "sharpness")
    for _ in range(150):
        faint = bench(0, sharpness=sharp.value(sharp.bounded(rng.standard_normal())))
        noise = 30.0 * (rng.standard_normal(40) + 1j * rng.standard_normal(40))
        b = Bench((faint.data + noise) / 30.0)
        b = SimpleNamespace(data=b.data, simulate=lambda points, b=b: b.simulate(points) / 30.0)
        plain = plain_fit(b)
        (wider,) = of_any_form(b, [plain])
        for name, fit in (("plain", plain), ("any", wider)):
            hits[name].append(abs(fit.u[0] - log(1.2)) < 1.96 * np.sqrt(fit.covariance()[0, 0]))
    assert np.mean(hits["any"]) > 0.92 and np.mean(hits["plain"]) < 0.75


def test_a_form_is_a_prior_about_the_plain_formula():
    h = replace(SATURATION, shaped=("saturation",))
    assert h.calibrated == tuple(h.shapes) and set(h.prior) == {0.0, 1.0}
    plain = h.point(np.zeros(5))
    assert plain == Point({"saturation": {"field": 1.0}}, {})
    one = h.point(h.bounded(np.array([0.0, 1.0, 0.5, -3.0, 0.0]))).effects["saturation"]
    assert one["sharpness"] == pytest.approx(4 * np.exp(0.8)) and one["current"] == pytest.approx(1.0)
    assert "command" not in one
    assert h.instead("saturation", "delay").shaped == ("saturation",) and h.instead("delay").shaped == ()


def test_a_saturation_may_also_begin_at_the_current_or_the_command():
    found = [
        h.point(u).effects["saturation"]
        for h, u in starts_elsewhere(Hypothesis((), {}, scales=PAIR), "saturation", 2.0)
    ]
    iron, found = [v for v in found if v["field"] < 999], [v for v in found if v["field"] > 999]
    assert sorted({*found[0]} | {*found[-1]}) == ["command", "current", "field", "sharpness"]
    assert [values["field"] for values in found] == pytest.approx([1000.0] * len(found))
    cornered, gentle = ([v["field"] for v in iron if (v["sharpness"] > 4) == sharp] for sharp in (True, False))
    assert (
        cornered
        == gentle
        == [c.value(u[0]) for u in starts("saturation", PAIR) for c in coordinates_of("saturation", PAIR)]
    )
    assert {round(v["sharpness"], 2) for v in iron} == {1.53, 19.81}
    knees = [(values.get("current", values.get("command")), values.get("sharpness", 4.0)) for values in found]
    assert {round(knee, 6) for knee, sharp in knees if sharp == 4.0} == {
        1.4,
        3.0,
        6.0,
    }  # about the 2 A that are reached
    assert {round(knee, 6) for knee, sharp in knees if 1.0 < sharp < 2.0} == {3.0, 6.0, 12.0}
    assert not starts_elsewhere(Hypothesis((), {}), "friction", 2.0)


@pytest.mark.parametrize("name", [name for name, card in EFFECTS.items() if card.shapes])
def test_the_plain_formula_lies_within_its_bounds(name):
    card = EFFECTS[name]
    for key, p in card.shapes.items():
        assert p.default is not None and (p.low <= p.default <= p.high or p.default == p.absent == inf), key
    assert set(card.plain_kernel) <= set(card.shapes)
    assert {s.name for s in shapes_of(name)} == {f"{name}.{key}" for key in card.shapes}
    assert {c.parameter for c in coordinates_of(name)} == set(card.plain)


def test_only_other_forms_need_the_shaped_kernel():
    assert not shaped(effect("saturation", 1.0, sharpness=4.0)) and shaped(effect("saturation", 1.0, sharpness=5.0))
    assert not shaped(effect("amplifier_lag", 1e-5, feedback=0.5))


def test_a_single_magnet_has_no_field_and_its_knees_lie_beyond_the_current_at_rest():
    ball = Rig("ball", "electromagnet", mass=0.05, gap=8e-3, bias_current=0.9, control_rate=1000.0)
    assert "saturation" in single_effects(ball)
    assert not coordinates_of("saturation", ball.scales) and not starts("saturation", ball.scales)
    begun = starts_elsewhere(Hypothesis((), {}, scales=ball.scales), "saturation", 0.5)
    found = [h.point(h.bounded(u)).effects["saturation"] for h, u in begun]
    assert all("field" not in values for values in found)
    knees = [values.get("current", values.get("command")) for values in found]
    assert knees[:3] == pytest.approx([0.9 + times * 0.5 for times in (0.7, 1.5, 3.0)])
    h = begun[0][0]
    closest = h.point(h.bounded(np.full(h.size, 1e3))).effects["saturation"]
    assert closest["current"] == closest["command"] == pytest.approx(1.01 * 0.9)
    assert replace(ball, effects=effect("saturation", **closest)).effects["saturation"]["current"] > 0.9


LINES = np.arange(2.0, 60.0, 0.5)


def on_springs(points):
    """Motion per force of a free mass with one or two bodies on it, in noise of variance one."""
    s, found = 2j * np.pi * LINES, []
    for p in points:
        carried = 1.0
        own = p.effects.get("support_resonance", {})
        first = own.get("frequency", 1.0), own.get("damping_ratio", 0.1), own.get("mass_ratio", 0.0)
        times, damping = own.get("further_frequency", 2.5), own.get("further_damping", 0.02)
        for frequency, ratio, mass in (first, (times * first[0], damping, own.get("further_ratio", 0.0))):
            w = 2 * np.pi * frequency
            held = w**2 + 2 * ratio * w * s
            carried = carried + mass * held / (held + s**2)
        found.append(1000.0 / carried)
    return np.array(found)


@pytest.mark.parametrize("further", [(0.01, 2.4), (0.02, 0.4)])
def test_a_further_body_is_found_wherever_its_mode_lies(further):
    mode = effect("support_resonance", 15.0, damping_ratio=0.02, mass_ratio=0.08)["support_resonance"]
    truth = {**mode, "further_ratio": further[0], "further_frequency": further[1], "further_damping": 0.015}
    noise = np.random.default_rng(4).standard_normal((2, LINES.size))
    data = on_springs([Point({"support_resonance": truth}, {})])[0] + noise[0] + 1j * noise[1]
    b = SimpleNamespace(data=data, simulate=on_springs)
    h = Hypothesis(("support_resonance",), {})
    (plain,) = begin([h], [np.array([c.at(mode[c.parameter]) for c in h.coordinates])], b.data, on_springs)
    iterate([plain], b.data, on_springs, 20)
    (found,) = in_other_forms(b, 1e6, [plain], 1)
    at = found.hypothesis.point(found.u).effects["support_resonance"]
    assert plain.cost > 2 * 2 * LINES.size > found.cost
    assert at["further_frequency"] == pytest.approx(further[1], rel=0.02)
    assert at["further_ratio"] == pytest.approx(further[0], rel=0.2)
    assert found.hypothesis.effects == ("support_resonance",)
