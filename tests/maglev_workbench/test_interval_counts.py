"""The counts of `maglev coverage`, on a few draws.

They stand in no folder of that name, because on the path it would hide the package `coverage`, which numba asks for.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from worker_jobs import Numbered

from maglev_env.loop.magnets.kinds import force_law
from maglev_workbench.commands.coverage import aperiodic, study
from maglev_workbench.commands.coverage.aperiodic import APERIODIC, KINDS
from maglev_workbench.commands.coverage.benches import BENCHES, real
from maglev_workbench.commands.coverage.conditions import CONDITIONS, REPEATING
from maglev_workbench.commands.coverage.counts import Interval, counted, interval
from maglev_workbench.commands.coverage.kept import kept
from maglev_workbench.commands.coverage.periodic import PERIODIC
from maglev_workbench.commands.coverage.report import coverage_json, coverage_markdown


def test_every_periodic_condition_makes_its_experiment():
    for name, condition in PERIODIC.items():
        one, other = condition.experiment(0, 1), condition.experiment(0, 2)
        assert one.seed != other.seed and one.excitations != other.excitations, name
        powers = [[np.mean(x.waveform(e.rig.control_rate) ** 2) for x in e.excitations] for e in (one, other)]
        assert powers[0] == pytest.approx(powers[1], rel=1e-9), name  # what is not linear responds to the power


@pytest.mark.slow
def test_a_count_has_truths_near_the_linear_loop_and_the_same_seed_gives_the_same():
    condition = replace(PERIODIC["linear"], periods=2)
    rows = study.coverage(condition, 2, 1)
    by_name = {row.quantity: row for row in rows}
    assert by_name["peak_sensitivity"].truth == pytest.approx(2.47, rel=0.02)
    assert by_name["stiffness at 90 Hz"].truth == pytest.approx(35.6e3, rel=0.02)
    assert all(row.draws == 2 and 0 <= row.held <= 2 for row in rows)
    assert study.coverage(condition, 2, 1) == rows
    data = coverage_json({"linear": rows}, 1)
    assert json.loads(json.dumps(data))["conditions"]["linear"][0]["covered"] == rows[0].held / 2
    assert "maglev coverage linear --draws 2 --seed 1" in coverage_markdown({"linear": rows}, 2, 1)


def test_a_page_keeps_the_part_that_is_not_counted_again():
    row = counted("k", [interval(0.9, 1.1, 1.0)] * 2)
    first = coverage_markdown(dict.fromkeys(APERIODIC, (row,)), 2, 1)
    both = coverage_markdown(dict.fromkeys(REPEATING, (row,)), 3, 4, first)
    assert "`maglev coverage unrepeated --draws 2 --seed 1 --docs docs/coverage.md`" in both
    assert "`maglev coverage repeating --draws 3 --seed 4 --docs docs/coverage.md`" in both
    assert coverage_markdown(dict.fromkeys(APERIODIC, (row,)), 2, 1, both) == both


def test_a_page_keeps_the_conditions_that_are_not_counted_again():
    old, new = (counted("k", [interval(0.9, high, 1.0)] * 3) for high in (1.1, 1.3))
    whole = coverage_markdown(dict.fromkeys(APERIODIC, (old, old)), 2, 1)
    first, second, *_ = APERIODIC
    page = coverage_markdown({second: (new, new)}, 20, 5, whole)
    for command in ("unrepeated --draws 2 --seed 1", f"{second} --draws 20 --seed 5"):
        assert f"Made by `maglev coverage {command}" in page
    rows, before = ([line for line in text.splitlines() if line.startswith("|")] for text in (page, whole))
    assert [i for i, (one, two) in enumerate(zip(rows, before, strict=True)) if one != two] == [4, 5]
    # Counted again it takes its own place, and what it replaces is no longer said.
    again = coverage_markdown({second: (old, old)}, 20, 6, page)
    assert "--seed 6" in again and "--seed 5" not in again and again.count("Made by") == 2
    assert coverage_markdown(dict.fromkeys(APERIODIC, (old, old)), 2, 1, again) == whole
    assert coverage_markdown({first: (old, old)}, 2, 1).count("Made by") == 1


def test_an_open_end_holds_and_a_narrow_interval_off_the_truth_does_not():
    ends = [(0.9, None), (None, 1.1), (1.01, 1.02), (0.5, 1.5)]
    row = counted("k", [*(interval(low, high, 1.0) for low, high in ends), None])
    assert row.held == 3 and row.draws == 4 and row.abstained == 1 and row.half_width is None
    assert row.interval[0] < 0.75 == row.covered < row.interval[1]
    assert counted("k", [interval(1.0, 3.0, 2.0)] * 2).half_width == pytest.approx(0.5)
    assert counted("k", [interval(-1.0, 1.0, 0.0)] * 2).held == 2


def test_errors_count_in_standard_errors_and_a_quantity_that_is_never_bounded_has_no_share():
    row = counted("k", [Interval(0.0, 2.0, 1.0, error) for error in (-1.0, 1.0, 3.0)])
    assert row.bias == pytest.approx(1.0) and row.spread == pytest.approx(2.0)
    never = counted("k", [None, None])
    assert never.covered is None and never.interval is None and never.abstained == 2
    data = coverage_json({"ball_hover": (never,)}, 0)
    assert json.loads(json.dumps(data, allow_nan=False))["conditions"]["ball_hover"][0]["covered"] is None
    assert "| 100% |" in coverage_markdown({"ball_hover": (never,)}, 2, 0)


@pytest.mark.parametrize("name", list(BENCHES))
def test_a_rig_that_is_drawn_differs_from_what_is_told_as_its_tolerances_say(name):
    nominal = BENCHES[name].rig
    off, delays = [], []
    for draw in range(200):
        true = real(nominal, np.random.default_rng(draw))
        law = force_law(true.rig)
        if name == "ball":  # a pull as (i / x)^2 that carries the weight has these slopes
            weight = true.rig.mass * nominal.gravity
            slopes = 2 * weight / law.bias_current, -2 * weight / true.rig.gap
            assert true.current == pytest.approx(law.bias_current - force_law(nominal).bias_current, abs=1e-12)
            for value, truth in zip(slopes, ("actuator_gain", "negative_stiffness"), strict=True):
                assert value == pytest.approx(true.truth[truth], rel=1e-9)
        off.append([true.truth[k] for k in ("actuator_gain", "negative_stiffness")])
        delays.append(true.truth["delay"] * nominal.control_rate)
    spread = np.std(off, axis=0) / abs(np.mean(off, axis=0))
    stated = [nominal.tolerance[k] for k in ("actuator_gain", "negative_stiffness")]
    assert spread == pytest.approx(stated, rel=0.15)
    assert 0 <= min(delays) < 0.05 and 0.95 < max(delays) <= 1


def test_every_bench_is_excited_in_every_way():
    assert len(APERIODIC) == len(BENCHES) * len(KINDS) and APERIODIC.items() <= CONDITIONS.items()
    time = np.arange(1000) / 1000
    for kind, (_, _, wave) in KINDS.items():
        one, other = (wave(time, np.random.default_rng(seed)) for seed in (1, 2))
        assert np.array_equal(one, wave(time, np.random.default_rng(1))) and abs(one).max() < 3
        assert np.array_equal(one, other) == (kind == "hover") == (not one.any())


@pytest.mark.slow
def test_recordings_without_a_period_are_counted(monkeypatch):
    monkeypatch.setattr(aperiodic, "SAMPLES", 6000)
    rows = study.coverage(CONDITIONS["ball_chirp"], 2, 4)
    assert [row.quantity for row in rows] == ["actuator_gain", "negative_stiffness", "damping", "delay"]
    assert all(row.draws + row.abstained == 2 for row in rows)
    assert rows[1].truth == pytest.approx(-104, rel=0.2) and rows[1].half_width < 0.1 and abs(rows[1].bias) < 3


def test_draws_are_counted_in_their_order_on_one_process_and_two():
    assert (
        study.coverage(Numbered(), 5, 4)
        == study.coverage(Numbered(), 5, 4, processes=2)
        == ((4, 0), (4, 1), (4, 2), (4, 3), (4, 4))
    )


def test_a_study_resumes_from_its_folder_and_refuses_counts_of_another_one(tmp_path):
    row, asked = counted("k", [interval(0.9, 1.1, 1.0), None]), []

    def count():
        asked.append(1)
        return (row,)

    assert [kept(tmp_path / "out", "linear", 2, 1, count) for _ in range(2)] == [(row,), (row,)] and len(asked) == 1
    with pytest.raises(ValueError, match=r"linear\.json was counted with another seed, draws; give another folder"):
        kept(tmp_path / "out", "linear", 3, 2, count)
    (tmp_path / "out" / "linear.json").write_text("{}")
    with pytest.raises(ValueError, match="is no file of counts"):
        kept(tmp_path / "out", "linear", 2, 1, count)


@pytest.mark.slow
@pytest.mark.parametrize("draw", [4, 25])
def test_where_nothing_but_noise_moves_a_ball_its_magnet_is_not_bounded(draw):
    """Opened at the rig of each pass, these went to a gain of half as much again, to a thousandth."""
    found = APERIODIC["ball_hover"].drawn(5, draw)
    assert found and not any(found.values())
