"""The sensor's block: from the rotor's displacement to the reading."""

from collections.abc import Callable, Mapping

import numpy as np

from maglev_env.loop import actuator
from maglev_env.loop.card import EffectCard, Parameter, decay, first_order, phase, relative
from maglev_env.loop.converters import converter_bits, converter_range
from maglev_env.loop.mechanics import Y
from maglev_env.loop.resonance import RESONANCE_DAMPING, RESONANCE_FREQUENCY, further_mode
from maglev_env.loop.system import System, Values
from maglev_lanes.converter import quantised
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

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
        first_order() | {"feedback": Parameter("", -2.0, 0.95, 0.0, scale=1.0, shape=0.4)},
        "a second probe pole 1 / (1 + s T) after the nominal one, D eq 3.20; with feedback a filter of second order, "
        "1 / (1 + s (T_0 + (1 - feedback) T) + s^2 T_0 T)",
        "force and displacement",
        form_share=0.0015,
        plain_kernel=("feedback",),
    ),
    "sensor_resonance": EffectCard(
        "sensor",
        {
            "frequency": RESONANCE_FREQUENCY,
            "damping_ratio": RESONANCE_DAMPING,
            "coupling": Parameter("", -0.5, 0.5, 0.05, scale=0.02, starts=(0.01,)),
            "support_share": Parameter("", 0.0, 1.0, 1.0, scale=1.0, shape=1.0, needs=("support",)),
            "outside_share": Parameter("", 0.0, 1.0, 0.0, scale=1.0, shape=1.0),
            # On a base that swings, too, the mount moves by the difference of two modes: -1.
            **further_mode(Parameter("", -2.0, 2.0, 0.0, scale=0.2, shape=1.0, added=True)),
        },
        "the probe's mount moves with the bearing's reaction, as a second-order mode (D 7.2); in other forms it feels "
        "a smaller share of what the support's spring and damper make, or also forces from outside: with all of both "
        "it moves as the rotor is accelerated; and there is a further mode, at a multiple of that frequency",
        "force and displacement across the resonance",
        flexible=True,
        resonance=True,
        form_share=0.001,
    ),
    "runout": EffectCard(
        "sensor",
        {"amplitude": Parameter("m", 0.0, 1e-3), "harmonics": decay(), "phase": phase()},
        "the sensed surface is not round: adds to the reading at 1x, 2x and 3x of the speed of rotation",
        "displacement at two speeds",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `estimation.lines.tones`",
    ),
    "pickup": EffectCard(
        "sensor",
        {
            "amplitude": Parameter("m", 0.0, 1e-3),
            "frequency": Parameter("Hz", 0.1, 1e4, 50.0),
            "harmonics": decay(),
            "phase": phase(),
        },
        "the mains couple into the probe's cable: adds to the reading at 50 Hz and its harmonics",
        "displacement at standstill",
        flexible=True,
        not_fitted="a tone: it is found by its frequency, see `estimation.lines.tones`",
    ),
}


MOUNT, PROBE = ("mount", "mount_velocity"), ("probe", "probe_lag")
FURTHER = ("further_mount", "further_mount_velocity")  # of a further mode
STATES = (*MOUNT, *PROBE, *FURTHER)


def reading(
    system: System,
    values: Values,
    displacement: np.ndarray,
    bearing: np.ndarray,
    support: np.ndarray | float = 0.0,
    outside: np.ndarray | float = 0.0,
) -> np.ndarray:
    """The displacement that the probe reads, before its gain, with the motion of its mount.

    Args:
        system: with all of STATES, whose equations are written.
        values: of its lanes.
        displacement: signal of the rotor's displacement, m.
        bearing: signal of the rotor's acceleration by the bearing, m per unit of time squared.
        support: signal of the part of it that the support's spring and damper make.
        outside: signal of the rotor's acceleration by forces from outside.

    Returns:
        Signal of the displacement read, m.
    """
    frequency = values.effect("sensor_resonance")
    coupling = np.where(frequency > 0, values.effect("sensor_resonance", "coupling"), 0.0)
    further, times, damping = (
        values.effect("sensor_resonance", f"further_{key}") for key in ("ratio", "frequency", "damping")
    )
    modes = (
        (MOUNT, frequency, values.effect("sensor_resonance", "damping_ratio"), coupling),
        (FURTHER, times * frequency, damping, coupling * further),
    )
    feels, beside = (values.effect("sensor_resonance", key)[:, None] for key in ("support_share", "outside_share"))
    felt = bearing - (1 - feels) * support + beside * outside
    for (position, velocity), turns, damped, moved in modes:
        if system.without((position, velocity), there := moved != 0):
            continue
        returning = system.oscillator((position, velocity), turns, damped)
        system.put(velocity, returning - moved[:, None] * felt)
        system.there[:, system.at(position, velocity)] = there[:, None]
        displacement = displacement - system.signal(position)
    return probe(system, values, displacement)


