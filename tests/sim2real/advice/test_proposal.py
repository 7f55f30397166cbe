"""Which recording is proposed for which question, on linear problems."""

from types import SimpleNamespace

import numpy as np
import pytest

from sim2real.advice import next_experiment as own
from sim2real.advice import separation, slower_rotation
from sim2real.advice.made_already import made_already
from sim2real.advice.recording_menu import Item
from sim2real.gap.locate import Where
from sim2real.judgement.judge import Entry
from sim2real.judgement.tones.sightings import Sighting
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin, differentiate
from sim2real.search.hypotheses import Hypothesis

NAMES = ("mass", "actuator_gain", "sensor_gain")


def of(names, probability, candidate=None):
    return Entry(tuple(names.split("+")), probability, 0.0, candidate, None)


def simulator(rows):
    def simulate(points):
        sizes = ([10.0 * p.effects.get(name, {}).get("change", 0.0) for name in NAMES] for p in points)
        return np.array([np.array(own) @ rows for own in sizes], complex)

    return simulate


def recorded(name, motion=1.0, place=0.0, gains=1.0):
    """What advice needs of a recording, in a gap of 1 m."""
    series = {"displacement": np.array([[place - 0.1 * motion, place + 0.1 * motion]])}
    nominal, experiment = SimpleNamespace(gap=1.0), SimpleNamespace(gains=gains, recorded_rate=10.0)
    return SimpleNamespace(name=name, series=series, nominal=nominal, experiment=experiment)


def part_of(record):
    return SimpleNamespace(record=record, opened=SimpleNamespace(outputs=("plant",)))


@pytest.fixture
def asked(monkeypatch):
    """Asks for a recording between the three effects, of which the second and the third are least unlike in it."""
    drawn = np.random.default_rng(4).standard_normal((4, 40, 2)) @ (1, 1j)
    simulate = simulator(np.array([drawn[0], drawn[1], drawn[1] + 0.2 * drawn[2]]))
    problem = SimpleNamespace(parts=(part_of(recorded("a.npz")),), data=drawn[3], simulate=simulate)
    fits = begin([Hypothesis((n,), {}) for n in NAMES], [np.full(1, 5.0)] * 3, problem.data, simulate)
    differentiate(fits[:2], problem.data, simulate, True)
    calibration = begin([Hypothesis((), {})], [np.zeros(0)], problem.data, simulate)
    attribution = Attribution(0.0, tuple(map(Candidate, [*calibration, *fits])), 80.0, problem)
    monkeypatch.setattr(own, "menu", lambda _: [Item("another", 1.0, None, ("plant",), {"amplitude": 2.0})])
    monkeypatch.setattr(separation, "look", lambda *_: (SimpleNamespace(smoothed=simulate), np.ones(40)))
    return lambda *found: own.propose(attribution, found, ())


def turned(monkeypatch, hidden=(), noise=1e-9):
    """A 1 kg rotor on 3,000 N/m that reads 1 um at 3,000 rpm, in records whose lines hide some frequencies (Hz)."""

    def seen(frequency):
        receptance = 1 / (3000.0 + (2 * np.pi * frequency) ** 2)
        return Sighting(0, "spin", 1, frequency, 1e-6, noise, receptance, 1e3)

    monkeypatch.setattr(slower_rotation, "seen_at", lambda index, part, point, f: [] if f in hidden else [seen(f)])
    record = SimpleNamespace(experiment=SimpleNamespace(speed_rpm=3000.0), name="turning")
    base = SimpleNamespace(fit=SimpleNamespace(hypothesis=Hypothesis((), {}), u=np.zeros(0)))
    problem = SimpleNamespace(parts=(SimpleNamespace(record=record),))
    return SimpleNamespace(candidates=(), simplest=base, problem=problem), [seen(50.0)]


def test_another_speed_is_for_what_differs_in_nothing_but_what_turns(monkeypatch):
    """The bearing's frequency is 8.7 Hz: at 25 Hz the unbalance reads 89 % as much as the runout, at 4.2 Hz 19 %."""
    found = [of("delay+unbalance", 0.5, 1), of("delay+runout", 0.4, 1), of("sensor_lag+unbalance", 0.01, 2)]
    (proposed,) = own.propose(*_in_turn(turned(monkeypatch), found)).proposals
    assert proposed.change == {"speed": 1 / 12} and proposed.of == "turning"
    share = (2 * np.pi * 50 / 12) ** 2 / (3000 + (2 * np.pi * 50 / 12) ** 2)
    whole = (2 * np.pi * 50) ** 2 / (3000 + (2 * np.pi * 50) ** 2)
    assert proposed.expected_separation == pytest.approx(((1 - share / whole) / 0.03) ** 2, rel=5e-3)


