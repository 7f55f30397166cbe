"""What one axis states for itself counts for it: in what drives it, in its tolerances, in what is not told."""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.campaign import RecordingSpec
from maglev_env.recordings.campaign_tables import ChannelSource
from maglev_env.rig.drawn import scaled_rig
from maglev_env.rig.rig import axis_rig
from maglev_env.rig.rig_file import load_rig
from sim2real.compared.point import Point, experiment_at
from sim2real.compared.tolerance_forms import OF, form_nuisances
from sim2real.recorded.drive.drive import drive_of
from sim2real.recorded.open_reading import _untold

RIG = replace(load_rig("hmb_radial"), per_axis={"x": {"amplifier_time_constant": 2e-4}, "y": {"voltage_range": 5.0}})
READ = ChannelSource(("a",), (1.0,))


def spec(**channels: ChannelSource) -> RecordingSpec:
    return RecordingSpec("run.csv", "fit", RIG.control_rate, 0, None, None, 0.0, None, (), channels)


def channels() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    return {"displacement": 1e-6 * rng.normal(size=(2, 4000)), "current": 0.1 * rng.normal(size=(2, 4000))}


def test_a_measured_current_passes_no_amplifier_of_either_axis():
    rig = drive_of(RIG, spec(), channels(), known=False).experiment.rig
    for axis in range(2):
        assert axis_rig(rig, axis).amplifier_time_constant == 0.0
        assert axis_rig(rig, axis).voltage_range > 100 * RIG.voltage_range


def test_a_tolerance_changes_what_an_axis_states_for_itself():
    e = experiment_at(Experiment(RIG, NO_CONTROLLER, ()), Point({}, {"amplifier_time_constant": 0.5}))
    found = [axis_rig(e.rig, axis).amplifier_time_constant for axis in range(2)]
    assert found == pytest.approx([3e-4, 1.5 * RIG.amplifier_time_constant])


@pytest.mark.parametrize("stated", ["x", "y"])
def test_what_one_axis_states_is_not_known_of_the_other(stated):
    known = replace(READ, delay_tolerance=1e-6, scale_tolerance=0.01)
    one = spec(**{f"current_{axis}": known if axis == stated else READ for axis in "xy"})
    drive = drive_of(RIG, one, channels(), known=False)
    other = 1 if stated == "x" else 0
    errors = [e for e in _untold(one, drive, False, None) if e.delay or e.scale]
    assert {e.axis for e in errors} == {other} and len(errors) == 2


def test_whole_numbers_of_an_axis_stay_whole():
    rig = scaled_rig(replace(RIG, per_axis={"y": {"bearings": 2, "amplifier_time_constant": 2e-4}}), {"mass": 1.1})
    assert rig.per_axis["y"] == {"bearings": 2, "amplifier_time_constant": 2e-4} and rig.mass == 1.1 * RIG.mass


def test_the_magnets_of_each_axis_have_a_form_of_their_own():
    """One form for both cannot hold two amplifiers that are off in opposite senses."""
    rig = replace(load_rig("hmb_radial"), tolerance={"actuator_gain": 0.03, "negative_stiffness": 0.04})
    e, rng = Experiment(rig, NO_CONTROLLER, ()), np.random.default_rng(1)
    both = {}

    def predicted(points):
        drawn = rng.standard_normal((len(points), 2, 2, 5))
        names = [OF + "actuator_gain", OF + "negative_stiffness"]
        both.update(zip(names, drawn[1::2] - drawn[::2], strict=True))
        return drawn

    found = form_nuisances(e, Point({}, {}), predicted, True, True)
    assert set(found) == {f"{name} along {axis}" for name in both for axis in "xy"}
    for name, change in both.items():
        along = [found[f"{name} along {axis}"] for axis in "xy"]
        for i, own in enumerate(along):
            assert not own[:, 1 - i].any()
            assert np.allclose(own[:, i] / change[:, i], (own[:, i] / change[:, i]).flat[0])
