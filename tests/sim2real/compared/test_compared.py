"""Which part of a recording without a period is compared, and up to which frequency."""

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from maglev_env.experiment import Experiment
from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.open_record import EACH, TOGETHER, compared

FREE = load_rig("hmb_free")
NOMINAL = Experiment(FREE, FREE.gains, ())
RATE = FREE.control_rate


def swept(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A sweep from 20 to 120 Hz, and a reading that follows it in white noise."""
    t = np.arange(int(seconds * RATE)) / RATE
    drive = 0.1 * chirp(t, 20, seconds, 120)
    noise = 1e-7 * np.random.default_rng(seed).standard_normal(t.size)
    return drive, 1e-5 * lfilter([0.05], [1, -0.95], drive) + noise


@pytest.mark.parametrize("seed", [3, 4])
def test_nothing_is_compared_where_the_drive_is_what_rounding_leaves_of_the_noise(seed):
    drive, y = swept(3.0, seed)
    rounded = drive + 1e-5 * (y - 1e-5 * lfilter([0.05], [1, -0.95], drive)) / 1e-7  # goes with the noise
    stretch = compared(NOMINAL, RATE, rounded[None], y[None], recordings=1)
    top = stretch.windows.centre[-1]
    assert 110 < top < 0.1 * RATE


def test_one_recording_alone_has_more_of_its_samples_compared():
    drive, y = swept(7.0, 5)
    alone = compared(NOMINAL, RATE, drive[None], y[None], recordings=1)
    among = compared(NOMINAL, RATE, drive[None], y[None], recordings=6)
    assert 0.99 * TOGETHER < alone.windows.samples <= TOGETHER
    assert 0.99 * EACH < among.windows.samples <= EACH and "driven most" in among.notes[0]
