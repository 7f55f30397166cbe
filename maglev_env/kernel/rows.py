"""Rows of one axis in the lane kernel's block: state, constants, exact linear chains, controller."""

from maglev_env.kernel.effect_rows import effect_rows
from selfsense.kernel_rows import LANES as LANES

# State. U: the command; ACTING and U_OLD: what acts from now on and what acted before, where a delay lies between.
Y, V, Z1, Z2, X1, X2, D, XI, ALIVE, STEPS, U, ACTING, U_OLD, PEAK_SQ, CURRENT_SQ, ERROR, RAW, SENSED = range(18)
# Constants of the converters and the PID, of the magnets, and of the mechanics.
PROBE_COUNTS, COUNT_MAX, PER_COUNT, KP, KD, KI, PER_U_COUNT, U_COUNT_MAX, U_COUNT, DECAY_D, DECAY_I = range(18, 29)
NOISE, GAP2, GAPM2, GAP, GAPM, FLUX_M, FLUX_C, BIAS, CALIBRATION, WEIGHT, EXPONENT = range(29, 40)
KNEE = EXPONENT  # of a pair, which has no exponent: what saturates its fields
KS, CS, PER_MASS, LIMIT_SQ, DELAY_STEPS = range(40, 45)
# What the other axis adds: stiffness, damping, force per nodal current, and share of its motion in this probe.
CROSS_K, CROSS_C, CROSS_GAIN, CROSS_SENSOR = range(45, 49)
# Exact linear chains, once per substep: sensor (2 states from z1 z2 y0 v0 y1 v1, the motion taken as a cubic), what the
# current adds to that cubic (2 states from x1 x2 old new), actuator (5 outputs from x1 x2 old new), whether the new
# command acts already when the substep begins, and what the other axis' current adds to the cubic.
SENSOR, SENSOR_CURRENT, ACTUATOR, ARRIVED, CROSS_CURRENT = 49, 61, 69, 89, 90
CHAIN_ROWS = 49
ROWS = 98


def filter_row(substeps: int) -> int:
    """First row of a linear controller: b0, then (b, a, state) for each power of 1 / z."""
    return ROWS + (substeps - 1) * CHAIN_ROWS


def axis_rows(substeps: int, controller_order: int, flexible: bool = False) -> int:
    """Rows of one axis; the three behind the last state stay zero, so that every state has a next one."""
    nominal = effect_row(substeps, controller_order)
    return nominal + (effect_rows(substeps) if flexible else 0)


def effect_row(substeps: int, controller_order: int) -> int:
    """Where the rows of a flexible axis' effects begin, behind all others."""
    return filter_row(substeps) + (3 * controller_order + 4 if controller_order else 0)
