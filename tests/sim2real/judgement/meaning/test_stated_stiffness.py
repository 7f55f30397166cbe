"""A stiffness far from its tolerance costs the same under any name."""

from dataclasses import replace

import pytest
from ball_bench import BALL

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, reshaped
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.compared.point import Point
from sim2real.judgement.meaning.stated_stiffness import stiffness_cost
from sim2real.search.exchanged import resembling
from sim2real.search.hypotheses import WIDER

LAW = {"exponent": -0.6, "offset": 0.3}


@pytest.mark.parametrize("rig", [load_rig("hmb_free"), rig_from_toml(BALL, "docs")], ids=["pair", "ball"])
def test_a_force_law_pays_for_the_stiffness_that_it_changes(rig):
    rig = replace(rig, tolerance={**rig.tolerance, "negative_stiffness": 0.05})
    law, step = force_law(rig), 1e-4 * rig.gap
    was, now = (
        (force(own, step, 0.0) - force(own, -step, 0.0)) / (2 * step) for own in (law, reshaped(law, *LAW.values()))
    )
    assert abs(now / was - 1) > 0.2
    expected = ((now / was - 1) / (WIDER * 0.05)) ** 2
    assert stiffness_cost(Point({"force_law": LAW}, {}), rig) == pytest.approx(expected, rel=1e-4)


def test_nothing_is_paid_twice_nor_without_a_tolerance():
    rig = load_rig("hmb_free")
    both = {"force_law": LAW, "negative_stiffness": {"change": -0.3}}
    assert stiffness_cost(Point(both, {}), rig) == 0.0  # the other name pays
    assert stiffness_cost(Point({"hysteresis": {"strength": 0.1}}, {}), rig) == 0.0
    assert stiffness_cost(Point({"force_law": LAW}, {}), replace(rig, tolerance={})) == 0.0


def test_what_resembles_an_effect_is_tried_in_its_place():
    assert set(resembling({"delay", "cubic_spring"})) == {frozenset({"delay", "soft_stop"})}
    assert set(resembling({"soft_stop", "force_law"})) == {
        frozenset({"cubic_spring", "force_law"}),
        frozenset({"soft_stop", "negative_stiffness"}),
    }
    assert resembling({"soft_stop", "cubic_spring"}) == resembling({"delay"}) == []
