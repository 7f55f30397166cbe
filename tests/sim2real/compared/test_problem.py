"""What recordings of one campaign share when they are simulated together, and what each has of its own."""

from dataclasses import replace

import ball_bench
import numpy as np
import pytest
from ball_bench import BALL
from bench_loop import Bench, write_campaign
from campaigns import planned, repeated
from scipy import signal

from estimation.lines.line_windows import KEPT
from maglev_env.loop.effect import effect
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.compared.law_shape import FORM_NAME, with_bent_law
from sim2real.compared.point import NOMINAL, Point
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import Predictor
from sim2real.judgement.dispersion import _left
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_evidence import simulated_series
from sim2real.recorded.records import read_records


def test_a_mode_rings_out_in_long_periods_whatever_recording_comes_first(tmp_path):
    """Its ringing lasts for as many periods as are waited for at most in the one, and for four times as many in the
    other."""
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    records = []
    for fundamental, count in ((32.0, 5), (8.0, 20)):
        push = Excitation("sphs", "force", fundamental, tuple(range(1, count)), 0.02)
        (record,) = repeated(tmp_path / f"{count}", [replace(plan.experiment, excitations=(push,))])
        records.append(record)
    ringing = Point(effect("support_resonance", 60.0, damping_ratio=0.012), {})
    found = []
    for order in (records, records[::-1], records[1:]):
        problem = assemble(order, rest=False)
        problem = replace(problem, nuisances=Nuisances((), np.zeros((0, problem.whitened.size))))
        (whole,) = problem.simulate([ringing])
        found.append(next(whole[part.place] for part in problem.parts if part.record is records[1]))
    for other in found[:2]:
        assert abs(other - found[2]).max() < 1e-9 * abs(found[2]).max()


def test_a_record_of_a_bent_law_does_not_share_the_lanes_of_one_without(tmp_path):
    rig = rig_from_toml(BALL, "ball")
    rng = np.random.default_rng(5)
    injection = 0.2 * signal.lfilter(*signal.butter(2, 20.0, fs=rig.control_rate), rng.normal(size=600))
    controller = ", ".join(
        line.partition("#")[0].strip() for line in BALL.partition("[gains]\n")[2].strip().splitlines()
    )
    runs = {name: ball_bench.record(rig, 0.6, seed, injection) for name, seed in (("a", 3), ("b", 4))}
    ball_bench.write_campaign(tmp_path, BALL, f"{{ {controller} }}", runs)
    one, other = read_records(load_campaign(tmp_path))[1]
    plain, same, bent = (
        Predictor(r, None, 0, replay=object()) for r in (one, other, with_bent_law(one, {FORM_NAME: 1.0}))
    )
    moved, expected = (simulated_series(one, p.lanes([NOMINAL])) for p in (bent, plain))
    assert abs(moved - expected)[0, 0].max() > 1e-3 * abs(expected)[0, 0].max()
    assert plain.kind == same.kind != bent.kind


def test_without_a_holdout_whole_windows_are_withheld_which_tell_whether_a_fit_leaves_more_than_noise(tmp_path):
    """Of a bench whose gain is 10 % off: a quarter of the coordinates withheld leaves three quarters of the freedom."""
    _, (record,) = read_records(write_campaign(tmp_path, Bench(gain=0.1), {"noise": "fit"}, 1.0, 3))
    whole = assemble([record])
    kept, withheld = whole.split(4)
    used, out = (p.parts[0].used.reshape(-1, KEPT) for p in (kept, withheld))
    assert np.array_equal(used | out, whole.parts[0].used.reshape(used.shape)) and not (used & out).any()
    assert out.any(axis=1).sum() == out.shape[0] // 4 and np.array_equal(out.any(axis=1), out.all(axis=1))
    freedom = {}
    for name, problem in (("whole", whole), ("kept", kept)):
        residual = problem.data - problem.simulate([NOMINAL])[0]
        left = _left(problem.parts[0], residual[problem.parts[0].place])
        assert left.ratio(0.0) > 1.5
        freedom[name] = left.freedom
    assert freedom["kept"] / freedom["whole"] == pytest.approx(0.75, abs=0.05)
