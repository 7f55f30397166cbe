"""Nominal loops that are not stable, although the recorded ones held the rotor."""

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.linear.poles import closed_loop_poles

GROWS = 1e-6  # per control sample: slower growth is that of an integrator or of rounding


def not_stable(e: Experiment) -> str:
    """What is wrong with the linear loop of an experiment, in words; empty where it is stable."""
    poles = closed_loop_poles(e)
    worst = poles[np.argmax(abs(poles))]
    if abs(worst) <= 1 + GROWS:
        return ""
    rate = e.rig.control_rate
    at = abs(float(np.angle(worst))) / (2 * np.pi) * rate
    time = 1 / (np.log(abs(worst)) * rate)
    how = f"at {at:.3g} Hz" if at > 0 else "without a swing"
    return (
        f"the nominal rig under the stated controller is not stable (pole {worst.real:.4g}"
        + (f"{worst.imag:+.4g}j" if at > 0 else "")
        + f" of the unit circle: it grows {how}, e-fold in {time:.3g} s): one of gains, their sign, the delays and "
        "lags of the loop, gain and stiffness of the magnet is stated wrong"
    )
