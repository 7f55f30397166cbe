"""The sensor's block: what lies between the rotor's displacement and the reading."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop.card import EffectCard, Parameter, decay, first_order, phase, relative
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY
from maglev_env.loop.system import System, Values

EFFECTS: Mapping[str, EffectCard] = {
    "sensor_gain": EffectCard(
        "sensor",
        relative((-0.2, -0.05, 0.05, 0.3)),
        "relative change of the true probe gain against its data sheet",
        "current, force and displacement",
        nominal="probe_gain",
    ),
    "sensor_lag": EffectCard(
        "sensor",
        first_order(),
        "a second probe pole 1 / (1 + s T), D eq 3.20",
        "force and displacement",
        form_share=0.005,
    ),
    "sensor_resonance": EffectCard(
        "sensor",
        {
            "frequency": RESONANCE_FREQUENCY,
            "damping_ratio": RESONANCE_DAMPING,
            "coupling": Parameter("", -0.5, 0.5, 0.05, scale=0.02, starts=(0.01,)),
        },
        "the probe's mount moves with the bearing's reaction, as a second-order mode (D 7.2)",
        "force and displacement across the resonance",
        flexible=True,
        resonance=True,
    ),
    "runout": EffectCard(
        "sensor",
        {"amplitude": Parameter("m", 0.0, 1e-3), "harmonics": decay(), "phase": phase()},
        "the sensed surface is not round: a reading at 1x, 2x and 3x of the speed",
        "displacement at two speeds",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `sim2real.tones`",
    ),
    "pickup": EffectCard(
        "sensor",
        {
            "amplitude": Parameter("m", 0.0, 1e-3),
            "frequency": Parameter("Hz", 0.1, 1e4, 50.0),
            "harmonics": decay(),
            "phase": phase(),
        },
        "mains in the probe's cable: a reading at 50 Hz and its harmonics",
        "displacement at standstill",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `sim2real.tones`",
    ),
}


MOUNT, PROBE = ("mount", "mount_velocity"), ("probe", "probe_lag")
STATES = (*MOUNT, *PROBE)


def reading(system: System, values: Values, displacement: np.ndarray, bearing: np.ndarray) -> np.ndarray:
    """What the probe reads, before its gain, as its mount moves.

    Args:
        system: with all of STATES.
        values: of its lanes.
        displacement: of the rotor, m.
        bearing: acceleration of the rotor by the bearing, m per unit of time squared.

    Returns:
        The displacement read, m.
    """
    frequency = values.effect("sensor_resonance")
    coupling = np.where(frequency > 0, values.effect("sensor_resonance", "coupling"), 0.0)
    if system.without(MOUNT, there := coupling != 0):
        return probe(system, values, displacement)
    returning = system.oscillator(MOUNT, frequency, values.effect("sensor_resonance", "damping_ratio"))
    position, velocity = MOUNT
    system.put(velocity, returning - coupling[:, None] * bearing)
    system.there[:, system.at(*MOUNT)] = there[:, None]
    return probe(system, values, displacement - system.signal(position))


def probe(system: System, values: Values, seen: np.ndarray) -> np.ndarray:
    """The probe's poles: from the displacement that it sees to the one that it reads, both signals in m."""
    return system.lags(PROBE, (values.rig("sensor_time_constant"), values.effect("sensor_lag")), seen)
