"""The lane kernel: one compiled loop that steps LANES simulations of the nominal one-axis loop together.

A block is flat arrays with LANES consecutive values per variable: constant strides are what lets the compiler turn
the loops over lanes into full-width vector instructions. Blocks are always full, so a lane's bits do not depend on
how many others run beside it. Absent effects are compiled out.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numba as nb
import numpy as np

from maglev_env.noise import FAST, normal

LANES = 16
W = LANES

# Rows of a block, one flat array so that the compiler sees every distance: state, then constants, then chains.
Y, V, Z1, Z2, X1, X2, D, XI, ALIVE, STEPS, U, U_OLD, PEAK, CURRENT_SQ = range(14)
(PROBE_COUNTS, COUNT_MAX, PER_COUNT, KP, KD, KI, PER_U_COUNT, U_COUNT_MAX, U_COUNT, DECAY_D, DECAY_I) = range(14, 25)
NOISE, GAP2, GAPM2, GAP, GAPM, FLUX_M, FLUX_C, BIAS, CALIBRATION, KS, CS, PER_MASS, LIMIT, DELAY_STEPS = range(25, 39)
# Exact linear chains, once per substep: sensor (2 states from z1 z2 y0 v0 y1 v1, the motion taken as a cubic), what the
# current adds to that cubic (2 states from x1 x2 old new), actuator (5 outputs from x1 x2 old new), and what of the old
# and the new command acts at the sampling instant when the actuator has no pole.
SENSOR, SENSOR_CURRENT, ACTUATOR, AT_START = 39, 51, 59, 79
CHAIN_ROWS = 42
ROWS = 81

# Output channels of a block, per sample.
DISPLACEMENT, COMMAND, CURRENT = range(3)
CHANNELS = ("displacement", "command", "current")
# Samples gathered before they are written out lane by lane, so that a lane's series is contiguous.
TILE = 8


@dataclass(frozen=True)
class Structure:
    """What is compiled in: magnets ("gap", "magnet", "none"), support, poles per chain, delay, converters, noise."""

    magnets: str
    supported: bool
    sensor_poles: int
    actuator_poles: int
    delayed: bool
    adc: bool
    dac: bool
    noise: bool


@cache
def kernel(structure: Structure, outputs: int, substeps: int = 1) -> Callable[..., int]:
    """The compiled stepper for a structure: `outputs` leading CHANNELS written (2 or 3), `substeps` per sample.

    Called as step(block, seeds, history, first_step, force, injection, reference, tile, out), all arrays flat: advances
    the block over len(force) samples and fills out (outputs, LANES, samples); tile is scratch of TILE samples. Returns
    the samples done: fewer when every lane has touched down.
    """
    return _make(outputs=outputs, substeps=substeps, **vars(structure))


def _make(magnets, supported, sensor_poles, actuator_poles, delayed, adc, dac, noise, outputs, substeps):
    sixth = 1.0 / 6.0
    magnetic, gap_path = magnets != "none", magnets == "gap"

    @nb.njit(fastmath=FAST, error_model="numpy", inline="always")
    def pull(x, i, y, current):
        """Magnet force (see magnetics.force) in sums and differences of the two gaps: one division, 25 operations."""
        if not magnetic:
            return 0.0
        y2 = y * y
        b = x[GAPM2 * W + i] - y2
        if gap_path:
            a = x[GAP2 * W + i] - y2
            inverse = 1.0 / (a * b)
            magnet, coil, reach = x[FLUX_M * W + i] * (a * inverse), x[FLUX_C * W + i] * (b * inverse), x[GAP * W + i]
        else:
            inverse = 1.0 / b
            magnet, coil, reach = x[FLUX_M * W + i] * inverse, x[FLUX_C * W + i] * inverse, x[GAPM * W + i]
        bias = x[BIAS * W + i] * coil
        field_sum = x[GAPM * W + i] * magnet + reach * bias
        slope = magnet + bias
        drive = current * coil
        bent = reach * (field_sum + drive * y) + slope * y2
        return x[CALIBRATION * W + i] * (y * field_sum * slope) + drive * bent

    @nb.njit(fastmath=FAST, error_model="numpy", nogil=True, cache=True)
    def step(x, seeds, history, first_step, force, injection, reference, tile, out):
        mask = np.int64(history.size // W - 1)
        samples = force.size
        for t in range(samples):
            f_ext, inject, ref = force[t], injection[t], reference[t]
            count = np.uint64(first_step + t + 1)
            o = (t % TILE) * outputs * W
            now = (np.int64(first_step + t) & mask) * W
            for i in range(W):
                sensed = x[Z2 * W + i] if sensor_poles == 2 else (x[Z1 * W + i] if sensor_poles == 1 else x[Y * W + i])
                if noise:
                    sensed = sensed + x[NOISE * W + i] * normal(seeds[i], count)
                counts = sensed * x[PROBE_COUNTS * W + i]
                if adc:
                    counts = np.rint(counts)
                shown = min(max(counts, -x[COUNT_MAX * W + i]), x[COUNT_MAX * W + i]) * x[PER_COUNT * W + i]
                x[PEAK * W + i] = max(x[PEAK * W + i], abs(shown))
                if magnetic:
                    e = ref - shown
                    lag, xi = e - x[D * W + i], x[XI * W + i]
                    u = x[KP * W + i] * e + x[KD * W + i] * lag + x[KI * W + i] * xi + inject
                    u = u * x[PER_U_COUNT * W + i]
                    if dac:
                        u = np.rint(u)
                    u = min(max(u, -x[U_COUNT_MAX * W + i]), x[U_COUNT_MAX * W + i]) * x[U_COUNT * W + i]
                    x[D * W + i] = e - lag * x[DECAY_D * W + i]
                    x[XI * W + i] = e + (xi - e) * x[DECAY_I * W + i]
                    x[U * W + i] = u
                tile[o + DISPLACEMENT * W + i] = shown
                tile[o + COMMAND * W + i] = x[U * W + i]
            if delayed:
                for i in range(W):
                    history[now + i] = x[U * W + i]
                for i in range(W):
                    behind = np.int64(first_step + t) - np.int64(x[DELAY_STEPS * W + i])
                    x[U * W + i] = history[(behind & mask) * W + i]
                    x[U_OLD * W + i] = history[((behind - 1) & mask) * W + i]
            for i in range(W):
                if actuator_poles == 2:
                    current = x[X2 * W + i]
                elif actuator_poles == 1:
                    current = x[X1 * W + i]
                else:
                    current = x[(AT_START + 1) * W + i] * x[U * W + i]
                    if delayed:
                        current = current + x[AT_START * W + i] * x[U_OLD * W + i]
                x[CURRENT_SQ * W + i] += current * current
                if outputs > CURRENT:
                    tile[o + CURRENT * W + i] = current
            for s in range(substeps):
                row = s * CHAIN_ROWS * W
                for i in range(W):
                    y, v = x[Y * W + i], x[V * W + i]
                    c0 = c1 = c2 = 0.0
                    if magnetic:
                        # Next x1, next x2, three nodal currents whose quadrature is exact; from x1 x2 old new.
                        a = row + ACTUATOR * W + i
                        u, x1, x2 = x[U * W + i], x[X1 * W + i], x[X2 * W + i]
                        n1, n2 = x[a + 3 * W] * u, x[a + 7 * W] * u
                        c0, c1, c2 = x[a + 11 * W] * u, x[a + 15 * W] * u, x[a + 19 * W] * u
                        if actuator_poles >= 1:
                            n1 = n1 + x[a] * x1
                            c0, c1, c2 = c0 + x[a + 8 * W] * x1, c1 + x[a + 12 * W] * x1, c2 + x[a + 16 * W] * x1
                        if actuator_poles == 2:
                            n2 = n2 + x[a + 4 * W] * x1 + x[a + 5 * W] * x2
                            c0, c1, c2 = c0 + x[a + 9 * W] * x2, c1 + x[a + 13 * W] * x2, c2 + x[a + 17 * W] * x2
                        if delayed:
                            old = x[U_OLD * W + i]
                            n1, n2 = n1 + x[a + 2 * W] * old, n2 + x[a + 6 * W] * old
                            c0, c1 = c0 + x[a + 10 * W] * old, c1 + x[a + 14 * W] * old
                            c2 = c2 + x[a + 18 * W] * old
                        if actuator_poles >= 1:
                            x[X1 * W + i] = n1
                        if actuator_poles == 2:
                            x[X2 * W + i] = n2
                    # Velocity and acceleration in displacement per step: h v and h^2 a.
                    fx = f_ext * x[PER_MASS * W + i]
                    ks = x[KS * W + i] if supported else 0.0
                    cs = x[CS * W + i] if supported else 0.0
                    # Nystrom, 4th order: the middle stages share a position, so the magnets are evaluated thrice.
                    a1 = pull(x, i, y, c0) + fx
                    if supported:
                        a1 = a1 - ks * y - cs * v
                    ym = y + 0.5 * v + 0.125 * a1
                    a2 = a3 = pull(x, i, ym, c1) + fx
                    if supported:
                        held = a2 - ks * ym
                        a2 = held - cs * (v + 0.5 * a1)
                        a3 = held - cs * (v + 0.5 * a2)
                    ye = y + v + 0.5 * a3
                    a4 = pull(x, i, ye, c2) + fx
                    if supported:
                        a4 = a4 - ks * ye - cs * (v + a3)
                    y1 = y + v + (a1 + a2 + a3) * sixth
                    v1 = v + (a1 + 2.0 * (a2 + a3) + a4) * sixth
                    if sensor_poles >= 1:
                        k = row + SENSOR * W + i
                        z1 = x[Z1 * W + i]
                        drive = x[k + 2 * W] * y + x[k + 3 * W] * v + x[k + 4 * W] * y1 + x[k + 5 * W] * v1
                        if magnetic:
                            q = row + SENSOR_CURRENT * W + i
                            drive = drive + x[q + 3 * W] * u
                            if actuator_poles >= 1:
                                drive = drive + x[q] * x1
                            if actuator_poles == 2:
                                drive = drive + x[q + W] * x2
                            if delayed:
                                drive = drive + x[q + 2 * W] * old
                        x[Z1 * W + i] = x[k] * z1 + drive
                        if sensor_poles == 2:
                            k = k + 6 * W
                            drive = x[k + 2 * W] * y + x[k + 3 * W] * v + x[k + 4 * W] * y1 + x[k + 5 * W] * v1
                            if magnetic:
                                q = q + 4 * W
                                drive = drive + x[q + 3 * W] * u
                                if actuator_poles >= 1:
                                    drive = drive + x[q] * x1
                                if actuator_poles == 2:
                                    drive = drive + x[q + W] * x2
                                if delayed:
                                    drive = drive + x[q + 2 * W] * old
                            x[Z2 * W + i] = x[k] * z1 + x[k + W] * x[Z2 * W + i] + drive
                    # A lane that touches down stays where it was: nothing beyond the clearance is simulated.
                    alive = x[ALIVE * W + i] if abs(y1) < x[LIMIT * W + i] else 0.0
                    x[Y * W + i] = y1 if alive > 0.0 else y
                    x[V * W + i] = v1 * alive
                    x[ALIVE * W + i] = alive
                    x[STEPS * W + i] += alive
            if t % TILE == TILE - 1:
                for c in range(outputs * W):
                    for j in range(TILE):
                        out[c * samples + t - (TILE - 1) + j] = tile[j * outputs * W + c]
                living = 0.0
                for i in range(W):
                    living += x[ALIVE * W + i]
                if living == 0.0:
                    return t + 1
        for t in range(samples - samples % TILE, samples):
            for c in range(outputs * W):
                out[c * samples + t] = tile[(t % TILE) * outputs * W + c]
        return samples

    return step