def _in_turn(rig, found):
    attribution, seen = rig
    return attribution, found, seen


def test_a_speed_at_which_a_line_hides_the_tone_is_not_proposed(monkeypatch):
    found = [of("unbalance", 0.5, 0), of("runout", 0.5, 0)]
    (proposed,) = own.propose(*_in_turn(turned(monkeypatch, hidden=(1 / 12 * 50,)), found)).proposals
    assert proposed.change == {"speed": 1 / 16}
    assert own.propose(*_in_turn(turned(monkeypatch, hidden=[50 * s for s in slower_rotation.SHARES]), found)) is None


def test_what_turns_is_no_question_where_the_class_agrees_about_it(asked):
    """The others are less probable by far."""
    found = [of("mass+unbalance", 0.52, 1), of("actuator_gain+unbalance", 0.46, 2), of("mass+runout", 0.011, 1)]
    (proposed,) = asked(*found).proposals
    assert proposed.what == "another" and proposed.why.endswith("tells mass from actuator_gain")


def test_another_speed_is_proposed_where_no_fits_differ(monkeypatch):
    """What turns beside calibration alone has no fit of its own."""
    found = [of("unbalance", 0.5, 0), of("runout+pickup", 0.5, 0)]
    (proposed,) = own.propose(*_in_turn(turned(monkeypatch), found)).proposals
    assert proposed.change == {"speed": 1 / 12}


def test_candidates_that_were_only_simulated_are_told_apart_too_and_the_nearest_are_named(asked):
    (proposed,) = asked(*(of(name, 0.33, i) for i, name in enumerate(NAMES, 1))).proposals
    assert proposed.why.endswith("actuator_gain from sensor_gain")
    others = [asked(of("mass", 0.5, 1), of(name, 0.5, i)).proposals[0] for i, name in enumerate(NAMES[1:], 2)]
    assert 0 < proposed.expected_separation < min(p.expected_separation for p in others)


def test_what_is_refuted_is_no_rival(asked):
    assert asked(of("unknown", 0.6), of("mass", 0.4, 1), of("actuator_gain", 0.0, 2)) is None


def chosen(told, *efforts, lengths=(1,)):
    return own._chosen(dict(enumerate(efforts)), told, lengths)


def of_pairs(*rows):
    """The least over pairs of candidates of what recordings add up to: a row for each recording."""
    return lambda n, length: (length * float(np.min(np.sum([rows[i] for i in n], axis=0))), ())


def test_two_recordings_that_each_leave_a_pair_are_planned_together():
    """Neither alone separates all, a third does but takes new hardware."""
    assert chosen(of_pairs([40.0, 0.5], [0.2, 30.0], [60.0, 60.0]), 1.0, 1.0, 3.0) == (1, [0, 1])
    assert chosen(of_pairs([40.0, 0.5], [0.2, 30.0], [60.0, 60.0]), 1.0, 1.0, 1.0) == (1, [2])


def test_what_adds_nothing_is_not_asked_for():
    assert chosen(of_pairs([4.0, 3.0], [0.1, 0.2], [2.0, 2.5]), 1.0, 1.0, 1.0) == (1, [0, 2])


def test_what_is_too_short_is_asked_for_longer_where_that_is_the_least_effort():
    """A recording four times as long takes less than two of another kind, and more than nothing."""
    rows = of_pairs([7.0, 8.0], [20.0, 18.0], [9.0, 9.0])
    assert chosen(rows, 1.0, 1.0, 1.0, lengths=(1, 4, 16)) == (4, [1])
    assert chosen(rows, 1.0, 1.0, 1.0) == (1, [1, 2])
    assert chosen(of_pairs([30.0, 30.0], [2.0, 2.0]), 1.0, 1.0, lengths=(1, 4, 16)) == (1, [0])
    assert chosen(of_pairs([0.2, 0.2], [0.1, 0.1]), 1.0, 1.0, lengths=(1, 4, 16)) == (16, [0, 1])


