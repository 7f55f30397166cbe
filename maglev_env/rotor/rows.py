"""Rows of the rotor kernel's block: states, constants of the body, its supports and its control; and its channels."""

from maglev_lanes.layout import LANES, rows_after
from selfsense import kernel_rows

# Generalised coordinates x, tilt of x, y, tilt of y, z (m, rad) and their rates; cosine and sine of the rotor's angle.
# For each axis, in the order (a, x), (a, y), (b, x), (b, y): probe, coil current, command, PID states. ONCE: what the
# force rejection takes off the inputs of the first controller in x and y and of the second.
Q, QD, COS, SIN, PROBE, CURRENT, COMMAND, D, XI, ONCE, _FOUND = rows_after(
    0, "Q[5] QD[5] COS SIN PROBE[4] CURRENT[4] COMMAND[4] D[4] XI[4] ONCE[4]"
)
# Accumulated results: greatest contact force (N) at a, b and the axial stop, sample of the first contact there, and the
# energy (J) lost by friction.
CONTACT, FIRST, RUBBED, _TURN = rows_after(_FOUND, "CONTACT[3] FIRST[3] RUBBED")
# Rotation in half a step and in a whole one; speed; static and couple unbalance, runout of both planes, m.
HALF_COS, HALF_SIN, TURN_COS, TURN_SIN, SPEED, STATIC, COUPLE, RUNOUT, _BODY = rows_after(
    _TURN, "HALF_COS HALF_SIN TURN_COS TURN_SIN SPEED STATIC COUPLE[2] RUNOUT[4]"
)
# 1 / mass, 1 / inertia, speed times polar over transverse inertia; accelerations of gravity; axial support.
PER_MASS, PER_INERTIA, GYRO, GRAVITY, AXIAL_K, AXIAL_C, AXIAL_STOP, _PLANES = rows_after(
    _BODY, "PER_MASS PER_INERTIA GYRO GRAVITY[3] AXIAL_K AXIAL_C AXIAL_STOP"
)
# Magnet planes and probe planes along the axis; fluid at the magnet planes; touchdown. TOUCH_SLIP: slip, per newton of
# the normal force, below which a step of the integration could not follow the friction.
MAGNETS, PROBES, FLUID_K, FLUID_C, CLEARANCE, TOUCH_K, TOUCH_D, TOUCH_MU, TOUCH_SLIP, SURFACE, _LAW = rows_after(
    _PLANES, "MAGNETS[2] PROBES[2] FLUID_K FLUID_C CLEARANCE TOUCH_K TOUCH_D TOUCH_MU TOUCH_SLIP SURFACE"
)
# Force law of the pair of one bearing (see `magnets.law.ForceLaw`); REACH: limit of the displacement in its field.
AREA, FLUX_M, GAP_M, FLUX_C, GAP_C, BIAS, SCALE, CALIBRATION, REACH, _CHAINS = rows_after(
    _LAW, "AREA FLUX_M GAP_M FLUX_C GAP_C BIAS SCALE CALIBRATION REACH"
)
# CHAIN: coefficients for the probe's next state, of itself and of the cubic through both ends. DECAYS: remaining share
# of a change of the command at the end of the step and at the three nodes of the current in the integration; see
# `kernel.exact.actuator_rows`.
CHAIN, DECAYS, _CONTROL = rows_after(_CHAINS, "CHAIN[5] DECAYS[4]")
# Converters and control as in the axis kernel. INTO, OUT: matrices (2 x 2) before and after the controllers; gains of
# each controller. REJECT: real and imaginary parts of the gain (2 x 2) of the force rejection, turned on by a
# sample, as STEP_COS and STEP_SIN turn.
COUNTS, COUNT_MAX, PER_COUNT, NOISE, PER_U, U_MAX, U_COUNT, _GAINS = rows_after(
    _CONTROL, "COUNTS COUNT_MAX PER_COUNT NOISE PER_U U_MAX U_COUNT"
)
INTO, OUT, KP, KI, KD, DECAY_D, DECAY_I, REJECT, STEP_COS, STEP_SIN, END = rows_after(
    _GAINS, "INTO[4] OUT[4] KP[4] KI[4] KD[4] DECAY_D[4] DECAY_I[4] REJECT[8] STEP_COS STEP_SIN"
)
ROWS = END // LANES
# Of a rotor on self-sensing: seconds of a step, the coils' gap at rest, and the rows of four self-sensors.
STEP, COIL_GAP, SELF = rows_after(END, "STEP COIL_GAP")
STRIDE = kernel_rows.END
SENSING_ROWS = (SELF + 4 * STRIDE) // LANES
# Channels per control sample: readings of the four probes, the four coil currents, and the axial displacement.
CHANNELS = ("probe_ax", "probe_ay", "probe_bx", "probe_by", "coil_ax", "coil_ay", "coil_bx", "coil_by", "axial")
# And on self-sensing: what the self-sensors read, and the displacements that they read.
READINGS, DISPLACEMENTS = slice(9, 13), slice(13, 17)
SENSED = ("sensed_ax", "sensed_ay", "sensed_bx", "sensed_by", "magnet_ax", "magnet_ay", "magnet_bx", "magnet_by")
