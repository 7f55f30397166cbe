"""A current that is read a sample late beside a known command, on a bench of another hand."""

import bench_loop
import numpy as np
import pytest

from sim2real.late_current import in_words
from sim2real.pooled import pooled
from sim2real.recorded.records import read_records


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, 1])
def test_late_readings_of_the_current_are_no_damping(tmp_path, late):
    folder = bench_loop.write_campaign(tmp_path, bench_loop.Bench(current_noise=2e-4), {"noise": "fit"}, 0.8, 5)
    run = dict(np.load(folder / "noise.npz"))
    own = {name: values[late:] for name, values in run.items()}
    own["current"] = run["current"][: run["current"].size - late]
    np.savez(folder / "noise.npz", **own)
    result = pooled(read_records(folder)[1])
    found = {c.name: c for c in result.coefficients}
    truth = {"actuator_gain": bench_loop.GAIN, "negative_stiffness": bench_loop.STIFFNESS, "damping": 0.0}
    for name, value in truth.items():
        assert abs(found[name].value - value) < 3 * found[name].se, name
    assert any("the current is not compared" in note for note in result.notes) is bool(late)


def test_words_name_the_channel_that_is_late():
    assert "comes 0.001 s later" in in_words(
        1e-3
    ) and "Its readings are late, or the displacement's are early" in in_words(1e-3)
    assert "comes 0.0004 s earlier" in in_words(-4e-4)
    assert "Its readings are early, or the displacement's are late" in in_words(-4e-4)
