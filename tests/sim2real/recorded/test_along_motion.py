"""Large motions: the noise that is left of a simulation, and what the shape of the force law leaves open.

The records are those of a ball by another integrator (`ball_bench`), under the controller of docs/controllers.md.
"""

from dataclasses import replace

import ball_bench
import numpy as np
import pytest
from ball_bench import BALL

from estimation.lines.line_windows import KEPT
from maglev_env.loop.gains import as_table
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force, linearise, reshaped
from maglev_env.recordings.campaign_writer import toml_value
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.compared.law_shape import law_shapes
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.recorded.along_motion import ends
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.open_loop import loop_at, nominal_loop
from sim2real.recorded.records import read_records

OWN = rig_from_toml(BALL, "docs")
# The derivative of every set-point step kicks the current by its own size.
RIG = replace(
    OWN, gains=replace(OWN.gains, limit=None, derivative_on="error", setpoint_filter=0.0, kp=400.0, kd=8.0, td=1e-3)
)
N = 4000


def record_of(folder, height, seed, noise=10e-6, channels=("displacement", "command", "reference"), reference=None):
    """Steps of the set point of this height, m, or another reference, with so much noise in the reading, m rms."""
    if reference is None:
        reference = np.repeat(height * np.random.default_rng(5).uniform(-1, 1, N // 500), 500)
    seconds = reference.size / RIG.control_rate
    run = ball_bench.record(RIG, seconds, seed, reference=reference, noise=(noise, 0.0)) | {"reference": reference}
    folder.mkdir()
    ball_bench.write_campaign(folder, BALL, toml_value(as_table(RIG.gains)), {"run": run}, channels)
    return read_records(folder)[1][0]


def normal_values(problem):
    """Damping and delay that are fitted, with gain and stiffness, at the truth, in standard errors."""
    points = [
        {"damping": {"coefficient": 0.02}},
        {"delay": {"time": 2e-5}},
        {"actuator_gain": {"change": 0.01}},
        {"negative_stiffness": {"change": 0.01}},
    ]
    base, *moved = problem.simulate([Point({}, {}), *(Point(p, {}) for p in points)])
    parts = lambda v: np.concatenate([v.real, v.imag])  # noqa: E731
    columns = np.array([parts(m - base) for m in moved]).T
    found = np.linalg.lstsq(columns, parts(problem.data - base), rcond=None)[0]
    return (found / np.sqrt(np.diag(np.linalg.inv(columns.T @ columns))))[:2]


@pytest.mark.slow
@pytest.mark.parametrize("channels", [("displacement", "command", "reference"), ("displacement", "reference")])
def test_noise_that_a_kick_of_the_current_multiplies_is_no_damping(tmp_path, channels):
    """The law is the stated one here, so its shape is no nuisance. A command that nobody recorded follows from the
    readings."""
    own, at_rest = [], []
    for seed in range(12):
        record = record_of(tmp_path / str(seed), 2.5e-4, seed, channels=channels)
        assert record.along is not None
        for kept, found in ((record, own), (replace(record, along=None), at_rest)):
            problem = assemble([kept])
            found.append(normal_values(replace(problem, nuisances=Nuisances((), problem.nuisances.columns[:0]))))
    assert np.mean(np.square(own)) == pytest.approx(1.0, abs=0.6)  # 24 squares of unit normals: sd 0.29
    assert np.mean(np.square(at_rest)) > 3.0


@pytest.mark.slow
def test_a_chirp_leaves_noise_alone_at_the_truth_where_no_command_is_recorded(tmp_path):
    """A window of 18 complex coordinates has a chi-square of mean 1, or somewhat less for its nuisances, and of s.d.
    0.24: 0.05 in the mean of 20 recordings."""
    t, fastest = np.arange(1500) / RIG.control_rate, np.log(30.0)
    chirp = 0.5e-3 * np.sin(2 * np.pi * 1.5 / fastest * np.expm1(t / 1.5 * fastest))  # from 1 to 30 Hz in 1.5 s
    own, at_rest = [], []
    for seed in range(20):
        record = record_of(tmp_path / str(seed), 0.0, seed, channels=("displacement", "reference"), reference=chirp)
        for kept, found in ((record, own), (replace(record, along=None), at_rest)):
            problem = assemble([kept])
            (predicted,) = problem.simulate([Point({}, {})])
            found.append(np.mean(abs(problem.data - predicted)[: 3 * KEPT].reshape(3, KEPT) ** 2 / 2, axis=1))
    assert np.all(np.mean(own, axis=0) < 1.25)
    assert np.mean(at_rest, axis=0)[0] > np.mean(own, axis=0)[0] + 0.3


def test_a_small_motion_is_opened_at_rest(tmp_path):
    assert record_of(tmp_path / "small", 2e-6, 1, noise=1e-6).along is None


def test_the_magnets_of_another_gain_pull_along_the_same_motion_as_their_own_current_does(tmp_path):
    """A gain that is a fifth larger is a current that is a fifth larger, in the same law."""
    record = record_of(tmp_path / "run", 2.5e-4, 1)
    e, law = replace(record.experiment, effects={"actuator_gain": {"change": 0.2}}), force_law(RIG)
    found, motion, h = record.along.under(e), record.along.motion, 1e-5
    place, current = motion.reading[0], ends(motion.driving, found.lag, found.late)[0][0]
    slopes = [
        (force(law, y, 1.2 * (i + h)) - force(law, y, 1.2 * (i - h))) / (2 * h)
        for y, i in ((place, current), (0.0, 0.0))
    ]
    np.testing.assert_allclose(found.begin[0], slopes[0] - slopes[1], rtol=1e-4, atol=1e-6 * slopes[1])
    loop = loop_at(record, e)
    assert not np.allclose(loop.blocks.plant, nominal_loop(record).blocks.plant, rtol=0.05)
    at_rest = loop_at(replace(record, along=None), e)  # there the nominal loop serves as well
    np.testing.assert_array_equal(at_rest.blocks.plant, nominal_loop(record).blocks.plant)


def test_what_a_noisy_current_pulls_more_is_that_of_squares_in_the_mean_too(tmp_path):
    """The pull of one coil is a square of its current, of which a slope midway is the exact secant."""
    record = record_of(tmp_path / "run", 2.5e-4, 1)
    looked = slice(record.first, record.first + record.windows.samples)
    noise = 0.2 * np.random.default_rng(2).standard_normal((1, record.windows.samples))
    predicted = np.stack([record.series["displacement"], np.zeros_like(record.command), record.command])
    predicted[2, :, looked] -= noise
    bent, law = loop_at(record, record.experiment, predicted).bent, force_law(RIG)
    lagging, place = (record.along.lag, record.along.late), record.along.motion.reading
    driving = record.along.motion.driving
    current, without = (ends(u, *lagging)[0] for u in (driving, driving - noise))
    more = force(law, place, current) - force(law, place, without) - linearise(law)[0] * (current - without)
    assert abs(more.mean()) > 5e-3  # N, of the noise's squares
    np.testing.assert_allclose(bent.along.begin * (current - without), more, atol=1e-6)


@pytest.mark.parametrize("rig", [RIG, load_rig("hmb_free"), load_rig("eframe")])
def test_the_shapes_of_a_law_keep_gain_and_stiffness_at_rest(rig):
    near = Point({"negative_stiffness": {"change": 0.04}, "actuator_gain": {"change": 0.1}}, {})
    law = force_law(rig)
    gain, stiffness = linearise(law)
    points = law_shapes(rig, near)
    assert len(points) == 2
    for point in points.values():
        bent = reshaped(law, **point.effects["force_law"])
        g, k = linearise(bent)
        assert g == pytest.approx(gain, rel=1e-9)
        assert k * (1 + point.effects["negative_stiffness"]["change"]) == pytest.approx(1.04 * stiffness, rel=1e-9)
        assert point.effects["actuator_gain"]["change"] == pytest.approx(0.1, rel=1e-9)


def test_the_form_of_the_law_keeps_how_the_gain_changes_with_the_gap():
    """The other shape of the two is that change: by a tenth."""
    law, h = force_law(RIG), 1e-6

    def change(own):
        return (linearise(own, h)[0] - linearise(own, -h)[0]) / (2 * h)

    form, steep = (p.effects["force_law"] for p in law_shapes(RIG, Point({}, {})).values())
    assert change(reshaped(law, **form)) == pytest.approx(change(law), rel=1e-5)
    assert change(reshaped(law, **steep)) == pytest.approx(change(law) / 0.9, rel=1e-5)
