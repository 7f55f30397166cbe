"""Pieces of the rotor kernel, inlined where they are used: what happens to one lane at one instant, on scalars, SI."""

import numpy as np

from maglev_env.rotor.rows import (
    AREA, AXIAL_C, AXIAL_K, AXIAL_STOP, BIAS, CALIBRATION, CHAIN, CLEARANCE, COMMAND, CONTACT, COS, COUPLE, CURRENT,
    DECAYS, FIRST, FLUID_C, FLUID_K, FLUX_C, FLUX_M, GAP_C, GAP_M, GRAVITY, GYRO, HALF_COS, HALF_SIN, LANES, MAGNETS,
    PER_INERTIA, PER_MASS, PROBE, PROBES, Q, QD, REACH, RUBBED, RUNOUT, SCALE, SIN, SPEED, STATIC, SURFACE, TOUCH_D,
    TOUCH_K, TOUCH_MU, TURN_COS, TURN_SIN,
)  # fmt: skip
from maglev_lanes.pieces import piece

W = LANES
SLIP = 1e-3  # m/s below which friction fades
WRECKED = 4.0  # square of the clearances from the centre
TINY = 1e-12  # m: keeps the direction of a centred rotor defined


@piece
def pull(x, i, y, current):
    """Force of one bearing along one direction (see `magnetics.force`): one division for both gaps."""
    y = min(max(y, -x[REACH * W + i]), x[REACH * W + i])
    gap_m, gap_c = x[GAP_M * W + i], x[GAP_C * W + i]
    y2 = y * y
    m2, c2 = gap_m * gap_m - y2, gap_c * gap_c - y2
    inverse = 1.0 / (m2 * c2)
    magnet, coil = x[FLUX_M * W + i] * (c2 * inverse), x[FLUX_C * W + i] * (m2 * inverse)
    q_up, q_low = coil * (gap_c + y), coil * (gap_c - y)
    bias, drive = x[BIAS * W + i], x[SCALE * W + i] * current
    b_up, b_low = magnet * (gap_m + y) + bias * q_up, magnet * (gap_m - y) + bias * q_low
    at_rest = x[CALIBRATION * W + i] * ((b_up - b_low) * (b_up + b_low))
    driven = 2.0 * (b_up * q_up + b_low * q_low) + drive * ((q_up - q_low) * (q_up + q_low))
    return x[AREA * W + i] * (at_rest + drive * driven)


@piece
def contact(x, i, px, py, vx, vy):
    """Force of the touchdown bearing at a plane: along x and y, its normal part, and what friction takes (W)."""
    r = np.sqrt(px * px + py * py + TINY * TINY)
    nx, ny = px / r, py / r
    depth = max(r - x[CLEARANCE * W + i], 0.0)
    approach, around = nx * vx + ny * vy, nx * vy - ny * vx
    normal = max(x[TOUCH_K * W + i] * depth * (1.0 + x[TOUCH_D * W + i] * approach), 0.0)
    slip = around + x[SURFACE * W + i]
    rub = x[TOUCH_MU * W + i] * normal * slip / np.sqrt(slip * slip + SLIP * SLIP)
    return -normal * nx + rub * ny, -normal * ny - rub * nx, normal, rub * slip


@piece
def accelerations(x, i, q0, q1, q2, q3, q4, v0, v1, v2, v3, v4, c0, c1, c2, c3, cos, sin, fx, ftx, fy, fty, fz):
    """Of the five coordinates, at coil currents c and the turn's cosine and sine, with generalised forces f; and the
    contact forces at a, b and the stop, and the power that friction takes."""
    za, zb = x[MAGNETS * W + i], x[(MAGNETS + 1) * W + i]
    ax, ay, bx, by = q0 + za * q1, q2 + za * q3, q0 + zb * q1, q2 + zb * q3
    vax, vay, vbx, vby = v0 + za * v1, v2 + za * v3, v0 + zb * v1, v2 + zb * v3
    k, c = x[FLUID_K * W + i], x[FLUID_C * W + i]
    t_ax, t_ay, touch_a, lost_a = contact(x, i, ax, ay, vax, vay)
    t_bx, t_by, touch_b, lost_b = contact(x, i, bx, by, vbx, vby)
    f_ax = pull(x, i, ax, c0) - k * ax - c * vax + t_ax
    f_ay = pull(x, i, ay, c1) - k * ay - c * vay + t_ay
    f_bx = pull(x, i, bx, c2) - k * bx - c * vbx + t_bx
    f_by = pull(x, i, by, c3) - k * by - c * vby + t_by
    static = x[STATIC * W + i]
    couple_c, couple_s = x[COUPLE * W + i], x[(COUPLE + 1) * W + i]
    per_mass, per_inertia, gyro = x[PER_MASS * W + i], x[PER_INERTIA * W + i], x[GYRO * W + i]
    a0 = (f_ax + f_bx + static * cos + fx) * per_mass + x[GRAVITY * W + i]
    a2 = (f_ay + f_by + static * sin + fy) * per_mass + x[(GRAVITY + 1) * W + i]
    a1 = (za * f_ax + zb * f_bx + couple_c * cos - couple_s * sin + ftx) * per_inertia - gyro * v3
    a3 = (za * f_ay + zb * f_by + couple_s * cos + couple_c * sin + fty) * per_inertia + gyro * v1
    stop = x[AXIAL_STOP * W + i]
    over = max(abs(q4) - stop, 0.0)
    side = np.copysign(1.0, q4)
    hit = max(x[TOUCH_K * W + i] * over * (1.0 + x[TOUCH_D * W + i] * side * v4), 0.0)
    a4 = (fz - x[AXIAL_K * W + i] * q4 - x[AXIAL_C * W + i] * v4 - side * hit) * per_mass + x[(GRAVITY + 2) * W + i]
    return a0, a1, a2, a3, a4, touch_a, touch_b, hit, lost_a + lost_b


