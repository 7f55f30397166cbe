"""Verdicts by given probabilities."""

import pytest

from sim2real.judgement.judge import Entry
from sim2real.judgement.verdict import verdict


def of(**probabilities: float) -> tuple[str, tuple[str, ...]]:
    rows = [Entry(tuple(name.split("__")), p, 0.0, None, None) for name, p in probabilities.items()]
    return verdict(sorted(rows, key=lambda e: -e.probability))


@pytest.mark.parametrize(
    ("probabilities", "answer"),
    [
        ({"none": 0.1, "calibration": 0.5, "delay": 0.4}, ("no_gap", ())),
        ({"unknown": 0.5, "delay": 0.4, "none": 0.1}, ("unexplained", ("unknown",))),
        ({"delay": 0.7, "sensor_lag": 0.1, "none": 0.2}, ("explained", ("delay",))),
        ({"delay": 0.45, "sensor_lag": 0.35, "none": 0.2}, ("ambiguous", ("delay", "sensor_lag"))),
        ({"delay__mass": 0.6, "delay": 0.4}, ("ambiguous", ("delay+mass", "delay"))),
        ({"delay": 0.6, "delay__mass": 0.4}, ("explained", ("delay",))),  # nothing but a superfluous effect more
    ],
)
def test_the_most_probable_answer_is_given(probabilities, answer):
    assert of(**probabilities) == answer


def test_a_cause_is_named_only_where_it_is_three_times_as_probable_as_that_nothing_acts():
    assert of(calibration=0.26, cubic_spring=0.74) == ("no_gap", ())
    assert of(calibration=0.24, cubic_spring=0.76) == ("explained", ("cubic_spring",))
    assert of(calibration=0.26, unknown=0.74) == ("no_gap", ())


def test_one_of_many_improbable_effects_is_not_named_where_nothing_is_more_probable():
    """As of a ball without an effect: together the effects are more probable than none, each of them less."""
    few = {name: 0.03 for name in ("force_law", "eddy_current", "gain_drift", "sensor_gain", "damping", "mass")}
    assert of(calibration=0.44, asymmetric_gain=0.32, unknown=0.06, **few) == ("no_gap", ())
    assert of(calibration=0.14, asymmetric_gain=0.62, unknown=0.06, **few) == ("explained", ("asymmetric_gain",))
