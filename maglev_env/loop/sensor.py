"""The sensor's block: what lies between the rotor's displacement and the reading."""

from collections.abc import Mapping

from maglev_env.loop.card import EffectCard, Parameter, decay, first_order, phase, relative
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY

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
