"""What the answer of `maglev new` says must be edited before the next command."""

import json

import numpy as np
import pytest
from command_line import maglev
from scipy.signal import lfilter

N = 400
MOVED = lfilter([0.02], [1, -0.98], np.random.default_rng(7).standard_normal(N))


@pytest.mark.parametrize(
    ("force", "header", "words"),
    [
        ("{:.2f}", "F_N", "nothing must be edited before"),
        ("0x{:04X}", "F_N", "mend the columns of log.csv that could not be read before"),
        ("1'{:03d}", "F_N", "mend the columns of log.csv that could not be read before"),
        ("ok {}", "remark", "nothing must be edited before"),
        ("{:.2f}", "F [V]", "state the scales below before"),
    ],
)
def test_the_answer_names_what_could_not_be_read(tmp_path, force, header, words):
    values = [force.format(k if "X" in force or "d" in force else float(k % 7)) for k in range(N)]
    rows = (f"{k / 1000},{100 * x:.4f},{f}\n" for k, x, f in zip(range(N), MOVED, values, strict=True))
    (tmp_path / "log.csv").write_text(f"t_s,x_um,{header}\n" + "".join(rows))
    maglev("new", str(tmp_path), "--json", str(tmp_path / "a.json"))
    data = json.loads((tmp_path / "a.json").read_text())
    assert words in data["answer"]
    assert any("F_N (" in point and values[0] in point for point in data["edit"]) == words.startswith("mend")
