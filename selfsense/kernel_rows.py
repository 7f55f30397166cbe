"""Rows of one self-sensor in a lane block: state of coil, supply and estimator, then their constants."""

LANES = 16
EDDY_MODES = 4

# State. COIL: the current (A), or the flux linkage (Wb) where the motion's voltage counts; ALPHA: share of the PWM
# period spent at level ON, the rest at OFF; RISE, FALL: where its edges lie, dead time included; LEVEL: in force now;
# VOLT_SECONDS: levels times seconds since the last sample; MODEL: the simulated inductor's current; GAP: at the last
# sample; FORWARD: amplitude of the ripple, A; INTEGRAL: of the convergence controller, m.
COIL, ALPHA, ON, OFF, RISE, FALL, LEVEL, VOLT_SECONDS, MODEL, GAP, READING, FORWARD, ESTIMATE, INTEGRAL = range(14)
EDDY = 14  # flux linkage that each eddy mode lags to
ACTUAL, SIMULATED = 18, 24  # the two forward paths, 6 states each
# Constants of coil, supply and reading. 1 / L = INVERSE_0 + INVERSE_1 gap, of the coil and as the estimator believes.
INVERSE_0, INVERSE_1, RESISTANCE, VOLTAGE, MAGNET_EMF, EDDY_RATE, CORE_SHARE, EDDY_TAIL, SATURATED = range(30, 39)
PER_FIELD, BIAS_FIELD, PERIOD, DEAD, STATES_3, NOISE, COUNTS, PER_COUNT, COUNT_MAX = range(39, 48)
# Constants of the estimator; INTERVAL: between samples, s.
MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE, MODEL_VOLTAGE, INTERVAL = range(48, 53)
KP, KI_INTERVAL, LOWEST, HIGHEST = range(53, 57)
# Second-order sections b0 b1 b2 a1 a2: two before the rectifier, one behind it.
BEFORE, BEHIND = 57, 67
# Of a sensor in a levitation loop: displacement = SCALE (REST_GAP - estimate) + SHIFT; the coil's current at rest; with
# what rotor and current began the step whose samples are taken; how far readings were off.
REST_GAP, SCALE, SHIFT, REST_CURRENT, BEGUN_Y, BEGUN_V, BEGUN_CURRENT = range(72, 79)
OFF_SUM, OFF_SQ, OFF_PEAK = range(79, 82)
SENSOR_ROWS = 82
