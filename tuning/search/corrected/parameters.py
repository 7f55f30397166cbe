"""The parameters of a rig that its linear loop shows, with their priors: what a fit may move."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.loop.axes import AXES
from maglev_env.loop.effect import EFFECTS, effect, effect_value
from maglev_env.rig.drawn import TANGENT, scaled_rig, tangent
from maglev_env.rig.rig import Rig, with_parameters
from maglev_env.task.episodes import log_spread, wide_factors

LAGS = {"delay": "time", "sensor_lag": "time_constant"}  # effects whose time is fitted, in control samples
DELAY_SPREAD, MOST_DELAY = 2.0, 20.0  # control samples: prior standard deviation of a lag, and largest value
TANGENT_SPREAD = 0.1  # prior standard deviation of a tangent that nothing is stated of
FACTORS = 4.0  # largest factor by which a parameter may differ from the nominal one


class Parameters:
    """Names of a rig's parameters, the delay last, with centre and standard deviation of each prior.

    Attributes:
        rig: The nominal rig, its magnets by their tangent.
        names: Names (p,).
        centre: (p,): 0, the logarithm of parameter over nominal; of the delay its control samples.
        spread: Prior standard deviations (p,).
    """

    def __init__(self, rig: Rig, wide: bool) -> None:
        """Set up.

        Args:
            rig: The nominal rig.
            wide: Whether parameters may lie anywhere in the rig's [randomization]; otherwise within its [tolerance].
        """
        self.rig = _by_tangent(rig)
        ends = {n: e for n, e in wide_factors(rig).items() if getattr(rig, n) is not None or n in TANGENT}
        drawn = {n: log_spread(e) for n, e in ends.items()} if wide else {}
        ranges: Mapping[str, float] = {**rig.tolerance, **drawn}
        frequency = np.geomspace(1e-4, 0.2, 12) * rig.control_rate
        names = [n for n in ranges if getattr(self.rig, n) and seen_in_loop(self.rig, n, frequency)]
        # Of magnets that are described by their geometry the tangent is fitted, as far as what is drawn may move it.
        spread = max((s for n, s in ranges.items() if n not in names), default=TANGENT_SPREAD)
        ranges = {**dict.fromkeys(TANGENT, spread), **ranges}
        names = [n for n in ranges if n in names or (n in TANGENT and getattr(self.rig, n))]
        self.names = (*names, "delay")
        self.spread = np.array([*(ranges[n] for n in names), DELAY_SPREAD])
        self.centre = np.array([0.0] * len(names) + [effect_value(rig.effects, "delay") * rig.control_rate])
        self.low = np.array([-np.log(FACTORS)] * len(names) + [0.0])
        self.high = np.array([np.log(FACTORS)] * len(names) + [most_lag(rig, "delay")])

    def rig_at(self, theta: np.ndarray) -> Rig:
        """The rig at parameters theta (p,), which are clipped to their bounds; it has the delay as an effect."""
        theta = np.clip(theta, self.low, self.high)
        return fitted_rig(self.rig, self.names, theta)


def most_lag(rig: Rig, name: str) -> float:
    """Largest time of one of LAGS in control samples, within the bounds of the effect."""
    bound = EFFECTS[name].parameters[LAGS[name]].on(rig.scales).high
    return min(MOST_DELAY, 0.999 * bound * rig.control_rate)


def seen_in_loop(rig: Rig, name: str, frequency: np.ndarray) -> bool:
    """Whether the linearised loop depends on a parameter; it does not on a converter's resolution, for example."""
    one, other = (loop_response(Experiment(r, rig.gains, ()), frequency) for r in (rig, scaled_rig(rig, {name: 1.01})))
    return not (np.allclose(one.plant, other.plant, 1e-9, 0) and np.allclose(one.receptance, other.receptance, 1e-9, 0))


def fitted_rig(nominal: Rig, names: Sequence[str], theta: np.ndarray) -> Rig:
    """The rig at theta (p,).

    Of LAGS theta is the control samples; of parameters of the rig or of its effects ("effect.parameter") the logarithm
    over the nominal value.
    """
    values = dict(zip(names, map(float, theta), strict=True))
    effects = {name: dict(own) for name, own in nominal.effects.items()}
    for name in LAGS:
        if name in values:
            effects |= effect(name, values.pop(name) / nominal.control_rate)
    factors = {name: float(np.exp(v)) for name, v in values.items()}
    for name in [n for n in factors if "." in n]:
        own, _, parameter = name.partition(".")
        bound = EFFECTS[own].parameters[parameter].on(nominal.scales)
        effects[own][parameter] = float(np.clip(effects[own][parameter] * factors.pop(name), bound.low, bound.high))
    return replace(scaled_rig(nominal, factors), effects=effects)


def _by_tangent(rig: Rig) -> Rig:
    """A rig whose magnets are given by their tangent, those of an axis with values of its own by their own one."""
    found = with_parameters(rig, tangent(rig))
    own = {name: {**values, **tangent(rig.by_axis[AXES.index(name)])} for name, values in rig.per_axis.items()}
    return replace(found, per_axis=own)
