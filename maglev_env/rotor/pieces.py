"""Pieces of the rotor kernel, inlined where they are used: what happens to one lane at one instant, on scalars, SI."""

import numpy as np

from maglev_env.loop.sensor import turned
from maglev_env.rotor.rows import (
    AREA, AXIAL_C, AXIAL_K, AXIAL_STOP, BIAS, CALIBRATION, CHAIN, CLEARANCE, COMMAND, CONTACT, COS, COUPLE, CURRENT,
    DECAYS, FIRST, FLUID_C, FLUID_K, FLUX_C, FLUX_M, GAP_C, GAP_M, GRAVITY, GYRO, HALF_COS, HALF_SIN, MAGNETS,
    ONCE, PER_INERTIA, PER_MASS, PROBE, PROBES, Q, QD, REACH, REJECT, RUBBED, RUNOUT, SCALE, SIN, SPEED, STATIC,
    STEP_COS, STEP_SIN, SURFACE, TOUCH_D, TOUCH_K, TOUCH_MU, TOUCH_SLIP, TURN_COS, TURN_SIN,
)  # fmt: skip
from maglev_lanes.layout import LANES
from maglev_lanes.pieces import piece

W = LANES
SLIP = 1e-3  # m/s below which friction fades, however small the force and the step
WRECKED = 4.0  # square of the clearances from the centre
TINY = 1e-12  # m: keeps the direction of a centred rotor defined


@piece
def pull(x, i, y, current):
    """Force of one bearing along one direction (see `loop.magnets.law.force`): one division for both gaps."""
    y = min(max(y, -x[i + REACH]), x[i + REACH])
    gap_m, gap_c = x[i + GAP_M], x[i + GAP_C]
    y2 = y * y
    m2, c2 = gap_m * gap_m - y2, gap_c * gap_c - y2
    inverse = 1.0 / (m2 * c2)
    magnet, coil = x[i + FLUX_M] * (c2 * inverse), x[i + FLUX_C] * (m2 * inverse)
    q_up, q_low = coil * (gap_c + y), coil * (gap_c - y)
    bias, drive = x[i + BIAS], x[i + SCALE] * current
    b_up, b_low = magnet * (gap_m + y) + bias * q_up, magnet * (gap_m - y) + bias * q_low
    at_rest = x[i + CALIBRATION] * ((b_up - b_low) * (b_up + b_low))
    driven = 2.0 * (b_up * q_up + b_low * q_low) + drive * ((q_up - q_low) * (q_up + q_low))
    return x[i + AREA] * (at_rest + drive * driven)


@piece
def contact(x, i, px, py, vx, vy):
    """Force of the touchdown bearing at a plane: along x and y, its normal part, and what friction takes (W)."""
    r = np.sqrt(px * px + py * py + TINY * TINY)
    nx, ny = px / r, py / r
    depth = max(r - x[i + CLEARANCE], 0.0)
    approach, around = nx * vx + ny * vy, nx * vy - ny * vx
    normal = max(x[i + TOUCH_K] * depth * (1.0 + x[i + TOUCH_D] * approach), 0.0)
    slip = around + x[i + SURFACE]
    fades = SLIP + x[i + TOUCH_SLIP] * normal
    rub = x[i + TOUCH_MU] * normal * slip / np.sqrt(slip * slip + fades * fades)
    return -normal * nx + rub * ny, -normal * ny - rub * nx, normal, rub * slip


