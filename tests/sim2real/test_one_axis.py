"""One axis of two by itself: what is read of it, and what is said of what acts along it alone."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.loop.gains import Gains
from maglev_env.recordings.campaign import Campaign, RecordingSpec
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point
from sim2real.gap.locate import Where
from sim2real.gap.shrink import Gap, Words
from sim2real.judgement.judge import Entry
from sim2real.one_axis import along_one_axis, of_one_axis
from sim2real.report import sentence
from sim2real.result import Diagnosis

RIG = load_rig("hmb_radial")
X, Y = Gains(kp=1e4, ki=0.0, kd=10.0), Gains(kp=2e4, ki=0.0, kd=10.0)
WORDS = dict.fromkeys(("measured", "before", "after"), Words(np.nan, np.nan, np.nan))
GAP = Gap(6.0, 2.0, 1.1, 1.0, 0.98, (0.9, 1.0), "holdout", WORDS, {})
FORCE = Excitation("multisine", "force", 4.0, (1, 3), 2.0)


def spec(name, *directions, role="fit"):
    channels = {
        f"{name}_{a}": ChannelSource((f"{name}_{a}",), (1.0,)) for name in ("displacement", "current") for a in "xy"
    }
    channels["time"] = ChannelSource(("time",), (1.0,))
    drives = tuple(replace(FORCE, direction=d) for d in directions)
    return RecordingSpec(name, role, RIG.control_rate, 0, None, None, 0.0, (X, Y), drives, channels)


def campaign(*specs):
    return Campaign("folder", replace(RIG, per_axis={"y": {"amplifier_time_constant": 3e-4}}), RIG.mass, specs)


def test_an_axis_has_its_own_channels_controller_drive_and_parameters():
    own = of_one_axis(campaign(spec("both", 60.0), spec("x", 0.0), spec("holdout", 90.0, role="holdout")), 1)
    assert [s.name for s in own.recordings] == ["both", "holdout"]  # nothing drives y in the second one
    assert own.rig.axes == 1 and own.rig.name == "hmb_radial-y" and own.rig.amplifier_time_constant == 3e-4
    both = own.recordings[0]
    assert set(both.channels) == {"displacement", "current", "time"} and both.channels["current"].columns == (
        "current_y",
    )
    assert both.gains == Y and both.excitations[0].amplitude == pytest.approx(2.0 * 0.75**0.5)
    assert both.excitations[0].direction == 0.0
    assert of_one_axis(campaign(spec("x", 0.0)), 1) is None
    assert [s.name for s in of_one_axis(campaign(spec("logged")), 1).recordings] == ["logged"]  # by what was recorded


def diagnosis(own, verdict):
    where = Where({"actuator": 1.0}, (), {"linear": 1.0}, True, None)
    cause = {"explained": ("saturation",), "no_gap": (), "unexplained": ("unknown",)}[verdict]
    which = (Entry(cause or ("none",), 0.9, 0.0, None, None),)
    return Diagnosis(verdict, cause, where, which, (), None, GAP, Point({}, {}), own, None, None, None, 1.0, ("own",))


def asked(x, y, shares=(0.2, 0.8)):
    """What comes of diagnoses of x and y alone that end in these verdicts, and the axes in the order of asking."""
    order = []

    def diagnosed(own):
        axis = own.rig.name[-1]
        order.append(axis)
        verdict = {"x": x, "y": y}[axis]
        if verdict == "falls":
            raise ValueError("no hypothesis levitates")
        return diagnosis(own, verdict)

    found = along_one_axis(campaign(spec("both", 45.0)), dict(zip("xy", shares, strict=True)), diagnosed)
    return found, "".join(order)


def test_what_acts_along_one_axis_is_named_there_and_the_other_one_is_said():
    found, order = asked("no_gap", "explained")
    assert order == "yx" and found.axis == "y" and found.cause == ("saturation",)
    assert found.where.axes == {"x": 0.0, "y": 1.0}
    assert found.notes[0].startswith("along x alone: There is no gap") and found.notes[1:] == ("own",)
    assert sentence(found).startswith(
        "No known effect of both axes explains the gap; along y alone, the gap is explained"
    )
    assert found.to_json()["axis"] == "y" and diagnosis(campaign(), "no_gap").to_json()["axis"] is None


def test_both_axes_may_have_a_gap_with_a_name_and_the_larger_one_comes_first():
    found, _ = asked("explained", "explained", shares=(0.7, 0.3))
    assert found.axis == "x" and found.notes[0].startswith("along y alone: The gap is explained by saturation")


@pytest.mark.parametrize(
    ("x", "y", "order"),
    [
        ("no_gap", "unexplained", "y"),  # and the other axis is not asked any more
        ("unexplained", "explained", "yx"),
        ("no_gap", "no_gap", "yx"),  # what is off lies between them
        ("explained", "falls", "y"),
    ],
)
def test_an_axis_that_has_no_name_for_its_gap_leaves_it_unknown(x, y, order):
    assert asked(x, y) == (None, order)
