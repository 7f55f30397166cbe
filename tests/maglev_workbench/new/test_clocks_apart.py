"""What is said of files of one run whose clocks begin apart, or each at its own 0."""

import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.guess.recording import guess_recording
from maglev_workbench.commands.new.joined import runs_of_parts

N, RATE = 3000, 1000.0
MOVED, PUSHED = lfilter([0.02], [1, -0.98], np.random.default_rng(7).standard_normal((2, N)))


@pytest.mark.parametrize(
    ("begins", "words"),
    [((0.0, 0.0), "each clock begins at 0"), ((12.0, 12.25), "they begin 0.25 s apart"), ((12.0, 12.0), "clocks")],
)
def test_clocks_that_begin_apart_are_said(tmp_path, begins, words):
    guesses = []
    for begin, name, values in zip(begins, ("x_um", "F_N"), (100 * MOVED, PUSHED), strict=True):
        path = tmp_path / f"run_{name}.csv"
        rows = (f"{begin + k / RATE:.4f},{v:.5f}\n" for k, v in enumerate(values))
        path.write_text(f"t_s,{name}\n" + "".join(rows))
        guesses.append({path: guess_recording(path)})
    (run,) = runs_of_parts(*guesses)
    assert run.why.endswith(words) or words in run.why
    assert ("begin" in run.why) == ("begin" in words)