def probe(system: System, values: Values, seen: np.ndarray) -> np.ndarray:
    """Signal of the displacement read (m): the displacement seen (a signal, m) after the probe's poles."""
    times = values.rig("sensor_time_constant"), values.effect("sensor_lag")
    read = system.lags(PROBE, times, seen)
    system.feed_back(PROBE, times, values.effect("sensor_lag", "feedback"))
    return read


# Rows of a lane. Z1, Z2: outputs of the probe's poles, m. SEEN: input of the converter, with the other axis' share, m;
# DRAWN: the reading's noise over its rms. CUBIC: coefficients of (z1, z2, y0, v0, y1, v1) for z1 and z2 at the end of
# the step, for a motion that is a cubic in time. BEND, CROSS_BEND: corrections by the currents of this axis and of the
# other one, coefficients of (x1, x2, old command, new command).
Z1, Z2, SEEN, DRAWN, PEAK_SQ, _CONSTANTS = rows_after(actuator.END, "Z1 Z2 SEEN DRAWN PEAK_SQ")
PROBE_COUNTS, COUNT_MAX, PER_COUNT, ROUNDS, NOISE, CROSS_SENSOR, CUBIC, BEND, CROSS_BEND, _MOUNT = rows_after(
    _CONSTANTS, "PROBE_COUNTS COUNT_MAX PER_COUNT ROUNDS NOISE CROSS_SENSOR CUBIC[12] BEND[8] CROSS_BEND[8]"
)
# The probe's mount: MOUNT_Y, MOUNT_V its position and velocity. MOUNT_NEXT: coefficients for both at the end of the
# step, MOUNT_SEEN: for their contribution to z1 and z2, of (position, velocity, change of the mover's position and of
# its velocity by the bearing). MOUNT_BEND, MOUNT_CROSS: as BEND and CROSS_BEND, for the mount. FURTHER_..: the same of
# its further mode; what the bearing adds to z1 and z2 by way of it is in MOUNT_SEEN.
# UNFELT: share of the support's reaction that does not move it. BESIDE: share of the forces from outside that does.
MOUNT_Y, MOUNT_V, MOUNT_NEXT, MOUNT_SEEN, MOUNT_BEND, MOUNT_CROSS, UNFELT, BESIDE, _FURTHER = rows_after(
    _MOUNT, "MOUNT_Y MOUNT_V MOUNT_NEXT[8] MOUNT_SEEN[8] MOUNT_BEND[8] MOUNT_CROSS[8] UNFELT BESIDE"
)
FURTHER_Y, FURTHER_V, FURTHER_NEXT, FURTHER_SEEN, FURTHER_BEND, FURTHER_CROSS, _TONES = rows_after(
    _FURTHER, "FURTHER_Y FURTHER_V FURTHER_NEXT[8] FURTHER_SEEN[4] FURTHER_BEND[8] FURTHER_CROSS[8]"
)
# Two rotating pointers (cosine, sine): the shaft's with the runout's phase and the mains' with the pickup's. TURN:
# their rotation in a step. RUNOUT, PICKUP: amplitudes of three harmonics each.
SHAFT_C, SHAFT_S, MAINS_C, MAINS_S, TURN_C, TURN_S, MAINS_TURN_C, MAINS_TURN_S, RUNOUT, PICKUP, END = rows_after(
    _TONES, "SHAFT_C SHAFT_S MAINS_C MAINS_S TURN_C TURN_S MAINS_TURN_C MAINS_TURN_S RUNOUT[3] PICKUP[3]"
)


def fill(x: LaneRows, values: Values, probe: bool) -> None:
    """Write the constants of the reading.

    Args:
        x: written.
        values: of the lanes.
        probe: false for a gap estimated by self-sensing, which passes no converter.
    """
    bits, gain = converter_bits(values, "adc_bits"), values.rig("probe_gain")
    true_gain = gain * (1 + values.effect("sensor_gain"))
    lsb = np.where(bits > 0, 2 * values.rig("voltage_range") / 2.0**bits, 1.0)
    x[PROBE_COUNTS], x[COUNT_MAX], x[PER_COUNT] = true_gain / lsb, converter_range(values) / lsb, lsb / gain
    if not probe:
        x[PROBE_COUNTS], x[COUNT_MAX], x[PER_COUNT] = true_gain / gain, np.inf, 1.0
    x[ROUNDS], x[NOISE] = (bits > 0) & probe, values.noise


