"""Rows of the rotor kernel's block: states, constants of the body, its supports and its control; and its channels."""

from maglev_lanes.layout import LANES as LANES

# Generalised coordinates x, tilt of x, y, tilt of y, z (m, rad) and their rates; the turn's cosine and sine.
Q, QD, COS, SIN = 0, 5, 10, 11
# Per axis in the order (a, x), (a, y), (b, x), (b, y): probe, coil current, command, PID states.
PROBE, CURRENT, COMMAND, D, XI = 12, 16, 20, 24, 28
# What was found on the way: greatest contact force (N) at a, b and the axial stop, sample of the first contact there,
# and what friction took (J).
CONTACT, FIRST, RUBBED = 32, 35, 38
# Turn over half a step and whole one; speed; static and couple unbalance (2), runout of both planes (2 each), m.
HALF_COS, HALF_SIN, TURN_COS, TURN_SIN, SPEED, STATIC, COUPLE, RUNOUT = 39, 40, 41, 42, 43, 44, 45, 47
# 1 / mass, 1 / inertia, speed times polar over transverse inertia; accelerations of gravity; axial support.
PER_MASS, PER_INERTIA, GYRO, GRAVITY, AXIAL_K, AXIAL_C, AXIAL_STOP = 51, 52, 53, 54, 57, 58, 59
# Magnet planes and probe planes along the axis; fluid at the magnet planes; touchdown.
MAGNETS, PROBES, FLUID_K, FLUID_C, CLEARANCE, TOUCH_K, TOUCH_D, TOUCH_MU, SURFACE = 60, 62, 64, 65, 66, 67, 68, 69, 70
# The pair's force law of one bearing (see `magnetics.ForceLaw`); what its field may see of the displacement.
AREA, FLUX_M, GAP_M, FLUX_C, GAP_C, BIAS, SCALE, CALIBRATION, REACH = 71, 72, 73, 74, 75, 76, 77, 78, 79
# Probe: next state from itself and the cubic through both ends (5). Amplifier: what is still missing of the command at
# the end, and at the three nodes that stand for the current in the integration (4); see `kernel.exact.actuator_rows`.
CHAIN, DECAYS = 80, 85
# Converters and control: as in the axis kernel; into and out of the controllers (2 x 2 each), gains per controller.
COUNTS, COUNT_MAX, PER_COUNT, NOISE, PER_U, U_MAX, U_COUNT = 89, 90, 91, 92, 93, 94, 95
INTO, OUT, KP, KI, KD, DECAY_D, DECAY_I = 96, 100, 104, 108, 112, 116, 120
ROWS = 124
# Channels written per control sample: what the four probes read, the four coil currents, and the axial displacement.
CHANNELS = ("probe_ax", "probe_ay", "probe_bx", "probe_by", "coil_ax", "coil_ay", "coil_bx", "coil_by", "axial")
