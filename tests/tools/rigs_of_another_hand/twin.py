"""Sealed campaigns of a suspended ball: random ball, law, controller, channels and records, with at most one effect.

    python tests/tools/rigs_of_another_hand/twin.py OUT [--count 60] [--seed 1]
    python tests/tools/rigs_of_another_hand/judge.py OUT [--tree TREE]

OUT/000 .. hold data files, rig.toml, campaign.toml and truth.json. What the engineer writes is right except for the
effect: the mass is weighed to 0.2 %, every other parameter is known to its tolerance and drawn within it.
"""

import argparse
import json
from dataclasses import dataclass, replace
from functools import partial
from math import exp
from pathlib import Path

import excite
import numpy as np
from bench import Bench, run
from physics import GRAVITY, Body, CurrentDrive, VoltageDrive, exponential, slopes
from regulators import Cascade, Pid
from rigs import Record, Rig, hanging, pole_area
from write import run_all, write_campaign

# What a diagnosis may call each truth; everything else but an abstention is wrong.
RIGHT = {
    "none": (),
    "actuator_gain": ("actuator_gain",),
    "sensor_gain": ("sensor_gain",),
    "delay": ("delay",),
    "amplifier_lag": ("amplifier_lag",),
    "sensor_lag": ("sensor_lag",),
    "damping": ("damping",),
    "friction": ("friction",),
    "law": ("negative_stiffness", "force_law"),
    "actuator_offset": ("actuator_offset",),
}
SPREAD = 0.03  # tolerance of gain and stiffness


@dataclass(frozen=True)
class Draw:
    """Nominal values of one campaign: kg, m, m, A, s, and whether a cascade holds the ball."""

    mass: float
    gap: float
    length: float
    rest: float
    dt: float
    cascade: bool


def drawn(rng: np.random.Generator) -> Draw:
    cascade = bool(rng.random() < 0.35)
    gap = rng.uniform(5e-3, 12e-3)
    dt = float(rng.choice([5e-3, 4e-3])) if cascade else float(rng.choice([1e-3, 5e-4]))
    return Draw(
        round(float(rng.uniform(0.015, 0.12)), 4), round(gap, 4), round(float(rng.uniform(6e-3, 14e-3)), 4),
        round(float(rng.uniform(0.5, 1.5)), 3), dt, cascade,
    )  # fmt: skip


def size_of(effect: str, d: Draw, rng: np.random.Generator) -> float:
    """A size that is plain beside the noise of most records: relative, s, N s/m, N or A."""
    pole = (GRAVITY / d.length) ** 0.5
    low, high = {
        "none": (1.0, 1.0),
        "actuator_gain": (0.12, 0.3),
        "sensor_gain": (0.12, 0.3),
        "law": (0.15, 0.35),
        "delay": (0.4, 1.0),
        "amplifier_lag": (0.4, 1.0),
        "sensor_lag": (0.4, 1.0),
        "damping": (0.1, 0.3),
        "friction": (0.003, 0.01),
        "actuator_offset": (0.04, 0.1),
    }[effect]
    share = float(rng.uniform(low, high))
    sign = float(rng.choice([-1.0, 1.0])) if effect in ("actuator_gain", "sensor_gain", "actuator_offset") else 1.0
    unit = {
        "delay": 0.08 / pole,
        "amplifier_lag": 0.08 / pole,
        "sensor_lag": 0.08 / pole,
        "damping": d.mass * pole,
        "friction": d.mass * GRAVITY,
        "actuator_offset": d.rest,
    }.get(effect, 1.0)
    return sign * share * unit


