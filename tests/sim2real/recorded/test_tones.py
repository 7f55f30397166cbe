"""Where tones come from: told by frequency, by how they grow with the speed, and by their harmonics."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import campaign

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import NOMINAL, Point, settling, together
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import residuals
from sim2real.judgement.tones.sightings import (
    FOREIGN,
    Sighting,
    _higher_harmonics,
    _mixed,
    _one_family,
    of_mains,
    sightings,
)
from sim2real.judgement.tones.unsynchronised import evidence, near_rotation, spin_costs
from sim2real.recorded.records import read_records
from sim2real.recorded.tones import families, near_tones, origin, outstanding, overtones
from sim2real.search.hypotheses import TONES

FREE = load_rig("hmb_free")
RESOLUTION = 1.0  # Hz, of a record of one second


@pytest.mark.parametrize(
    ("frequency", "speed", "named"),
    [(50.0, 0.0, "pickup 50 Hz"), (150.02, 0.0, "pickup 50 Hz"), (120.3, 0.0, "pickup 60 Hz"), (53.0, 0.0, None),
     (53.0, 3180.0, "spin"), (159.0, 3180.0, "spin"), (212.0, 3180.0, None), (200.0, 0.0, None)],
)  # fmt: skip
def test_a_tone_is_told_by_its_frequency(frequency, speed, named):
    assert origin(frequency, speed, RESOLUTION) == named


def test_harmonics_above_a_tone_of_known_origin_are_those_of_its_own_frequency():
    assert overtones(149.7, 0.0, RESOLUTION) == pytest.approx([49.9 * n for n in range(4, 10)])
    assert overtones(53.0, 3180.0, RESOLUTION)[0] == pytest.approx(212.0)
    assert overtones(53.0, 0.0, RESOLUTION) == []


def test_lines_near_known_tones_are_told():
    lines = 4.0 * np.arange(1, 60)
    assert set(lines[near_tones(lines, 0.4, 0.0)]) == {60.0, 100.0, 120.0, 180.0}
    assert set(lines[near_tones(lines, 0.4, 2640.0)]) == {44.0, 88.0, 132.0, 60.0, 100.0, 120.0, 180.0}
    assert {48.0, 52.0, 148.0} <= set(lines[near_tones(lines, 2.5, 0.0)])
    assert "spin" not in families(0.0) and families(3000.0)["spin"] == (50.0, 100.0, 150.0)


def test_a_line_stands_out_of_its_neighbours_or_not():
    rng = np.random.default_rng(7)

    def drawn(n, size=1.0):  # whitened residuals: |r|^2 is chi-square of two
        return size * (rng.standard_normal(n) + 1j * rng.standard_normal(n))

    alarms = sum(outstanding(drawn(1), drawn(24)) > 0 for _ in range(3000))
    assert alarms <= 6
    assert outstanding(np.array([8.0 + 0j]), drawn(24)) == pytest.approx(64.0, rel=0.6)
    assert outstanding(np.array([8.0 + 0j]), drawn(24, size=8.0)) == 0.0  # all is off there: no tone
    assert outstanding(np.array([6.0 + 0j]), []) == 36.0


def spin(record, speed, size, harmonic=1, receptance=1e-5):
    return Sighting(record, "spin", harmonic, speed / 60 * harmonic, size, 0.01 * size, receptance, 1e4)


class _Problem:
    """The speeds of a problem's recordings, which is all that sightings need."""

    def __init__(self, *speeds):
        experiment = [type("E", (), {"speed_rpm": s}) for s in speeds]
        record = [type("R", (), {"experiment": e}) for e in experiment]
        self.parts = [type("P", (), {"record": r}) for r in record]


def test_what_grows_with_the_square_of_the_speed_is_unbalance_and_what_stays_is_runout():
    problem = _Problem(3000.0, 6000.0)
    stays = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 1e-6)])
    assert stays["runout"] < 1 and stays["unbalance"] > 50
    grows = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 4e-6)])
    assert grows["unbalance"] < 1 and grows["runout"] > 50
    softer = spin_costs(problem, [spin(0, 3000.0, 1e-6), spin(1, 6000.0, 1e-6, receptance=2.5e-6)])
    assert softer["unbalance"] < 1  # four times the force on a quarter of the receptance
    assert set(stays) < set(TONES)


@pytest.mark.parametrize(
    ("second", "harmonic", "costs"),
    [(3e-7, 2, 8.0), (3e-7, 3, 0.0), (9e-8, 2, 0.0), (1.02e-7, 2, 0.0), (1.035e-7, 2, 2.2)],
    ids=["as an oval journal", "three times", "a bearing makes as much", "noise does", "hardly more than that"],
)
def test_a_tone_at_twice_the_speed_speaks_for_runout(second, harmonic, costs):
    found = spin_costs(_Problem(3000.0), [spin(0, 3000.0, 1e-6), spin(0, 3000.0, second, harmonic=harmonic)])
    assert found["runout"] == 0
    assert found["unbalance"] == pytest.approx(costs, rel=0.05)


