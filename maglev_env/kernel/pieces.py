"""Pieces of the lane kernel for one axis, inlined where they are used: what happens to one lane at one instant.

Every piece takes the block x and the lane i and works on scalars. Velocities are h v and accelerations h^2 a, in
displacement per step.
"""

from collections.abc import Callable

import numpy as np
from numba.extending import register_jitable

from maglev_env.kernel.effect_rows import FRICTION, OFFSET, OPEN, SLIP_SQ
from maglev_env.kernel.rows import (
    ACTING,
    ACTUATOR,
    BIAS,
    CALIBRATION,
    CROSS_C,
    CROSS_CURRENT,
    CROSS_GAIN,
    CROSS_K,
    CS,
    EXPONENT,
    FLUX_C,
    FLUX_M,
    GAP,
    GAP2,
    GAPM,
    GAPM2,
    KNEE,
    KS,
    LANES,
    SENSOR,
    SENSOR_CURRENT,
    U,
    U_OLD,
    V,
    WEIGHT,
    X1,
    X2,
    Y,
    Z1,
    Z2,
)
from selfsense.kernel_rows import BEGUN_CURRENT, BEGUN_V, BEGUN_Y, ESTIMATE, REST_CURRENT, REST_GAP, SCALE, SHIFT

W = LANES


