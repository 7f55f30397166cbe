"""What a fit leaves: its figures, its times and the force it lacks, on a bench of another hand."""

import json
from dataclasses import replace

import bench_loop
import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import campaign

from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.diagnose.leftover import leftover_sections
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.gap.fit_figures import figures
from sim2real.gap.leftover import SEGMENTS, leftover
from sim2real.gap.leftover_words import leftover_lines
from sim2real.gap.missing_force import missing_force, profiles
from sim2real.recorded.records import read_records
from sim2real.search.candidates import Attribution, Candidate
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis

NOMINAL = Point({}, {})
QUIET = Bench(stiffness=0.3, noise=1e-8, current_noise=1e-4)


@pytest.fixture(scope="module")
def stiffer(tmp_path_factory):
    """Records of a bench whose magnets pull 30 % more than nominally: noise, with a burst in its fourth eighth."""
    folder = write_campaign(tmp_path_factory.mktemp("b"), QUIET, {"noise": "fit"}, 1.0, 0)
    return assemble(read_records(folder)[1])


def test_the_force_that_lacks_is_that_of_the_stiffness(stiffer):
    displacement, current, velocity = profiles(stiffer.parts, NOMINAL)
    assert (displacement.quantity, current.quantity, velocity.quantity) == ("displacement", "current", "velocity")
    slope = np.polyfit(displacement.at, displacement.force, 1)[0]
    assert slope == pytest.approx(-0.3 * bench_loop.STIFFNESS, rel=0.1)  # N/m: it pushes further away
    assert displacement.clear > 10 > velocity.clear and displacement.share > 0.3
    true = profiles(stiffer.parts, Point({"negative_stiffness": {"change": 0.3}}, {}))[0]
    assert abs(true.force).max() < 0.1 * abs(displacement.force).max() and true.clear < 0.1 * displacement.clear


def test_the_figures_of_a_fit_need_no_nominal_rig(stiffer):
    point = Point({"negative_stiffness": {"change": 0.3}}, {})
    nominal, true = stiffer.data - stiffer.simulate([NOMINAL, point])
    good, bad = figures(stiffer, true), figures(stiffer, nominal)
    assert good.predicted > 0.999 > bad.predicted and good.residual_rms < 0.2 * bad.residual_rms
    assert good.chi_square < 0.2 * bad.chi_square
    assert figures(stiffer, np.full_like(true, np.nan)) is None


def test_the_times_of_a_burst_are_named(tmp_path):
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 1.0, 0))
    y = record.series["displacement"]
    size = record.windows.samples // SEGMENTS
    burst = slice(record.first + 3 * size, record.first + 4 * size)
    y[:, burst] += 3e-6 * np.sin(2 * np.pi * 300 * np.arange(size) / bench_loop.RATE)
    found = left_of(assemble([record]))
    (own,) = found.recordings
    assert len(own.segments) == SEGMENTS and int(np.argmax([s[2] for s in own.segments])) == 3
    assert own.segments[3][0] == pytest.approx(burst.start / bench_loop.RATE, abs=1e-3)
    # The noise of a record without a period is what is left of it: of the gap, this record has no share by itself.
    lines = leftover_lines(replace(found, recordings=(replace(own, share=1.0),)))
    assert any("most of it at " in line for line in lines)
    assert sum(found.channels.values()) == pytest.approx(1.0)


def left_of(problem):
    """What calibration leaves, as the best partial explanation."""
    fits = begin([Hypothesis((), {})], [np.zeros(0)], problem.data, problem.simulate)
    attribution = Attribution(fits[0].cost, tuple(map(Candidate, fits)), 2.0 * problem.data.size, problem)
    return leftover(attribution, problem, attribution.calibration, {}, 0)


def test_periodic_records_have_sections_and_json(tmp_path):
    folder = campaign(tmp_path / "c", names=("base", "half"), parameters={"negative_stiffness": -1.0e4})
    found = left_of(assemble(read_records(folder)[1]))
    (heading, words), (_, figure), *_ = leftover_sections(found)
    assert heading and "calibration alone" in words and "base.npz" in words
    assert [a.text.partition(":")[0] for a in figure.layout.annotations] == [
        "residual / noise",
        *(f"missing force over the {name}" for name in ("displacement", "current", "velocity")),
    ]
    data = plain(found.to_json())
    json.dumps(data, allow_nan=False)
    assert [p["quantity"] for p in data["missing_force"]] == ["displacement", "current", "velocity"]
    assert found.recordings[0].motion > 1.5 * found.recordings[1].motion  # the largest first
    slope = np.polyfit(found.profiles[0].at, found.profiles[0].force, 1)[0]
    assert slope == pytest.approx(2.5e3, rel=0.3)
    named = replace(
        found,
        effects=("delay",),
        parameters={"delay.time": {"value": 7.5e-5, "se": 1e-6, "at_bound": False}},
        share=None,
    )
    assert leftover_lines(named)[0].startswith("Best partial explanation: delay, time 75.0 +- 2.0 µs (95 %). It leaves")
    ended = replace(named, parameters={"delay.time": {"value": 1e-3, "se": None, "at_bound": True}})
    assert "time 1 ms (at its bound, not identified). It leaves" in leftover_lines(ended)[0]
    # Of what is so far behind that it is not differentiated again no error is known.
    calibration = {"mass (relative)": {"value": 0.2, "se": None, "at_bound": False}}
    untold = replace(named, effects=(), parameters=calibration)
    assert "(no parameter moves clearly)" in leftover_lines(untold)[0]
    # The noise of a recording may be told a little too large: no share of nothing is given.
    assert any(line.startswith("By recording") for line in leftover_lines(named))
    quiet = replace(named, recordings=tuple(replace(r, share=0.0) for r in named.recordings))
    assert any("no recording is left with more than noise" in line for line in leftover_lines(quiet))
    assert not any(line.startswith("By recording") for line in leftover_lines(quiet))


def test_where_the_rotor_touches_down_there_is_no_force(stiffer):
    assert missing_force(stiffer.parts[0], Point({"negative_stiffness": {"change": 9.0}}, {})) is None
    assert profiles(stiffer.parts, Point({"negative_stiffness": {"change": 9.0}}, {})) == ()