def test_what_turns_as_fast_as_the_mains_may_be_theirs():
    """They give the same reading at every speed, as a runout does."""
    found = [spin(0, 3000.0, 1e-6), spin(1, 3000.0, 1.2e-6)]
    costs = spin_costs(_Problem(3000.0, 3000.0), found, mains=True)
    assert costs["pickup"] == costs["runout"] > 0
    assert "pickup" not in spin_costs(_Problem(3000.0, 3000.0), found)


def test_a_vibration_near_the_stated_speed_may_be_the_rotation():
    problem = _Problem(3000.0)
    problem.parts[0].record.name = "run.csv"
    (said,) = near_rotation(problem, [Sighting(0, "foreign", 1, 49.8, 1e-7, 1e-9, 1e-5, 90.0)])
    assert "run.csv" in said and "0.4 % from" in said and "state 2988 rpm" in said
    assert not near_rotation(problem, [Sighting(0, "foreign", 1, 61.0, 1e-7, 1e-9, 1e-5, 90.0)])


def test_parts_of_one_tone_are_no_further_measurements_of_it():
    """Beside a line and on it: how large the whole is, between 0.7 and 1.3 of the larger part, is not known."""
    problem = _Problem(3000.0, 6000.0)
    parts = [spin(0, 3000.0, 1e-6), spin(0, 3000.0, 3e-7), spin(1, 6000.0, 4.8e-6)]
    costs = spin_costs(problem, parts)
    assert costs["unbalance"] < 1  # 1.2 of it
    assert spin_costs(problem, [parts[0], parts[2]])["unbalance"] > 5  # nothing else there: 1.00 +- 0.05 of it
    far = [spin(0, 3000.0, 1e-6), spin(0, 3000.0, 3e-7), spin(1, 6000.0, 9e-6)]
    assert spin_costs(problem, far)["unbalance"] > 5


def test_evidence_is_summed_by_family():
    found = [spin(0, 3000.0, 1e-6), Sighting(0, "pickup 50 Hz", 1, 50.0, 1e-7, 1e-9, 1e-5, 40.0),
             Sighting(1, "pickup 60 Hz", 1, 60.0, 1e-7, 1e-9, 1e-5, 30.0),
             Sighting(1, "foreign", 1, 71.0, 1e-7, 1e-9, 1e-5, 25.0)]  # fmt: skip
    assert evidence(found) == {"spin": 1e4, "pickup": 70.0, "foreign": 25.0}


def sighting(family, harmonic, frequency, record=0):
    return Sighting(record, family, harmonic, frequency, 1e-7, 1e-9, 1e-5, 50.0)


def test_near_the_mains_a_tone_is_of_one_family():
    """At 3008 rpm what lies at 50.13 and 150.4 Hz is the rotor's alone; one that only the mains explain keeps both."""
    e = type("E", (), {"speed_rpm": 3008.0, "fundamental": 2.0})
    problem = type("P", (), {"parts": [type("Q", (), {"record": type("R", (), {"experiment": e})})]})
    turning = [sighting("spin", 1, 50.13), sighting("spin", 3, 150.4)]
    assert _one_family(problem, [*turning, sighting("pickup 50 Hz", 1, 50.1)]) == turning
    both = [*turning, sighting("pickup 60 Hz", 1, 60.0)]
    assert _one_family(problem, both) == both
    mains = [sighting("pickup 50 Hz", 1, 50.1), sighting("pickup 60 Hz", 1, 60.0)]
    assert _one_family(problem, [*mains, sighting("spin", 1, 50.1)]) == mains
    # What either explains is the rotor's, and may be of the mains.
    assert _one_family(problem, mains[:1]) == [sighting("spin", 1, 50.1)]
    assert of_mains(problem, turning) and not of_mains(problem, [*turning, sighting("spin", 1, 43.0, record=0)])


