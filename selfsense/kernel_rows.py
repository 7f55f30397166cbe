"""Rows of one self-sensor in a lane block: state of coil, supply and estimator, then their constants."""

from maglev_lanes.layout import LANES as LANES

# z coth z, z^2 = s tau, is 1 + sum of weight s tau / (s tau + rate): to 2.5e-3 up to |s tau| = 50 (0.23 mm at 48 kHz),
# to 1.6e-2 up to 300. The first of the series' own modes, rates n^2 pi^2, come far too late after an edge.
EDDY_RATES = (10.05, 52.35, 289.2, 4228.0)
EDDY_WEIGHTS = (2.0917, 3.5239, 10.755, 87.523626)

# State. COIL: the current (A), or the flux linkage (Wb) where the motion's voltage counts; ALPHA: share of the PWM
# period spent at level ON, the rest at OFF; RISE, FALL: where its edges lie, dead time included;
# VOLT_SECONDS: levels times seconds since the last sample; MODEL: the simulated inductor's current; GAP: at the last
# sample; FORWARD: amplitude of the ripple, A; INTEGRAL: of the convergence controller, m.
COIL, ALPHA, ON, OFF, RISE, FALL, VOLT_SECONDS, MODEL, GAP, READING, FORWARD, ESTIMATE, INTEGRAL = range(13)
EDDY = 13  # flux linkage that each eddy mode lags to
ACTUAL, SIMULATED = 17, 23  # the two forward paths, 6 states each
# Constants of coil, supply and reading. 1 / L = INVERSE_0 + INVERSE_1 gap, of the coil and as the estimator believes.
INVERSE_0, INVERSE_1, RESISTANCE, VOLTAGE, MAGNET_EMF, EDDY_RATE, CORE_SHARE, SATURATED = range(29, 37)
PER_FIELD, BIAS_FIELD, PERIOD, DEAD, STATES_3, NOISE, COUNTS, PER_COUNT, COUNT_MAX = range(37, 46)
# Constants of the estimator; INTERVAL: between samples, s.
MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE, MODEL_VOLTAGE, INTERVAL = range(46, 51)
KP, KI_INTERVAL, LOWEST, HIGHEST = range(51, 55)
# Second-order sections b0 b1 b2 a1 a2: two before the rectifier, one behind it.
BEFORE, BEHIND = 55, 65
# Of a sensor in a levitation loop: displacement = SCALE (REST_GAP - estimate) + SHIFT; the coil's current at rest; with
# what rotor and current began the step whose samples are taken; how far readings were off.
REST_GAP, SCALE, SHIFT, REST_CURRENT, BEGUN_Y, BEGUN_V, BEGUN_CURRENT = range(70, 77)
OFF_SUM, OFF_SQ, OFF_PEAK = range(77, 80)
SENSOR_ROWS = 80
