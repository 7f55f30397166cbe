"""What is said below the pooled estimate."""

from maglev_workbench.commands.estimate.pooled_report import pooled_json, pooled_lines, pooled_sections
from sim2real.coefficients import Coefficient
from sim2real.pooled import Pooled
from sim2real.recorded.at_rest.static_evidence import AT_REST
from sim2real.words import AT_BOUND

GAIN = Coefficient("actuator_gain", "N/A", 0.6, 0.02, 0.84, True)
DAMPING = Coefficient("damping", "N s/m", -0.1125, 0.05, 0.0, True, at_limit=True)
FOUND = Pooled((GAIN, DAMPING), 1.0, (), {AT_REST: (GAIN,), "run.txt": (GAIN, DAMPING)}, ("chirp.txt",))


def test_a_coefficient_at_its_limit_and_a_holdout_are_said():
    limit, held = pooled_lines(FOUND)
    assert "damping ended at the bound" in limit and "-0.1125 N s/m" in limit and "later than the current" in limit
    assert held == "held out, and not used: chirp.txt"
    found = pooled_json(FOUND)
    assert found["coefficients"][1]["interval"] is None and found["coefficients"][1]["se"] is None
    assert [c["at_limit"] for c in found["coefficients"]] == [False, True] and found["held_out"] == ["chirp.txt"]
    assert pooled_lines(Pooled((GAIN,), 1.0, (), {})) == []


def test_the_page_shows_each_recording_and_the_rest():
    (_, whole), (heading, table) = pooled_sections(FOUND)
    assert AT_BOUND in whole and "-0.2" not in whole and AT_BOUND in table  # no interval where the search ends
    assert heading == "Each recording alone"
    assert table.count("<tr>") == 3 and AT_REST in table and "0.6 ± 0.02" in table
    assert len(pooled_sections(Pooled((GAIN,), 1.0, (), {}))) == 1
