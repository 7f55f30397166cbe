"""Rigs hidden behind `maglev tune --campaign`: it proposes, another integrator records, and its claims are judged.

    python tests/tools/hidden_campaigns.py OUT [--count 15] [--seed 1] [--tree TREE]
    python tests/tools/hidden_campaigns.py OUT --read

OUT/000 .. hold the campaign, what was said after each recording, and judged.json: whether the rotor touched down, and
each requirement's claimed interval beside what the hidden rig does. Laws and equations are written from textbooks; only
the goal's grammar is the product's. What a rig deviates by lies within its stated tolerances, except for one effect.
"""

import argparse
import json
import os
import subprocess
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import numba
import numpy as np
import scipy

from maglev_env.rig.goal import parse_goal

G, MOST = 9.80665, 8  # m/s2; recordings of a campaign
SUB = 8  # steps of the integrator in a tick
EFFECTS = ("none", "gain", "delay", "lag", "eddy", "friction", "saturation", "voltage", "second body", "probe")


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


def truth(hidden, gains, block, goal, rng):
    """What the hidden rig does at gains: values of the goal's quantities by name."""
    force, injection, lines = waves(block, hidden)
    n = force.size
    rows, _ = sent(hidden, gains, np.tile(force, 4), np.tile(injection, 4))
    spectrum = [np.fft.rfft(x[-n:]) for x in (rows[1], rows[3])]
    at = lines["current"]
    f = at / (n * hidden.dt)
    s = spectrum[0][at] / np.fft.rfft(injection)[at]
    fine = np.exp(np.linspace(np.log(f[0]), np.log(f[-1]), 20_000))
    loop = scipy.interpolate.CubicSpline(np.log(f), 1 / s - 1)(np.log(fine))
    size, angle = np.abs(loop), np.angle(-loop)
    unit = np.flatnonzero(np.diff(np.sign(size - 1)))
    real = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0))
    factors = [max(size[k], 1 / size[k]) for k in real] + [size[0]]
    push = lines["force"]
    hold = np.sinc(push / n)  # the force is held for a tick
    found = {
        "peak_sensitivity": float(np.abs(1 / (1 + loop)).max()),
        "phase_margin": float(np.degrees(min(abs(angle[unit]), default=np.pi))),
        "gain_margin": float(min(factors)),
        "disk_margin": float(1 / np.abs(1 / (1 + loop) - 0.5).max()),
        "compliance": float(np.abs(spectrum[1][push] / np.fft.rfft(force)[push] / hold).max()),
    }
    still = np.zeros(round(2.0 / hidden.dt))
    hidden = replace(hidden, noise=(hidden.noise[0], 0.0, 0.0))  # of the current itself, not of its meter
    hover, _ = sent(hidden, gains, still, still, rng)
    found["noise_current"] = float(hover[2][still.size // 4 :].std())
    middle = hover[0][still.size // 4 :].mean()
    for r in goal.measured:
        kind = r.quantity.event
        if kind not in ("impulse", "step", "lift_off"):
            continue
        span = round((0.5 if kind == "impulse" else 3 * r.limit) / hidden.dt)
        push, quiet = np.zeros(span), round(0.5 / hidden.dt)
        if kind == "impulse":
            push[0] = r.size / hidden.dt
        if kind == "step":
            push[:] = r.size
        push = push if kind == "lift_off" else np.concatenate([np.zeros(quiet), push])
        lying = {"start": r.size if hidden.law == 0 else -r.size, "held": 100} if kind == "lift_off" else {}
        rows, down = sent(hidden, gains, push, np.zeros(push.size), rng, **lying)
        y = rows[0][push.size - span :] - middle
        if kind == "impulse":
            found[r.name] = np.inf if down else float(np.abs(y).max())
            continue
        width = max(1, round(r.limit / 30 / hidden.dt))
        calm = scipy.ndimage.uniform_filter1d(hover[0][still.size // 4 :] - middle, width).std()
        y = scipy.ndimage.uniform_filter1d(y, width, mode="nearest")
        end = y[-max(1, int(0.2 * y.size)) :].mean()
        near = max(0.1 * np.abs(y).max(), 0.01 * hidden.clearance, 5 * calm)
        out = np.flatnonzero(np.abs(y - end) > near)
        found[r.name] = np.inf if down else float((out[-1] + 1) * hidden.dt) if out.size else 0.0
    return found


def pair(rng, small):
    """A pair of magnets: `hmb_free` as it is described, or a new one of 1 to 6 kg with default gains."""
    if small:
        mass, gain, stiffness, clearance, dt, lag, probe = 0.08012, 5.7, -12.5e3, 0.35e-3, 5e-5, 1e-4, 1.6e-5
        # The permanent magnets' reluctance acts as a wider gap.
        noise, gap, spread, toml = (0.5e-6, 2e-3, 5e-3), 0.6e-3, (0.005, 0.05, 0.1, 0.02), None
    else:
        mass, gap, dt = float(rng.uniform(1, 6)), float(rng.uniform(0.3e-3, 0.6e-3)), float(rng.choice([2e-4, 1e-4]))
        bias, clearance, lag, probe = float(rng.uniform(1.5, 4)), 0.5 * gap, float(rng.uniform(1e-4, 3e-4)), 2e-5
        rate = float(rng.uniform(250, 450))  # 1/s, of the fall
        stiffness, noise, spread = -mass * rate**2, (0.3e-6, 5e-3, 0.02 * mass), (0.002, 0.05, 0.05, 0.01)
        gain = -stiffness * gap / bias
        toml = f"""schema = "maglev-rig/1"
name = "pair"
magnet = "electromagnet_pair"
[parameters]
mass = {mass}
gap = {gap}
clearance = {clearance}
turns = 100
pole_area = {gain * gap**2 / (bias * 4e-7 * np.pi * 1e4)}
bias_current = {bias}
actuator_gain = {gain}
negative_stiffness = {stiffness}
amplifier_time_constant = {lag}
sensor_time_constant = {probe}
probe_gain = 20000.0
adc_bits = 0
dac_bits = 0
control_rate = {1 / dt}
gravity = 0.0
[noise]
displacement = {noise[0]}
current = {noise[1]}
force = {noise[2]}
[tolerance]
mass = {spread[0]}
actuator_gain = {spread[1]}
negative_stiffness = {spread[2]}
probe_gain = {spread[3]}
amplifier_time_constant = 0.1
"""
    m, k, s, c = (1 + w * float(np.clip(rng.standard_normal(), -2, 2)) for w in spread)
    bias = -s * stiffness * gap / (k * gain)
    constants = (k * gain * gap**2 / (4 * bias), gap, bias)
    lag *= 1 + 0.1 * float(rng.standard_normal())
    hidden = Hidden(dt, m * mass, 0, constants, 0.0, 0.0, 0.0, clearance, lag, probe, noise, scale=c)
    return hidden, toml, bias


def ball(rng):
    """A ball below a coil of an exponential law; its engineer describes the tangent of the nominal one."""
    mass, gap = float(rng.uniform(0.015, 0.12)), float(rng.uniform(6e-3, 14e-3))
    length, rest, dt = float(rng.uniform(6e-3, 14e-3)), float(rng.uniform(0.5, 1.5)), float(rng.choice([1e-3, 5e-4]))
    gain, stiffness, wide = 2 * mass * G / rest, -mass * G / length, 2 * length
    lag, probe, noise = 1.5 * dt, 3e-4, (float(rng.uniform(2e-6, 6e-6)), 2e-3, 0.01 * mass)
    spread = (0.002, 0.04, 0.04, 0.01)
    toml = f"""schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
[parameters]
mass = {mass}
gap = {wide}
clearance = {0.6 * gap}
turns = 1000
pole_area = {4 * mass * G * wide**2 / (rest**2 * 4e-7 * np.pi * 1e6)!r}
bias_current = {rest}
actuator_gain = {gain}
negative_stiffness = {stiffness}
amplifier_time_constant = {lag}
sensor_time_constant = {probe}
probe_gain = 1000.0
adc_bits = 0
dac_bits = 0
control_rate = {1 / dt}
[noise]
displacement = {noise[0]}
current = {noise[1]}
force = {noise[2]}
[tolerance]
mass = {spread[0]}
actuator_gain = {spread[1]}
negative_stiffness = {spread[2]}
probe_gain = {spread[3]}
amplifier_time_constant = 0.1
"""
    m, k, s, c = (1 + w * float(np.clip(rng.standard_normal(), -2, 2)) for w in spread)
    own, weight = length / s, m * mass * G
    true_rest = 2 * weight / (k * gain)  # the gain of i^2 is 2 F / i
    constants = (weight / true_rest**2 * np.exp(gap / own), gap, own)
    lag *= 1 + 0.1 * float(rng.standard_normal())
    hidden = Hidden(
        dt, m * mass, 1, constants, weight, true_rest, rest, 0.6 * gap, lag, probe, noise, scale=c
    )  # fmt: skip
    return hidden, toml, rest


def disturbed(hidden, effect, rng, bias):
    """The rig with an effect of a size that is plain beside the noise."""
    h, share = dict(vars(hidden)), float(rng.uniform(0.6, 1.4))
    fall = np.sqrt(abs(stiffness_of(hidden)) / hidden.mass)  # 1/s
    if effect == "gain":
        up = 1 + 0.13 * share * float(rng.choice([-1, 1]))
        h["constants"] = (h["constants"][0] * (up**2 if h["law"] else up), *h["constants"][1:])
        h["rest"] = h["rest"] / up if h["law"] else h["rest"]
    if effect == "delay":
        h["late"] = max(1, round(0.05 * share / fall / h["dt"] * SUB))
    if effect == "lag":
        h["probe"] = h["probe"] + 0.04 * share / fall
    if effect == "eddy":
        h["eddy"] = (0.25 * share, 0.2 / fall)
    if effect == "friction":
        h["friction"] = 0.004 * share * h["mass"] * G
    if effect == "saturation":
        h["saturation"] = 3.5 * share * (h["rest"] or bias)
        if h["law"]:
            h["rest"] = h["saturation"] * np.arctanh(min(0.99, h["rest"] / h["saturation"]))
    if effect == "voltage":
        h["rate"] = (h["rest"] or bias) * fall * 6 * share
    if effect == "second body":
        second, mode = 0.15 * share * h["mass"], 2 * np.pi * fall * float(rng.uniform(0.6, 1.2))
        h["body"] = (second, second * mode**2, 2 * 0.03 * second * mode)
    if effect == "probe":
        h["bend"] = 0.25 * share / h["clearance"]
    return Hidden(**h)


def stiffness_of(h):
    p = h.numbers()
    return (pull(p, 1e-7, h.rest) - pull(p, -1e-7, h.rest)) / 2e-7


def drawn(seed, index):
    """A hidden rig, its rig.toml (None: hmb_free), its effect and its goal."""
    rng = np.random.default_rng([541, seed, index])
    kind = ("hmb_free", "ball", "pair")[index % 3]
    effect = EFFECTS[(index // 3 + 3 * (index % 3) + seed) % len(EFFECTS)]
    hidden, toml, bias = ball(rng) if kind == "ball" else pair(rng, kind == "hmb_free")
    hidden = disturbed(hidden, effect, rng, bias)
    return hidden, toml, f"{kind}, {effect}"


def campaign(folder, seed, index, tree):
    """One campaign to its end."""
    hidden, toml, name = drawn(seed, index)
    rng = np.random.default_rng([7, seed, index])
    folder.mkdir(parents=True, exist_ok=True)
    if toml:
        (folder / "rig.toml").write_text(toml)
    text = f'schema = "maglev-campaign/1"\nrig = "{"rig.toml" if toml else "hmb_free"}"\n'
    (folder / "campaign.toml").write_text(text)
    downs, block, first = 0, None, None
    for turn in range(MOST + 2):
        data = folder / f"said{turn}.json"
        environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            ["maglev", "tune", "--campaign", folder, "--goal", "engineer", "--budget", str(MOST), "--json", data],
            env=environment, capture_output=True, text=True,
        )  # fmt: skip
        (folder / f"said{turn}.txt").write_text(done.stdout + done.stderr)
        if done.returncode:
            return {"name": name, "error": done.stderr[-300:]}
        said = json.loads(data.read_text())
        if said["stop"]:
            break
        block = tomllib.loads((folder / "tune" / "next.toml").read_text())["recording"][0]
        first = first or block
        downs += record(folder, hidden, block, rng)
        text += "\n" + (folder / "tune" / "next.toml").read_text()
        (folder / "campaign.toml").write_text(text)
    row = {"name": name, "stop": said["stop"], "recordings": turn, "touchdowns": downs, "notes": said["notes"]}
    if said["keep"] is None:
        return row | {"kept": False}
    goal = parse_goal(said["made_by"]["goal"])
    own = truth(hidden, said["keep"], first, goal, rng)
    claim, rows = said["claim"], {}
    for r in goal.measured:
        v, true = claim["values"][r.name], own[r.name]
        met = true <= r.limit if r.quantity.most else true >= r.limit
        inside = v["low"] <= true <= v["high"] if None not in (v["low"], v["high"]) else None
        rows[r.name] = {
            "limit": r.limit, "claim": [v["value"], v["low"], v["high"]], "true": true, "met": bool(met), "in": inside,
        }  # fmt: skip
    return row | {"kept": True, "missed": claim["missed"], "unsure": claim["unsure"], "values": rows}


def shown(row):
    if "error" in row or not row["kept"]:
        return f"{row['name']:24} {row.get('error') or row['stop']}"
    values = row["values"].items()
    missed = [n for n, v in values if not v["met"]]
    out = [f"{n} {v['claim'][1]:.3g}..{v['claim'][2]:.3g} true {v['true']:.3g}" for n, v in values if v["in"] is False]
    return (
        f"{row['name']:24} {row['recordings']} recordings, {row['touchdowns']} touchdowns; truly missed "
        f"{', '.join(missed) or 'nothing'} (claimed {', '.join(row['missed']) or 'nothing'}); in interval "
        f"{sum(v['in'] is not False for _, v in values)} of {len(values)}; {'; '.join(out)}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--read", action="store_true")
    options = parser.parse_args()
    rows = []
    for index in range(options.count):
        folder = options.out / f"{index:03d}"
        path = folder / "judged.json"
        if not path.exists():
            if options.read:
                continue
            row = campaign(folder, options.seed, index, options.tree.resolve())
            path.write_text(json.dumps(row, indent=1))
        rows.append(json.loads(path.read_text()))
        print(f"{index:03d} {shown(rows[-1])}", flush=True)
    kept = [r for r in rows if r.get("kept")]
    every = [v for r in kept for v in r["values"].values() if v["in"] is not None]
    if kept:
        met = sum(all(v["met"] for v in r["values"].values()) for r in kept)
        print(
            f"{len(rows)} cases, {len(kept)} kept gains; truly met {met}; in interval "
            f"{sum(v['in'] for v in every)} of {len(every)}; recordings median "
            f"{np.median([r['recordings'] for r in kept]):g}; touchdowns {sum(r.get('touchdowns', 0) for r in rows)}"
        )


if __name__ == "__main__":
    main()
