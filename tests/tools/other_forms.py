"""Campaigns of one effect in textbook forms that are not the library's, and what a tree's diagnosis says of them.

    python tests/tools/other_forms.py make OUT [--count 40] [--seed 1] [--only saturation friction ...]
    python tests/tools/other_forms.py answer OUT --tree TREE --as NAME
    python tests/tools/other_forms.py table OUT [--misses]

OUT/000 .. are campaigns of two rigs (the free rotor, and one on springs) with two recordings and a holdout; truth.json
holds what was drawn: effect, form, constants, and its size as a multiple of what a 1 % test of the recording detects
with a power of one half. Some have no effect, and some one that is in no library. Nominal parameters are drawn within
their tolerances. `answer` continues where it was stopped. Integrator and formulas are this file's own.
"""

import argparse
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numba as nb
import numpy as np

MU_0 = 4e-7 * np.pi
SUBSTEPS, MOST_POLES, STOPS = 10, 24, 3
# States of the rotor's equations; behind them stand the poles of the eddy currents and the stops.
Y, V, I1, I2, PROBE, BRISTLE, BOUC, M1, MV1, M2, MV2, B1, BV1, B2, BV2, EDDY = range(16)
ECHO, CREEP = EDDY + MOST_POLES + STOPS, EDDY + MOST_POLES + STOPS + 1
SIZE = CREEP + 1
NONE, POWER, TANH, ARCTAN, CLIP = range(5)  # curves that saturate
LUGRE, DAHL, KARNOPP, STEEP = range(1, 5)  # friction
FIELD, CURRENT, COMMAND = range(3)  # where a saturation sits


class Plant(NamedTuple):
    """Constants of the rig and of its one effect, SI; the defaults change nothing."""

    mass: float = 0.08012
    spring: float = 0.0
    damper: float = 0.0
    gain: float = 5.7
    stiffness: float = -12.5e3
    probe: float = 1.0
    amplifier: float = 1e-4
    knee: float = 1.0
    knee_kind: int = NONE
    knee_power: float = 4.0
    knee_at: int = FIELD
    friction_kind: int = 0
    coulomb: float = 0.0
    static: float = 1.0
    stribeck: float = 1e-3
    presliding: float = 1e-6
    power: float = 1.0
    viscous: float = 0.0
    bouc: float = 0.0
    bouc_power: float = 1.0
    bouc_beta: float = 0.5
    width: float = 0.1
    stop: float = 0.0
    rate: float = 0.0
    damping: float = 1.0
    zero: float = 0.0
    volts: float = np.inf
    soft: bool = False
    modes: float = 0.0
    mode_rate: float = 0.0
    mode_damping: float = 0.02
    mode_two: float = 0.0
    bodies: float = 0.0
    body_rate: float = 0.0
    body_damping: float = 0.02
    body_two: float = 0.0
    delay: float = 0.0  # below a control period
    jitter: float = 0.0
    square: float = 0.0
    drift: float = 0.0
    cubic: float = 0.0
    bent_probe: float = 0.0
    dropped: float = 0.0
    # Of no library; each is the size of its kind.
    soft_band: float = 0.0
    two_tap: float = 0.0
    speed_gain: float = 0.0
    kink: float = 0.0
    kink_at: float = 0.0
    creep: float = 0.0
    uneven_band: float = 0.0
    one_sided: float = 0.0
    steep_drag: float = 0.0
    bowl: float = 0.0
    echo: float = 0.0
    echo_rate: float = 1.0
    rippled: float = 0.0
    root_drag: float = 0.0
    half_drag: float = 0.0
    probe_kink: float = 0.0
    weak_pull: float = 0.0
    fading: float = 0.0
    slow_amplifier: float = 0.0


@nb.njit(cache=True)
def _saturated(p, x):
    a = abs(x) / p.knee
    if p.knee_kind == POWER:
        return x / (1.0 + a**p.knee_power) ** (1.0 / p.knee_power)
    if p.knee_kind == TANH:
        return p.knee * np.tanh(x / p.knee)
    if p.knee_kind == ARCTAN:
        return p.knee * 2.0 / np.pi * np.arctan(0.5 * np.pi * x / p.knee)
    return min(max(x, -p.knee), p.knee)


