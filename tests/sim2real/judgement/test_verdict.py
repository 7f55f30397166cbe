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
        ({"delay": 0.6, "sensor_lag": 0.05, "none": 0.35}, ("explained", ("delay",))),
        ({"delay": 0.4, "sensor_lag": 0.3, "none": 0.3}, ("ambiguous", ("delay", "sensor_lag"))),
        ({"delay__mass": 0.6, "delay": 0.4}, ("ambiguous", ("delay+mass", "delay"))),
        ({"delay": 0.6, "delay__mass": 0.4}, ("explained", ("delay",))),  # nothing but a superfluous effect more
    ],
)
def test_the_most_probable_answer_is_given(probabilities, answer):
    assert of(**probabilities) == answer


def test_one_of_many_improbable_effects_is_not_named_where_nothing_is_more_probable():
    """As of a ball without an effect: together the effects are more probable than none, each of them less."""
    few = {name: 0.03 for name in ("force_law", "eddy_current", "gain_drift", "sensor_gain", "damping", "mass")}
    assert of(calibration=0.44, asymmetric_gain=0.32, unknown=0.06, **few) == ("no_gap", ())
    assert of(calibration=0.30, asymmetric_gain=0.46, unknown=0.06, **few) == ("explained", ("asymmetric_gain",))
