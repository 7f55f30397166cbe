"""Parameters at which an effect is no longer what its name says.

A fit takes up what it lacks in any way that it can. A cause that no name describes is then found under one, at values
that no bench has: a support that drives the rotor instead of damping it, a mode so strongly damped that it has no
resonance or far above all that was driven, two modes of which one takes back what the other does, a stop that touches
wherever the rotor is, iron that saturates far above every field, a zero of the current that is off by nearly all of the
bias, a pull that is infinite well before the rotor touches its magnet, or a lag that is a delay.
"""

from collections.abc import Collection, Mapping

import numpy as np

from maglev_env.loop.effect import EFFECTS
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.rig.rig import Rig
from sim2real.compared.point import Point
from sim2real.search.fit import Fit
from sim2real.search.hypotheses import NO_RESONANCE, REPLACED, RESONANCES, Coordinate, added_lag, dead_part

STOP, NEARLY = "soft_stop", 1.01  # times the least distance of a stop at which a fit of it has ended there
# Share of the field at which iron saturates that the fields in the gaps must reach. Below it a knee of any sharpness
# bends nothing: what it does is that of a smaller force constant, which has a name of its own.
KNEE, REACHED = "saturation", 0.1
OF_BIAS = 0.8  # share of the bias current, or of its range, by which the zero of a current is off at most
LAW, LAW_OFFSET = "force_law", "offset"
LAG, DEAD = "amplifier_lag", 0.5  # share of what a lag adds from which on it is the dead time in it: a delay


def meaningless_cost(fit: Fit, rig: Rig, motion: float, current: float) -> float:
    """Cost of parameters that contradict the meaning of their effect; inf where the effect is none there.

    Args:
        fit: A fitted hypothesis.
        rig: The nominal rig.
        motion: Largest displacement from the mean in any recording, m.
        current: Largest control current in any recording, A.
    """
    point = fit.hypothesis.point(fit.u)
    modes = [point.effects[name] for name in fit.hypothesis.effects if name in RESONANCES]
    if any(mode["damping_ratio"] >= NO_RESONANCE or _cancels(mode) for mode in modes):
        return np.inf
    least = NEARLY * EFFECTS[STOP].parameters["distance"].of_motion * motion
    if STOP in fit.hypothesis.effects and point.effects[STOP]["distance"] < least:
        return np.inf
    own = zip(fit.hypothesis.coordinates, fit.u, strict=False)
    if any(_beyond(c, float(u)) for c, u in own):
        return np.inf
    if LAG in fit.hypothesis.effects and _is_delay(rig, point, fit.hypothesis.effects):
        return np.inf
    if KNEE in point.effects and _never_bends(rig, point.effects[KNEE], motion, current):
        return np.inf
    return _driving_cost(fit, rig)


def _beyond(c: Coordinate, u: float) -> bool:
    """Whether an effect has no meaning where this coordinate is.

    A zero is then off by nearly all of the bias, a law of force has its pole where the rotor still moves freely, or a
    mode is so far from all that was driven that it shows its static part alone, which many causes have.
    """
    if (c.effect, c.parameter) == (LAW, LAW_OFFSET):
        return c.value(u) < 0 and c.at_bound(u)
    if EFFECTS[c.effect].parameters[c.parameter].within_bias:
        return abs(c.value(u)) > OF_BIAS * c.high
    return c.effect in RESONANCES and c.parameter == "frequency" and c.at_bound(u)


def _cancels(mode: Mapping[str, float]) -> bool:
    """Whether a further mode has the opposite sign of the first one and lies within its width: the difference of two
    such modes is slow and does not ring, as creep."""
    if mode.get("further_ratio", 0.0) >= 0:
        return False
    times = mode["further_frequency"]
    return abs(times - 1) < mode["damping_ratio"] + times * mode["further_damping"]


def _is_delay(rig: Rig, point: Point, causes: Collection[str]) -> bool:
    """Whether most of the time by which the amplifier lags more than stated is dead time, of which alone it would be
    another name of a delay."""
    stated = REPLACED[LAG]
    whole = added_lag(point.effects, LAG, causes, rig.effects) + getattr(rig, stated) * point.changes.get(stated, 0.0)
    return dead_part(point.effects, LAG, causes, rig.effects) > DEAD * max(whole, 0.0)


def _never_bends(rig: Rig, knee: Mapping[str, float], motion: float, current: float) -> bool:
    """Whether no field in the gaps of a pair comes near the one (T) at which the iron saturates, of an effect without a
    knee in the currents."""
    field, *currents = (knee.get(key, np.inf) for key in ("field", "current", "command"))
    if not np.isfinite(field) or np.isfinite(currents).any():
        return False
    law = force_law(rig)
    nearest = max(law.gap - motion, 0.0)
    most = law.magnet_flux / (nearest + law.magnet_gap) if law.magnet_flux else 0.0
    most += law.coil_flux * (law.bias_current + law.gain_scale * current) / max(nearest + law.coil_gap, 1e-300)
    return bool(most < REACHED * field)


def _driving_cost(fit: Fit, rig: Rig) -> float:
    """What a fit whose support drives the rotor would lose with a support that does not damp at all, to second order.

    A support without a source of energy has no negative damping.
    """
    at = [i for i, c in enumerate(fit.hypothesis.coordinates) if c.effect == "damping"]
    if not at or fit.jacobian is None:
        return 0.0
    c = fit.hypothesis.coordinates[at[0]]
    total = rig.support_damping + c.value(float(fit.u[at[0]]))
    if total >= 0 or not c.scale:
        return 0.0
    return float((total / c.scale) ** 2 / fit.covariance()[at[0], at[0]])
