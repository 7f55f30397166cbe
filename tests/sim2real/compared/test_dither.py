"""A limited voltage under noise: what the noise dithers is predicted as the record has it, and not as without noise."""

from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import planned, repeated

from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import DITHERED, Point, together
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import residuals, series_at
from sim2real.recorded.open_evidence import coordinates_of
from sim2real.recorded.records import read_records

FREE = load_rig("hmb_free")


def test_only_what_a_limit_is_in_runs_with_noise():
    limited, plain = Point(effect("amplifier_voltage_limit", 0.4), {}), Point(effect("delay", 1e-5), {})
    assert "amplifier_voltage_limit" in DITHERED
    groups = together([limited, plain, limited], 0.5, FREE)
    assert groups == [((0.0, False), [1]), ((0.0, True), [0, 2])]
    quiet = replace(FREE, noise=replace(FREE.noise, displacement=0.0))
    assert together([limited, plain], 0.5, quiet) == [((0.0, False), [0, 1])]
    assert together([plain], 0.5, replace(FREE, effects=limited.effects)) == [((0.0, True), [0])]


@pytest.mark.slow
def test_a_limit_is_predicted_under_its_noise(tmp_path):
    """At the truth the cost of eight records is that of their noise, but for the chance of the noise that is simulated;
    without any it is far off."""
    limit = effect("amplifier_voltage_limit", 0.35)
    e = planned(FREE, limit, names=("base",))[0].experiment
    problem = assemble(repeated(tmp_path, [replace(e, seed=s) for s in range(8)]))
    truth = Point(limit, {})
    cost = float((abs(problem.data - problem.simulate([truth])[0]) ** 2).sum()) / problem.data.size / 2
    hasty = float((abs(problem.data - problem.simulate([truth], settled=False)[0]) ** 2).sum()) / problem.data.size / 2
    assert cost < 1.2 and hasty > 2 * cost
    again = problem.simulate([Point({}, {}), truth])[1]
    np.testing.assert_allclose(again, problem.simulate([truth])[0], rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("play", [0.0, 1e-6, 5e-6])
def test_without_a_period_noise_adds_nothing_but_what_a_play_makes_of_it(tmp_path, play):
    """Of a bench of another hand whose play is as small as its noise, or larger."""
    _, records = read_records(write_campaign(tmp_path, Bench(play=play), {"noise": "fit", "steps": "fit"}, 2.0, 5))
    truth = Point(effect("probe_backlash", play) if play else {}, {}, dithered=True)
    problem = assemble(records, near=truth)
    cost = np.sum(abs(problem.data - problem.simulate([truth])[0]) ** 2) / problem.data.size / 2
    assert cost < 1.3
    for part in problem.parts:  # what is searched for tones is what is fitted
        loop, outputs = part.predictor.replay.loop, part.opened.outputs
        at = coordinates_of(part.record, loop, outputs, series_at(part.record, truth))
        (fitted,) = residuals([part.predictor], part.predictor.lanes([truth], True), dithered=True)[0]
        assert np.linalg.norm((at - fitted) / part.noise) < 1e-6 * np.linalg.norm(fitted / part.noise)
    if play:
        (plain,) = problem.simulate([Point({}, {})])
        assert np.sum(abs(problem.data - plain) ** 2) / problem.data.size / 2 > 2.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5, 6, 7])
def test_chance_of_the_simulated_noise_is_averaged(tmp_path, seed):
    """One noise of the bench's size makes another tenth of the cost at the truth."""
    play = 5e-6
    _, records = read_records(write_campaign(tmp_path, Bench(play=play), {"noise": "fit", "steps": "fit"}, 2.0, seed))
    truth = Point(effect("probe_backlash", play), {})
    problem = assemble(records, near=truth)
    cost = np.sum(abs(problem.data - problem.simulate([truth])[0]) ** 2) / problem.data.size / 2
    assert cost == pytest.approx(0.98, abs=0.04)
