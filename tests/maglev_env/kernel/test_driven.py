"""Lanes of several recordings in one block against each recording alone, and against lanes that share their waves."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.blocks import prepared
from maglev_env.kernel.driven import Drive, driven
from maglev_env.kernel.replay import STRETCH, replayed
from maglev_env.kernel.simulate import simulate_records
from maglev_env.kernel.steady import steady_spectra
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import with_gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

FREE = load_rig("hmb_free")
LINES = np.array([1, 3, 8, 20])
NEUTRAL = effect("friction", 0.0)
POINTS = [NEUTRAL, NEUTRAL | effect("delay", 3e-5), NEUTRAL | effect("eddy_current", 1e3)]


def experiment(peak, at="force", **gains):
    excited = Excitation("sphs", at, 50.0, tuple(LINES.tolist()), peak)
    own = with_gains(FREE.gains, **{name: f * getattr(FREE.gains, name) for name, f in gains.items()})
    return without_noise(Experiment(FREE, own, (excited,), effects=NEUTRAL, periods=1, transient_periods=4))


ONE, OTHER = experiment(0.5), experiment(0.03, "current", kp=0.9, kd=1.2)
LANES = prepared([replace(ONE, effects=own) for own in POINTS * 3])


def drive(e):
    return Drive(e, {place: np.atleast_2d(e.waveform(place)) for place in ("force", "current", "reference")})


@pytest.mark.parametrize("currents", [True, False])
def test_a_recording_is_the_same_beside_others(currents):
    run = dict(transient=700, periods=2, currents=currents)
    both = steady_spectra(LANES, [drive(ONE), drive(OTHER)], [LINES, LINES[:2]], **run)
    assert [s.shape for s in both] == [(9, 1 + currents, 1, 4), (9, 1 + currents, 1, 2)]
    for together, e, lines in zip(both, (ONE, OTHER), (LINES, LINES[:2]), strict=True):
        (alone,) = steady_spectra(LANES, [drive(e)], [lines], **run, threads=1)
        np.testing.assert_array_equal(together, alone)
    np.testing.assert_array_equal(both[0][:3], both[0][3:6])


def test_waves_of_ones_own_move_a_lane_as_shared_ones_do():
    for e in (ONE, OTHER):
        (found,) = steady_spectra(LANES, [drive(e)], [LINES], 4 * ONE.samples_per_period)
        for point, own in zip(POINTS, found, strict=False):
            record = simulate_records([replace(e, effects=point)])[0][:, -e.samples_per_period :]
            lines = np.fft.rfft(record)[:, LINES] * 2 / e.samples_per_period
            np.testing.assert_allclose(own[:, 0], lines[[0, 2]], rtol=0, atol=1e-10 * abs(lines[:3]).max(axis=1).min())


def test_a_constant_load_is_that_of_the_rig_of_its_lane():
    """As the same force in a wave would be that all lanes share, and of one recording alone."""

    def load(e):
        return np.array([0.3 if "delay" in e.effects else -0.2])

    loaded, plain = replace(drive(ONE), load=load), drive(OTHER)
    found, beside = replayed(LANES, [loaded, plain])
    np.testing.assert_array_equal(beside, replayed(LANES, [plain])[0])
    for lane, point in enumerate(POINTS):
        force = load(replace(ONE, effects=point))[:, None]
        shared = replace(drive(ONE), waves={**loaded.waves, "force": loaded.waves["force"] + force})
        np.testing.assert_array_equal(found[lane], replayed(LANES, [shared])[0][lane])
        assert abs(found[lane, 0].mean() - replayed(LANES, [drive(ONE)])[0][lane, 0].mean()) > 1e-6


@pytest.mark.parametrize("without", ["", "sensor_time_constant", "amplifier_time_constant"])
def test_plain_lanes_of_one_structure_are_as_those_of_the_flexible_kernel(without):
    """Its maps of the chains between command, force and reading are other ones, and it has all their parts."""
    rig = replace(ONE.rig, **({without: 0.0} if without else {}))
    e = replace(ONE, rig=rig, effects={})
    plain = [
        {},
        effect("delay", 3e-5),
        effect("sensor_lag", 2e-5),
        effect("amplifier_lag", 5e-5),
        effect("damping", 2.0),
    ]
    lanes = prepared([replace(e, effects=own) for own in plain])
    assert not any(b.batch.structure.flexible for b in lanes)
    assert len(lanes) == (2 if without.startswith("amplifier") else 1)
    flexible = prepared([replace(e, effects=own | NEUTRAL) for own in plain])
    found, wanted = (
        steady_spectra(own, [drive(e), drive(replace(OTHER, rig=rig))], [LINES] * 2, 700) for own in (lanes, flexible)
    )
    for one, other in zip(found, wanted, strict=True):
        scale = abs(other).max(axis=-1, keepdims=True)
        np.testing.assert_allclose(one / scale, other / scale, rtol=0, atol=1e-10)


def test_few_points_of_many_recordings_fill_their_blocks():
    blocks = driven(LANES, [drive(ONE), drive(OTHER)])
    assert [b.member.size for b in blocks] == [16, 2]
    assert np.bincount(np.concatenate([b.drive for b in blocks])).tolist() == [9, 9]


def test_a_shorter_recording_ends_before_a_longer_one():
    """What a lane does after the end of its own recording does not matter, not even a touchdown."""
    n = STRETCH // 4
    still = {place: np.zeros((1, n + STRETCH)) for place in ("force", "current", "reference")}
    pushed = {place: np.zeros((1, n)) for place in still}
    pushed["force"][0, -3:] = 60.0  # N: it falls, but not within three samples
    (stood,) = replayed(LANES, [Drive(ONE, pushed)])
    short, long = replayed(LANES, [Drive(ONE, pushed), Drive(OTHER, still)])
    assert np.isfinite(short).all() and np.isfinite(long).all() and abs(short[0]).max() > 0
    np.testing.assert_array_equal(short, stood)
    longer = {place: np.pad(w, ((0, 0), (0, STRETCH)), "edge") for place, w in pushed.items()}
    assert np.isnan(replayed(LANES, [Drive(ONE, longer)])[0]).all()
