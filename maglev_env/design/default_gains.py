"""Gains that levitate a rig, from its linearised force law and its lags."""

from dataclasses import replace

import numpy as np
import scipy

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.gains import Gains
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.rig.rig import Rig

ROBUST = 2.0  # peak sensitivity up to which no other variant is tried
# Variants: net stiffness in units of the magnet's own, damping ratio, derivative time constant in units of 1 / w, and
# its least value in samples. The first is well damped and quiet; the others need less control rate and are noisier.
VARIANTS = ((1.0, 0.7, 0.1, 2.0), (0.7, 0.5, 0.05, 1.0), (0.5, 0.3, 0.0, 0.5), (0.3, 0.3, 0.0, 0.5))
SLOW = 0.005  # radian by which sample and lags turn the mode of a magnet without stiffness
TRIED = 80  # gain sets that a search looks at for a rig that no variant makes robust
INTEGRAL_SHARE = 0.1  # of kp, with ten times the mode's time constant: effective, and harmless to the margins


def default_gains(rig: Rig) -> Gains:
    """PID gains for a controlled one-axis rig that gives none, rounded to three digits.

    The first of VARIANTS is taken whose nominal sampled loop is stable with a peak sensitivity of at most ROBUST. Where
    sampling and lags take nearly as long as the fall there is none, and what compensates the lags of the one with the
    lowest peak is too loud: kp and kd with the lowest peak near it are searched.

    Raises:
        ValueError: The rig has two axes or no magnets, or no variant is stable because the control rate or a lag is too
            slow for the magnet.
    """
    if rig.axes != 1:
        raise ValueError(f"rig {rig.name} has {rig.axes} axes: ask for the gains of one (see axis_rig)")
    if not rig.controlled:
        raise ValueError(f"rig {rig.name} has no magnets: there is nothing to control")
    gain, stiffness = linearise(force_law(rig))
    best, lowest = None, np.inf
    for variant in VARIANTS:
        gains = pole_placed(rig, gain, stiffness, *variant)
        peak = _peak_sensitivity(rig, gains)
        if peak < lowest:
            best, lowest = gains, peak
        if peak <= ROBUST:
            break
    if best is None:
        lag = rig.amplifier_time_constant + rig.sensor_time_constant
        total = rig.support_stiffness + stiffness
        rate = np.sqrt(abs(total) / rig.mass)
        what = "leaves its centre in" if total < 0 else "swings on its support in"
        raise ValueError(
            f"rig {rig.name}: no default gains stabilise it: uncontrolled it {what} {1e3 / rate:.3g} ms, with "
            f"{1e3 / rig.control_rate:.3g} ms between samples and {1e3 * lag:.3g} ms of lags; raise control_rate, "
            "correct gap, bias_current, mass or support, or give [gains]"
        )
    return best if lowest <= ROBUST else _calmest(rig, best)


def _calmest(rig: Rig, start: Gains) -> Gains:
    """The gains with the lowest peak sensitivity around others, by kp and kd; the integral stays their share of kp."""

    def at(factors: np.ndarray) -> Gains:
        kp, kd = np.exp(factors)
        return replace(start, kp=kp * start.kp, ki=kp * start.ki, kd=kd * start.kd)

    found = scipy.optimize.minimize(
        lambda factors: _peak_sensitivity(rig, at(factors)), np.zeros(2), method="Nelder-Mead",
        options={"maxfev": TRIED, "initial_simplex": np.array([[0.0, 0.0], [-0.2, 0.0], [0.0, -0.4]])},
    )  # fmt: skip
    best = at(found.x)
    rounded = (float(f"{value:.3g}") for value in (best.kp, best.ki, best.kd))
    return replace(start, **dict(zip(("kp", "ki", "kd"), rounded, strict=True)))


def pole_placed(
    rig: Rig, gain: float, stiffness: float, net: float, damping_ratio: float, td_share: float, td_samples: float
) -> Gains:
    """Gains for a net stiffness of net |k_n| and a damping ratio; the derivative compensates the lags.

    A support adds to the stiffness, which is not damped further for it. A magnet with next to no stiffness of its own,
    as a voice coil, sets no scale: there a mode that is slow beside the lags does.
    """
    dt = 1 / rig.control_rate
    lag = rig.amplifier_time_constant + rig.sensor_time_constant + dt
    own = net * max(abs(stiffness), rig.mass * (SLOW / lag) ** 2) + max(stiffness, 0.0)
    kp = (own - stiffness) / gain
    mode = np.sqrt((own + rig.support_stiffness) / rig.mass)
    kd = 2 * damping_ratio * np.sqrt(own * rig.mass) / gain + kp * lag
    td, ti = max(td_share / mode, td_samples * dt), max(Gains.ti, 10 / mode)
    return Gains(*(float(f"{value:.3g}") for value in (kp, INTEGRAL_SHARE * kp, kd, td, ti)))


def _peak_sensitivity(rig: Rig, gains: Gains) -> float:
    """Largest |S| of the nominal loop up to half the control rate; inf when it is unstable."""
    experiment = Experiment(rig, gains, ())
    if np.abs(closed_loop_poles(experiment)).max() >= 1:
        return np.inf
    frequency = np.geomspace(1e-5, 0.5, 500) * rig.control_rate
    return float(np.abs(loop_response(experiment, frequency).sensitivity).max())
