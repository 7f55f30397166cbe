"""A second effect in recordings that never repeat: beside the first one alone, what it does passes for noise."""

import numpy as np
import pytest

from sim2real.attributed import attributed
from sim2real.blind.benchmark.generate import Case, make, recorded
from sim2real.blind.benchmark.write import write_campaign
from sim2real.compared.bench_noise import NO_BOUND, bench_noise
from sim2real.compared.problem import assemble
from sim2real.compared.stated_noise import STATED, louder_than_stated
from sim2real.recorded.records import read_records
from sim2real.search import attribute

# A ball with a stop whose gain is asymmetric, in noise and in steps.
SEED, CASE = 10501, Case(3, "ball", "full", "pair", ("soft_stop", "asymmetric_gain"))

# With rivals of each that the same kernels simulate.
FEW = ("soft_stop", "asymmetric_gain", "cubic_spring", "deadband", "actuator_gain", "mass", "delay", "force_law")


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    made = make(CASE, SEED)
    folder = tmp_path_factory.mktemp("quiet") / "c"
    write_campaign(folder, made.truth.rig, made.case.channels, recorded(made, SEED))
    return read_records(folder)[1]


@pytest.mark.slow
def test_the_pair_is_found_under_the_noise_that_the_rig_states(records, monkeypatch):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: FEW)
    fitted = assemble([r for r in records if r.role == "fit"])
    judged = assemble([r for r in records if r.role == "holdout"])
    problem, _, attribution, _ = attributed(records, fitted, judged, bench_noise(records), lambda text: None)
    best = min(attribution.candidates, key=lambda c: c.predictive)
    assert {*best.effects} == {"soft_stop", "asymmetric_gain"}
    noisy = [(part.record, part.opened.outputs, part.noise) for part in problem.parts]
    assert louder_than_stated(noisy, 1.3) == {}
    assert problem.bench is NO_BOUND or not problem.bench.shown
    # The stop alone leaves what was taken for noise.
    near = attribution.of("soft_stop").fit
    loud = problem.again(near.hypothesis.point(near.u))
    assert louder_than_stated([(part.record, part.opened.outputs, part.noise) for part in loud.parts], 1.3)


@pytest.mark.slow
def test_the_stated_noise_is_that_of_the_displacement_alone(records):
    (record, *_) = records
    most = STATED.most(record, ("plant", "amplifier"))
    assert np.isfinite(most[0]).all() and np.isinf(most[1]).all()
    assert most[0].min() >= 2 * record.nominal.noise.displacement / np.sqrt(record.windows.samples)
