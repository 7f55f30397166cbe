"""Effects of the rig itself, as a corrected one has them, in what is simulated of a recording."""

from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench, write_campaign
from campaigns import planned, repeated

from maglev_env.experiment import Experiment
from maglev_env.lane_values import shaped_law
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.compared.point import NOMINAL, Point, experiment_at
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import experiment_near, series_at
from sim2real.compared.tolerance_forms import LITTLE, tolerance_forms
from sim2real.recorded.nuisances import Nuisances
from sim2real.recorded.records import read_records

GAIN, STIFFNESS, RATE = "actuator_gain", "negative_stiffness", 0.05


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    (plan,) = planned(load_rig("hmb_free"), names=("base",))
    (found,) = repeated(tmp_path_factory.mktemp("own"), [plan.experiment])
    return found


def on(record, effects):
    """The record of a rig with effects of its own."""
    rigs = (replace(rig, effects=effects) for rig in (record.nominal, record.experiment.rig))
    nominal, rig = rigs
    return replace(record, nominal=nominal, experiment=replace(record.experiment, rig=rig, effects=effects))


def plainly(problem, point=NOMINAL):
    """What a problem predicts, with all that is not known of the measurement left in."""
    known = replace(problem, nuisances=Nuisances((), np.zeros((0, problem.whitened.size))))
    return known.simulate([point])[0]


def test_a_tolerance_moves_what_the_rig_s_own_effect_gives(record):
    part = assemble([record]).parts[0]
    corrected = replace(part.predictor, record=on(record, effect(GAIN, 0.1)))
    set_to, within = (Point(effect(GAIN, change), {GAIN: 0.03}) for change in (-0.2, 1.1 * 1.03 - 1))
    expected = part.predictor([within, set_to])
    found = corrected([Point({}, {GAIN: 0.03}), set_to])
    assert abs(found - expected).max() < 1e-9 * abs(expected).max()


@pytest.mark.parametrize(
    ("own", "point", "gain"),
    [
        (RATE, NOMINAL, 1 + RATE),
        (0.0, Point(effect("gain_drift", RATE), {}), 1 + RATE),
        (RATE, Point({}, {GAIN: 0.03}), 1.03 * (1 + RATE)),
        (RATE, Point(effect("gain_drift", 2 * RATE), {}), 1 + 2 * RATE),
    ],
)
def test_a_drift_of_the_rig_counts_by_its_mean_as_that_of_a_point_does(record, own, point, gain):
    """With the middle of the periods 1 s after the begin."""
    length = record.count / record.experiment.fundamental
    drifting = replace(on(record, effect("gain_drift", own) if own else {}), start=1.0 - 0.5 * length)
    found = experiment_near(drifting, point).effects
    assert set(found) == {GAIN} and found[GAIN]["change"] == pytest.approx(gain - 1, rel=1e-9)


def test_recordings_at_different_times_do_not_share_the_mean_of_the_rig_s_drift(record):
    own = on(record, effect("gain_drift", RATE))
    records = [own, replace(own, start=own.start + 2.0)]
    together, *alone = (plainly(assemble(r, rest=False)) for r in (records, *([r] for r in records)))
    assert abs(together - np.concatenate(alone)).max() < 1e-9 * abs(together).max()
    assert np.linalg.norm(alone[0] - alone[1]) > 1e-3 * np.linalg.norm(alone[0])


def test_what_acts_before_the_drive_is_left_out_of_the_rig_too(tmp_path):
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0))
    late = replace(
        on(record, effect("amplifier_lag", 1e-4) | effect("mass", 0.1)), upstream=frozenset({"amplifier_lag"})
    )
    assert experiment_near(late, NOMINAL).effects == effect("mass", 0.1)
    assert experiment_near(late, Point(effect("amplifier_lag", 2e-4), {})).effects == effect("mass", 0.1)


def test_noise_smooths_a_limit_of_the_rig_as_it_does_that_of_a_point(record):
    limit = effect("amplifier_voltage_limit", 0.2)
    own, by_point = (assemble([r], rest=False) for r in (on(record, limit), record))
    expected = plainly(by_point, Point(limit, {}))
    for point in (NOMINAL, Point(limit, {})):
        assert abs(plainly(own, point) - expected).max() < 1e-9 * abs(expected).max()
    part = own.parts[0]
    smoothed, hasty = (part.whitened(predict([NOMINAL]))[0] for predict in (part.predictor.smoothed, part.predictor))
    assert abs(smoothed - expected).max() < 1e-9 * abs(expected).max()
    assert np.linalg.norm(hasty - expected) > 1e-3 * np.linalg.norm(expected)


