"""A drift of the reading over an open record lies along what is left out for it, whatever moved the rotor."""

from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign

from sim2real.recorded.open_evidence import measured_of, opened_of
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.records import read_records
from sim2real.recorded.slow_drift import drift_columns


@pytest.mark.parametrize("turns", [0.1, 1 / 2.7])
def test_a_slow_drift_of_the_reading_is_left_out(tmp_path, turns):
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 1.0, 0))
    loop = nominal_loop(record)
    outputs = opened_of(loop).outputs
    samples = record.series["displacement"].shape[1]
    drift = 1e-6 * np.sin(2 * np.pi * turns * np.arange(samples) / samples + 1)
    warm = replace(record, series={**record.series, "displacement": record.series["displacement"] + drift})
    change = (measured_of(warm, loop, outputs) - measured_of(record, loop, outputs)).ravel()
    columns = np.array([c.ravel() for c in drift_columns(record, loop, outputs).values()])
    assert columns.shape == (3, change.size)
    real = np.concatenate([columns.real, columns.imag], axis=1)
    wanted = np.concatenate([change.real, change.imag])
    size, *_ = np.linalg.lstsq(real.T, wanted, rcond=None)
    left = wanted - size @ real
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(wanted)
    assert abs(size).max() < 1  # of a standard deviation: nothing is known of a drift as small as this
