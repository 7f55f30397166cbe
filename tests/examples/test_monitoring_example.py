"""The example of monitoring finds its step, and draws it."""

from pathlib import Path

import pytest


@pytest.mark.slow
def test_the_step_is_found(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "examples"))
    import monitoring

    found = monitoring.watched()
    assert found.delay <= 0.5 and (found.alarms > found.change).all()
    monitoring.picture(found).savefig(tmp_path / "m.png")
