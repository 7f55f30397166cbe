"""How alike two simulators rank gains, against scores by the evaluation itself and hand-made ones."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import LinearController
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import load_rig
from sim2real.advice import gain_choice as own
from sim2real.advice.gain_choice import FACTORS, GainChoice, gain_choice, gain_sets
from sim2real.compared.point import Point

FREE = load_rig("hmb_free")


def test_what_is_chosen_and_what_it_costs():
    nominal, corrected = np.linspace(0, 1, len(FACTORS)), np.linspace(0.9, 0.1, len(FACTORS))
    found = GainChoice(nominal, corrected)
    assert found.chosen == (FACTORS[-1], FACTORS[0])
    assert found.regret == pytest.approx(0.8) and found.rank_correlation == pytest.approx(-1.0)
    assert GainChoice(nominal, nominal).regret == 0.0
    assert GainChoice(nominal, np.zeros(len(FACTORS))).rank_correlation is None


def test_gains_of_both_axes_are_scaled_and_others_than_pid_refused():
    radial = load_rig("hmb_radial").gains
    sets = gain_sets(radial)
    assert len(sets) == len(FACTORS)
    for (kp, kd), one in zip(FACTORS, sets, strict=True):
        pairs = zip(one, radial, strict=True) if isinstance(radial, tuple) else [(one, radial)]
        assert all((g.kp, g.kd, g.ki) == (kp * r.kp, kd * r.kd, r.ki) for g, r in pairs)
    with pytest.raises(ValueError, match="PID"):
        gain_sets(LinearController((1.0,), (1.0,)))


@pytest.mark.slow
def test_both_simulators_score_as_the_evaluation_does(monkeypatch):
    monkeypatch.setattr(own, "FACTORS", FACTORS[4:7])
    late = Point(effect("delay", 1.5e-4), {})
    found = gain_choice(FREE, late)
    for at, one in enumerate(gain_sets(FREE.gains)):
        e = protocol_experiment(FREE, one)
        assert found.nominal[at] == evaluate([e]).score[0]
        assert found.corrected[at] == evaluate([replace(e, effects=late.effects)]).score[0]
    assert (found.nominal != found.corrected).any() and found.regret >= 0


def test_without_what_scores_gains_there_is_no_choice():
    force = tuple(e for e in FREE.protocol.excitations if e.at == "force")
    assert gain_choice(replace(FREE, protocol=replace(FREE.protocol, excitations=force)), Point({}, {})) is None
    assert gain_choice(load_rig("pedestal"), Point({}, {})) is None
    assert gain_choice(with_parameters(FREE, {"negative_stiffness": -6e4}), Point({}, {})) is None
