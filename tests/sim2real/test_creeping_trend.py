"""A trend over periods that no gain makes, where a rotor may not be at rest yet."""

from types import SimpleNamespace

import pytest

from maglev_env.rig.rig_file import load_rig
from sim2real import diagnosis as module
from sim2real.compared.drift import Drift
from sim2real.compared.point import Point


@pytest.mark.parametrize(
    ("effects", "left", "counts"),
    [
        ({"probe_backlash": {"half_width": 1e-6}}, 30.0, False),
        ({"probe_backlash": {"half_width": 1e-6}}, 3.0, True),  # a gain that drifts makes it
        ({"delay": {"time": 1e-5}}, 90.0, True),
        ({"delay": {"time": 1e-5}}, 30.0, False),  # the rest of a transient
    ],
)
def test_it_is_no_evidence_of_an_unknown_cause(monkeypatch, effects, left, counts):
    seen = {}

    def stop(attribution, tones, spin, causes, drift):
        seen.update(tones=tones, drift=drift)
        raise StopIteration

    names = ("sightings", "vibration_costs", "spin_costs", "looked_at", "seen_lost")
    for name in names:
        monkeypatch.setattr(module, name, lambda *a: {})
    monkeypatch.setattr(module, "evidence", lambda seen: {})
    monkeypatch.setattr(module, "drift_of", lambda problem, near: Drift(0.1, 0.02, max(left, 30.0), left, True))
    monkeypatch.setattr(module, "evidence_of", stop)
    fit = SimpleNamespace(u=None, hypothesis=SimpleNamespace(point=lambda u: Point(effects, {})))
    records = [SimpleNamespace(nominal=load_rig("hmb_free"))]
    with pytest.raises(StopIteration):
        module._weighed(records, None, SimpleNamespace(simplest=SimpleNamespace(fit=fit)))
    assert (module.DRIFT in seen["tones"]) == counts and (seen["drift"] is not None) == counts
