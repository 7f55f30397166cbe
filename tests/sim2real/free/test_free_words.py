"""A free correction in words: what is said of its ends is what its curve shows there."""

import numpy as np
import pytest

from maglev_env.loop.free.element import SHARES
from sim2real.free.drawn import GAIN_SD, Drawn
from sim2real.free.kinds import CURVE, PLACES, Kind
from sim2real.free.shape import form_of
from sim2real.free.words import in_words

X = np.array([*(-s for s in SHARES[::-1]), *SHARES])
ONE_SIDED, BENT = -np.maximum(X, 0.0), -X + 0.5 * X**2
UNEVEN, UNEVEN_BEND = 0.1 * X + 0.2 * np.maximum(X, 0.0), 0.2 * X + 0.1 * X**2


def told(place, reach, curve, sd):
    """A curve (n,) over X with standard errors, as `drawn` makes it, in words."""
    over, of = PLACES[place]
    form = form_of(reach * X, curve, sd**2 * np.eye(X.size), GAIN_SD if over == of else np.inf)
    at, value = (np.insert(v, X.size // 2, 0.0) for v in (reach * X, curve))
    return form.name, in_words(Drawn(Kind(place, CURVE), reach, at, value, np.full(at.size, sd), form))


@pytest.mark.parametrize(
    ("place", "reach", "curve", "name", "ends"),
    [
        ("free_spring", 1e-4, ONE_SIDED, "one-sided",
         ("-1.000 +- 0.024 N (95 %) at 100 µm", "0 +- 24 mN (95 %) at -100 µm")),
        ("free_spring", 1e-4, BENT, "bent",
         ("-500 +- 24 mN (95 %) at 100 µm", "1.500 +- 0.024 N (95 %) at -100 µm")),
        ("free_damper", 1.0, ONE_SIDED, "one-sided",
         ("-1.000 +- 0.024 N (95 %) at 1 m/s", "0 +- 24 mN (95 %) at -1 m/s")),
        ("free_command", 2.0, UNEVEN, "one-sided",
         ("+15.0 +- 1.2 % (95 %) for positive", "+5.0 +- 1.2 % (95 %) for negative")),
        ("free_command", 2.0, UNEVEN_BEND, "bent",
         ("+15.0 +- 1.2 % (95 %) at 2 A", "+5.0 +- 1.2 % (95 %) at -2 A")),
        ("free_gain", 1e-4, UNEVEN_BEND, "bent",
         ("-10.0 +- 2.4 % (95 %) at -100 µm", "+30.0 +- 2.4 % (95 %) at 100 µm")),
    ],
)  # fmt: skip
def test_both_ends_of_a_curve_that_is_not_odd_are_those_of_the_curve(place, reach, curve, name, ends):
    form, words = told(place, reach, curve, 0.024 / 1.96)
    assert form == name
    for end in ends:
        assert end in words


@pytest.mark.parametrize(
    ("place", "size", "said"),
    [("free_damper", 0.3, ", as of dry friction"), ("free_damper", -0.3, ", which drives"), ("free_spring", 0.3, "")],
)
def test_a_step_is_dry_friction_where_it_holds_the_motion_back(place, size, said):
    """The curve of a damper is a force against the velocity."""
    form, words = told(place, 1.0, size * np.sign(X), 0.01)
    assert form == "step" and "either way" + said in words
    assert ("dry friction" in words) == (place == "free_damper")
