"""Recordings whose ticks jitter: read, driven and simulated at those ticks."""

from dataclasses import replace

import ball_bench
import bench_loop
import numpy as np
import pytest
from ball_bench import BALL
from bench_loop import Bench, write_campaign

from maglev_env.experiment import Experiment, without_noise
from maglev_env.kernel.blocks import prepared
from maglev_env.kernel.driven import Drive
from maglev_env.kernel.replay import replayed
from maglev_env.loop.gains import as_table
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.recordings.recording import read_recording
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.recorded import records
from sim2real.recorded.open_reading import AT_TICKS, NOT_AT_TICKS, open_record
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.ticks import Ticks


@pytest.mark.parametrize(
    ("line", "note", "source"), [("", AT_TICKS, "command"), (", delay = 1e-6", NOT_AT_TICKS, "current")]
)
def test_a_jittered_recording_says_how_its_controller_is_used(tmp_path, line, note, source):
    folder = write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.3, 1)
    columns = dict(np.load(folder / "noise.npz"))
    time = np.arange(columns["command"].size) / bench_loop.RATE
    columns["time"] = time + np.random.default_rng(2).uniform(-0.1, 0.1, time.size) / bench_loop.RATE
    np.savez(folder / "noise.npz", **columns)
    text = (folder / "campaign.toml").read_text().replace('from = "displacement" ', f'from = "displacement"{line} ')
    (folder / "campaign.toml").write_text(text + '\ntime = { from = "time" }\n')
    campaign = load_campaign(folder)
    dataset = read_recording(campaign, campaign.recordings[0])
    assert dataset.attrs["resampled"] and ("tick_displacement" in dataset.coords) == (not line)
    record = open_record(campaign, campaign.recordings[0], dataset)
    assert note in record.notes and record.source == source


def test_a_constant_of_the_command_of_a_jittered_suspended_ball_is_not_part_of_what_drives_it(tmp_path):
    """It is what a gain that is not the nominal one needs to carry the weight."""
    rig = rig_from_toml(BALL, "docs")
    rig = replace(rig, gains=replace(rig.gains, limit=None))
    rng = np.random.default_rng(8)
    late = np.concatenate([[0.0], rng.uniform(-0.15, 0.15, 3000)])
    run = ball_bench.record(rig, 3.0, 4, 0.03 * rng.standard_normal(3000), lasts=1 + np.diff(late))
    run["time"] = (np.arange(3000) + late[:-1]) / 1000
    more = run | {"command": run["command"] + 0.02}
    controller = toml_value(as_table(rig.gains))
    folder = ball_bench.write_campaign(tmp_path, BALL, controller, {"run": run, "more": more}, channels=tuple(run))
    driven = [record.waves["current"] for record in records.read_records(folder)[1]]
    assert AT_TICKS in records.read_records(folder)[1][0].notes
    assert driven[1] == pytest.approx(driven[0], abs=1e-6)


@pytest.mark.slow
def test_a_jittered_recording_with_a_period_is_compared_at_its_own_ticks(tmp_path):
    """A ball whose controller ticks late and early by 15 % of a step, under a multisine that repeats by its ticks."""
    rig = rig_from_toml(BALL, "docs")
    rig = replace(rig, gains=replace(rig.gains, limit=None))
    rng, lines = np.random.default_rng(6), np.arange(2, 60)
    phase = 2 * np.pi * np.outer(lines, np.arange(500)) / 500 + rng.uniform(0, 2 * np.pi, (lines.size, 1))
    injection = np.tile(0.006 * np.cos(phase).sum(axis=0), 6)
    late = np.concatenate([[0.0], rng.uniform(-0.15, 0.15, injection.size)])
    run = ball_bench.record(rig, injection.size / 1000, 4, injection, lasts=1 + np.diff(late))
    run |= {"injection": injection, "time": (np.arange(injection.size) + late[:-1]) / 1000}
    controller = toml_value(as_table(rig.gains))
    folder = ball_bench.write_campaign(tmp_path, BALL, controller, {"run": run}, channels=tuple(run))
    text = (folder / "campaign.toml").read_text()
    multisine = f'{{ kind = "multisine", at = "current", fundamental = 2.0, lines = {lines.tolist()} }}'
    (folder / "campaign.toml").write_text(text.replace('{ kind = "none" }', multisine))

    stiffer = Point({"negative_stiffness": {"change": 0.01}}, {})

    def told():
        """The record, the whitened power that the truth leaves, and the cost of 1 % of stiffness."""
        _, (record,) = records.read_records(folder)
        problem = assemble([record])
        left = np.sum(abs(problem.data - problem.simulate([Point({}, {}), stiffer])) ** 2, axis=1)
        return record, left[0] / 2 / problem.data.size, left[1] - left[0]

    record, power, cost = told()
    assert isinstance(record, OpenRecord) and records.WITHOUT_PERIOD in record.notes and AT_TICKS in record.notes
    assert power == pytest.approx(1.0, abs=0.15)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(records, "jitters", lambda *_: False)
        resampled, _, poorer = told()
    assert not isinstance(resampled, OpenRecord) and cost > 3 * poorer > 0, "what resampling does counts as noise"


def test_a_loop_is_simulated_at_its_own_ticks_as_by_another_integrator():
    """Under regular ticks it is ten times further off."""
    rig = rig_from_toml(BALL, "docs")
    gains = replace(rig.gains, limit=None)
    rig = replace(rig, gains=gains)
    n, rng = 1500, np.random.default_rng(11)
    late = np.concatenate([[0.0], rng.uniform(-0.2, 0.2, n)])
    injection = np.repeat(0.03 * rng.standard_normal(n // 10), 10)
    run = ball_bench.record(rig, n / 1000, 4, injection, noise=(0.0, 0.0), lasts=1 + np.diff(late))
    e = without_noise(Experiment(rig, gains, ()))
    waves = {"force": np.zeros((1, n)), "current": injection[None], "reference": np.zeros((1, n))}
    lanes = prepared([e], 64)
    off = []
    for instants in (np.arange(n) + late[:-1], None):
        (found,) = replayed(lanes, [Drive(e, waves, instants)])
        off.append(np.abs(found[0, 0, 0] - run["displacement"]).max() / np.abs(run["displacement"]).max())

    assert 10 * off[0] < off[1] > 0.02
    regular = replayed(lanes, [Drive(e, waves, np.arange(n, dtype=float) + 7.0)])[0]
    np.testing.assert_array_equal(regular, replayed(lanes, [Drive(e, waves)])[0])


def ticks_apart(jitter):
    """4,000 ticks, each a sample after the one before, but for a random share of it."""
    return np.cumsum(1 + jitter * np.random.default_rng(1).standard_normal(4000))


@pytest.mark.parametrize(("jitter", "exact"), [(0.01, False), (0.05, True)])
def test_ticks_that_jitter_less_than_the_simulation_can_place_them_are_simulated_as_regular(jitter, exact):
    assert (Ticks(ticks_apart(jitter), {}).simulated is not None) == exact


def test_ticks_of_another_rate_or_with_one_missing_are_simulated_as_they_were():
    ticks = ticks_apart(0.01)
    assert Ticks(1.002 * ticks, {}).simulated is not None
    assert Ticks(np.delete(ticks, 2000), {}).simulated is not None
