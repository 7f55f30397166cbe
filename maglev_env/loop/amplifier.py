"""The amplifier's block: from the command to the coil's current."""

from collections.abc import Callable, Mapping
from math import inf

import numpy as np

from maglev_env.loop import controller, saturation
from maglev_env.loop.card import EffectCard, Parameter, first_order
from maglev_env.loop.controller import ACTING, ARRIVED, U_OLD, U
from maglev_env.loop.magnets.knee import creeping_share, kept_share
from maglev_env.loop.system import System, Values
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "amplifier_lag": EffectCard(
        "amplifier",
        first_order()
        | {
            "feedback": Parameter("", -2.0, 0.95, 0.0, scale=1.0, shape=0.4),
            "lead": Parameter("", 0.0, 1.5, 0.0, scale=1.0, shape=0.5, apart_from=("amplifier_voltage_limit",)),
        },
        "a second amplifier pole 1 / (1 + s T) after the nominal one; with feedback and lead a second-order loop, "
        "(1 + lead s T) / (1 + s (T_0 + (1 - feedback) T) + s^2 T_0 T): a current loop with integral action has a lead "
        "of 1 and a feedback of T_0 / T",
        "command and current",
        ("magnets",),
        form_share=0.0005,  # its fits have a dead time and a feedback
        plain_kernel=("feedback", "lead"),
    ),
    "amplifier_voltage_limit": EffectCard(
        "amplifier",
        {
            "voltage": Parameter("V", 1e-3, 1e5, absent=inf, starts=tuple(np.geomspace(0.1, 20.0, 40))),
            "softness": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=0.3),
        },
        "|L di/dt + R i| <= V: the voltage limits how fast the coil's current can change; i counts from rest, so V is "
        "what is left beside the voltage that holds the bias, or the current that carries a weight, and is the same up "
        "and down; with softness s, a command beyond what the current can follow by x limits is followed by "
        "x / (1 + |x|^(1 / s))^s",
        "command and current at two amplitudes",
        ("coil",),
        flexible=True,
        linear=False,
        form_share=0.08,
        dither="always",
    ),
}


STATES = ("amplifier", "amplifier_lag")


def coil_current(system: System, values: Values, command: np.ndarray) -> np.ndarray:
    """Signal of the coil's current (A): the command (a signal, A) after the amplifier's poles."""
    first, second = values.rig("amplifier_time_constant"), values.effect("amplifier_lag")
    current = system.lags(STATES, (first, second), command)
    both = (first > 0) & (second > 0)
    feedback, lead = (values.effect("amplifier_lag", name) for name in ("feedback", "lead"))
    system.feed_back(STATES, (first, second), feedback)
    if lead.any():
        # The command enters the second pole itself, so that its output stays the current.
        ahead = np.divide(system.step, first, out=np.zeros(len(first)), where=both) * lead
        less = ahead * (1 - feedback) * np.divide(second, first, out=np.zeros(len(first)), where=both)
        system.add(STATES[1], ahead[:, None] * command)
        system.add(STATES[0], -less[:, None] * command)
    return current


# Rows of a lane. X1, X2: outputs of the poles, A. NEXT: coefficients of both outputs at the end of the step; NODES:
# coefficients of three nodal currents that represent the coil's current in the integration step (see
# `maglev_env.kernel.exact`). Each has four, for (x1, x2, old command, new command). OPEN: 1 where the amplifier has no
# pole. The voltage limits the command to the range KEPT x1 +- REACH, with a knee of the sharpness LIMIT_SHARPNESS.
# PER_COMMAND: one over the command that saturates, 1/A; COMMAND_SHARPNESS, COMMAND_FALL: of that knee; ASKED, FLOWS:
# the command at rest, A, and what of it flows.
X1, X2, CURRENT_SQ, NEXT, NODES, OPEN, KEPT, REACH, _SHAPE = rows_after(
    controller.END, "X1 X2 CURRENT_SQ NEXT[8] NODES[12] OPEN KEPT REACH"
)
LIMIT_SHARPNESS, PER_COMMAND, COMMAND_SHARPNESS, COMMAND_FALL, ASKED, FLOWS, END = rows_after(
    _SHAPE, "LIMIT_SHARPNESS PER_COMMAND COMMAND_SHARPNESS COMMAND_FALL ASKED FLOWS"
)
HARD = 100.0  # sharpness that stands for a hard limit