@nb.njit(cache=True)
def _pull(p, y, i):
    """Force (N) of two hybrid magnets from the fields in their gaps, scaled to the measured gain and stiffness."""
    gap, area, turns, bias = 0.35e-3, 39.27e-6, 90.0, 0.2
    own = 0.5 * 0.7 * 5e-3 / 1.05
    reluctance = 0.5 * 5e-3 * area / (1.05 * 34.715e-6)
    push, wide = 0.5 * MU_0 * turns, gap + reluctance
    at_rest = own / wide + push * bias / gap
    scale = area / MU_0  # both magnets of an axis, one face each
    k_i = scale * 2.0 * at_rest * push / gap * 2.0
    k_y = scale * 2.0 * at_rest * (own / wide**2 + push * bias / gap**2) * 2.0
    up, down, drive = gap - y, gap + y, i * p.gain / k_i
    r1, r2 = own / (up + reluctance) + push * bias / up, own / (down + reluctance) + push * bias / down
    d1, d2 = r1 + push * drive / up, r2 - push * drive / down
    if p.knee_kind != NONE and p.knee_at == FIELD:
        r1, r2, d1, d2 = _saturated(p, r1), _saturated(p, r2), _saturated(p, d1), _saturated(p, d2)
    return scale * (d1 * d1 - d2 * d2 + (-p.stiffness / k_y - 1.0) * (r1 * r1 - r2 * r2))


@nb.njit(cache=True)
def _rates(p, s, u, outside, strength, rates, shares, d):
    """Derivatives d of all states under the command u (A) and the force outside (N); strength: of the actuator."""
    y, v, i = s[Y], s[V], s[I1]
    if p.rate > 0.0:  # a second-order current loop in place of the nominal pole
        d[I1] = s[I2] + p.zero * p.rate**2 * u - 2.0 * p.damping * p.rate * i
        d[I2] = p.rate**2 * (u - i)
    elif p.volts < np.inf:
        asked = 0.57e-3 * (u - i) / p.amplifier + 2.0 * i
        given = p.volts * np.tanh(asked / p.volts) if p.soft else min(max(asked, -p.volts), p.volts)
        d[I1] = (given - 2.0 * i) / 0.57e-3
    else:
        d[I1] = (u - i) / p.amplifier
    seen = i
    for k in range(MOST_POLES):
        d[EDDY + k] = rates[k] * (i - s[EDDY + k])
        seen += shares[k] * (s[EDDY + k] - i)
    if p.bouc > 0.0:
        z, di = s[BOUC], d[I1] / p.width
        bend = abs(z) ** p.bouc_power
        d[BOUC] = di - p.bouc_beta * abs(di) * bend * np.sign(z) - (1.0 - p.bouc_beta) * di * bend
        seen -= p.bouc * p.width * z
    if p.stop > 0.0:
        for k in range(STOPS):
            at, z, limit = EDDY + MOST_POLES + k, s[EDDY + MOST_POLES + k], p.width * (0.5 + 0.7 * k)
            d[at] = 0.0 if abs(z) >= limit and z * d[I1] > 0.0 else d[I1]
            seen -= p.stop / STOPS * z
    if p.knee_kind != NONE and p.knee_at == CURRENT:
        seen = _saturated(p, seen)
    # Where the current pulls otherwise than it should: by speed, beyond a place, by the square of the place, late.
    past = max(y - p.kink_at, 0.0)
    d[ECHO] = p.echo_rate * (seen - s[ECHO])
    seen = seen + p.echo * (s[ECHO] - seen)
    seen -= p.weak_pull * np.tanh(seen / max(p.weak_pull, 1e-9))
    seen *= 1.0 - p.fading * (v / 5e-3) ** 2
    seen *= 1.0 - p.speed_gain * abs(v) / (abs(v) + 2e-3) + p.kink * past / 1e-5 + p.bowl * (y / 1e-5) ** 2
    bearing = _pull(p, y, seen * strength) - p.spring * y - p.damper * v - p.square * abs(v) * v - p.cubic * y**3
    d[CREEP] = (y - s[CREEP]) / 4e-3  # a spring in series with a dashpot
    bearing -= p.root_drag * np.sign(v) * np.sqrt(abs(v)) + p.half_drag * max(v, 0.0)
    bearing -= p.creep * (y - s[CREEP]) + p.one_sided * max(y - p.kink_at, 0.0) + p.steep_drag * v**5
    level = p.coulomb * (1.0 + (p.static - 1.0) * np.exp(-abs(v / p.stribeck)))
    applied = bearing + outside
    if p.friction_kind == LUGRE:
        stiff = p.coulomb / p.presliding
        d[BRISTLE] = v - stiff * abs(v) * s[BRISTLE] / level
        bearing -= stiff * s[BRISTLE] + 0.3 * np.sqrt(stiff * p.mass) * 0.05 * d[BRISTLE] + p.viscous * v
    elif p.friction_kind == DAHL:
        z = s[BRISTLE] / p.presliding
        d[BRISTLE] = v * max(1.0 - z * np.sign(v), 0.0) ** p.power
        bearing -= p.coulomb * z
    elif p.friction_kind == KARNOPP:
        if abs(v) < 4e-5:
            bearing -= min(max(applied, -p.coulomb * p.static), p.coulomb * p.static) + 2.0 * v
        else:
            bearing -= p.coulomb * np.sign(v) + p.viscous * v
    elif p.friction_kind == STEEP:
        bearing -= level * np.tanh(v / 1e-4) + p.viscous * v
    total = bearing + outside
    for k in range(2):  # bodies on the rotor, and modes of the probe's mount
        own, ratio = p.body_rate * (1.0 + 1.4 * k), p.bodies if k == 0 else p.bodies * p.body_two
        if ratio > 0.0:
            at = B1 + 2 * k
            tie = ratio * p.mass * (own**2 * (s[at] - y) + 2.0 * p.body_damping * own * (s[at + 1] - v))
            d[at], d[at + 1] = s[at + 1], -tie / (ratio * p.mass)
            total += tie
        own, share = p.mode_rate * (1.0 + 1.4 * k), p.modes if k == 0 else p.modes * p.mode_two
        if share != 0.0:
            at = M1 + 2 * k
            d[at] = s[at + 1]
            d[at + 1] = -share * bearing / p.mass - 2.0 * p.mode_damping * own * s[at + 1] - own**2 * s[at]
    d[Y], d[V] = v, total / p.mass
    d[PROBE] = (y - s[M1] - s[M2] - s[PROBE]) / 1.6e-5


