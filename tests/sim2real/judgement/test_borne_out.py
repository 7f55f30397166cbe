"""A class of explanations beside a holdout that some of them do not explain."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.judgement import borne_out as borne_out_module
from sim2real.judgement.borne_out import borne_out, shows_nothing, without
from sim2real.judgement.judge import Entry
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

ENTRIES = [
    Entry(("sensor_resonance",), 0.6, 100.0, 1, None),
    Entry(("support_resonance",), 0.2, 103.0, 2, None),
    Entry(("runout",), 0.1, 105.0, 0, None),
    Entry(("unknown",), 0.1, 100.0, None, None),
]


def judged(nominal, calibrated, *after):
    """A holdout whose gaps are these, nominal first, and candidates of which the first is calibration."""
    names = [(), ("sensor_resonance",), ("support_resonance",)]
    fits = [Fit(h := Hypothesis(n, {}), np.zeros(h.size), np.zeros(1), 1.0) for n in names]
    gaps = np.array([nominal, calibrated, *after])
    holdout = SimpleNamespace(
        data=np.zeros(50), simulate=lambda points: np.sqrt(2) * gaps[: len(points), None] * np.ones(50)
    )
    candidates = [SimpleNamespace(fit=f) for f in fits]
    return holdout, SimpleNamespace(candidates=candidates, calibration=candidates[0])


@pytest.mark.parametrize(
    ("gaps", "kept"),
    [
        ((30.0, 8.6, 10.6, 4.3), [1, 2]),  # the most probable one is refuted
        ((30.0, 8.6, 4.3, 4.2), [0, 1, 2]),
        ((30.0, 8.6, 9.0, 40.0), [2]),  # tones leave the lines alone
        ((30.0, 1.1, 1.15, 1.14), [0, 1, 2]),  # calibration leaves no clear gap
        ((30.0, 1.1, 1.15, 4.3), [0, 2]),  # nor does it, and one leaves clearly more
        ((30.0, 8.6, np.nan, 4.3), [1, 2]),  # it touches down
        ((np.nan, 8.6, 10.6, 4.3), [0, 1, 2]),  # nothing to compare with
    ],
)
def test_those_are_kept_that_the_holdout_bears_out(gaps, kept):
    assert borne_out(*judged(*gaps), ENTRIES[:3]) == [ENTRIES[i] for i in kept]


@pytest.mark.parametrize(
    ("gaps", "saved", "moved", "kept"),
    [
        ((0.4, 0.4, 0.45), 1e4, 0.4, True),
        ((0.4, 0.4, 0.45), 20.0, 0.4, False),
        ((0.95, 0.95, 1.05), 1e4, 1.0, False),  # calibration leaves less
        ((0.95, 1.1, 1.05), 1e4, 1.0, True),  # more than the nominal rig does, and no more than noise
        ((0.95, 1.1, 1.05), 20.0, 1.0, False),
        ((0.95, 1.5, 1.4), 1e4, 1.0, True),  # its parameters may be elsewhere
        ((0.95, 1.5, 1.4), 1e4, 1.4, False),
        ((6.2, 60.0, 8.7), 1e4, 1.1, True),  # it tells a combination of parameters that the fitted ones do not
        ((6.2, 60.0, 8.7), 1e4, 4.0, False),
    ],
)
def test_a_holdout_without_a_gap_says_nothing_of_what_is_beyond_doubt(monkeypatch, gaps, saved, moved, kept):
    """The voltage limits a large drive, and not that of the holdout."""
    holdout, attribution = judged(*gaps)
    attribution.calibration.fit.cost = 1.0 + saved
    monkeypatch.setattr(borne_out_module, "left_on", lambda problem, fit: 2 * 50 * moved**2)
    assert borne_out(holdout, attribution, ENTRIES[:1]) == (ENTRIES[:1] if kept else [])


@pytest.mark.parametrize(
    ("plain", "with_effect", "kept"),
    [(1.0, 1.0, True), (1.0, 1.1, True), (1.0, 1.3, False), (2.5, 2.5, False)],  # the last: more than noise is left
)
def test_a_holdout_that_depends_on_what_the_fitted_ones_hardly_tell_refutes_nothing(
    monkeypatch, plain, with_effect, kept
):
    """Both leave a clear gap of it at the values of the fit, calibration less, and noise where these may be."""
    holdout, attribution = judged(3.0, 1.8, 1.9)
    left = {(): plain, ENTRIES[0].effects: with_effect}
    monkeypatch.setattr(borne_out_module, "left_on", lambda problem, fit: 2 * 50 * left[fit.hypothesis.effects])
    assert borne_out(holdout, attribution, ENTRIES[:1]) == (ENTRIES[:1] if kept else [])


def test_the_probability_of_what_is_refuted_goes_to_the_others():
    found = without(ENTRIES, ENTRIES[:1])
    assert [e.effects[0] for e in found] == ["support_resonance", "runout", "unknown", "sensor_resonance"]
    assert [e.probability for e in found] == pytest.approx([0.5, 0.25, 0.25, 0.0])


@pytest.mark.parametrize(
    ("gap", "mass", "fitted", "nothing"),
    [
        (1.0, 0.5, 1.1, True),
        (1.2, 0.5, 1.1, True),
        (1.35, 0.5, 1.1, False),
        (1.0, 9.0, 1.1, False),
        (1.0, 0.5, 5.0, False),  # what was fitted shows a gap
    ],
)
def test_a_holdout_that_calibration_simulates_to_its_noise_shows_nothing(gap, mass, fitted, nothing):
    holdout, _ = judged(gap, gap)
    weighed = Fit(Hypothesis((), {"mass": 0.01}), np.array([mass]), np.zeros(1), fitted * 40.0)
    attribution = SimpleNamespace(calibration=SimpleNamespace(fit=weighed), expected=40.0)
    assert shows_nothing(holdout, attribution, 10.0) == nothing
    assert not shows_nothing(holdout, attribution, 200.0)  # what differs between the recordings


@pytest.mark.parametrize(("spread", "kept"), [(0.0, True), (1.0, False)])
def test_what_closes_a_little_of_a_clear_gap_must_surely_close_some(spread, kept):
    """A fit of many parameters follows one part of the holdout and misses the rest by more than before."""
    holdout, attribution = judged(2.1, 2.1, 1.9)
    size = np.full(400, 2.1)
    after = np.where(np.arange(400) % 80 < 8, 1 + 4.3 * spread, 1.0) + (1 - spread) * 0.9
    assert np.mean(after**2) < np.mean(size**2)
    rows = np.sqrt(2) * np.stack([size, size, after])
    holdout.data, holdout.simulate = np.zeros(400), lambda points: rows[: len(points)]
    assert borne_out(holdout, attribution, ENTRIES[:1]) == (ENTRIES[:1] if kept else [])