def fill(x: LaneRows, values: Values, h: np.ndarray) -> None:
    """Write the constants of the limits for integration steps of h (s), (n,)."""
    x[LIMIT_SHARPNESS] = 1 / np.maximum(values.effect("amplifier_voltage_limit", "softness"), 1 / HARD)
    x[PER_COMMAND] = 1 / values.effect("saturation", "command")
    x[COMMAND_SHARPNESS], x[COMMAND_FALL] = values.effect("saturation", "sharpness"), saturation.fall(values)
    _, x[FLOWS], x[ASKED] = saturation.at_rest(values)
    first, voltage = values.rig("amplifier_time_constant"), values.effect("amplifier_voltage_limit")
    x[OPEN] = (first == 0) & (values.effect("amplifier_lag") == 0)
    inductance, resistance = values.inductance, values.rig("coil_resistance")
    # The limit is expressed as a command: the one with which the first pole reaches, in one step, the current that the
    # full voltage would reach.
    eased = np.where(resistance > 0, _approached(h, inductance / np.where(resistance > 0, resistance, 1.0)), 0.0)
    slope = np.where(resistance > 0, eased / np.where(resistance > 0, resistance, 1.0), h / inductance)
    per_volt = slope / _approached(h, first)
    limited = np.isfinite(voltage)
    x[REACH] = np.where(limited, np.where(limited, voltage, 0.0) * per_volt, np.inf)
    x[KEPT] = np.where(limited, 1 - resistance * per_volt, 0.0)


def _approached(h: np.ndarray, time_constant: np.ndarray) -> np.ndarray:
    """Share of a step change that a first-order pole has completed after the time h."""
    return -np.expm1(-h / np.where(time_constant > 0, time_constant, 1e-300))


@piece
def saturated_command(x, k, u):
    """What a saturating amplifier makes of a command, beside what flows at rest."""
    whole = u + x[k + ASKED]
    size = abs(whole) * x[k + PER_COMMAND]
    return whole * creeping_share(size, x[k + COMMAND_SHARPNESS], x[k + COMMAND_FALL]) - x[k + FLOWS]


def _allowed(limited: bool, shaped: bool) -> Callable:
    """A piece that gives what the voltage allows of a command, A; arguments as `commands`."""

    @piece
    def allowed(x, k, u):
        if not limited:
            return u
        kept, reach = x[k + KEPT] * x[k + X1], x[k + REACH]
        if shaped:
            u = saturated_command(x, k, u)
            beyond = u - kept
            return kept + beyond * kept_share(abs(beyond) / reach, x[k + LIMIT_SHARPNESS])
        return min(max(u, kept - reach), kept + reach)

    return allowed


def commands(delayed: bool, limited: bool, shaped: bool) -> tuple[Callable, Callable]:
    """Pieces that give the old and the new command of a step, A, clipped to what the voltage allows.

    Args:
        delayed: whether a delay lies between the controller's command and the one that acts.
        limited: whether the voltage is limited.
        shaped: whether the command may saturate, and the limit may be soft.
    """
    acting, allowed = ACTING if delayed else U, _allowed(limited, shaped)

    @piece
    def old(x, k):
        return allowed(x, k, x[k + U_OLD]) if delayed else 0.0

    @piece
    def new(x, k):
        return allowed(x, k, x[k + acting])

    return old, new


def carried(poles: int, delayed: bool, limited: bool, shaped: bool) -> Callable[[int], Callable]:
    """A maker of pieces for linear combinations of the amplifier's states and commands.

    Args:
        poles: number of the amplifier's poles, 0 .. 2.
        delayed: as in `commands`.
        limited, shaped: as in `commands`.

    Returns:
        A function from the offset of four rows of coefficients, for (x1, x2, old command, new command), to the piece
        (x, k, source) that applies those of lane k to the states of lane `source`.
    """
    old, new = commands(delayed, limited, shaped)

    # One piece for all rows: the compiler takes its time for a piece, and hardly any to put the offset into it.
    @piece
    def total(x, k, source, first):
        found = x[k + first + 3 * W] * new(x, source)
        if poles >= 1:
            found = found + x[k + first] * x[source + X1]
        if poles == 2:
            found = found + x[k + first + W] * x[source + X2]
        if delayed:
            found = found + x[k + first + 2 * W] * old(x, source)
        return found

    return lambda first: piece(lambda x, k, source: total(x, k, source, first))


def coil(poles: int, delayed: bool, limited: bool, shaped: bool) -> Callable:
    """A piece that gives the coil's current at the start of a step, A; arguments as `carried`."""
    allowed = _allowed(limited, shaped)

    @piece
    def now(x, k):
        if limited:
            # Without a pole the current is the command itself, within the range that the voltage allows.
            held = x[k + X2]
            return held + x[k + OPEN] * (allowed(x, k, arrived(x, k)) - held)
        if poles == 2:
            return x[k + X2]
        if poles == 1:
            return x[k + X1]
        return arrived(x, k) if delayed else x[k + U]

    return now


@piece
def arrived(x, k):
    """The command that acts at the start of a step, A."""
    new = x[k + ARRIVED]
    return new * x[k + ACTING] + (1.0 - new) * x[k + U_OLD]


def store_current(poles: int) -> Callable:
    """A piece that stores the states of the poles at the end of the step."""

    @piece
    def store(x, k, x1, x2):
        if poles >= 1:
            x[k + X1] = x1
        if poles == 2:
            x[k + X2] = x2
        return 0.0

    return store