@piece
def accelerations(x, i, q0, q1, q2, q3, q4, v0, v1, v2, v3, v4, c0, c1, c2, c3, cos, sin, fx, ftx, fy, fty, fz):
    """Of the five coordinates, at coil currents c and the turn's cosine and sine, with generalised forces f; and the
    contact forces at a, b and the stop, and the power that friction takes."""
    za, zb = x[i + MAGNETS], x[i + MAGNETS + W]
    ax, ay, bx, by = q0 + za * q1, q2 + za * q3, q0 + zb * q1, q2 + zb * q3
    vax, vay, vbx, vby = v0 + za * v1, v2 + za * v3, v0 + zb * v1, v2 + zb * v3
    k, c = x[i + FLUID_K], x[i + FLUID_C]
    t_ax, t_ay, touch_a, lost_a = contact(x, i, ax, ay, vax, vay)
    t_bx, t_by, touch_b, lost_b = contact(x, i, bx, by, vbx, vby)
    f_ax = pull(x, i, ax, c0) - k * ax - c * vax + t_ax
    f_ay = pull(x, i, ay, c1) - k * ay - c * vay + t_ay
    f_bx = pull(x, i, bx, c2) - k * bx - c * vbx + t_bx
    f_by = pull(x, i, by, c3) - k * by - c * vby + t_by
    static = x[i + STATIC]
    couple_c, couple_s = x[i + COUPLE], x[i + COUPLE + W]
    per_mass, per_inertia, gyro = x[i + PER_MASS], x[i + PER_INERTIA], x[i + GYRO]
    a0 = (f_ax + f_bx + static * cos + fx) * per_mass + x[i + GRAVITY]
    a2 = (f_ay + f_by + static * sin + fy) * per_mass + x[i + GRAVITY + W]
    a1 = (za * f_ax + zb * f_bx + couple_c * cos - couple_s * sin + ftx) * per_inertia - gyro * v3
    a3 = (za * f_ay + zb * f_by + couple_s * cos + couple_c * sin + fty) * per_inertia + gyro * v1
    stop = x[i + AXIAL_STOP]
    over = max(abs(q4) - stop, 0.0)
    side = np.copysign(1.0, q4)
    hit = max(x[i + TOUCH_K] * over * (1.0 + x[i + TOUCH_D] * side * v4), 0.0)
    a4 = (fz - x[i + AXIAL_K] * q4 - x[i + AXIAL_C] * v4 - side * hit) * per_mass + x[i + GRAVITY + 2 * W]
    return a0, a1, a2, a3, a4, touch_a, touch_b, hit, lost_a + lost_b


@piece
def read(x, i, p, y, v, y1, v1, r, rv, r1, rv1):
    """Next state of probe p: its exact answer to the cubic through both ends of motion and runout (rates times h)."""
    c, at = i + CHAIN, i + PROBE + p * W
    start, end = x[c + W] * (y + r) + x[c + 2 * W] * (v + rv), x[c + 3 * W] * (y1 + r1) + x[c + 4 * W] * (v1 + rv1)
    x[at] = x[c] * x[at] + start + end


@piece
def follow_turn(x, i, left):
    """What the force rejection takes off next: it turns with the rotor, and grows by its gain times what is left.

    Left: inputs of the first controller in x and y and of the second, behind the force rejection.
    """
    c, s, n, g = x[i + STEP_COS], x[i + STEP_SIN], i + ONCE, i + REJECT
    ex, ey, fx, fy = left[i], left[i + W], left[i + 2 * W], left[i + 3 * W]
    ax, ay = turned(x[n], x[n + W], c, s)
    bx, by = turned(x[n + 2 * W], x[n + 3 * W], c, s)
    x[n] = ax + x[g] * ex - x[g + W] * ey + x[g + 2 * W] * fx - x[g + 3 * W] * fy
    x[n + W] = ay + x[g] * ey + x[g + W] * ex + x[g + 2 * W] * fy + x[g + 3 * W] * fx
    x[n + 2 * W] = bx + x[g + 4 * W] * ex - x[g + 5 * W] * ey + x[g + 6 * W] * fx - x[g + 7 * W] * fy
    x[n + 3 * W] = by + x[g + 4 * W] * ey + x[g + 5 * W] * ex + x[g + 6 * W] * fy + x[g + 7 * W] * fx