def campaign(seed: int, effect: str | None = None) -> tuple[Rig, tuple[str, ...]]:
    """A rig with its records, and the channels that its campaign uses."""
    rng = np.random.default_rng([77, seed])
    d = drawn(rng)
    effect = effect or str(rng.choice(list(RIGHT), p=[0.25, *[0.75 / (len(RIGHT) - 1)] * (len(RIGHT) - 1)]))
    size = size_of(effect, d, rng)
    top = 2 * d.mass * GRAVITY * d.length * exp(d.gap / d.length) / d.rest**2
    nominal = exponential(top, d.gap, d.length)
    length = d.length / (1 + size if effect == "law" else 1 + SPREAD * rng.standard_normal())
    stronger = 1 + SPREAD * rng.standard_normal()
    law = exponential(stronger**2 * top * length / d.length * exp(d.gap / length - d.gap / d.length), d.gap, length)
    mass = d.mass * (1 + 0.002 * rng.standard_normal())
    gain = 1 + size if effect == "actuator_gain" else 1.0
    offset = size if effect == "actuator_offset" else 0.0
    pull = law
    if offset:
        law = lambda y, i: pull(y, i + offset)  # noqa: E731
    body = Body(mass, law, damping=size if effect == "damping" else 0.0, friction=size if effect == "friction" else 0.0)
    pole = (GRAVITY / d.length) ** 0.5
    base = 0.4 * top
    drive = (
        VoltageDrive(3.0, base, top, d.gap, d.length, (-30.0, 30.0), gain)
        if d.cascade
        else CurrentDrive(1.5 * d.dt + (size if effect == "amplifier_lag" else 0.0), gain)
    )
    if d.cascade and effect == "amplifier_lag":
        effect, size = "none", 1.0  # a cascade's inner loop hides it
    reading = 1 + size if effect == "sensor_gain" else 1.0
    bench = Bench(
        body,
        drive,
        d.dt,
        hanging(lambda y, i: law(y, i * gain), mass),
        noise=float(rng.uniform(2e-6, 8e-6)),
        step=20e-3 / 4096,
        command_step=(60.0 if d.cascade else 6.0) / 4096,
        sensor_lag=0.3e-3 + (size if effect == "sensor_lag" else 0.0),
        delay=size if effect == "delay" else 0.0,
        substeps=20 if d.cascade else 5,
        stops=(-0.9 * d.gap - 3e-3, 0.8 * d.gap),
        reading=reading,
        jitter=float(rng.choice([0.0, 0.0, 0.01])),
        meter_lag=float(rng.choice([0.0, d.dt])),
        meter_scale=0.01 * rng.standard_normal(),
        meter_noise=2e-3,
        meter_step=4.0 / 4096,
    )
    wanted = pole * (2.2 if d.cascade else 2.6)
    k_i, k = slopes(nominal, d.rest)
    kp, kd = (d.mass * wanted**2 - k) / k_i, 1.5 * d.mass * wanted / k_i

    def controller(stiffer: float) -> Pid | Cascade:
        outer = Pid(kp * stiffer, 0.4 * kp * pole, kd * stiffer, 0.0 if d.cascade else 4 * d.dt, d.dt)
        inductance = base + top * exp(-d.gap / d.length)
        return Cascade(outer, 0.6 * inductance / d.dt, 0.15 * inductance / d.dt**2, d.rest) if d.cascade else outer

    n = round(float(rng.uniform(12.0, 25.0)) / d.dt)
    records = []
    for index in range(4):
        stiff = partial(controller, float(rng.choice([1.0, 1.15])))
        kind = str(rng.choice(["steps", "chirp", "noise", "sine"])) if index < 3 else "steps"
        move = float(rng.uniform(0.1e-3, 0.3e-3))
        reference = set_points(kind, rng, n, d.dt, move, pole)
        records.append(Record(f"run{index}", kind, stiff, reference, role="holdout" if index == 3 else "fit"))
    law_gap = 2 * d.length
    toml = f"""schema = "maglev-rig/1"
name = "ball"
magnet = "electromagnet"
axes = 1

[parameters]
mass = {d.mass}
gap = {law_gap}
clearance = {min(d.gap, law_gap)}
turns = 1000
pole_area = {pole_area(d.mass, d.rest, law_gap, 1000)!r}
bias_current = {d.rest}
actuator_gain = {k_i!r}
negative_stiffness = {k!r}
coil_inductance = {base + top * exp(-d.gap / d.length):.6g}
coil_resistance = 3.0
amplifier_gain = 0.3
amplifier_time_constant = {1.5 * d.dt:g}
sensor_time_constant = 3e-4
probe_gain = 1000.0
adc_bits = 12
dac_bits = 12
control_rate = {1 / d.dt:g}

[noise]
displacement = {bench.noise}
current = 2e-3

[tolerance]
mass = 0.002
actuator_gain = {SPREAD}
negative_stiffness = {SPREAD}
amplifier_time_constant = 0.1
"""
    truth = {
        "effect": effect,
        "size": size,
        "right": RIGHT[effect],
        "mass_kg": mass,
        "cascade": d.cascade,
        "kinds": [r.kind for r in records],
        "slopes": slopes(lambda y, i: law(y, i * gain), bench.rest),
        "nominal": {"rest_current_A": d.rest},
        "meter_lag_s": bench.meter_lag,
        "jitter": bench.jitter,
    }
    chain = {"scale_tolerance": 0.01, "offset_tolerance": 0.02}
    if bench.meter_lag:
        chain["filter"] = [1 / (2 * np.pi * bench.meter_lag)]
    rig = Rig(
        "twin", bench, records, toml, truth, {"ending": "csv", "separator": ";", "decimal": ",", "preamble": []},
        {
            "time": ("t", 1.0, 0.0, 6),
            "reference": ("ref_mm", -1e-3, d.gap, 5),
            "displacement": ("pos_mm", -1e-3, d.gap, 5),
            "current": ("i_A", 1.0, -d.rest, 5),
            "voltage": ("u_V", 1.0, 0.0, 5),
            "command": ("iref_A", 1.0, -d.rest, 5),
        },
        chain={"current": chain},
    )  # fmt: skip
    use = (
        ("time", "displacement", "current", "reference")
        if d.cascade
        else ("time", "displacement", "command", "reference")
    )
    if not d.cascade and rng.random() < 0.5:
        use = (*use, "current")
    return rig, use


