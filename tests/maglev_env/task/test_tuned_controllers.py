"""Controllers of other forms as tasks: which gains are tuned, in which box, and what an experiment is made with."""

from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from short_sweeps import short_rig

from maglev_env.design.controllers import with_controller
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.experiment import protocol_experiment
from maglev_env.loop.controller_forms import Cascade, CurrentLoop, Pid, StateFeedback
from maglev_env.loop.filtered_pid import FilteredPid, LowPass, Notch
from maglev_env.loop.gains import GAIN_CARDS, Gains, digital, gain_values
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.gain_box import TUNED, WIDE_RANGE, gain_box, parse_tuned
from maglev_env.task.task import make_task
from tuning.methods import make_tuner

FREE = load_rig("hmb_free")
TEXT = "pid + notch 650"
DOCS = (Path(__file__).parents[3] / "docs" / "controllers.md").read_text(encoding="utf-8")


def test_a_filter_adds_its_gains_to_those_of_the_pid():
    task = make_task(FREE, controller=TEXT)
    box = task.box
    assert box.names == (*TUNED, "notch_frequency", "notch_depth", "notch_width")
    assert [tuple(pair) for pair in zip(box.low[:3], box.high[:3], strict=True)] == [FREE.bounds[n] for n in TUNED]
    np.testing.assert_allclose([box.low[3:], box.high[3:]], [[455.0, 0.02, 0.05], [910.0, 1.0, 2.0]])
    assert box.log.tolist() == [True, True, True, False, True, True]
    assert set(box.names) <= set(task.layout.names)
    point = np.array([0.1, -0.2, 0.3, -1.0, 1.0, 0.5])
    made = task.experiment(task.draw(np.random.default_rng(0)), box.gains(point), 1).gains
    assert (made.notch.frequency, made.notch.depth) == pytest.approx((455.0, 1.0))
    np.testing.assert_allclose(box.point(made), point, atol=1e-12)


def test_the_plain_pid_is_tuned_as_ever():
    task = make_task(FREE)
    assert task.box.names == TUNED and task.rig.gains == FREE.gains == make_task(FREE, controller="pid").rig.gains
    assert isinstance(task.experiment(task.draw(np.random.default_rng(0)), task.box.high, 1).gains, Gains)


@pytest.mark.parametrize(
    ("controller", "names"),
    [
        (Pid(8000.0, 0.0, 5.2, 1e-4), ("kp", "ki", "kd")),  # the rig has bounds of ki
        (StateFeedback(8000.0, 5.2, 0.1), ("displacement", "velocity", "current")),
        (Cascade(Pid(110.0, 60.0, 3.0, 5e-3), CurrentLoop(6.0, 400.0), 4.0),
         ("outer_kp", "outer_ki", "outer_kd", "inner_kp", "inner_ki")),
        (FilteredPid(8000.0, 0.0, 5.2, low_pass=LowPass(3000.0)),
         ("kp", "ki", "kd", "low_pass_frequency", "low_pass_damping")),
    ],
    ids=["pid", "state feedback", "cascade", "low-pass"],
)  # fmt: skip
def test_every_form_has_gains_to_tune(controller, names):
    box = gain_box(replace(FREE, gains=controller))
    assert box.names == names
    changed = box.applied(controller, box.high)
    assert [gain_values(changed)[name] for name in names] == box.high.tolist()


def test_a_default_frequency_stays_below_half_of_the_control_rate():
    filtered = replace(FREE, gains=FilteredPid(8000.0, 0.0, 5.2, low_pass=LowPass(5000.0)))
    assert gain_box(filtered, ("low_pass_frequency",)).high[0] == 0.45 * FREE.control_rate
    with pytest.raises(ValueError, match=r"bounds: .* half of the control rate"):
        gain_box(filtered, bounds={"low_pass_frequency": (100.0, 12_000.0)})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"controller": TEXT, "tuned": ("notch2_depth",)}, "no gain 'notch2_depth'; gains are kp, ki, kd, td"),
        ({"controller": TEXT, "bounds": {"notch_depth": (0.5, 200.0)}}, "bounds: .*depth = 200"),
        ({"controller": "pid + comb 3"}, "no filter 'comb'"),
    ],
)  # fmt: skip
def test_what_cannot_be_tuned_is_refused_by_name(arguments, words):
    with pytest.raises(ValueError, match=words):
        make_task(FREE, **arguments)


def test_a_numerator_and_a_denominator_are_refused_or_fitted():
    known = digital(FilteredPid(8000.0, 2000.0, 5.2, notch=Notch(657.0)), 1 / FREE.control_rate)
    by_numbers = replace(FREE, gains=known)
    with pytest.raises(ValueError, match=r"numerator and denominator, which have no gains to tune; .*--controller"):
        make_task(by_numbers)
    fitted = make_task(by_numbers, controller="pid + notch 600").rig.gains
    assert gain_values(fitted)["notch_frequency"] == pytest.approx(657.0, rel=1e-3)


@pytest.mark.parametrize(
    ("method", "gains", "words"),
    [
        ("rule", StateFeedback(8000.0, 5.2, 0.1), "it chooses kp and kd"),
    ],
)
def test_a_tuner_that_cannot_tune_it_says_so(method, gains, words):
    task = make_task(replace(FREE, gains=gains))
    with pytest.raises(ValueError, match=words):
        make_tuner(method, task, task.draw(np.random.default_rng(0)), 0, 10)


def test_gains_are_named_as_the_command_line_names_them():
    assert parse_tuned([]) == (None, {})
    assert parse_tuned(["kp", "notch_frequency=500:800"]) == (
        ("kp", "notch_frequency"), {"notch_frequency": (500.0, 800.0)},
    )  # fmt: skip
    with pytest.raises(ValueError, match="is not name or name=lo:hi"):
        parse_tuned(["kp=3"])


def test_every_gain_is_documented_as_its_card_has_it():
    for name, card in GAIN_CARDS.items():
        low, high = card.tuned
        ends = f"{low:g} .. {high:g}" + ("" if card.absolute else " times the preset")
        scale = "logarithmic" if 0 < WIDE_RANGE * low <= high else "linear"
        row = f"| `{name}` | {card.unit or '1'} | {ends} | {scale} | {'yes' if card.first else 'if named'} |"
        assert row in DOCS, row


@pytest.mark.slow
def test_a_flat_notch_changes_nothing_and_a_deep_one_does():
    rig = short_rig()
    flat, deep = (with_controller(rig, f"pid + notch {own}").gains for own in ("650 depth=1", "455 depth=0.02 width=2"))
    found = evaluate([protocol_experiment(rig, gains) for gains in (rig.gains, flat, deep)])
    peak = found.margins["peak_sensitivity"]
    # The same controller by two kernels under the same noise: rounding alone may flip a converter's last digit.
    assert peak[1] == pytest.approx(peak[0], rel=1e-3) and found.score[1] == pytest.approx(found.score[0], rel=1e-3)
    assert not peak[2] < 1.2 * peak[0], "a deep, wide notch near the crossover takes its phase"


@pytest.mark.slow
def test_an_environment_acts_on_a_notch():
    env = gymnasium.make("maglev_env:maglev/Rig-v0", rig=short_rig(), controller=TEXT)
    observation, info = env.reset(seed=1)
    assert env.action_space.shape == (6,) and observation.shape == env.observation_space.shape
    assert 455.0 < info["notch_frequency"] < 910.0
    _, _, _, _, info = env.step(np.array([0.0, 0.0, 0.0, -1.0, 1.0, 0.0], np.float32))
    assert (info["notch_frequency"], info["notch_depth"]) == pytest.approx((455.0, 1.0))
