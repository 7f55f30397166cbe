"""Whether intervals of the pooled estimate hold the truth, on many short draws of a bench.

    python tests/tools/rigs_of_another_hand/cover.py OUT.jsonl --variant A A-free [--count 30] [--first 0] [--seconds 8]
    python tests/tools/rigs_of_another_hand/cover.py OUT.jsonl

A draw varies what the engineer knows to a tolerance: mass, gain, stiffness, the amplifier's lag, the meter's scale.
Each line of OUT.jsonl is one draw and variant; a run that was stopped continues. At the end, or without a variant, the
table of z = (value - truth) / se: mean, standard deviation, share within 95 %, and how often a coefficient is not
bounded; then the share within 95 % by each recording alone, which is by each kind of excitation.
"""

import argparse
import json
import tempfile
import time
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np
from make import VARIANTS
from physics import CurrentDrive, Law, slopes
from rigs import RIGS, Rig, hanging
from write import run_all, write_campaign

from sim2real.pooled import pooled
from sim2real.recorded.records import read_records

KEPT = {
    "A": ("steps", "chirp", "sine", "hover"),
    "B": ("escalon", "chirp", "senoidal", "reposo"),
    "D": ("noise1", "noise2", "noise3"),
    "C": ("run1", "run2", "run3"),
}
SECONDS = {"A": 8.0, "B": 20.0, "C": 20.0, "D": 1.5}
SPREAD = 0.05  # of gain and stiffness


def drawn(letter: str, seed: int, seconds: float) -> Rig:
    """A bench whose truth differs from what is stated as the tolerances say."""
    rng = np.random.default_rng([31, ord(letter), seed])
    rig = RIGS[letter]("none", seed=1000 + seed, seconds=seconds)
    bench, body = rig.bench, rig.bench.body
    stronger, steeper = 1 + SPREAD * rng.standard_normal(2)

    def law(y: float, i: float, of: Law = body.law) -> float:
        return stronger * of(steeper * y, i)

    mass = body.mass * (1 + 0.002 * rng.standard_normal())
    rest = hanging(law, mass) if body.hangs else 0.0
    drive = bench.drive
    if isinstance(drive, CurrentDrive):
        drive = replace(drive, lag=drive.lag * (1 + 0.2 * rng.uniform(-1, 1)))
    scale = 0.01 * rng.standard_normal() if bench.meter_scale else 0.0
    bench = replace(bench, body=replace(body, mass=mass, law=law), rest=rest, drive=drive, meter_scale=scale)
    gain, stiffness = slopes(law, rest)
    truth = {**rig.truth, "actuator_gain": gain, "negative_stiffness": stiffness, "damping": 0.0, "delay": 0.0}
    return replace(rig, bench=bench, truth=truth, records=[r for r in rig.records if r.name in KEPT[letter]])


def fell(rig: Rig, logs: dict[str, dict[str, np.ndarray]]) -> bool:
    """Whether the drawn bench did not hold its own body, so that a record shows none that floats."""
    low, high = rig.bench.stops
    return any(log["true"].min() <= low or log["true"].max() >= high for log in logs.values())


def answer(folder: Path, truth: dict) -> dict:
    began = time.process_time()
    try:
        found = pooled([r for r in read_records(folder)[1] if r.role == "fit"])
    except ValueError as error:
        return {"refused": str(error)}
    except Exception:  # what no user should see
        return {"crashed": traceback.format_exc()}
    z = {
        c.name: [c.value, c.se, truth[c.name], c.bounded, (c.value - truth[c.name]) / c.se if c.se else 0.0]
        for c in found.coefficients
    }
    rest = {c.name: (c.value - truth[c.name]) / c.se for c in found.of_each.get("means and weight", ())}
    own = {
        name: {c.name: [c.value, c.se, truth[c.name], c.identified] for c in each}
        for name, each in found.of_each.items()
    }
    return {
        "z": z, "rest": rest, "misfit": found.misfit, "said": found.disagreements, "own": own,
        "cpu": time.process_time() - began,
    }  # fmt: skip


def table(lines: list[dict]) -> None:
    for variant in dict.fromkeys(line["variant"] for line in lines):
        own = [line for line in lines if line["variant"] == variant]
        good = [line for line in own if "z" in line]
        refused = [line.get("refused", line.get("crashed")) for line in own if "z" not in line]
        print(f"{variant}: {len(own)} draws, {len(refused)} refused {set(refused)}")
        if not good:
            continue
        said = sum(bool(line["said"]) for line in good)
        misfit, cpu = (np.median([line[key] for line in good]) for key in ("misfit", "cpu"))
        print(f"  misfit {misfit:.2f}; {said} with disagreements; {cpu:.0f} s of processor each")
        for name in good[0]["z"]:
            rows = [line["z"][name] for line in good]
            z = np.array([r[4] for r in rows if r[3]])
            unbounded = sum(not r[3] for r in rows)
            if z.size:
                error = np.array([(r[0] - r[2]) for r in rows if r[3]]) / (abs(rows[0][2]) or 1.0)
                se = np.median([r[1] / (abs(r[2]) or 1.0) for r in rows if r[3]])
                print(
                    f"  {name:18} z {z.mean():+6.2f} sd {z.std(ddof=1):5.2f} cover95 {np.mean(abs(z) < 1.96):4.0%}"
                    f"  error {error.mean():+.2g} sd {error.std(ddof=1):.2g}  se {se:.2g}  not bounded {unbounded}"
                )
            else:
                print(f"  {name:18} never bounded")
        for record in dict.fromkeys(r for line in good for r in line["own"] if r != "means and weight"):
            rows = [line["own"][record] for line in good if record in line["own"]]
            shares = []
            for name in rows[0]:
                z = np.array([(r[name][0] - r[name][2]) / r[name][1] for r in rows if r[name][3] and r[name][1]])
                within = f"{np.mean(abs(z) < 1.96):.0%} of {z.size}" if z.size else "never identified"
                shares.append(f"{name} {within}")
            print(f"  {record}: {', '.join(shares)}; used in {len(rows)} of {len(good)}")
        for name in good[0]["rest"]:
            z = np.array([line["rest"][name] for line in good if name in line["rest"]])
            print(f"  at rest: {name} z {z.mean():+.2f} sd {z.std(ddof=1):.2f} cover95 {np.mean(abs(z) < 1.96):.0%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--variant", nargs="*", default=[], choices=list(VARIANTS))
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    lines = [json.loads(text) for text in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {(line["variant"], line["draw"]) for line in lines}
    letters = sorted({v[0] for v in options.variant})
    for draw in range(options.first, options.first + options.count):
        for letter in letters:
            variants = [v for v in options.variant if v[0] == letter and (v, draw) not in done]
            if not variants:
                continue
            rig = drawn(letter, draw, options.seconds or SECONDS[letter])
            logs = run_all(rig, draw)
            for name in variants:
                v = VARIANTS[name]
                found = {"refused": "the bench itself lets its body fall"}
                if not fell(rig, logs):
                    with tempfile.TemporaryDirectory() as folder:
                        write_campaign(Path(folder), v.of(rig), v.use, logs, v.gains)
                        found = answer(Path(folder), rig.truth)
                lines.append({"variant": name, "draw": draw, **found})
                with options.out.open("a") as file:
                    file.write(json.dumps(lines[-1], default=float) + "\n")
                print(name, draw, lines[-1].get("z", lines[-1]), flush=True)
    table(lines)


if __name__ == "__main__":
    main()
