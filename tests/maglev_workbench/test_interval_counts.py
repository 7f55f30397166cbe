"""The counts of `maglev coverage`, on a few draws.

They stand in no folder of that name, because on the path it would hide the package `coverage`, which numba asks for.
"""

import json

import numpy as np
import pytest

from maglev_workbench.commands.coverage import study
from maglev_workbench.commands.coverage.conditions import CONDITIONS
from maglev_workbench.commands.coverage.report import coverage_json, coverage_markdown


def test_every_condition_makes_its_experiment():
    for name, condition in CONDITIONS.items():
        one, other = condition.experiment(0, 1), condition.experiment(0, 2)
        assert one.seed != other.seed and one.excitations != other.excitations, name


@pytest.mark.slow
def test_a_count_has_truths_near_the_linear_loop_and_the_same_seed_gives_the_same():
    rows = study.coverage(CONDITIONS["linear"], 3, 1)
    by_name = {row.quantity: row for row in rows}
    assert by_name["peak_sensitivity"].truth == pytest.approx(2.47, rel=0.02)
    assert by_name["stiffness at 90 Hz"].truth == pytest.approx(35.6e3, rel=0.02)
    assert all(row.draws == 3 and 0 <= row.held <= 3 for row in rows)
    assert study.coverage(CONDITIONS["linear"], 3, 1) == rows
    data = coverage_json({"linear": rows}, 1)
    assert json.loads(json.dumps(data))["conditions"]["linear"][0]["covered"] == rows[0].held / 3
    assert "maglev coverage linear --draws 3 --seed 1" in coverage_markdown({"linear": rows}, 3, 1)


def test_an_open_end_holds_and_a_narrow_interval_off_the_truth_does_not():
    row = study._counted("k", 1.0, [(0.9, None), (None, 1.1), (1.01, 1.02), (0.5, 1.5)])
    assert row.held == 3 and row.half_width is None
    assert row.interval[0] < 0.75 < row.interval[1]
    assert study._counted("k", 2.0, [(1.0, 3.0)] * 2).half_width == pytest.approx(0.5)
    assert np.isclose(study._counted("k", 0.0, [(-1.0, 1.0)] * 2).held, 2)
