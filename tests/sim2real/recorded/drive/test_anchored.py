"""A stand-in that follows what the simulated rig makes of the recorded current, on a bench of another hand."""

from dataclasses import replace

import bench_loop
import numpy as np

from maglev_env.recordings.campaign import load_campaign
from sim2real.compared.point import Point
from sim2real.compared.simulated import lanes_of
from sim2real.recorded.drive.anchored import anchored
from sim2real.recorded.drive.quiet import quiet
from sim2real.recorded.open_evidence import coordinates_of, measured_of, measured_series, simulated_series
from sim2real.recorded.open_loop import nominal_loop
from sim2real.recorded.records import read_records


def test_a_stand_in_no_longer_answers_to_what_the_fit_leaves(tmp_path):
    folder = bench_loop.write_campaign(tmp_path, bench_loop.Bench(noise=3e-6, current_noise=0.0), {"noise": ""}, 1.0, 4)
    text = (folder / "campaign.toml").read_text().replace('role = ""\n', "")
    kept = [line for line in text.splitlines() if not line.startswith(("gains", "command"))]
    (folder / "campaign.toml").write_text("\n".join(kept))
    campaign = load_campaign(folder)
    rig = replace(campaign.rig, noise=replace(campaign.rig.noise, current=1e-4))
    (record,) = read_records(replace(campaign, rig=rig))[1]
    record = replace(record, along=None)
    loop, lanes = nominal_loop(record), lanes_of(record, [Point({}, {})])

    def left(r):
        """Opened coordinates that the simulation leaves, those of the stand-in's answer, and the opened lines."""
        simulated = simulated_series(r, lanes)[0]
        off = measured_series(r) - simulated
        off[0] = quiet(r.series["displacement"]) - simulated[0]
        told = r.excited
        coordinates = measured_of(r, loop, ("plant",)) - coordinates_of(r, loop, ("plant",), simulated)
        answer = r.coordinates(simulated[2] - r.command)
        return coordinates[..., told], answer[..., told], loop.opened(r, off[0], off[2], None)[0]

    before, answered, lines = left(record)
    after, answers, _ = left(anchored(record, lines))
    np.testing.assert_allclose(after, before, atol=0.1 * np.abs(before).max())
    assert np.linalg.norm(answers) < 0.1 * np.linalg.norm(answered)