def set_points(kind: str, rng: np.random.Generator, n: int, dt: float, move: float, pole: float) -> np.ndarray:
    """A reference (n,) of a kind, m; its rates follow the fall's (pole, 1/s)."""
    if kind == "steps":
        return excite.steps(rng, n, dt, move, 12 / pole)
    if kind == "chirp":
        return excite.chirp(n, dt, move, 0.3, 0.5 * pole)
    if kind == "noise":
        return excite.band_noise(rng, n, dt, 0.5 * move, 0.4 * pole)
    return excite.sine(n, dt, move, 0.1 * pole)


def holds(rig: Rig) -> bool:
    """Whether every record's loop keeps the ball within 1.5 mm for its first 3 s."""
    for record in rig.records:
        few = record.reference[: round(3.0 / rig.bench.dt)]
        try:
            log = run(replace(rig.bench, substeps=5), record.controller(), few, None, np.random.default_rng(1))
        except (OverflowError, ValueError):  # it flew out of every law
            return False
        if not np.abs(log["true"]).max() < 1.5e-3:
            return False
    return True


def recorded(seed: int, index: int) -> tuple[Rig, tuple[str, ...], dict[str, dict[str, np.ndarray]]]:
    """The first campaign, from a seed on, whose loops keep the ball to the end, and its logs."""
    while True:
        rig, use = campaign(seed)
        if holds(rig):
            try:
                return rig, use, run_all(rig, index)
            except (OverflowError, ValueError):  # it flew out of every law after the first seconds
                pass
        seed += 100_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    for index in range(options.count):
        folder = options.out / f"{index:03d}"
        if not (folder / "truth.json").exists():
            rig, use, logs = recorded(1000 * options.seed + index, index)
            write_campaign(folder, rig, use, logs, gains="command" in use)
            print(folder, json.loads((folder / "truth.json").read_text())["effect"], flush=True)


if __name__ == "__main__":
    main()