@piece
def advance(x, i, h, at, fx, ftx, fy, fty, fz):
    """One integration step of h (s), the at-th, under held commands and forces: Runge and Kutta's, 4th order, on nodes
    of the coil currents with which its quadrature is exact; noted: contacts, and what friction takes."""
    cos, sin = x[i + COS], x[i + SIN]
    hc, hs = x[i + HALF_COS], x[i + HALF_SIN]
    tc, ts = x[i + TURN_COS], x[i + TURN_SIN]
    cos_h, sin_h = turned(cos, sin, hc, hs)
    cos_1, sin_1 = turned(cos, sin, tc, ts)
    q0, q1, q2, q3, q4 = x[i + Q], x[i + Q + W], x[i + Q + 2 * W], x[i + Q + 3 * W], x[i + Q + 4 * W]
    v0, v1, v2 = x[i + QD], x[i + QD + W], x[i + QD + 2 * W]
    v3, v4 = x[i + QD + 3 * W], x[i + QD + 4 * W]
    u0, u1, u2 = x[i + COMMAND], x[i + COMMAND + W], x[i + COMMAND + 2 * W]
    u3 = x[i + COMMAND + 3 * W]
    d0, d1 = x[i + CURRENT] - u0, x[i + CURRENT + W] - u1
    d2, d3 = x[i + CURRENT + 2 * W] - u2, x[i + CURRENT + 3 * W] - u3
    end, begin = x[i + DECAYS], x[i + DECAYS + W]
    middle, last = x[i + DECAYS + 2 * W], x[i + DECAYS + 3 * W]
    j0, j1, j2, j3 = u0 + begin * d0, u1 + begin * d1, u2 + begin * d2, u3 + begin * d3
    a0, a1, a2, a3, a4, n_a, n_b, n_z, lost = accelerations(
        x, i, q0, q1, q2, q3, q4, v0, v1, v2, v3, v4, j0, j1, j2, j3, cos, sin, fx, ftx, fy, fty, fz
    )
    m0, m1, m2, m3 = u0 + middle * d0, u1 + middle * d1, u2 + middle * d2, u3 + middle * d3
    g = 0.5 * h
    w0, w1, w2, w3, w4 = v0 + g * a0, v1 + g * a1, v2 + g * a2, v3 + g * a3, v4 + g * a4
    b0, b1, b2, b3, b4, _, _, _, lost_b = accelerations(
        x, i, q0 + g * v0, q1 + g * v1, q2 + g * v2, q3 + g * v3, q4 + g * v4, w0, w1, w2, w3, w4, m0, m1, m2, m3,
        cos_h, sin_h, fx, ftx, fy, fty, fz,
    )  # fmt: skip
    z0, z1, z2, z3, z4 = v0 + g * b0, v1 + g * b1, v2 + g * b2, v3 + g * b3, v4 + g * b4
    c0, c1, c2, c3, c4, _, _, _, lost_c = accelerations(
        x, i, q0 + g * w0, q1 + g * w1, q2 + g * w2, q3 + g * w3, q4 + g * w4, z0, z1, z2, z3, z4, m0, m1, m2, m3,
        cos_h, sin_h, fx, ftx, fy, fty, fz,
    )  # fmt: skip
    k0, k1, k2, k3, k4 = v0 + h * c0, v1 + h * c1, v2 + h * c2, v3 + h * c3, v4 + h * c4
    l0, l1, l2, l3 = u0 + last * d0, u1 + last * d1, u2 + last * d2, u3 + last * d3
    e0, e1, e2, e3, e4, _, _, _, lost_e = accelerations(
        x, i, q0 + h * z0, q1 + h * z1, q2 + h * z2, q3 + h * z3, q4 + h * z4, k0, k1, k2, k3, k4, l0, l1, l2, l3,
        cos_1, sin_1, fx, ftx, fy, fty, fz,
    )  # fmt: skip
    s = h / 6.0
    p0, p1 = q0 + s * (v0 + 2.0 * (w0 + z0) + k0), q1 + s * (v1 + 2.0 * (w1 + z1) + k1)
    p2, p3 = q2 + s * (v2 + 2.0 * (w2 + z2) + k2), q3 + s * (v3 + 2.0 * (w3 + z3) + k3)
    p4 = q4 + s * (v4 + 2.0 * (w4 + z4) + k4)
    r0, r1 = v0 + s * (a0 + 2.0 * (b0 + c0) + e0), v1 + s * (a1 + 2.0 * (b1 + c1) + e1)
    r2, r3 = v2 + s * (a2 + 2.0 * (b2 + c2) + e2), v3 + s * (a3 + 2.0 * (b3 + c3) + e3)
    r4 = v4 + s * (a4 + 2.0 * (b4 + c4) + e4)
    # Pressed in as deep as the clearance a rotor is wrecked: it stays where it is, and no number runs away.
    za, zb = x[i + MAGNETS], x[i + MAGNETS + W]
    ax, ay, bx, by = q0 + za * q1, q2 + za * q3, q0 + zb * q1, q2 + zb * q3
    far = max(ax * ax + ay * ay, bx * bx + by * by)
    whole = 1.0 if far < WRECKED * x[i + CLEARANCE] * x[i + CLEARANCE] else 0.0
    p0, p1, p2 = q0 + whole * (p0 - q0), q1 + whole * (p1 - q1), q2 + whole * (p2 - q2)
    p3, p4 = q3 + whole * (p3 - q3), q4 + whole * (p4 - q4)
    r0, r1, r2, r3, r4 = whole * r0, whole * r1, whole * r2, whole * r3, whole * r4
    spin = h * x[i + SPEED]
    for p in range(2):
        zp = x[i + PROBES + p * W]
        rc, rs = x[i + RUNOUT + (2 * p) * W], x[i + RUNOUT + (2 * p + 1) * W]
        ox, oy, ox_1, oy_1 = rc * cos - rs * sin, rs * cos + rc * sin, rc * cos_1 - rs * sin_1, rs * cos_1 + rc * sin_1
        read(
            x, i, 2 * p, q0 + zp * q1, h * (v0 + zp * v1), p0 + zp * p1, h * (r0 + zp * r1),
            ox, -spin * oy, ox_1, -spin * oy_1,
        )  # fmt: skip
        read(
            x, i, 2 * p + 1, q2 + zp * q3, h * (v2 + zp * v3), p2 + zp * p3, h * (r2 + zp * r3),
            oy, spin * ox, oy_1, spin * ox_1,
        )  # fmt: skip
    x[i + Q], x[i + Q + W], x[i + Q + 2 * W] = p0, p1, p2
    x[i + Q + 3 * W], x[i + Q + 4 * W] = p3, p4
    x[i + QD], x[i + QD + W], x[i + QD + 2 * W] = r0, r1, r2
    x[i + QD + 3 * W], x[i + QD + 4 * W] = r3, r4
    x[i + CURRENT], x[i + CURRENT + W] = u0 + end * d0, u1 + end * d1
    x[i + CURRENT + 2 * W], x[i + CURRENT + 3 * W] = u2 + end * d2, u3 + end * d3
    x[i + COS], x[i + SIN] = cos_1, sin_1
    x[i + CONTACT] = max(x[i + CONTACT], n_a)
    x[i + CONTACT + W] = max(x[i + CONTACT + W], n_b)
    x[i + CONTACT + 2 * W] = max(x[i + CONTACT + 2 * W], n_z)
    x[i + FIRST] = min(x[i + FIRST], at if n_a > 0.0 else np.inf)
    x[i + FIRST + W] = min(x[i + FIRST + W], at if n_b > 0.0 else np.inf)
    x[i + FIRST + 2 * W] = min(x[i + FIRST + 2 * W], at if n_z > 0.0 else np.inf)
    x[i + RUBBED] += whole * s * (lost + 2.0 * (lost_b + lost_c) + lost_e)
