"""Effects, each alone and all together, that the tests of linear loop and kernel share."""

from dataclasses import replace

from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.rig.rig_file import load_rig

FREE = replace(load_rig("hmb_free"), support_stiffness=500.0, support_damping=3.0, protocol=None)
CROSS = Cross(3000.0, -2000.0, 1.5, -1.0, 0.8, -0.5, 0.1, -0.07)
OTHER_Y = {"mass": 0.1, "actuator_gain": 4.5, "negative_stiffness": -9e3, "amplifier_time_constant": 5e-5}
COUPLED = replace(FREE, axes=2, per_axis={"y": OTHER_Y}, cross=CROSS)
SECOND_BODY = effect("support_resonance", 300.0, damping_ratio=0.03, mass_ratio=0.2)
MOUNT = effect("sensor_resonance", 180.0, damping_ratio=0.04, coupling=0.3)
EACH = {
    "nominal": {},
    "eddy_current": effect("eddy_current", 400.0, order=0.6),
    "hysteresis": effect("hysteresis", 0.2),
    "friction": effect("friction", 0.02, velocity=2e-3),
    "friction that sticks": effect("friction", 0.02, velocity=1e-4, presliding=2e-6),
    "support_resonance": SECOND_BODY,
    "sensor_resonance": MOUNT,
    "a mount the other way": effect("sensor_resonance", 700.0, coupling=-0.2),
    "saturation": effect("saturation", 0.9),
    "eccentricity": effect("eccentricity", 1e-4),
}
ALL = {
    **{name: value for effects in EACH.values() for name, value in effects.items()},
    **MOUNT,
    **effect("amplifier_lag", 3e-5),
    **effect("sensor_lag", 2e-5),
    **effect("actuator_gain", 0.1),
    **effect("negative_stiffness", -0.1),
    **effect("mass", 0.1),
    **effect("sensor_gain", 0.05),
    **effect("damping", 2.0),
    **effect("support_stiffness", 0.1),
}