@nb.njit(cache=True)
def simulate(p, gains, force, injection, reference, noise, late, rates, shares, out):
    """Advance the loop from rest by Runge-Kutta steps; False where the rotor touches.

    Args:
        p: constants.
        gains: kp, ki, kd, td, ti.
        force, injection: (samples,), N and A. reference: m.
        noise: of the probe (samples,), m. late: uniform numbers (samples,) for the jitter of the delay and for drops.
        rates, shares: of the eddy currents' poles, (MOST_POLES,).
        out: displacement, command, current (3, samples), written.
    """
    kp, ki, kd, td, ti = gains
    dt = 1.0 / 20000.0
    h = dt / SUBSTEPS
    keep_d, keep_i = np.exp(-dt / td), np.exp(-dt / ti)
    s, trial = np.zeros(SIZE), np.zeros(SIZE)
    k1, k2, k3, k4 = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    lag_d = lag_i = acting = waiting = before = crept = 0.0
    samples = force.size
    for n in range(samples):
        seen = p.probe * (s[PROBE] + p.bent_probe * s[PROBE] ** 2 + noise[n])
        seen += p.rippled * np.sin(s[PROBE] / 6e-6) + p.probe_kink * max(s[PROBE] - p.kink_at, 0.0)
        seen = np.round(seen * 8000.0 / 3.0517578125e-4) * 3.0517578125e-4 / 8000.0
        e = reference - seen
        asked = kp * e + kd * (e - lag_d) / td + ki * lag_i + injection[n]
        lag_d, lag_i = e + (lag_d - e) * keep_d, e + (lag_i - e) * keep_i
        u = np.round(asked / 1.220703125e-3) * 1.220703125e-3
        out[0, n], out[1, n], out[2, n] = seen, u, s[I1]
        if not late[n] < p.dropped:
            given = _saturated(p, u) if p.knee_kind != NONE and p.knee_at == COMMAND else u
            if p.soft_band > 0.0:
                given -= p.soft_band * np.tanh(u / p.soft_band)
            if p.uneven_band > 0.0:
                given -= min(max(u, -0.3 * p.uneven_band), p.uneven_band)
            crept += (u - crept) * 0.01  # of a command that rises slowly to its end
            given -= p.slow_amplifier * (u - crept)
            waiting, before = given + p.two_tap * (before - given), given
        arrives = p.delay + p.jitter * (2.0 * late[n] - 1.0)
        strength = 1.0 + p.drift * n / samples
        for j in range(SUBSTEPS):
            # The command of a step in which it changes is the mean of both.
            new = min(max(((j + 1) * h - arrives) / h, 0.0), 1.0)
            now = acting + (waiting - acting) * new
            _rates(p, s, now, force[n], strength, rates, shares, k1)
            for q in range(SIZE):
                trial[q] = s[q] + 0.5 * h * k1[q]
            _rates(p, trial, now, force[n], strength, rates, shares, k2)
            for q in range(SIZE):
                trial[q] = s[q] + 0.5 * h * k2[q]
            _rates(p, trial, now, force[n], strength, rates, shares, k3)
            for q in range(SIZE):
                trial[q] = s[q] + h * k3[q]
            _rates(p, trial, now, force[n], strength, rates, shares, k4)
            for q in range(SIZE):
                s[q] += h / 6.0 * (k1[q] + 2.0 * k2[q] + 2.0 * k3[q] + k4[q])
            if not abs(s[Y]) < 0.3e-3:
                return False
        acting = waiting
    return True


