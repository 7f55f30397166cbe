"""Tones on lines of the drive: magnets that are not linear mix them with it, and the simulation has them, too."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import planned, write

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import assemble
from sim2real.compared.tones_on_lines import tones_on_lines, with_tones_on_lines
from sim2real.recorded.records import read_records

LINE = 20  # of the drive, an even one, at which the rotor turns


def recorded(folder, effects, rig="hmb_free", louder=8.0, line=LINE):
    """A recording with a motion of two fifths of the gap, and a rotor that turns at a line."""
    (plan,) = planned(load_rig(rig), names=("base",))
    e = plan.experiment
    drives = tuple(replace(own, amplitude=louder * own.amplitude) for own in e.excitations)
    e = replace(e, speed_rpm=60 * line * e.fundamental, excitations=drives, effects=effects)
    return assemble(read_records(write(folder / "c", [("base", "fit", e)], rig))[1])


def chi_square(problem):
    return np.mean(abs(problem.data - problem.simulate([NOMINAL])[0]) ** 2) / 2


def with_tones(problem):
    (part,) = problem.parts
    found = with_tones_on_lines(problem)
    return assemble([found.get(part.record.name, part.record)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "most", "size"),
    [(effect("runout", 4e-6, harmonics=0.4), 60.0, 4e-6), (effect("unbalance", 4e-6), 1e3, 3.09e-5), ({}, 0.0, None)],
    ids=("runout", "unbalance", "nothing"),
)
def test_what_a_tone_on_a_line_makes_of_the_others_is_simulated(tmp_path, effects, most, size):
    plain = recorded(tmp_path, effects)
    heard = with_tones(plain)
    assert chi_square(plain) > most and 0.9 < chi_square(heard) < 1.1
    sizes = [float(abs(t.amplitude[0])) for t in tones_on_lines(heard.parts[0], NOMINAL) if t.harmonic == 1]
    assert sizes == ([] if size is None else [pytest.approx(size, rel=0.01)])
    if size is not None:  # which the linear loop tells by a tenth too small
        assert abs(tones_on_lines(plain.parts[0], NOMINAL)[0].amplitude[0]) < 0.93 * size
        record = heard.parts[0].record
        assert all(np.array_equal(record.waves[place], plain.parts[0].record.waves[place]) for place in record.waves)


@pytest.mark.slow
def test_each_of_two_axes_has_its_part_of_a_tone(tmp_path):
    plain = recorded(tmp_path, effect("runout", 1.5e-5), "hmb_radial", 8.0)
    assert chi_square(with_tones(plain)) < 1.15 < 0.5 * chi_square(plain)


def test_what_a_gap_leaves_on_a_driven_line_is_no_tone_that_is_simulated(tmp_path):
    """At the nominal rig it looks like one, and with the effect it is gone."""
    mode = {"support_resonance": {"frequency": 20.0, "damping_ratio": 0.03, "mass_ratio": 0.02}}
    (part,) = (problem := recorded(tmp_path, mode, louder=1.0, line=5)).parts
    assert part.record.excited[list(part.record.lines).index(5)]
    assert [t.harmonic for t in tones_on_lines(part, NOMINAL)] and with_tones_on_lines(problem) == {}
    assert tones_on_lines(part, Point(mode, {})) == []


def test_a_simulation_that_touches_down_tells_no_tone(tmp_path):
    problem = recorded(tmp_path, effect("runout", 4e-6), louder=1.0)
    falls = Point({"negative_stiffness": {"change": 8.0}}, {})
    assert tones_on_lines(problem.parts[0], falls) == [] and with_tones_on_lines(problem, near=falls) == {}