def fill_tones(x: LaneRows, values: Values, h: np.ndarray, axis: int) -> None:
    """Write runout and pickup for steps of h (s), (n,); in y (axis 1) the shaft is a quarter of a turn later."""
    mains = 2 * np.pi * values.effect("pickup", "frequency")
    x[TURN_C], x[TURN_S] = np.cos(values.speed * h), np.sin(values.speed * h)
    x[MAINS_TURN_C], x[MAINS_TURN_S] = np.cos(mains * h), np.sin(mains * h)
    begun, phase = values.effect("runout", "phase") - axis * np.pi / 2, values.effect("pickup", "phase")
    x[SHAFT_C], x[SHAFT_S], x[MAINS_C], x[MAINS_S] = np.cos(begun), np.sin(begun), np.cos(phase), np.sin(phase)
    for name, first in (("runout", RUNOUT), ("pickup", PICKUP)):
        x[first] = values.effect(name) * values.effect(name, "harmonics") ** np.arange(3)[:, None]


def seen(poles: int) -> int:
    """The row that the probe's converter reads, for a number of probe poles."""
    return (Y, Z1, Z2)[poles]


@piece
def shown(x, k, sensed):
    """The sensed displacement (m) after the converter has rounded and limited it."""
    top = x[k + COUNT_MAX]
    return quantised(sensed * x[k + PROBE_COUNTS], -top, top, x[k + ROUNDS]) * x[k + PER_COUNT]


@piece
def cross_seen(x, k, own, other):
    """The sensed displacement (m) with the other axis' share."""
    return own + x[k + CROSS_SENSOR] * other


@piece
def z1_next(x, k, y, v, y1, v1):
    """First probe state at the end of the step, exact for the cubic through the motion at both ends of the step."""
    q = k + CUBIC
    own = x[q] * x[k + Z1] + x[q + W] * x[k + Z2]
    return own + x[q + 2 * W] * y + x[q + 3 * W] * v + x[q + 4 * W] * y1 + x[q + 5 * W] * v1


@piece
def z2_next(x, k, y, v, y1, v1):
    """Second probe state at the end of the step, likewise."""
    q = k + CUBIC + 6 * W
    own = x[q] * x[k + Z1] + x[q + W] * x[k + Z2]
    return own + x[q + 2 * W] * y + x[q + 3 * W] * v + x[q + 4 * W] * y1 + x[q + 5 * W] * v1


def by_mount(first: int, state: int = MOUNT_Y) -> Callable:
    """A piece that gives the mount's contribution to a value; its four coefficients are in the rows from `first`.

    The arguments `moved` and `pushed` are the mover's change of position and of velocity by the bearing. Position and
    velocity are those in the rows from `state`: of the mount, or of its further mode.
    """

    @piece
    def total(x, k, moved, pushed):
        q = k + first
        return x[q] * x[k + state] + x[q + W] * x[k + state + W] + x[q + 2 * W] * moved + x[q + 3 * W] * pushed

    return total


def store_reading(poles: int) -> Callable:
    """A piece that stores the probe's states at the end of the step."""

    @piece
    def store(x, k, z1, z2):
        if poles >= 1:
            x[k + Z1] = z1
        if poles == 2:
            x[k + Z2] = z2
        return 0.0

    return store


def seen_of_further_mode(first: int) -> Callable:
    """A piece for what the further mode itself contributes to a value."""

    @piece
    def total(x, k):
        return x[k + first] * x[k + FURTHER_Y] + x[k + first + W] * x[k + FURTHER_V]

    return total


@piece
def felt_too(x, k, slowed, outside):
    """What the mount feels beside the bearing: less of the deceleration by the support, more of forces from outside."""
    return x[k + UNFELT] * slowed + x[k + BESIDE] * outside


def store_mount(state: int = MOUNT_Y) -> Callable:
    """A piece that stores position and velocity in the rows from `state`."""

    @piece
    def store(x, k, mount, mount_v):
        x[k + state], x[k + state + W] = mount, mount_v
        return 0.0

    return store


@piece
def harmonics(x, first, c):
    """Sum of three harmonics of an angle with cosine c; their amplitudes are in three rows from `first`."""
    square = c * c
    total = x[first] * c + x[first + W] * (2.0 * square - 1.0)
    return total + x[first + 2 * W] * (c * (4.0 * square - 3.0))


@piece
def tone(x, k):
    """Contribution of runout and pickup to the reading, m."""
    return harmonics(x, k + RUNOUT, x[k + SHAFT_C]) + harmonics(x, k + PICKUP, x[k + MAINS_C])


@piece
def turned(c, s, turn_c, turn_s):
    """Cosine and sine of an angle and its turn together."""
    return c * turn_c - s * turn_s, s * turn_c + c * turn_s


@piece
def turn_pointers(x, k):
    """Rotate the pointers of shaft and mains to the end of the step."""
    x[k + SHAFT_C], x[k + SHAFT_S] = turned(x[k + SHAFT_C], x[k + SHAFT_S], x[k + TURN_C], x[k + TURN_S])
    x[k + MAINS_C], x[k + MAINS_S] = turned(x[k + MAINS_C], x[k + MAINS_S], x[k + MAINS_TURN_C], x[k + MAINS_TURN_S])
    return 0.0