def axis_pieces(
    first: int,
    other: int,
    magnets: str,
    supported: bool,
    sensor_poles: int,
    actuator_poles: int,
    delayed: bool,
    saturating: bool = False,
    flexible: bool = False,
    sticking: bool = False,
    effects: int = 0,
) -> tuple[Callable, ...]:
    """currents, acceleration, drag, probe, push, sway and beside of the axis whose rows begin at row `first`,
    where the other one's begin at row `other`, and those of a flexible axis' effects `effects` rows behind."""
    # Not njit: a dispatcher in the closure of a compiled function has another name in every process, and no cache.
    inlined = register_jitable(forceinline=True) if flexible else register_jitable(inline="always")
    b = first * W
    e = b + effects * W
    acting = ACTING if delayed else U

    @inlined
    def currents(x, row, i):
        """Three nodal currents whose quadrature over the step is exact, from x1 x2 old new, and the next x1 and x2."""
        c0 = c1 = c2 = n1 = n2 = 0.0
        if magnets != "none":
            a = b + row + ACTUATOR * W + i
            u, x1, x2 = x[b + acting * W + i], x[b + X1 * W + i], x[b + X2 * W + i]
            n1, n2 = x[a + 3 * W] * u, x[a + 7 * W] * u
            c0, c1, c2 = x[a + 11 * W] * u, x[a + 15 * W] * u, x[a + 19 * W] * u
            if actuator_poles >= 1:
                n1 = n1 + x[a] * x1
                c0, c1, c2 = c0 + x[a + 8 * W] * x1, c1 + x[a + 12 * W] * x1, c2 + x[a + 16 * W] * x1
            if actuator_poles == 2:
                n2 = n2 + x[a + 4 * W] * x1 + x[a + 5 * W] * x2
                c0, c1, c2 = c0 + x[a + 9 * W] * x2, c1 + x[a + 13 * W] * x2, c2 + x[a + 17 * W] * x2
            if delayed:
                old = x[b + U_OLD * W + i]
                n1, n2 = n1 + x[a + 2 * W] * old, n2 + x[a + 6 * W] * old
                c0, c1 = c0 + x[a + 10 * W] * old, c1 + x[a + 14 * W] * old
                c2 = c2 + x[a + 18 * W] * old
        return c0, c1, c2, n1, n2

    @register_jitable(forceinline=True)
    def saturated(x, i, y, current):
        """By a pair whose fields' squares bend: B^2 / sqrt(1 + (B / B_s)^4) in each gap."""
        own, far = x[b + GAPM * W + i] - y, x[b + GAPM * W + i] + y
        if magnets == "gap":
            near, wide = x[b + GAP * W + i] - y, x[b + GAP * W + i] + y
            inverse = 1.0 / ((own * far) * (near * wide))
            magnet = x[b + FLUX_M * W + i] * (near * wide * inverse)
            coil = x[b + FLUX_C * W + i] * (own * far * inverse)
            upper_coil, lower_coil = coil * wide, coil * near
        else:
            inverse = 1.0 / (own * far)
            magnet, coil = x[b + FLUX_M * W + i] * inverse, x[b + FLUX_C * W + i] * inverse
            upper_coil, lower_coil = coil * far, coil * own
        bias, knee = x[b + BIAS * W + i], x[b + KNEE * W + i]
        upper, lower = magnet * far + bias * upper_coil, magnet * own + bias * lower_coil
        s1, s2 = upper + current * upper_coil, lower - current * lower_coil
        s1, s2, s3, s4 = s1 * s1, s2 * s2, upper * upper, lower * lower
        r1, r2 = np.sqrt(1.0 + knee * (s1 * s1)), np.sqrt(1.0 + knee * (s2 * s2))
        r3, r4 = np.sqrt(1.0 + knee * (s3 * s3)), np.sqrt(1.0 + knee * (s4 * s4))
        # One division for all four; the fields are twice themselves, as in sums and differences of both gaps.
        first_two, last_two = r1 * r2, r3 * r4
        inverse = 0.25 / (first_two * last_two)
        at_rest = (s3 * r4 - s4 * r3) * (first_two * inverse)
        return (s1 * r2 - s2 * r1) * (last_two * inverse) + (x[b + CALIBRATION * W + i] - 1.0) * at_rest

    @inlined
    def acceleration(x, i, y, current):
        """By the magnets (see magnetics.force) and the support's spring."""
        spring = x[b + KS * W + i] * y if supported else 0.0
        if magnets == "none":
            return -spring
        if flexible:
            y = y + x[e + OFFSET * W + i]
        if saturating:
            return saturated(x, i, y, current) - spring
        if magnets == "electromagnet":
            coil = x[b + FLUX_C * W + i] / (x[b + GAP * W + i] - y)
            bias, drive = x[b + BIAS * W + i] * coil, current * coil
            at_bias = x[b + CALIBRATION * W + i] * (bias * bias) - x[b + WEIGHT * W + i]
            return at_bias + drive * (2.0 * bias + drive) - spring
        elif magnets == "magnet_coil":
            coil = x[b + FLUX_C * W + i] * (x[b + GAP * W + i] - y) ** (-x[b + EXPONENT * W + i])
            magnet = x[b + FLUX_M * W + i] / (x[b + GAPM * W + i] - y)
            at_bias = coil * x[b + BIAS * W + i] + magnet * magnet
            return x[b + CALIBRATION * W + i] * at_bias - x[b + WEIGHT * W + i] + coil * current - spring
        else:
            # A pair, in sums and differences of its two gaps: one division, 25 operations.
            y2 = y * y
            c = x[b + GAPM2 * W + i] - y2
            if magnets == "gap":
                a = x[b + GAP2 * W + i] - y2
                inverse = 1.0 / (a * c)
                magnet, coil = x[b + FLUX_M * W + i] * (a * inverse), x[b + FLUX_C * W + i] * (c * inverse)
                reach = x[b + GAP * W + i]
            else:
                inverse = 1.0 / c
                magnet, coil = x[b + FLUX_M * W + i] * inverse, x[b + FLUX_C * W + i] * inverse
                reach = x[b + GAPM * W + i]
            bias = x[b + BIAS * W + i] * coil
            field_sum = x[b + GAPM * W + i] * magnet + reach * bias
            slope = magnet + bias
            drive = current * coil
            bent = reach * (field_sum + drive * y) + slope * y2
            return x[b + CALIBRATION * W + i] * (y * field_sum * slope) + drive * bent - spring

    @inlined
    def drag(x, i, v):
        """Deceleration by the support's damper, and by friction that depends on the velocity alone."""
        damper = x[b + CS * W + i] * v if supported else 0.0
        if flexible and not sticking:
            return damper + x[e + FRICTION * W + i] * v / np.sqrt(v * v + x[e + SLIP_SQ * W + i])
        return damper

    @inlined
    def probe(x, row, i, y, v, y1, v1):
        """Next probe states: their exact answer to the cubic through both ends, and to what the current adds to it."""
        k = b + row + SENSOR * W + i
        q = b + row + SENSOR_CURRENT * W + i
        z1, z2 = x[b + Z1 * W + i], x[b + Z2 * W + i]
        m1 = x[k] * z1 + x[k + 2 * W] * y + x[k + 3 * W] * v + x[k + 4 * W] * y1 + x[k + 5 * W] * v1
        m2 = x[k + 6 * W] * z1 + x[k + 7 * W] * z2
        m2 = m2 + x[k + 8 * W] * y + x[k + 9 * W] * v + x[k + 10 * W] * y1 + x[k + 11 * W] * v1
        if magnets != "none":
            u, x1, x2 = x[b + acting * W + i], x[b + X1 * W + i], x[b + X2 * W + i]
            m1, m2 = m1 + x[q + 3 * W] * u, m2 + x[q + 7 * W] * u
            if actuator_poles >= 1:
                m1, m2 = m1 + x[q] * x1, m2 + x[q + 4 * W] * x1
            if actuator_poles == 2:
                m1, m2 = m1 + x[q + W] * x2, m2 + x[q + 5 * W] * x2
            if delayed:
                old = x[b + U_OLD * W + i]
                m1, m2 = m1 + x[q + 2 * W] * old, m2 + x[q + 6 * W] * old
        return m1, m2

    @inlined
    def beside(x, row, i):
        """What the other axis' current adds to the next probe states."""
        q, c = b + row + CROSS_CURRENT * W + i, other * W + i
        u, x1, x2 = x[c + acting * W], x[c + X1 * W], x[c + X2 * W]
        m1, m2 = x[q + 3 * W] * u, x[q + 7 * W] * u
        if actuator_poles >= 1:
            m1, m2 = m1 + x[q] * x1, m2 + x[q + 4 * W] * x1
        if actuator_poles == 2:
            m1, m2 = m1 + x[q + W] * x2, m2 + x[q + 5 * W] * x2
        if delayed:
            old = x[c + U_OLD * W]
            m1, m2 = m1 + x[q + 2 * W] * old, m2 + x[q + 6 * W] * old
        return m1, m2

    @inlined
    def push(x, i, y, current):
        """Acceleration of this axis by the other one's displacement and current."""
        return x[b + CROSS_GAIN * W + i] * current - x[b + CROSS_K * W + i] * y

    @inlined
    def sway(x, i, v):
        """Deceleration of this axis by the other one's velocity."""
        return x[b + CROSS_C * W + i] * v

    return currents, acceleration, drag, probe, push, sway, beside


