"""What `maglev diagnose` says of single effects that are large, and of none, in recordings of any excitation.

    python tests/tools/single_effects.py OUT [--count 30] [--seed 1] [--tree TREE] [--only 3 7] [--again]

Campaigns are those of the benchmark's generator (docs/benchmark.md), a fifth of them without an effect, the others with
one of 10 to 100 thresholds; their recordings are noise, chirps, steps, one sine, hover, and a few multisines. What a
rig cannot show at ten thresholds is left out. OUT/cNNNN.json keeps each answer, so a run that was stopped continues.

Each campaign is one of: named, ambiguous (the effect is in the class), abstained (unexplained), missed (no gap), beside
(it, and another one that is not there), wrong, clear (no gap where there is none), false alarm, refused, traceback.
"""

import argparse
import json
import os
import subprocess
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from sim2real.blind.benchmark import generate
from sim2real.blind.benchmark.drives import Drive, draw_drive
from sim2real.blind.benchmark.generate import plan
from sim2real.blind.benchmark.rigs import BenchRig, log_uniform

LEAST = 10.0  # thresholds
RECIPES = (
    ("noise", "steps", "chirp"),
    ("chirp", "noise", "steps"),
    ("steps", "chirp", "noise"),
    ("chirp", "sine", "noise"),
    ("noise", "hover", "steps"),
    ("multisine", "chirp", "noise"),
)
GOOD = ("named", "ambiguous", "clear")
OF_A_BALL = {"negative_stiffness": "force_law"}  # one mechanism below a single magnet


def drawn(shape: str, rig: BenchRig, forced: bool, level: float, rng: np.random.Generator) -> Drive:
    """A drive of the benchmark, or one sine within the loop's bandwidth."""
    if shape != "sine":
        return draw_drive(shape, rig, forced, level, rng)
    drive = draw_drive("chirp", rig, forced, level, rng)
    frequency = rig.bandwidth / (2 * np.pi) * log_uniform(rng, 0.2, 1.0)
    turns = frequency * np.arange(drive.wave.size) / rig.parameters["control_rate"]
    return replace(drive, shape=shape, wave=np.abs(drive.wave).max() * np.sin(2 * np.pi * turns))


def answered(folder: Path, tree: Path) -> dict:
    """What `maglev diagnose` of a tree says of a campaign."""
    path = os.pathsep.join([str(tree), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "160"}
    out, begun = folder.with_suffix(".found"), time.time()
    command = ["maglev", "diagnose", str(folder), "--out", str(out), "--json", str(out / "answer.json")]
    out.mkdir(exist_ok=True)
    done = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, timeout=3600)
    found = {"seconds": time.time() - begun, "said": done.stdout + done.stderr, "verdict": "refused", "cause": []}
    if done.returncode == 0:
        answer = json.loads((out / "answer.json").read_text())
        found |= {key: answer[key] for key in ("verdict", "cause")}
    return found


def outcome(truth: set[str], found: dict) -> str:
    verdict, cause = found["verdict"], [{OF_A_BALL.get(n, n) for n in c.split("+")} for c in found["cause"]]
    truth = {OF_A_BALL.get(name, name) for name in truth}
    if verdict == "refused":
        return "traceback" if "Traceback" in found["said"] else "refused"
    if verdict == "unexplained":
        return "abstained" if truth else "false alarm"
    if verdict == "no_gap":
        return "missed" if truth else "clear"
    if not truth:
        return "false alarm"
    if verdict == "ambiguous":
        return "ambiguous" if truth in cause else "wrong"
    named = set().union(*cause)
    return "named" if named == truth else "beside" if truth & named else "wrong"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[2])
    parser.add_argument("--only", nargs="*", type=int, default=[])
    parser.add_argument("--again", action="store_true", help="forget earlier answers")
    options = parser.parse_args()
    options.out = options.out.resolve()  # the command runs in the tree, not here
    options.out.mkdir(parents=True, exist_ok=True)
    generate.SHARES, generate.SIZES, generate.RECIPES = {"none": 0.2}, (LEAST, 100.0), RECIPES
    generate.draw_drive = drawn
    count: Counter[str] = Counter()
    for case in sorted(plan(options.count, options.seed), key=lambda case: case.number):
        if options.only and case.number not in options.only:
            continue
        folder = options.out / f"c{case.number:04d}"
        labelled, kept = folder.with_suffix(".label"), folder.with_suffix(".json")
        if not labelled.exists():
            label = generate._produce(case, options.out, options.seed, False)
            labelled.write_text(json.dumps(label, indent=1))
        label = json.loads(labelled.read_text())
        if label["sizes"] and label["sizes"][0] < LEAST:
            continue
        if options.again or not kept.exists():
            kept.write_text(json.dumps(answered(folder, options.tree.resolve()), indent=1))
        found = json.loads(kept.read_text())
        result = outcome(set(label["effects"]), found)
        count[result] += 1
        what = f"{','.join(label['effects']) or 'none'} {label['sizes']}"
        print(
            f"{folder.name}  {label['rig']:6} {label['channels']:12} {what:40} {result:12} {found['cause']}", flush=True
        )
    total = sum(count.values())
    print(f"{total} campaigns: {dict(count)}; right {sum(count[k] for k in GOOD) / max(total, 1):.0%}")


if __name__ == "__main__":
    main()
