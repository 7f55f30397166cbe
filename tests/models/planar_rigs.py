"""Rigs of two axes that the tests of kernel, linear loop, controllers and self-sensing share."""

from dataclasses import replace

from maglev_env.experiment import Experiment
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import NO_CONTROLLER, Gains
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig

FREE = replace(load_rig("hmb_free"), axes=2, support_stiffness=500.0, protocol=None)
OTHER_Y = {
    "mass": 0.1,
    "gap": 0.4e-3,
    "turns": 70.0,
    "actuator_gain": 4.5,
    "negative_stiffness": -9e3,
    "support_stiffness": 1000.0,
    "amplifier_time_constant": 5e-5,
    "sensor_time_constant": 3e-5,
    "probe_gain": 7000.0,
}
CROSS = Cross(3000.0, -2000.0, 1.5, -1.0, 0.8, -0.5, 0.1, -0.07)
UNLIKE = replace(FREE, per_axis={"y": OTHER_Y})
COUPLED = replace(UNLIKE, cross=CROSS)
GAINS = (FREE.gains, Gains(9000.0, 1500.0, 6.0, 8e-5, 0.02))
EVERY_EFFECT = {
    **effect("delay", 61.7e-6),
    **effect("amplifier_lag", 3e-5),
    **effect("sensor_lag", 2e-5),
    **effect("actuator_gain", 0.1),
    **effect("negative_stiffness", -0.1),
    **effect("mass", 0.1),
    **effect("sensor_gain", 0.05),
    **effect("damping", 2.0),
    **effect("support_stiffness", 0.1),
}


def oblique(rig, amplitude=1.0, **changes):
    """20 ms periods; force, current and reference each in a direction of its own, none along an axis."""
    excitations = (
        Excitation("sphs", "force", 50.0, tuple(range(1, 20, 2)), amplitude, direction=30.0),
        Excitation("sphs", "current", 50.0, (2, 6, 10, 20, 40), 0.1, direction=-50.0),
        Excitation("multisine", "reference", 50.0, (4, 8, 12), 2e-6, seed=1, direction=160.0),
    )
    gains = GAINS if rig.controlled else NO_CONTROLLER
    e = Experiment(rig, gains, excitations if rig.controlled else excitations[:1])
    return replace(e, periods=2, transient_periods=0, **changes)


def axes_of(record):
    """(channels, 2, samples) of a record."""
    return record.reshape(4, 2, -1)