def test_what_modes_need_to_ring_out_groups_their_lanes():
    slow = Point({"sensor_resonance": {"frequency": 40.0, "damping_ratio": 0.01, "coupling": 0.05}}, {})
    fast = Point({"support_resonance": {"frequency": 400.0, "damping_ratio": 0.05, "mass_ratio": 0.05}}, {})
    plain = Point(effect("delay", 1e-5), {})
    assert settling(plain) == 0.0
    assert np.exp(-settling(slow) * 2 * np.pi * 40 * 0.01) == pytest.approx(1.5e-3, rel=0.01)
    groups = together([slow, plain, fast, slow], 0.5, FREE)
    assert [which for _, which in groups] == [[1], [2], [0, 3]]
    anyway = together([slow, plain, fast, slow], 0.5, FREE, 0.3)  # s, which is more than the fast one needs
    assert [which for _, which in anyway] == [[1, 2], [0, 3]] and anyway[1] == groups[2]
    assert all(
        lasts >= settling(p) for (lasts, _), which in groups for p in ([slow, plain, fast, slow][i] for i in which)
    )


@pytest.mark.slow
def test_a_mode_has_rung_out_where_it_is_looked_at(tmp_path):
    """A sharp mode that the nominal loop knows nothing of: the period predicted is that of a record as long again."""
    problem = assemble([r for r in read_records(campaign(tmp_path / "c", names=("base",)))[1]])
    mode = Point({"sensor_resonance": {"frequency": 37.0, "damping_ratio": 0.012, "coupling": 0.1}}, {})
    steady = residuals([problem.parts[0].predictor], problem.parts[0].predictor.lanes([mode]), 2 * settling(mode))[0]
    whitened = steady[..., problem.parts[0].used] * (np.sqrt(2) / problem.parts[0].noise[..., problem.parts[0].used])
    (whitened,) = problem.nuisances.clear(whitened.reshape(1, -1))  # without what forms of stated constants may do
    found, hasty = (problem.simulate([mode], settled)[0] for settled in (True, False))
    size = abs(whitened).max()
    assert abs(found - whitened).max() < 5e-3 * size < 0.1 * abs(hasty - whitened).max()


def test_a_tone_on_a_higher_harmonic_of_what_is_seen_belongs_to_it():
    """Distorted mains: the fifth harmonic of 50 Hz is no foreign vibration, but only where the mains is seen."""
    problem = _Problem(0.0)
    record = problem.parts[0].record
    record.experiment.fundamental, record.experiment.recorded_per_period = 2.0, 1000
    record.series = {"displacement": np.zeros((1, 6000))}
    mains = replace(sighting("pickup 50 Hz", 1, 49.95), chi2=900.0)
    fifth, other = sighting("foreign", 1, 249.7), sighting("foreign", 1, 223.0)
    named = replace(fifth, family="pickup 50 Hz", harmonic=5)
    assert _higher_harmonics(problem, [mains, fifth, other]) == [mains, named, other]
    assert _higher_harmonics(problem, [fifth, other]) == [fifth, other]
    louder = replace(fifth, chi2=2000.0)
    assert _higher_harmonics(problem, [mains, louder]) == [mains, louder]


def test_what_lies_a_line_of_the_drive_beside_a_clearer_tone_is_mixed_of_both():
    """Mains at 50.012 Hz in the loop of a ball whose drive has lines 4 Hz apart: tones at 14.02 and 22.02 Hz."""
    problem = _Problem(0.0, 0.0)
    for record in (part.record for part in problem.parts):
        record.experiment.fundamental, record.experiment.recorded_per_period = 4.0, 1000
        record.series = {"displacement": np.zeros((1, 6000))}
    mains = replace(sighting("pickup 50 Hz", 1, 50.012), chi2=900.0)
    below, mirrored, other = (sighting("foreign", 1, f) for f in (22.02, 13.98, 15.5))
    named = [replace(s, family="pickup 50 Hz", harmonic=0) for s in (below, mirrored)]
    assert _mixed(problem, [mains, below, mirrored, other]) == [mains, *named, other]
    louder = replace(below, chi2=1000.0)
    assert _mixed(problem, [mains, louder]) == [mains, louder]
    assert _mixed(problem, [below]) == [below]
    elsewhere = replace(below, record=1)
    assert _mixed(problem, [mains, elsewhere]) == [mains, elsewhere]


@pytest.mark.parametrize(("turns", "seen"), [(1.5, False), (5.5, True)])
def test_what_turns_less_than_three_times_is_a_wander_of_the_reading(tmp_path, turns, seen):
    """The recording is a second long. It is the reading's alone, which no loop follows."""
    folder = campaign(tmp_path / "c", names=("base", "half"))
    for file in folder.glob("*.npz"):
        columns = dict(np.load(file))
        columns["displacement"] = columns["displacement"] + 2e-7 * np.sin(2 * np.pi * turns * columns["time"])
        np.savez(file, **columns)
    _, records = read_records(folder)
    problem = assemble(records)
    found = sightings(problem, NOMINAL, False)
    assert any(s.family == FOREIGN and abs(s.frequency - turns) < 0.5 for s in found) == seen
    assert any("wanders slowly" in note for record in records for note in record.notes) != seen