def test_of_an_unknown_cause_it_is_asked_where_it_acts_and_of_what_it_depends(monkeypatch):
    kinds = ({"amplitude": 2.0}, {"channels": ["current"]}, {"gains": [0.8, 1.3]}, {"excitation": {}}, {"offset": 1e-5})
    monkeypatch.setattr(own, "menu", lambda _: [Item(str(k), 1.0, None, ("plant",), k) for k in kinds])
    rest = recorded("rest.npz", 0.01)

    def asked_of(*records, where) -> list[str]:
        problem = SimpleNamespace(parts=tuple(map(part_of, (rest, *records))))
        plan = own.propose(SimpleNamespace(problem=problem), [], [], where)
        assert [c.change for c in plan.menu] == list(kinds)
        assert all(p.expected_separation is None and p.of == "a.npz" for p in plan.proposals)
        return [next(iter(p.change)) for p in plan.proposals]

    once = recorded("a.npz")
    early = Where({"controller+amplifier": 0.9, "sensor": 0.1}, (), {"linear": 1.0}, True, None)
    bent = Where({"actuator+mechanics": 1.0}, (), {"linear": 0.2, "odd": 0.8}, True, None)
    assert asked_of(once, where=early) == ["channels", "excitation", "gains"]
    assert asked_of(once, where=bent) == ["channels", "offset", "amplitude"]
    assert asked_of(once, recorded("half.npz", 0.5), where=bent) == ["channels", "offset", "gains"]
    assert asked_of(once, recorded("other.npz", 0.9, gains=2.0), where=early) == ["channels", "excitation", "offset"]
    untold = Where({"actuator": 0.2, "amplifier": 0.8}, (), {"linear": 1.0}, True, None, between=False)
    assert asked_of(once, where=untold) == ["channels", "amplitude", "gains"]


def test_what_was_varied_already_is_known():
    once = recorded("a.npz")
    assert made_already([recorded("rest.npz", 0.01), once]) == frozenset()
    assert made_already([once, recorded("b.npz", 0.9, place=0.06)]) == {"offset"}
    assert made_already([once, recorded("b.npz", 0.3, gains=2.0)]) == {"amplitude", "gains"}


def test_what_nothing_tells_apart_is_said_and_does_not_hide_what_can_be_told(asked, monkeypatch):
    """The third effect does what the second does, in all that can be recorded."""
    drawn = np.random.default_rng(4).standard_normal((2, 40, 2)) @ (1, 1j)
    same = SimpleNamespace(smoothed=simulator(np.array([drawn[0], drawn[1], drawn[1]])))
    monkeypatch.setattr(separation, "look", lambda *_: (same, np.ones(40)))
    plan = asked(*(of(name, 0.33, i) for i, name in enumerate(NAMES, 1)))
    assert plan.untold == ("actuator_gain from sensor_gain",)
    (proposed,) = plan.proposals
    assert proposed.expected_separation > own.SEPARATED and "tells mass from" in proposed.why
    plan = asked(of("actuator_gain", 0.5, 2), of("sensor_gain", 0.5, 3))
    assert plan.proposals == () and plan.untold == ("actuator_gain from sensor_gain",)


def test_a_longer_recording_is_asked_for_only_where_all_of_it_is_compared():
    """100 s with a period, and without one 20,000 samples beside three recordings, of which 30,000 are compared."""
    once = SimpleNamespace(series={"displacement": np.zeros((1, 1000))}, experiment=SimpleNamespace(recorded_rate=10.0))
    assert own._lengths(once, 3) == [1]
    quick = SimpleNamespace(series=once.series, experiment=SimpleNamespace(recorded_rate=1000.0))
    assert own._lengths(quick, 3) == [1, 4, 16]
    e = SimpleNamespace(rig=SimpleNamespace(control_rate=1e4))
    windows = SimpleNamespace(sample_rate=1e4)
    for samples, expected in ((1000, [1, 4, 16]), (7000, [1, 4]), (20_000, [1])):
        record = object.__new__(OpenRecord)
        vars(record).update(series={"displacement": np.zeros((1, samples))}, experiment=e, windows=windows)
        assert own._lengths(record, 3) == expected
