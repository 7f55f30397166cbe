"""What a stand-in controller makes of the noise of a reading, which a magnet's pull would take for stiffness."""

import numpy as np

from maglev_env.experiment import Experiment, without_noise
from maglev_env.rig.rig_file import load_rig
from sim2real.recorded.drive.drive import Drive
from sim2real.recorded.drive.quiet import quiet

SAMPLES = 20_000
NOISE = 10e-6


def _motion():
    """A motion of 40 Hz and its reading at 20 kHz, (1, samples) each, m."""
    t = np.arange(SAMPLES) / 20_000.0
    motion = 60e-6 * np.sin(2 * np.pi * 40.0 * t)[None] * np.hanning(SAMPLES)
    return motion, motion + NOISE * np.random.default_rng(1).normal(size=motion.shape)


def test_a_reading_loses_its_noise_and_keeps_its_motion():
    motion, reading = _motion()
    assert np.std(quiet(reading) - motion) < 0.25 * NOISE
    assert np.std(quiet(motion) - motion) < 1e-3 * motion.std()


def test_a_tone_where_noise_is_told_leaves_the_reading_alone():
    motion, reading = _motion()
    tone = 2e-6 * np.sin(2 * np.pi * 9000.0 * np.arange(SAMPLES) / 20_000.0)
    assert np.std(quiet(motion + tone) - motion) < 3e-6
    assert np.std(quiet(reading + tone) - motion) < 0.3 * NOISE


def test_a_stand_in_is_not_driven_by_the_noise_of_the_log():
    rig = load_rig("hmb_free")
    e = without_noise(Experiment(rig, rig.gains, ()))
    motion, reading = _motion()
    current = np.zeros_like(motion)

    def injected(y, stand_in):
        drive = Drive(e, "current", stand_in=stand_in)
        return drive.driving({"displacement": y, "current": current}).waves["current"]

    shaken, known = (injected(reading, stands) - injected(motion, stands) for stands in (True, False))
    # The controller that is known read that noise itself, so all of it is part of what it made.
    assert known.std() > rig.gains.kp * NOISE
    assert shaken.std() < 0.2 * known.std()
