"""Rows of lane blocks: named once, one after the other."""

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from maglev_env.kernel.layout import AXIS, WAVE, of_substep
from maglev_lanes.layout import LANES, LaneRows, row, rows_after

# In the order in which their rows follow each other.
BLOCKS = (
    "magnets.rows", "mechanics", "second_body", "further_body", "controller", "amplifier", "eddy", "actuator", "sensor",
    "external", "further.command_path", "further.uneven_gain", "further.springs", "further.probe_play",
    "further.vibration", "free.places",
    "self_sensing_pieces",
)  # fmt: skip
DECLARED = re.compile(r"^([A-Z][\w, ]+) = rows_after\(\s*([\w.]+),\s*f?\"([^\"]+)\",?\s*\)", re.MULTILINE)


def test_rows_follow_each_other():
    first, several, last, end = rows_after(3 * LANES, "FIRST SEVERAL[4] LAST")
    assert (row(first), row(several), row(last), row(end)) == (3, 4, 8, 9)


@pytest.mark.parametrize(
    "block", [*(f"maglev_env.loop.{name}" for name in BLOCKS[:-1]), "selfsense.kernel_rows", "maglev_env.rotor.rows"]
)
def test_every_row_is_declared_under_its_own_name(block):
    source = Path(import_module(block).__file__).read_text()
    found = DECLARED.findall(source)
    assert found
    for names, _, declared in found:
        *rows, _ = names.split(", ")
        assert rows == re.sub(r"\[.*?\}?\]", "", declared).split()


def test_blocks_do_not_overlap_and_fill_an_axis():
    ends = [import_module(f"maglev_env.loop.{block}").END for block in BLOCKS]
    assert ends == sorted(set(ends))
    assert ends[-1] == WAVE < AXIS  # then come the rows of the waves
    for flexible in (False, True):
        rows = of_substep(flexible)
        assert len(set(rows.tolist())) == len(rows)
        assert rows.max() < AXIS


def test_values_are_written_by_the_offset_of_their_row():
    values = np.zeros((5, 3))
    x = LaneRows(values)
    x[LANES], x[2 * LANES] = 7.0, np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(values, [[0, 0, 0], [7, 7, 7], [0, 1, 2], [3, 4, 5], [0, 0, 0]])
    np.testing.assert_array_equal(x[3 * LANES], [3, 4, 5])
