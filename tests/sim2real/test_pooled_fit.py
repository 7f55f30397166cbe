"""Where the fit of one rig to many recordings ends: not in a valley, and not with a mass that nobody weighed."""

from dataclasses import replace
from pathlib import Path

import ball_bench
import bench_loop
import numpy as np
import pytest

from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real import pooled_fit
from sim2real.coefficients import Coefficient
from sim2real.compared.evidence import evidence_of
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.pooled import _scatter
from sim2real.recorded.drive.log_filter import smoothing
from sim2real.recorded.open_evidence import coordinates_of, simulated_series, smoothed_alike
from sim2real.recorded.open_loop import loop_at
from sim2real.recorded.open_reading import SHAPED
from sim2real.recorded.records import read_records
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import Hypothesis

FREE = load_rig("hmb_free")


def _current_alone(folder: Path, noise: float = 1e-4):
    """The records of a campaign whose controller is not known and whose meter has this noise, A."""
    lines = (folder / "campaign.toml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(("gains", "controller", "command"))]
    (folder / "campaign.toml").write_text("\n".join(kept))
    campaign = load_campaign(folder)
    rig = replace(campaign.rig, noise=replace(campaign.rig.noise, current=noise))
    return read_records(replace(campaign, rig=rig))[1]


@pytest.mark.slow
def test_a_scale_of_the_current_that_a_fit_went_far_along_is_given_back_to_the_gain(tmp_path):
    bench = bench_loop.Bench(gain=0.05, current_noise=0.0)
    records = _current_alone(bench_loop.write_campaign(tmp_path, bench, {"noise": "fit"}, 0.8, 5))
    problem, fit, _ = pooled_fit.fitted(records)
    h = fit.hypothesis
    at = next(i for i, c in enumerate(h.coordinates) if c.effect == "actuator_gain")
    gain = h.coordinates[at]
    whole = 1 + gain.value(float(fit.u[at]))
    assert whole == pytest.approx(1.05, abs=0.002)
    # The same force by a current of 6 % more and a gain of 6 % less: six tolerances of the scale.
    astray = fit.u.copy()
    astray[at] = gain.at(whole / 1.06 - 1)
    far = problem.with_errors(h.point(astray), {**problem.errors, "scale of current": 6.0})
    back, u = pooled_fit._about(far, h, astray)
    assert abs(back.errors["scale of current"]) < 1e-9
    assert 1 + gain.value(float(u[at])) == pytest.approx(whole, abs=0.003)


@pytest.mark.slow
def test_where_a_ball_rests_does_not_weigh_it(tmp_path):
    """A sweep of a sixth of the gap: how gain and stiffness change along it told the mass to a hundredth of 0.2 %."""
    rig = rig_from_toml(ball_bench.BALL, "ball")
    t = np.arange(4000) / rig.control_rate
    reference = 0.8e-3 * np.sin(2 * np.pi * (0.5 * t + 2.4 * t**2))
    run = ball_bench.record(rig, 4.0, 1, reference=reference, noise=(4e-6, 2e-4)) | {"reference": reference}
    text = (
        ball_bench.BALL + "\n[tolerance]\nmass = 0.002\n" if "[tolerance]" not in ball_bench.BALL else ball_bench.BALL
    )
    ball_bench.write_campaign(tmp_path, text, "", {"chirp": run}, ("displacement", "current", "reference"))
    records = _current_alone(tmp_path, 2e-4)
    _, fit, _ = pooled_fit.fitted(records)
    h = fit.hypothesis
    assert "mass" in h.calibrated
    mass = len(h.coordinates) + h.calibrated.index("mass")
    assert np.sqrt(fit.covariance()[mass, mass]) > 0.8


@pytest.mark.slow
def test_noise_in_the_current_does_not_tell_its_scale_from_the_gain(tmp_path):
    """Taken off one of both alone, the answer to noise left the gain six times as sharp, and 0.8 % too low."""
    rig = rig_from_toml(ball_bench.BALL, "ball")
    reference = 0.4e-3 * np.sign(np.sin(2 * np.pi * 0.3 * np.arange(8000) / rig.control_rate + 1e-6))
    run = ball_bench.record(rig, 8.0, 2, reference=reference, noise=(4e-6, 0.0)) | {"reference": reference}
    ball_bench.write_campaign(tmp_path, ball_bench.BALL, "", {"steps": run}, ("displacement", "current", "reference"))
    (record,) = _current_alone(tmp_path)
    found = evidence_of(record, Point({}, {}), {})
    more, at = found.predictor([Point({"actuator_gain": {"change": 1e-4}}, {}), Point({}, {})])
    gain, scale = (more - at) / 1e-4, found.nuisances["scale of current"] / -0.01
    told = record.told
    assert np.linalg.norm((gain - scale)[..., told]) < 3e-3 * np.linalg.norm(gain[..., told])


@pytest.mark.slow
def test_a_filter_of_the_whole_log_changes_only_what_the_law_bends(tmp_path):
    records = _current_alone(bench_loop.write_campaign(tmp_path, bench_loop.Bench(), {"chirp": "fit"}, 1.5, 5))
    (record,) = records
    rig = record.nominal
    slower = replace(record, nominal=replace(rig, control_rate=2 * rig.control_rate))  # the log of a faster controller
    slower = replace(slower, smoothed=smoothing(slower, SHAPED, None))

    def shares(times: float) -> list[float]:
        own = replace(
            slower, waves={**record.waves, "current": times * record.waves["current"]}, added=times * record.added
        )
        (part,) = assemble([own]).parts
        loop = loop_at(own, own.experiment)
        lanes = part.predictor.lanes([Point({}, {})])
        outputs = part.opened.outputs
        at = coordinates_of(own, loop, outputs, simulated_series(own, lanes)[0])
        found = smoothed_alike(own, loop, outputs, lanes, at)
        assert len(found) == 3 and not smoothing(record, SHAPED, None)
        return [float(np.linalg.norm(c) / np.linalg.norm(at)) for c in found.values()]

    large, small = np.array(shares(1.0)), np.array(shares(0.1))
    assert (small < 0.1 * large).all()  # in proportion to the square of the motion


def test_recordings_that_agree_are_not_said_to_disagree():
    def told(*values):
        return [Coefficient("actuator_gain", "N/A", v, 2.0, 180.0, True) for v in values]

    assert not _scatter(told(183.0, 183.5, 182.8))  # whatever all of them together gave
    assert _scatter(told(183.0, 183.5, 196.0))


def test_a_recording_that_shows_fewer_effects_begins_where_all_together_ended():
    near = Hypothesis(("actuator_gain", "delay", "damping"), {"mass": 0.01, "probe_gain": 0.02})
    fit = Fit(near, np.array([1.0, 2.0, 3.0, 4.0, 5.0]), np.zeros(1, complex), 0.0)
    fewer = Hypothesis(("actuator_gain", "damping", "support_stiffness"), {"probe_gain": 0.02})
    assert pooled_fit._carried(fewer, fit) == pytest.approx([1.0, 3.0, 0.0, 5.0])


def test_the_nominal_rig_has_the_coordinates_of_its_own_effects():
    h = Hypothesis(("actuator_gain", "damping", "delay"), {"mass": 0.01})
    assert not pooled_fit._of_rig(h, FREE).any()
    beside = Hypothesis((*h.effects, "support_resonance"), {})  # absent, it has a damping ratio nevertheless
    assert not pooled_fit._of_rig(beside, FREE).any()
    own = effect("actuator_gain", 0.1) | effect("delay", 7e-5)
    assert h.point(pooled_fit._of_rig(h, replace(FREE, effects=own))).effects == own | effect("damping", 0.0)
