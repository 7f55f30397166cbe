"""A ball under its coil, pushed: what tests of controllers and of unlike axes share."""

from maglev_env.design.default_gains import default_gains
from maglev_env.experiment import Experiment, without_noise
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import Rig


def driven(rig, controller, fundamental=50.0, force=1.0, current=0.1):
    """20 ms periods of force and injection on interleaved lines."""
    excitations = (
        Excitation("sphs", "force", fundamental, tuple(range(1, 20, 2)), force),
        Excitation("sphs", "current", fundamental, (2, 6, 10, 20, 40), current),
    )
    return without_noise(Experiment(rig, controller, excitations, periods=2, transient_periods=0))


SLOW = {"control_rate": 4000.0, "amplifier_time_constant": 5e-4, "sensor_time_constant": 1e-4, "probe_gain": 500.0}
BALL = Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4, bearings=2, **SLOW)


def pushed(rig, share):
    """Force and injection, 100 ms periods, with a peak of a share of the weight or, for a pair, of stiffness x gap."""
    gain, stiffness = linearise(force_law(rig))
    peak = share * (abs(stiffness) * rig.gap if rig.magnet.endswith("pair") else rig.mass * rig.gravity)
    return driven(rig, default_gains(rig), 10.0, peak, 0.05 * peak / gain)
