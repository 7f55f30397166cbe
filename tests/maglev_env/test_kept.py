"""Results that are kept by value."""

from dataclasses import replace

import pytest

from maglev_env.kept import by_value
from maglev_env.rig.rig_file import load_rig


def test_a_result_is_made_once_for_each_value():
    made = []

    @by_value(2)
    def mass(rig, times=1.0):
        made.append(rig.name)
        return rig.mass * times

    rig = load_rig("hmb_free")
    assert mass(rig) == mass(rig) == rig.mass
    assert made == ["hmb_free"]
    assert mass(replace(rig, mass=2.0)) == 2.0
    assert mass(rig, times=2.0) == 2 * rig.mass
    assert len(made) == 3


def test_what_has_changed_meanwhile_is_another_value():
    @by_value(2)
    def total(table):
        return sum(table.values())

    table = {"a": 1}
    assert total(table) == 1
    table["a"] = 2
    assert total(table) == 2


def test_a_failure_is_not_kept():
    @by_value(2)
    def inverse(x):
        return 1 / x

    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            inverse(0)
