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
