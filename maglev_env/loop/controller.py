"""The controller's block: from the reading to the command."""

from collections.abc import Mapping

import numpy as np

from maglev_env.loop import further_body
from maglev_env.loop.card import EffectCard, Parameter
from maglev_env.loop.converters import converter_bits, converter_range
from maglev_env.loop.system import Values
from maglev_lanes.converter import quantised
from maglev_lanes.layout import LANES as W
from maglev_lanes.layout import LaneRows, rows_after
from maglev_lanes.pieces import piece

EFFECTS: Mapping[str, EffectCard] = {
    "delay": EffectCard(
        "controller",
        {"time": Parameter("s", 0.0, 20.0, scale=0.2, starts=(0.2, 1.5), per="control period")},
        "computation and hold delay e^(-s T), 1 to 1.5 samples on real controllers",
        "command and current",
        ("magnets",),
    ),
}


# Rows of a lane. U: the command, A. ACTING, U_OLD: with a delay, the command that acts from now on and the one that
# acted before. D, XI: states of the PID. ERROR, RAW: input and output of a linear controller.
U, ACTING, U_OLD, D, XI, ERROR, RAW, _CONSTANTS = rows_after(further_body.END, "U ACTING U_OLD D XI ERROR RAW")
# ARRIVED: 1 if the new command already acts at the start of a substep.
KP, KD, KI, DECAY_D, DECAY_I, PER_U_COUNT, U_COUNT_MAX, U_COUNT, U_ROUNDS, DELAY_STEPS, ARRIVED, END = rows_after(
    _CONSTANTS, "KP KD KI DECAY_D DECAY_I PER_U_COUNT U_COUNT_MAX U_COUNT U_ROUNDS DELAY_STEPS ARRIVED"
)
ERROR_STATE = 3  # rows of a filter of the error for each power of 1 / z: b, a, state
# Rows of a controller with several inputs: the coefficients of reference, reading and current without delay, the
# limits, the reading, the current, and the command before and behind the limit (HEAD rows); then for each power of
# 1 / z the coefficients of reference, reading and current, a, the one of what the limit cuts off, and the state.
HEAD, INPUT_STATE = 9, 6


def fill(x: LaneRows, values: Values) -> None:
    """Write the constants of the command's converter; those of the controller itself are written elsewhere."""
    per_volt, bits = values.rig("amplifier_gain"), converter_bits(values, "dac_bits")
    count = np.where(bits > 0, 2 * values.rig("voltage_range") * per_volt / 2.0**bits, 1.0)
    most = converter_range(values) * per_volt
    x[PER_U_COUNT], x[U_COUNT_MAX], x[U_COUNT], x[U_ROUNDS] = 1 / count, most / count, count, bits > 0


@piece
def pid_step(error, d, xi, kp, kd, ki, decay_d, decay_i):
    """The command of a PID, kp e + kd (e - d) + ki xi with kd over the lag's time, and its next states d and xi."""
    lag = error - d
    return kp * error + kd * lag + ki * xi, error - lag * decay_d, error + (xi - error) * decay_i


@piece
def pid(x, k, error):
    """Command of a PID (A) before the converter limits it; advances its states to the next sample."""
    u, x[k + D], x[k + XI] = pid_step(
        error, x[k + D], x[k + XI], x[k + KP], x[k + KD], x[k + KI], x[k + DECAY_D], x[k + DECAY_I]
    )
    return u


@piece
def command(x, k, u):
    """Store and return the command (A) after the converter has rounded and limited u."""
    top = x[k + U_COUNT_MAX]
    found = quantised(u * x[k + PER_U_COUNT], -top, top, x[k + U_ROUNDS]) * x[k + U_COUNT]
    x[k + U] = found
    return found


@piece
def filter_output(x, k, f):
    """Command of a linear controller whose rows start at f: b0, then (b, a, state) for each power of 1 / z."""
    u = x[f] * x[k + ERROR] + x[f + 3 * W]
    x[k + RAW] = u
    return u


@piece
def filter_ahead(x, k, g):
    """Advance one of its states to the next sample (transposed direct form II)."""
    fed = x[g] * x[k + ERROR] - x[g + W] * x[k + RAW]
    x[g + 2 * W] = fed + x[g + 5 * W]


@piece
def limited_output(x, f, reference, reading, current):
    """Command (A) of a controller with several inputs whose rows start at f."""
    x[f + 5 * W], x[f + 6 * W] = reading, current
    u = x[f] * reference - x[f + W] * reading - x[f + 2 * W] * current + x[f + (HEAD + INPUT_STATE - 1) * W]
    limited = min(max(u, x[f + 3 * W]), x[f + 4 * W])
    x[f + 7 * W], x[f + 8 * W] = u, limited
    return limited


@piece
def inputs_ahead(x, f, g, reference):
    """Advance one of its states to the next sample (transposed direct form II); g: rows of its power of 1 / z."""
    u = x[f + 7 * W]
    fed = x[g] * reference - x[g + W] * x[f + 5 * W] - x[g + 2 * W] * x[f + 6 * W]
    own = x[g + 3 * W] * u + x[g + 4 * W] * (u - x[f + 8 * W])
    x[g + 5 * W] = fed - own + x[g + (2 * INPUT_STATE - 1) * W]
