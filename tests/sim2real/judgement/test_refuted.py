"""The verdict where the holdout refutes all that is named."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real import diagnosis
from sim2real.judgement.judge import Entry


def entries(calibration, unknown):
    rest = [Entry(("calibration",), calibration, 108.0, 0, None), Entry(("unknown",), unknown, 100.0, None, None)]
    return [Entry(("damping",), 0.6, 100.0, 1, None), *sorted(rest, key=lambda e: -e.probability)]


@pytest.mark.parametrize(
    ("calibration", "unknown", "verdict"), [(0.3, 0.1, "no_gap"), (0.1, 0.3, "unexplained"), (0.0, 0.4, "unexplained")]
)
def test_what_is_left_decides(monkeypatch, calibration, unknown, verdict):
    """Where calibration is then the most probable, nothing is missing."""
    monkeypatch.setattr(diagnosis, "borne_out", lambda *a: [])
    monkeypatch.setattr(diagnosis, "shows_nothing", lambda *a: False)
    evidence = SimpleNamespace(cost=np.array([108.0, 100.0]))
    weighed = SimpleNamespace(
        found=entries(calibration, unknown), verdict="explained", cause=("damping",), evidence=evidence
    )
    named = diagnosis._named(None, None, "holdout", None, weighed)
    assert (named.verdict, named.cause) == (verdict, () if verdict == "no_gap" else ("unknown",))
    assert not named.kept and any("not named" in note for note in named.notes)
    assert sum(e.probability for e in named.found) == pytest.approx(1.0)


@pytest.mark.parametrize("clear", [False, True])
def test_what_the_holdout_shows_is_named_where_it_leaves_no_clear_gap(monkeypatch, clear):
    """An offset that the fitted recordings did not tell from none explained a third of the gap of a holdout."""
    found = [Entry(("calibration",), 0.8, 100.0, 0, None), Entry(("unknown",), 0.1, 100.0, None, None)]
    found.append(Entry(("actuator_offset",), 0.1, 102.0, 1, None))
    monkeypatch.setattr(diagnosis, "shown_by_both", lambda *a: found[2:])
    monkeypatch.setattr(diagnosis, "leaves_clear_gap", lambda *a: clear)
    weighed = SimpleNamespace(found=found, verdict="no_gap", cause=(), evidence=None)
    monkeypatch.setattr(diagnosis, "_predicts_nothing", lambda *a: False)
    named = diagnosis._named(None, None, "holdout", None, weighed)
    probability = {e.effects: e.probability for e in named.found}
    if clear:
        assert (named.verdict, named.cause, named.kept) == ("unexplained", ("unknown",), [])
        assert probability[("unknown",)] == pytest.approx(0.5) and probability[("calibration",)] == 0.0
    else:
        assert (named.verdict, named.cause) == ("explained", ("actuator_offset",))
        assert probability[("actuator_offset",)] == pytest.approx(1.0)
