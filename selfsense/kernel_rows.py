"""Rows of one self-sensor in a lane block: state of coil, supply and estimator, then their constants."""

from maglev_lanes.layout import LANES, rows_after

# z coth z with z^2 = s tau is approximated by 1 + sum of weight s tau / (s tau + rate), with an error below 2.5e-3 up
# to |s tau| = 50 (0.23 mm at 48 kHz) and below 1.6e-2 up to 300. The first modes of the exact series (rates n^2 pi^2)
# would respond far too slowly after an edge.
EDDY_RATES = (10.05, 52.35, 289.2, 4228.0)
EDDY_WEIGHTS = (2.0917, 3.5239, 10.755, 87.523626)

# State. COIL: the current (A), or the flux linkage (Wb) if the voltage by motion counts; ALPHA: share of the PWM
# period spent at level ON, the rest at OFF; RISE, FALL: times of its edges, including dead time;
# VOLT_SECONDS: levels times seconds since the last sample; MODEL: the simulated inductor's current; GAP: at the last
# sample; FORWARD: amplitude of the ripple, A; INTEGRAL: of the convergence controller, m; EDDY: flux linkage that each
# eddy mode lags to; ACTUAL, SIMULATED: the two forward paths.
COIL, ALPHA, ON, OFF, RISE, FALL, VOLT_SECONDS, MODEL, GAP, READING, FORWARD, ESTIMATE, INTEGRAL, _PATHS = rows_after(
    0, "COIL ALPHA ON OFF RISE FALL VOLT_SECONDS MODEL GAP READING FORWARD ESTIMATE INTEGRAL"
)
EDDY, ACTUAL, SIMULATED, _COIL = rows_after(_PATHS, "EDDY[4] ACTUAL[6] SIMULATED[6]")
# Constants of coil, supply and reading. 1 / L = INVERSE_0 + INVERSE_1 gap, of the coil and as the estimator believes.
INVERSE_0, INVERSE_1, RESISTANCE, VOLTAGE, MAGNET_EMF, EDDY_RATE, CORE_SHARE, SATURATED, _SUPPLY = rows_after(
    _COIL, "INVERSE_0 INVERSE_1 RESISTANCE VOLTAGE MAGNET_EMF EDDY_RATE CORE_SHARE SATURATED"
)
PER_FIELD, BIAS_FIELD, PERIOD, DEAD, STATES_3, NOISE, COUNTS, PER_COUNT, COUNT_MAX, _ESTIMATOR = rows_after(
    _SUPPLY, "PER_FIELD BIAS_FIELD PERIOD DEAD STATES_3 NOISE COUNTS PER_COUNT COUNT_MAX"
)
# Constants of the estimator; INTERVAL: between samples, s. BEFORE, BEHIND: second-order sections b0 b1 b2 a1 a2, two
# before the rectifier and one behind it.
MODEL_INVERSE_0, MODEL_INVERSE_1, MODEL_RESISTANCE, MODEL_VOLTAGE, INTERVAL, _GAINS = rows_after(
    _ESTIMATOR, "MODEL_INVERSE_0 MODEL_INVERSE_1 MODEL_RESISTANCE MODEL_VOLTAGE INTERVAL"
)
KP, KI_INTERVAL, LOWEST, HIGHEST, BEFORE, BEHIND, _LOOP = rows_after(
    _GAINS, "KP KI_INTERVAL LOWEST HIGHEST BEFORE[10] BEHIND[5]"
)
# Of a sensor in a levitation loop: displacement = SCALE (REST_GAP - estimate) + SHIFT; REST_CURRENT: the coil's current
# at rest; BEGUN_...: motion and current at the start of the present step; OFF_...: accumulated errors of the readings.
REST_GAP, SCALE, SHIFT, REST_CURRENT, BEGUN_Y, BEGUN_V, BEGUN_CURRENT, OFF_SUM, OFF_SQ, OFF_PEAK, END = rows_after(
    _LOOP, "REST_GAP SCALE SHIFT REST_CURRENT BEGUN_Y BEGUN_V BEGUN_CURRENT OFF_SUM OFF_SQ OFF_PEAK"
)
SENSOR_ROWS = END // LANES
