"""What is said below the pooled estimate."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from maglev_workbench.commands.estimate.each_figure import ALL, each_figure
from maglev_workbench.commands.estimate.pooled_report import apart_lines, pooled_json, pooled_lines, pooled_sections
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled
from sim2real.recorded.at_rest.static_evidence import AT_REST
from sim2real.words import AT_BOUND

GAIN = Coefficient("actuator_gain", "N/A", 0.6, 0.02, 0.84, True)
DAMPING = Coefficient("damping", "N s/m", -0.1125, 0.05, 0.0, True, at_limit=True)
FOUND = Pooled((GAIN, DAMPING), 1.0, {}, {AT_REST: (GAIN,), "run.txt": (GAIN, DAMPING)}, ("chirp.txt",))


def test_a_coefficient_at_its_limit_and_a_holdout_are_said():
    limit, held = pooled_lines(FOUND)
    assert "damping ended at the bound" in limit and "-0.1125 N s/m" in limit and "later than the current" in limit
    assert held == "held out, and not used: chirp.txt"
    found = pooled_json(FOUND)
    assert found["coefficients"][1]["interval"] is None and found["coefficients"][1]["se"] is None
    assert [c["at_limit"] for c in found["coefficients"]] == [False, True] and found["held_out"] == ["chirp.txt"]
    assert pooled_lines(Pooled((GAIN,), 1.0, {}, {})) == []


def test_the_page_shows_each_recording_and_the_rest():
    (_, whole), (heading, _), (_, table) = pooled_sections(FOUND)
    assert AT_BOUND in whole and "-0.2" not in whole and AT_BOUND in table  # no interval where the search ends
    assert heading == "Each recording alone"
    assert table.count("<tr>") == 3 and AT_REST in table and "0.6 ± 0.02" in table
    assert len(pooled_sections(Pooled((GAIN,), 1.0, {}, {}))) == 1


@pytest.mark.parametrize(
    ("gain", "stiffness", "apart"), [(0.52, -50.0, ()), (0.8, -50.0, ("gain",)), (0.6, -90, ("stiff",))]
)
def test_a_response_that_contradicts_the_fit_is_said(gain, stiffness, apart):
    own = SimpleNamespace(actuator=SimpleNamespace(gain=gain, gain_se=0.02, stiffness=stiffness, stiffness_se=1.0))
    fitted = Pooled((GAIN, Coefficient("negative_stiffness", "N/m", -52.0, 1.0, -60.0, True)), 1.0, {}, {})
    lines = apart_lines([("steps.txt", own), ("force.txt", SimpleNamespace(actuator=None))], fitted)
    assert len(lines) == bool(apart)
    for word, number in (("gain", f"{gain:.4g} +- 0.039 N/A"), ("stiff", f"{stiffness:.4g} +- 2 N/m")):
        assert any(number in line for line in lines) == (word in apart)
    assert ("steps.txt" in dict(pooled_sections(fitted, lines))["The rig in all recordings"]) == bool(apart)


def test_a_figure_shows_each_recording_beside_all_of_them():
    late = Coefficient("delay", "s", 90e-6, 2e-6, 0.0, True)
    found = Pooled((GAIN, late), 1.0, {}, {"a.csv": (GAIN,), "b.csv": (replace(GAIN, value=0.62), late)})
    figure = each_figure(found)
    gain, delay = figure.data
    assert list(gain.y) == ["a.csv", "b.csv", ALL] and list(delay.y) == ["b.csv", ALL]
    assert gain.x[1] == 0.62 and gain.error_x.array[1] == pytest.approx(1.96 * GAIN.se, rel=1e-3)
    assert delay.x[0] == pytest.approx(90) and figure.layout.xaxis2.title.text == "delay, µs"
    assert each_figure(Pooled((GAIN,), 1.0, {}, {})) is None
