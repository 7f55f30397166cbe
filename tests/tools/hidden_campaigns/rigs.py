"""Hidden rigs of textbook laws with an integrator of their own, and what they record. Nothing is the product's."""

from dataclasses import dataclass

import numba
import numpy as np
import scipy

SUB = 8  # steps of the integrator in a tick


@dataclass(frozen=True)
class Hidden:
    """A hidden rig, SI. law: 0 an opposed pair (constant, gap, bias), 1 a ball (factor, gap, length); lag, probe: of
    amplifier and reading; body: mass, stiffness and damping of a second one on a spring; eddy: share and time constant
    of what of the current acts late; rate: A/s that the voltage allows; bend: of the reading, 1/m."""

    dt: float
    mass: float
    law: int
    constants: tuple[float, float, float]
    weight: float
    rest: float
    nominal_rest: float
    clearance: float
    lag: float
    probe: float
    noise: tuple[float, float, float]
    friction: float = 0.0
    body: tuple[float, float, float] = (0.0, 0.0, 0.0)
    eddy: tuple[float, float] = (0.0, 1.0)
    rate: float = 1e12
    saturation: float = 1e12
    scale: float = 1.0
    bend: float = 0.0
    late: int = 0

    def numbers(self):
        return np.array([
            self.mass, self.law, *self.constants, self.weight, self.lag, self.probe, self.friction, *self.body,
            *self.eddy, self.rate, self.saturation,
        ])  # fmt: skip


@numba.njit(cache=True)
def pull(p, y, i):
    """Force (N) at displacement y (m) toward the coil and the current i (A) that acts, without the weight."""
    i = p[15] * np.tanh(i / p[15])
    if p[1] == 0:
        y = min(max(y, -0.9 * p[3]), 0.9 * p[3])
        return p[2] * (((p[4] + i) / (p[3] - y)) ** 2 - ((p[4] - i) / (p[3] + y)) ** 2)
    return p[2] * i * i * np.exp(-(p[3] - y) / p[4])


@numba.njit(cache=True)
def slope(p, s, u, f):
    """Rates of [y, v, i, late part of i, read y, y2, v2] at a command u (A) and a force f (N)."""
    acting = (1 - p[12]) * s[2] + p[12] * s[3]
    force = pull(p, s[0], acting) - p[5] + f
    if p[8] > 0:
        force -= p[8] * np.tanh(s[1] / 1e-4)
    out = np.zeros(7)
    if p[9] > 0:
        spring = p[10] * (s[0] - s[5]) + p[11] * (s[1] - s[6])
        force -= spring
        out[5], out[6] = s[6], spring / p[9]
    out[0], out[1] = s[1], force / p[0]
    out[2] = min(max((u - s[2]) / p[6], -p[14]), p[14])
    out[3] = (s[2] - s[3]) / p[13]
    out[4] = (s[0] - s[4]) / p[7]
    return out


@numba.njit(cache=True)
def run(p, dt, rest, gains, force, injection, noise, start, clearance, scale, bend, late, held):
    """Rows reading, command, current, y of a run (4, n); noise (2, n) of reading and current; whether it touched.

    start: y at which the rotor lies for `held` ticks without current; held < 0: it hovers.
    """
    n, kp, ki, kd, td, ti = force.size, gains[0], gains[1], gains[2], gains[3], gains[4]
    s = np.array([start, 0.0, rest if held < 0 else 0.0, rest if held < 0 else 0.0, start, start, 0.0])
    if p[1] == 0 and held >= 0:
        s[2] = s[3] = 0.0
    low, sum_, touched, h = 0.0, 0.0, False, dt / SUB
    fresh = np.full(late + 1, rest)
    out = np.zeros((4, n))
    ticks = 0
    for k in range(-max(held, 0), n):
        at = max(k, 0)
        reading = scale * s[4] * (1 + bend * s[4]) + noise[0, at]
        e = -reading
        command = kp * e + kd * (e - low) / td + ki * sum_
        low += (1 - np.exp(-dt / td)) * (e - low)
        sum_ += (1 - np.exp(-dt / ti)) * (e - sum_)
        ticks += 1
        if k < 0:
            continue
        command += injection[k]
        out[0, k], out[1, k], out[2, k], out[3, k] = reading, command, s[2] + noise[1, k], s[0]
        for _ in range(SUB):
            fresh[:-1] = fresh[1:]
            fresh[late] = rest + command
            u = fresh[0]
            a = slope(p, s, u, force[k])
            b = slope(p, s + 0.5 * h * a, u, force[k])
            c = slope(p, s + 0.5 * h * b, u, force[k])
            d = slope(p, s + h * c, u, force[k])
            s = s + h / 6 * (a + 2 * b + 2 * c + d)
            if abs(s[0]) >= clearance:
                touched = True
                s[0], s[1] = np.sign(s[0]) * clearance, 0.0
    return out, touched


def sent(hidden, gains, force, injection, rng=None, start=0.0, held=-1):
    noise = np.zeros((2, force.size))
    if rng is not None:
        noise = rng.standard_normal((2, force.size)) * np.array(hidden.noise[:2])[:, None]
    h = hidden
    return run(
        h.numbers(), h.dt, h.rest, np.array([gains[n] for n in ("kp", "ki", "kd", "td", "ti")]), force, injection,
        noise, start, h.clearance, h.scale, h.bend, h.late, held,
    )  # fmt: skip


def waves(block, hidden):
    """Force, injection (n,) of one period, and the lines of each, of a proposed recording; Schroeder's phases."""
    n = round(1 / block["excitation"][0]["fundamental"] / hidden.dt)
    made, lines = {"force": np.zeros(n), "current": np.zeros(n)}, {}
    for e in block["excitation"]:
        own = np.array(e["lines"])
        k = np.arange(own.size)
        phase = -np.pi * k * (k + 1) / own.size + 0.3
        wave = np.cos(2 * np.pi * own[:, None] * np.arange(n) / n + phase[:, None]).sum(axis=0)
        made[e["at"]] += e["amplitude"] * wave / np.abs(wave).max()
        lines[e["at"]] = own
    return made["force"], made["current"], lines


def record(folder, hidden, block, rng):
    """Writes the recording that a block proposes; whether the rotor touched down."""
    force, injection, _ = waves(block, hidden)
    periods = block["excitation"][0]["periods"]
    f, u = np.tile(force, periods), np.tile(injection, periods)
    rows, touched = sent(hidden, block["gains"], f, u, rng)
    channels = {
        "displacement": rows[0], "command": rows[1], "current": rows[2] - hidden.nominal_rest,
        "force": f + hidden.noise[2] * rng.standard_normal(f.size), "injection": u,
    }  # fmt: skip
    scipy.io.savemat(folder / block["file"], {k: v[:, None] for k, v in channels.items()})
    return touched