@piece
def read(x, i, p, y, v, y1, v1, r, rv, r1, rv1):
    """Next state of probe p: its exact answer to the cubic through both ends of motion and runout (rates times h)."""
    c = CHAIN * W + i
    at = (PROBE + p) * W + i
    start, end = x[c + W] * (y + r) + x[c + 2 * W] * (v + rv), x[c + 3 * W] * (y1 + r1) + x[c + 4 * W] * (v1 + rv1)
    x[at] = x[c] * x[at] + start + end


@piece
def advance(x, i, h, at, fx, ftx, fy, fty, fz):
    """One integration step of h (s), the at-th, under held commands and forces: Runge and Kutta's, 4th order, on nodes
    of the coil currents with which its quadrature is exact; noted: contacts, and what friction takes."""
    cos, sin = x[COS * W + i], x[SIN * W + i]
    hc, hs = x[HALF_COS * W + i], x[HALF_SIN * W + i]
    tc, ts = x[TURN_COS * W + i], x[TURN_SIN * W + i]
    cos_h, sin_h = cos * hc - sin * hs, sin * hc + cos * hs
    cos_1, sin_1 = cos * tc - sin * ts, sin * tc + cos * ts
    q0, q1, q2, q3, q4 = x[Q * W + i], x[(Q + 1) * W + i], x[(Q + 2) * W + i], x[(Q + 3) * W + i], x[(Q + 4) * W + i]
    v0, v1, v2 = x[QD * W + i], x[(QD + 1) * W + i], x[(QD + 2) * W + i]
    v3, v4 = x[(QD + 3) * W + i], x[(QD + 4) * W + i]
    u0, u1, u2 = x[COMMAND * W + i], x[(COMMAND + 1) * W + i], x[(COMMAND + 2) * W + i]
    u3 = x[(COMMAND + 3) * W + i]
    d0, d1 = x[CURRENT * W + i] - u0, x[(CURRENT + 1) * W + i] - u1
    d2, d3 = x[(CURRENT + 2) * W + i] - u2, x[(CURRENT + 3) * W + i] - u3
    end, begin = x[DECAYS * W + i], x[(DECAYS + 1) * W + i]
    middle, last = x[(DECAYS + 2) * W + i], x[(DECAYS + 3) * W + i]
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
    za, zb = x[MAGNETS * W + i], x[(MAGNETS + 1) * W + i]
    ax, ay, bx, by = q0 + za * q1, q2 + za * q3, q0 + zb * q1, q2 + zb * q3
    far = max(ax * ax + ay * ay, bx * bx + by * by)
    whole = 1.0 if far < WRECKED * x[CLEARANCE * W + i] * x[CLEARANCE * W + i] else 0.0
    p0, p1, p2 = q0 + whole * (p0 - q0), q1 + whole * (p1 - q1), q2 + whole * (p2 - q2)
    p3, p4 = q3 + whole * (p3 - q3), q4 + whole * (p4 - q4)
    r0, r1, r2, r3, r4 = whole * r0, whole * r1, whole * r2, whole * r3, whole * r4
    spin = h * x[SPEED * W + i]
    for p in range(2):
        zp = x[(PROBES + p) * W + i]
        rc, rs = x[(RUNOUT + 2 * p) * W + i], x[(RUNOUT + 2 * p + 1) * W + i]
        ox, oy, ox_1, oy_1 = rc * cos - rs * sin, rs * cos + rc * sin, rc * cos_1 - rs * sin_1, rs * cos_1 + rc * sin_1
        read(
            x, i, 2 * p, q0 + zp * q1, h * (v0 + zp * v1), p0 + zp * p1, h * (r0 + zp * r1),
            ox, -spin * oy, ox_1, -spin * oy_1,
        )  # fmt: skip
        read(
            x, i, 2 * p + 1, q2 + zp * q3, h * (v2 + zp * v3), p2 + zp * p3, h * (r2 + zp * r3),
            oy, spin * ox, oy_1, spin * ox_1,
        )  # fmt: skip
    x[Q * W + i], x[(Q + 1) * W + i], x[(Q + 2) * W + i] = p0, p1, p2
    x[(Q + 3) * W + i], x[(Q + 4) * W + i] = p3, p4
    x[QD * W + i], x[(QD + 1) * W + i], x[(QD + 2) * W + i] = r0, r1, r2
    x[(QD + 3) * W + i], x[(QD + 4) * W + i] = r3, r4
    x[CURRENT * W + i], x[(CURRENT + 1) * W + i] = u0 + end * d0, u1 + end * d1
    x[(CURRENT + 2) * W + i], x[(CURRENT + 3) * W + i] = u2 + end * d2, u3 + end * d3
    x[COS * W + i], x[SIN * W + i] = cos_1, sin_1
    x[CONTACT * W + i] = max(x[CONTACT * W + i], n_a)
    x[(CONTACT + 1) * W + i] = max(x[(CONTACT + 1) * W + i], n_b)
    x[(CONTACT + 2) * W + i] = max(x[(CONTACT + 2) * W + i], n_z)
    x[FIRST * W + i] = min(x[FIRST * W + i], at if n_a > 0.0 else np.inf)
    x[(FIRST + 1) * W + i] = min(x[(FIRST + 1) * W + i], at if n_b > 0.0 else np.inf)
    x[(FIRST + 2) * W + i] = min(x[(FIRST + 2) * W + i], at if n_z > 0.0 else np.inf)
    x[RUBBED * W + i] += whole * s * (lost + 2.0 * (lost_b + lost_c) + lost_e)
