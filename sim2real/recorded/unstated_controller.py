"""Was a controller at work in a recording that states none?

A rotor on springs stands without one, so that a recording without a controller is taken for one of the open loop. But
there the current is what the amplifier makes of the injection, and does not answer a force or a motion.
"""

from collections.abc import Mapping

import numpy as np
import scipy.signal

from maglev_env.rig.rig import Rig

ANSWERS = 0.1  # share of the current's variance that is no answer to the injection, from which on a controller made it
TAPS = 4  # samples of the injection behind the nominal amplifier, of which an amplifier that is another makes a current


def unstated_controller(rig: Rig, channels: Mapping[str, np.ndarray], sample_rate: float) -> bool:
    """Whether a controller that is not stated was at work.

    Args:
        rig: The nominal rig.
        channels: Channel -> (axes, samples).
        sample_rate: Hz.
    """
    if not rig.controlled or "current" not in channels:
        return False
    current = channels["current"]
    injection = channels.get("injection", np.zeros_like(current))
    return any(_left(rig, *pair, sample_rate) > ANSWERS for pair in zip(current, injection, strict=True))


def _left(rig: Rig, current: np.ndarray, injection: np.ndarray, sample_rate: float) -> float:
    """Share of a current's variance that does not follow from the injection, both (samples,); 0 of noise alone."""
    moving = current - current.mean()
    if np.std(moving) < 3 * rig.noise.current or not np.any(moving):
        return 0.0
    decay = np.exp(-1 / (sample_rate * rig.amplifier_time_constant)) if rig.amplifier_time_constant else 0.0
    made = scipy.signal.lfilter([1 - decay], [1, -decay], injection - injection.mean())
    columns = np.stack([np.roll(made, k) for k in range(TAPS)], axis=1)[TAPS:]
    rest = moving[TAPS:] - columns @ np.linalg.lstsq(columns, moving[TAPS:], rcond=None)[0]
    return float(rest.var() / moving.var())