def test_noise_smooths_a_play_of_the_rig_as_it_does_that_of_a_point(tmp_path):
    _, (record,) = read_records(write_campaign(tmp_path, Bench(), {"noise": "fit"}, 0.5, 0))
    play = effect("probe_backlash", 1e-6)
    expected = series_at(record, Point(play, {}))
    found = series_at(on(record, play), NOMINAL)
    assert abs(found - expected).max() < 1e-9 * abs(expected).max()
    assert np.linalg.norm(expected - series_at(record, NOMINAL)) > 1e-3 * np.linalg.norm(expected)


def test_a_tolerance_that_moves_to_its_end_stays_within_the_range_of_its_effect():
    """In units of a tolerance, rounding left it by the last digit; and a rig's own change adds to it."""
    for own, change, end in ((0.0, -0.9000000000000001, -0.9), (-0.5, -0.9, -0.9), (4.0, 3.0, 9.0)):
        rig = replace(load_rig("hmb_free"), effects={STIFFNESS: {"change": own}} if own else {})
        e = experiment_at(Experiment(rig, Gains(kp=1e4, ki=0.0, kd=10.0), ()), Point({}, {STIFFNESS: change}))
        assert e.effects[STIFFNESS]["change"] == end
    with pytest.raises(ValueError, match=r"negative_stiffness\.change = -0\.95 is outside"):
        experiment_at(
            Experiment(load_rig("hmb_free"), Gains(kp=1e4, ki=0.0, kd=10.0), ()), Point({}, {STIFFNESS: -0.95})
        )


PAIR, SINGLE = load_rig("hmb_free"), rig_from_toml(draw_rig("ball", np.random.default_rng(3)).toml(), "rig.toml")


def pull(rig, point, y, current):
    """What the magnets of a rig at a point pull with (N)."""
    e = experiment_at(Experiment(rig, Gains(kp=1e4, ki=0.0, kd=10.0), ()), point)
    gain, stiffness = (1 + e.effects.get(name, {}).get("change", 0.0) for name in (GAIN, STIFFNESS))
    law = shaped_law(force_law(rig), e.effects)
    return force(replace(law, stiffness_scale=law.stiffness_scale * stiffness), y, gain * current)


@pytest.mark.parametrize("rig", (PAIR, SINGLE), ids=("pair", "single"))
@pytest.mark.parametrize("own", (0.0, 0.1, -0.2))
@pytest.mark.parametrize("share", (0.0, 0.4, 1.0))
def test_both_forms_of_a_tolerance_are_about_the_value_of_the_rig_s_own_effect(rig, own, share):
    forms = {GAIN: {"change": own, "force_share": share}, STIFFNESS: {"change": own, "distance_share": share}}
    forms |= effect("force_law", 0.5, offset=0.1) if rig is SINGLE else {}
    rig = replace(rig, tolerance={GAIN: 0.03, STIFFNESS: 0.04}, effects=forms)
    y, current = 1e-5 * rig.gap, 1e-5 * (rig.bias_current or 1.0)
    e = Experiment(rig, Gains(kp=1e4, ki=0.0, kd=10.0), ())
    for name, (*pair, deviations) in tolerance_forms(e).items():
        at_rest = [(pull(rig, p, 0.0, current) - pull(rig, p, 0.0, -current)) / current for p in (NOMINAL, *pair)]
        along = [(pull(rig, p, y, 0.0) - pull(rig, p, -y, 0.0)) / y for p in (NOMINAL, *pair)]
        moved, kept = (at_rest, along) if name == GAIN else (along, at_rest)
        more = rig.tolerance[name] * deviations
        assert more == pytest.approx((-1 if own < 0 else 1) * LITTLE * rig.tolerance[name])
        assert moved[1] == pytest.approx((1 + more) * moved[0], rel=1e-6) == moved[2]
        assert kept == pytest.approx([kept[0]] * 3, rel=1e-6)
        far = [pull(rig, p, 0.2 * rig.gap, 0.5 * (rig.bias_current or 1.0)) for p in pair]
        assert far[0] != pytest.approx(far[1], rel=1e-6)