def half_order(corner: float) -> tuple[np.ndarray, np.ndarray]:
    """Poles of 1 / (1 + sqrt(s / w)), from its integral over relaxations, on a grid of their rates."""
    rates = np.geomspace(1.0, 3e6, MOST_POLES)
    x = rates / (2 * np.pi * corner)
    density = np.sqrt(x) / (1 + x) / np.pi  # of ln rate
    shares = density * np.log(rates[1] / rates[0])
    return slow_enough(rates, shares / max(shares.sum(), 1.0))


def slow_enough(rates: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poles (1/s) that the integrator's steps resolve; what faster ones carry passes without a lag."""
    kept = rates < 4e5
    return np.where(kept, rates, 1.0), np.where(kept, shares, 0.0)


def plate(ratio: float, time: float, one_sided: bool) -> tuple[np.ndarray, np.ndarray]:
    """Poles of a gap in series with a plate into which the flux diffuses, from one side or from both.

    1 / (1 + r z tanh z) or 1 / (1 + r (z coth z - 1)), z^2 = s time; both are Cauer ladders of ten rungs.
    """
    top, bottom = np.array([1.0]), np.array([2.0 * 10 + 1.0])
    for odd in range(19, 0 if one_sided else 1, -2):
        top, bottom = bottom, np.polyadd(odd * bottom, np.polymul(top, [1.0, 0.0]))
    rung = np.polymul(top, [1.0, 0.0])
    whole = np.polyadd(bottom, ratio * rung)
    poles = np.roots(whole).real
    residues = np.polyval(bottom, poles) / np.polyval(np.polyder(whole), poles)
    rates, shares = -poles / time, -residues / poles
    slow = np.argsort(rates)[:MOST_POLES]
    spare = (0, MOST_POLES - slow.size)
    return slow_enough(np.pad(rates[slow], spare, constant_values=1.0), np.pad(shares[slow], spare))


Size = float
Made = tuple[Plant, tuple[np.ndarray, np.ndarray] | None]
FLAT = (np.ones(MOST_POLES), np.zeros(MOST_POLES))


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def saturation(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    place, curve = form.split(" ")
    at = {"field": FIELD, "current": CURRENT, "command": COMMAND}[place]
    kind = {"power": POWER, "tanh": TANH, "arctan": ARCTAN, "clip": CLIP}[curve]
    power = _log(rng, 1.5, 20.0)
    unit = 1.0 if at == FIELD else 0.3
    return lambda x: (p._replace(knee=unit / x, knee_kind=kind, knee_power=power, knee_at=at), None)


def friction(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    kind = {"lugre": LUGRE, "dahl": DAHL, "karnopp": KARNOPP, "steep": STEEP}[form]
    constants = {
        "static": rng.uniform(1.0, 1.6), "stribeck": _log(rng, 5e-4, 5e-3), "presliding": _log(rng, 3e-7, 3e-6),
        "power": rng.uniform(0.5, 2.0), "viscous": rng.uniform(0.0, 0.3),
    }  # fmt: skip
    return lambda x: (p._replace(friction_kind=kind, coulomb=0.01 * x, **constants), None)


def hysteresis(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    width, power, beta = _log(rng, 0.01, 0.1), rng.uniform(1.0, 2.5), rng.uniform(0.4, 1.0)
    if form == "bouc-wen":
        return lambda x: (p._replace(bouc=min(0.05 * x, 0.8), bouc_power=power, bouc_beta=beta, width=width), None)
    return lambda x: (p._replace(stop=min(0.05 * x, 0.8), width=width), None)


def eddy_current(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    time = _log(rng, 2e-3, 2e-2)
    if form == "half order":
        return lambda x: (p, half_order(1e4 / x**2))
    return lambda x: (p, plate(min(0.2 * x, 20.0) * np.sqrt(1e-3 / time), time, form == "one-sided"))


def amplifier_lag(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    damping, share = rng.uniform(0.45, 0.95), rng.uniform(0.1, 0.4) if form == "pi" else 0.0

    def made(x: Size) -> Made:
        slow = (p.amplifier + 2e-5 * x) / (1 - share)
        return p._replace(rate=2 * damping / slow, damping=damping, zero=share * slow), None

    return made


def amplifier_voltage_limit(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    return lambda x: (p._replace(volts=1.0 / x, soft=form == "soft"), None)


def sensor_resonance(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    rate, damping = 2 * np.pi * _log(rng, 40, 250), _log(rng, 0.01, 0.05)
    two = 0.4 if form == "two modes" else 0.0
    return lambda x: (p._replace(modes=0.01 * x, mode_rate=rate, mode_damping=damping, mode_two=two), None)


def support_resonance(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    rate, damping = 2 * np.pi * _log(rng, 40, 250), _log(rng, 0.01, 0.05)
    two = 0.4 if form == "two modes" else 0.0
    return lambda x: (p._replace(bodies=0.01 * x, body_rate=rate, body_damping=damping, body_two=two), None)


def delay(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    share = 0.5 if form == "jitter" else 0.0
    return lambda x: (p._replace(delay=min(5e-6 * x, 3.3e-5), jitter=share * min(5e-6 * x, 3.3e-5)), None)


def damping(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    part = rng.uniform(0.1, 0.4) if form == "part quadratic" else 0.0
    return lambda x: (p._replace(damper=p.damper + (1 - part) * x, square=part * x / 5e-3), None)


def unknown(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    unit = {"drift": 0.05, "cubic": 1e12, "bent_probe": 500.0, "dropped": 0.02}[form]
    return lambda x: (p._replace(**{form: unit * x}), None)


UNNAMED = ("unknown", "no name", "no name again", "no name thrice")


def no_name(rng: np.random.Generator, p: Plant, form: str) -> Callable[[Size], Made]:
    """Effects that are in no library."""
    if form == "spring_kink":
        at = rng.uniform(-2e-6, 4e-6)
        return lambda x: (p._replace(one_sided=-2e3 * x, kink_at=at), None)
    unit = {"soft_band": 2e-3, "speed_gain": 0.02, "kink": 0.02, "two_tap": 0.05, "square": 200.0, "creep": 500.0,
            "cubic": 1e12, "bent_probe": 500.0, "uneven_band": 4e-3, "one_sided": 2e3, "steep_drag": 1e10,
            "bowl": 0.02, "echo": 0.05, "rippled": 1e-8, "root_drag": 0.05, "half_drag": 0.5, "probe_kink": 0.005,
            "weak_pull": 1e-3, "fading": 0.01, "slow_amplifier": 0.02}[form]  # fmt: skip
    more = {
        "kink": {"kink_at": rng.uniform(-3e-6, 3e-6)},
        "one_sided": {"kink_at": rng.uniform(0.0, 5e-6)},
        "probe_kink": {"kink_at": rng.uniform(0.0, 4e-6)},
        "echo": {"echo_rate": _log(rng, 100.0, 1500.0)},
    }.get(form, {})
    most = {"speed_gain": 0.6, "two_tap": 0.7, "echo": 0.8, "slow_amplifier": 0.7}.get(form, np.inf)
    return lambda x: (p._replace(**{form: min(unit * x, most)}, **more), None)


DRAWS: dict[str, tuple[Callable, tuple[str, ...]]] = {
    "saturation": (saturation, ("field power", "field tanh", "field arctan", "field clip", "current tanh",
                                "current clip", "command power", "command tanh")),
    "friction": (friction, ("lugre", "dahl", "karnopp", "steep")),
    "hysteresis": (hysteresis, ("bouc-wen", "stops")),
    "eddy_current": (eddy_current, ("half order", "one-sided", "two-sided")),
    "amplifier_lag": (amplifier_lag, ("second order", "pi")),
    "amplifier_voltage_limit": (amplifier_voltage_limit, ("soft", "hard")),
    "sensor_resonance": (sensor_resonance, ("one mode", "two modes")),
    "support_resonance": (support_resonance, ("one mode", "two modes")),
    "delay": (delay, ("jitter",)),
    "damping": (damping, ("part quadratic",)),
    "unknown": (unknown, ("drift", "cubic", "bent_probe", "dropped")),
    "no name": (no_name, ("soft_band", "speed_gain", "kink", "two_tap", "square", "creep", "cubic", "bent_probe")),
    "no name again": (no_name, ("uneven_band", "one_sided", "steep_drag", "bowl", "echo", "rippled", "spring_kink")),
    "no name thrice": (no_name, ("root_drag", "half_drag", "probe_kink", "weak_pull", "fading", "slow_amplifier")),
    "none": (lambda rng, p, form: lambda x: (p, None), ("",)),
}  # fmt: skip
# What may stand beside the truth in an ambiguous answer; of amplifier_lag and delay either one alone.
ALIKE = {"amplifier_lag": ("delay",), "delay": ("amplifier_lag",)}
TOLERANCE = {"mass": 0.005, "gain": 0.05, "stiffness": 0.10, "probe": 0.02, "amplifier": 0.10}
NOISE, FORCE_NOISE, CURRENT_NOISE = 0.5e-6, 5e-3, 2e-3
ONE = 40.0  # chi-square of the gap that a 1 % test of about 150 residuals detects with a power of one half


def rig(springs: bool) -> tuple[Plant, dict[str, float]]:
    """Nominal constants, and the parameters that make the rig of a campaign from hmb_free."""
    if not springs:
        return Plant(), {}
    held = {"mass": 0.92, "support_stiffness": 134.5e3, "support_damping": 10.0}
    return Plant(mass=0.92, spring=134.5e3, damper=10.0), held


def ran(plant: Plant, poles: tuple | None, e, noisy: np.random.Generator | None) -> np.ndarray | None:
    """Displacement, command, current (3, samples) of an experiment; None where the rotor touches."""
    waves = [np.tile(e.waveform(at), e.periods + e.transient_periods) for at in ("force", "current")]
    n = waves[0].size
    rng = noisy or np.random.default_rng(0)
    noise, late = NOISE * rng.standard_normal(n) if noisy else np.zeros(n), rng.uniform(size=n)
    g, out = e.gains, np.zeros((3, n))
    gains = np.array([g.kp, g.ki, g.kd, g.td, g.ti])
    good = simulate(plant, gains, *waves, e.offset, noise, late, *(poles or FLAT), out)
    return out if good and np.isfinite(out).all() else None


class Scale:
    """Sizes of effects on a recording, in units of what is detected beyond what calibration explains."""

    def __init__(self, plain: Plant, e) -> None:
        self.e, self.rest = e, ran(plain, None, e, None)
        self.last = tuple(self.rest.shape[1] - n * e.samples_per_period for n in (1, 2))
        moved = (plain._replace(**{k: getattr(plain, k) * (1 + sd)}) for k, sd in TOLERANCE.items())
        self.columns = np.stack([self.seen(ran(one, None, e, None)) for one in moved], axis=1)

    def seen(self, run: np.ndarray) -> np.ndarray:
        """Whitened real lines of what a run changes."""
        e = self.e
        change = (run - self.rest)[:, -e.periods * e.samples_per_period :]
        lines = np.fft.rfft(change)[[0, 2], : 250 * e.periods : e.periods] / change.shape[1]
        sd = np.array([np.hypot(NOISE, FORCE_NOISE * 1e-5), CURRENT_NOISE]) / np.sqrt(2 * change.shape[1])
        return np.concatenate([(part / sd[:, None]).ravel() for part in (lines.real, lines.imag)])

    def __call__(self, made: Made) -> float:
        """Size of an effect; inf where the rotor touches, or rings on so that no period equals the one before."""
        if (run := ran(*made, self.e, None)) is None:
            return np.inf
        last, before = (run[0, k : k + self.e.samples_per_period] for k in self.last)
        if np.std(last - before) > NOISE and not made[0].dropped:
            return np.inf
        c, j = self.seen(run), self.columns
        explained = (j.T @ c) @ np.linalg.solve(j.T @ j + np.eye(j.shape[1]), j.T @ c)
        return float(np.sqrt(max(c @ c - explained, 0.0) / ONE))


def sized(form: Callable[[Size], Made], scale: Scale, wanted: float) -> tuple[Made, float]:
    """The effect at about a wanted size, by bisection; the largest at which the rotor floats where it cannot be had."""
    low, high, best = 1e-2, 1e3, None
    for _ in range(8):
        middle = np.sqrt(low * high)
        found = scale(form(middle))
        if found <= 1.3 * wanted and (best is None or found >= best[1]):
            best = form(middle), found
        low, high = (low, middle) if found > wanted else (middle, high)
    if best is None:
        raise ValueError("no size of this effect lets the rotor float")
    return best


def make(folder: Path, seed: int, effect: str, form: str) -> None:
    """Write one campaign and its truth.json."""
    from maglev_env.design.protocols import diagnosis_campaign
    from maglev_env.kernel.simulate import simulate_records
    from maglev_env.loop.effect import NO_EFFECTS
    from maglev_env.recordings.campaign_writer import write_campaign
    from maglev_env.recordings.recording import simulated_recording
    from maglev_env.rig.excitation import Excitation
    from maglev_env.rig.rig import with_parameters
    from maglev_env.rig.rig_file import load_rig

    rng = np.random.default_rng([23, seed])
    springs = bool(rng.integers(2))
    nominal, parameters = rig(springs)
    preset = with_parameters(load_rig("hmb_free"), parameters)
    push, inject = (1.5 if springs else 0.4), 0.1
    parts = (
        Excitation("sphs", "force", 8.0, tuple(range(1, 42)), push),
        Excitation("sphs", "current", 8.0, (43, 51, 65, 79, 99, 127, 161, 205), inject),
    )
    preset = replace(preset, protocol=replace(preset.protocol, excitations=parts))
    plan = diagnosis_campaign(preset, preset.gains, NO_EFFECTS, seed)
    chosen = [row for row in plan if row.name in ("base", "half", "holdout")]
    rows = [(r.name, r.role, replace(r.experiment, periods=4, transient_periods=4)) for r in chosen]
    off = {k: getattr(nominal, k) * (1 + sd * rng.standard_normal()) for k, sd in TOLERANCE.items()}
    true = nominal._replace(**off)
    wanted = _log(rng, 3.0, 100.0)
    made, size = (true, None), 0.0
    if effect != "none":
        scale = Scale(true, rows[0][2])
        for _ in range(20):
            drawn = DRAWS[effect][0](rng, true, form)
            try:
                made, size = sized(drawn, scale, wanted)
                break
            except ValueError:
                continue
    written = []
    for name, role, e in rows:
        log = ran(*made, e, rng)
        if log is None:
            raise ValueError(f"{folder}: the rotor touches in {name}")
        dataset = simulated_recording(e, simulate_records([e])[0])
        n = log.shape[1]
        log[2] += CURRENT_NOISE * rng.standard_normal(n)
        force = np.tile(e.waveform("force"), e.periods + e.transient_periods) + FORCE_NOISE * rng.standard_normal(n)
        for channel, values in zip(("displacement", "command", "current", "force"), (*log, force), strict=True):
            dataset[channel].values[:] = values
        kept = ["displacement", "command", "current", "injection", "force"]
        written.append((name, role, dataset[[c for c in kept if c in dataset]], e))
    write_campaign(folder, "hmb_free", parameters, written)
    constants = {k: v for k, v in made[0]._asdict().items() if v != getattr(nominal, k)}
    truth = {"effect": effect, "form": form, "size": size, "springs": springs, "constants": constants}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1, default=float))


ANSWER = """
import json, sys, time
from sim2real.diagnosis import diagnose
begun = time.process_time()
d = diagnose(sys.argv[1])
which = [(list(e.effects), e.probability) for e in d.which[:5]]
json.dump({"verdict": d.verdict, "cause": d.cause, "cpu": time.process_time() - begun, "which": which,
           "after": d.gap.after}, open(sys.argv[2], "w"))
"""


def outcome(truth: dict, verdict: str, cause: Sequence[str]) -> str:
    """right (named alone), ambiguous (it is an alternative), unexplained, missed, wrong, false alarm or clear."""
    effect = truth["effect"]
    if effect == "none":
        return {"no_gap": "clear", "unexplained": "false alarm"}.get(verdict, "false alarm")
    if effect in UNNAMED:
        return {"unexplained": "flagged", "no_gap": "missed"}.get(verdict, "wrong")
    if verdict in ("no_gap", "unexplained"):
        return {"no_gap": "missed"}.get(verdict, verdict)
    named = [{part} for part in cause] if verdict == "explained" else [set(c.split("+")) for c in cause]
    if verdict == "explained" and tuple(cause) == (effect,):
        return "right"
    rest = [n for n in named if not n & {effect, *ALIKE.get(effect, ())}]
    if verdict == "ambiguous" and {effect} in named:
        return "right" if not rest and all(len(n) == 1 for n in named) else "ambiguous"
    if verdict == "explained" and effect in cause:
        return "spurious second"
    return "ambiguous" if any(effect in n for n in named) and verdict == "ambiguous" else "wrong"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["make", "answer", "table"])
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--as", dest="name", default="answer")
    parser.add_argument("--misses", action="store_true", help="list every campaign that is not right")
    options = parser.parse_args()
    if options.what == "make":
        cases = [(effect, form) for effect, (_, forms) in DRAWS.items() for form in forms]
        cases = [case for case in cases if not options.only or case[0] in options.only]
        for n in range(options.count):
            folder = options.out / f"{n:03d}"
            if not (folder / "truth.json").exists():
                make(folder, 1000 * options.seed + n, *cases[n % len(cases)])
                truth = json.loads((folder / "truth.json").read_text())
                print(folder, truth["effect"], truth["form"], f"{truth['size']:.1f}", flush=True)
        return
    folders = sorted(p.parent for p in options.out.glob("*/truth.json"))
    if options.what == "answer":
        for folder in folders:
            target = folder / f"{options.name}.json"
            if not target.exists():
                environment = os.environ | {"PYTHONPATH": str(options.tree), "OPENBLAS_NUM_THREADS": "1"}
                command = [sys.executable, "-c", ANSWER, str(folder), str(target)]
                subprocess.run(command, env=environment, cwd=options.tree, check=True)
        return
    names = sorted({p.stem for f in folders for p in f.glob("*.json")} - {"truth"})
    for name in names:
        count: dict[str, Counter[str]] = {}
        cpu = []
        for folder in folders:
            if (folder / f"{name}.json").exists():
                truth, answer = (json.loads((folder / f"{k}.json").read_text()) for k in ("truth", name))
                found = outcome(truth, answer["verdict"], answer["cause"])
                count.setdefault(truth["effect"], Counter())[found] += 1
                cpu.append(answer["cpu"])
                if options.misses and found not in ("right", "clear", "flagged"):
                    top = ", ".join(f"{'+'.join(e)} {p:.2f}" for e, p in answer["which"][:4])
                    print(name, folder.name, truth["effect"], truth["form"], f"{truth['size']:.1f}", found, "|", top)
        total = sum((c for e, c in count.items() if e not in ("none", *UNNAMED)), Counter())
        print(f"{name}: singles {dict(total)} of {total.total()}; median {np.median(cpu):.1f} s of processor")
        for effect, own in count.items():
            print(f"  {effect}: {dict(own)}")


if __name__ == "__main__":
    main()
