"""Tones of recordings without a period, as the opened loop of a rig that was found shows them."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from maglev_env.experiment import Experiment, axis_experiment
from maglev_env.linear.loop import loop_response
from maglev_env.rig.rig import Rig
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.open_tones import with_tones
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import assemble
from sim2real.judgement.tones import sightings as module
from sim2real.judgement.tones.sightings import (
    FOREIGN,
    Sighting,
    _bands,
    _creeps,
    _foreign_elsewhere,
    _is_foot,
    _is_trend,
    _opened,
    _rings,
    sightings,
)
from sim2real.recorded.records import read_records

TONE = 2e-6  # m, of the probe, at 61.7 Hz


def test_the_size_of_a_tone_is_that_of_the_rig_found(tmp_path):
    """What the probe reads beside the displacement is as large as it is where the loop is opened at the true rig. At
    the nominal one, whose magnets pull more, it would be two thirds of that."""
    folder = write_campaign(tmp_path, Bench(stiffness=-0.4, tone=TONE), {"noise": "fit"}, 1.0, 0)
    _, (record,) = read_records(folder)
    found = Point({"negative_stiffness": {"change": -0.4}}, {})
    (seen,) = sightings(assemble([with_tones(record, found)], near=found), found)
    assert seen.family == FOREIGN and seen.frequency == pytest.approx(61.7, abs=0.1)
    assert seen.size == pytest.approx(TONE, rel=0.03)


def test_a_tone_of_two_axes_has_the_size_that_it_has_along_each():
    """A circular runout turns: its amplitude is that of either axis, which open their own loops."""
    rig = load_rig("hmb_radial")
    rig = replace(rig, gains=(rig.gains, replace(rig.gains, kp=0.5 * rig.gains.kp)))
    record, f = SimpleNamespace(experiment=Experiment(rig, rig.gains, ())), 60.0
    loops = [loop_response(axis_experiment(record.experiment, axis), np.array([f])) for axis in range(2)]
    back = np.array([1 + r.plant[0] * r.controller[0] for r in loops])
    assert abs(back[0]) > 1.05 * abs(back[1])
    size, _ = _opened(record, NOMINAL, f, TONE * np.array([1.0, 1j]) / back)
    assert size == pytest.approx(TONE, rel=1e-6)
    size, _ = _opened(record, NOMINAL, f, None, TONE * np.array([1.0, 1j]))
    assert size == pytest.approx(TONE, rel=1e-6)


@pytest.mark.parametrize(("frequency", "trend"), [(43.76, True), (44.5, True), (45.0, False), (46.0, False)])
def test_a_tone_that_the_periods_hardly_tell_from_a_line_may_be_its_trend(frequency, trend):
    """Five periods of 0.25 s tell 0.8 Hz apart; only lines that are driven can drift."""
    record = SimpleNamespace(
        frequency=np.array([40.0, 44.0, 48.0]),
        excited=np.array([False, True, False]),
        experiment=SimpleNamespace(fundamental=4.0),
        count=5,
    )
    assert _is_trend(SimpleNamespace(record=record), frequency) == trend


@pytest.mark.parametrize(
    ("effects", "frequency", "creeps"),
    [
        ({"friction": {"force": 1e-3}}, 2.06, True),
        ({"friction": {"force": 1e-3}}, 6.3, False),
        ({"sensor_resonance": {"frequency": 300.0}}, 2.06, False),
    ],
)
def test_what_creeps_below_the_lines_under_friction_is_no_tone(effects, frequency, creeps):
    record = SimpleNamespace(experiment=SimpleNamespace(fundamental=4.0), nominal=load_rig("hmb_free"))
    assert _creeps(record, Point(effects, {}), frequency) == creeps


@pytest.mark.parametrize(
    ("clearer", "of_mains", "family"), [(8e4, 0.0, FOREIGN), (1e3, 0.0, "pickup 50 Hz"), (8e4, 9e3, "pickup 50 Hz")]
)
def test_a_short_record_leaves_the_origin_of_a_tone_to_a_long_one(clearer, of_mains, family):
    """Half a second does not tell 100.9 Hz from twice the mains; three seconds do."""
    e = SimpleNamespace(fundamental=10.0, recorded_per_period=1)
    series = [{"displacement": np.zeros((1, round(10 * seconds)))} for seconds in (3.0, 0.5)]
    records = [SimpleNamespace(experiment=e, series=own) for own in series]
    problem = SimpleNamespace(parts=[SimpleNamespace(record=r) for r in records])
    rest = {"size": 1e-6, "sd": 1e-8, "receptance": 1e-5}
    long = Sighting(0, FOREIGN, 1, 100.9, chi2=clearer, **rest)
    short = Sighting(1, "pickup 50 Hz", 2, 101.05, chi2=5e3, **rest)
    mains = [Sighting(0, "pickup 50 Hz", 1, 50.0, chi2=of_mains, **rest)] if of_mains else []
    found = _foreign_elsewhere(problem, [long, short, *mains])
    assert found[0] == long and found[1].family == family
    assert found[1].frequency == (100.9 if family == FOREIGN else 101.05)


@dataclass(frozen=True)
class OnRig:
    """A record of which only the rig matters."""

    nominal: Rig
    experiment: Experiment


@dataclass(frozen=True)
class Shown:
    """What a loop is opened to."""

    outputs: tuple[str, ...] = ()


def on(effects):
    rig = replace(load_rig("hmb_free"), effects=effects)
    record = OnRig(rig, Experiment(rig, rig.gains, ()))
    return SimpleNamespace(record=record, opened=SimpleNamespace(outputs=("plant",)))


MODE = {"sensor_resonance": {"frequency": 200.0, "damping_ratio": 0.01, "coupling": 0.05}}


def test_a_mode_of_the_rig_rings_as_one_of_a_point_does(monkeypatch):
    moved = {"sensor_resonance": {**MODE["sensor_resonance"], "frequency": 300.0}}
    for part, point in ((on({}), Point(MODE, {})), (on(MODE), NOMINAL), (on(moved), Point(MODE, {}))):
        assert _rings(part, point, 205.0) and not _rings(part, point, 300.0)
    assert not _rings(on({}), NOMINAL, 205.0)
    monkeypatch.setattr(module, "opened_loop", lambda record: Shown())
    monkeypatch.setattr(module, "loud_bands", lambda *_: [(190.0, 210.0, 50.0), (20.0, 30.0, 40.0)])
    assert [s.chi2 for s in _bands(0, on({}), NOMINAL, False)] == [50.0, 40.0]
    assert [s.chi2 for s in _bands(0, on(MODE), NOMINAL, False)] == [40.0]
    assert _bands(0, on({"friction": {"force": 0.02}}), NOMINAL, False) == []


@pytest.mark.parametrize(("frequency", "foot"), [(49.91, True), (48.9, False)])
def test_a_rotation_beside_the_mains_is_not_their_foot(frequency, foot):
    """Two seconds resolve half a hertz."""
    record = SimpleNamespace(
        experiment=SimpleNamespace(fundamental=10.0, recorded_per_period=1), series={"displacement": np.zeros((1, 20))}
    )
    problem = SimpleNamespace(parts=[SimpleNamespace(record=record)])
    mains = Sighting(0, "pickup 50 Hz", 1, 49.93, 6e-8, 5e-10, 4e-5, 1.6e4)
    turns = Sighting(0, "spin", 1, frequency, 6e-8, 5e-9, 4e-5, 154.0)
    assert _is_foot(problem, turns, [mains]) == foot
    assert not _is_foot(problem, replace(turns, record=0), [])
