"""Two changes that are one: gain and stiffness off by the same share."""

import pytest

from sim2real.weaker_pull import weaker_pull

BOTH = ("actuator_gain", "negative_stiffness")


def fitted(gain, stiffness, se=0.006):
    values = {"actuator_gain.change": (gain, 0.0003), "negative_stiffness.change": (stiffness, se)}
    return {name: {"value": value, "se": own, "at_bound": own is None} for name, (value, own) in values.items()}


@pytest.mark.parametrize(
    ("effects", "values", "said"),
    [
        (BOTH, fitted(-0.2816, -0.2894), "pull less throughout, by 28 %, have both"),
        (BOTH[::-1], fitted(0.1, 0.09), "pull more throughout, by 10 %, have both"),
        (BOTH, fitted(-0.28, -0.2), None),
        (BOTH, fitted(-0.02, -0.02), None),
        (BOTH, fitted(-0.28, -0.28, None), None),
        (("actuator_gain", "force_law"), fitted(-0.28, -0.28), None),
    ],
)
def test_it_is_said_where_both_are_off_alike(effects, values, said):
    found = weaker_pull(effects, values)
    assert (found is None) if said is None else said in found