def sensing_pieces(
    first: int, sensor: int, actuator_poles: int, delayed: bool, flexible: bool = False, effects: int = 0
) -> tuple[Callable, ...]:
    """begin, gap, target and show of the axis whose rows begin at row `first`, its self-sensor's at row `sensor`, and
    those of a flexible axis' effects `effects` rows behind its own."""
    b, c = first * W, sensor * W
    e = b + effects * W
    acting = ACTING if delayed else U

    @register_jitable(forceinline=True)
    def carried(x, i):
        """The control current now, as the nominal amplifier carries it."""
        if flexible:
            now = x[b + X2 * W + i]
            return now + x[e + OPEN * W + i] * (x[b + acting * W + i] - now)
        if actuator_poles == 2:
            return x[b + X2 * W + i]
        return x[b + X1 * W + i] if actuator_poles == 1 else x[b + acting * W + i]

    @register_jitable(forceinline=True)
    def begin(x, i):
        """Remember with what a step begins."""
        x[c + BEGUN_Y * W + i], x[c + BEGUN_V * W + i] = x[b + Y * W + i], x[b + V * W + i]
        x[c + BEGUN_CURRENT * W + i] = carried(x, i)

    @register_jitable(forceinline=True)
    def gap(x, i, here):
        """The coil's gap at a fraction of the step just made: the cubic through both ends of the motion."""
        rest = 1.0 - here
        ends = x[c + BEGUN_Y * W + i] * (rest * rest * (1.0 + 2.0 * here))
        ends = ends + x[b + Y * W + i] * (here * here * (3.0 - 2.0 * here))
        bend = x[c + BEGUN_V * W + i] * rest - x[b + V * W + i] * here
        if flexible:
            ends = ends + x[e + OFFSET * W + i]
        return x[b + GAP * W + i] - ends - bend * (here * rest)

    @register_jitable(forceinline=True)
    def target(x, i, ahead):
        """Mean coil current wanted at a time in steps from the beginning of the step, its change carried on."""
        begun = x[c + BEGUN_CURRENT * W + i]
        return x[c + REST_CURRENT * W + i] + begun + (carried(x, i) - begun) * ahead

    @register_jitable(forceinline=True)
    def show(x, i):
        """The displacement that the estimated gap stands for, where the probe's state would be."""
        off_rest = x[c + REST_GAP * W + i] - x[c + ESTIMATE * W + i]
        x[b + Z1 * W + i] = x[c + SCALE * W + i] * off_rest + x[c + SHIFT * W + i]

    return begin, gap, target, show
