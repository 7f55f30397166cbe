"""Run `maglev estimate` and `diagnose` on the campaigns of `make.py` and set what they say beside the truth.

    python tests/tools/rigs_of_another_hand/table.py OUT [--only A-none ...] [--tree TREE] [--again] [--read]

OUT/NAME/out keeps what was said, so a run that was stopped continues; --read runs nothing.
"""

import argparse
import json
import os
import subprocess
import time
from pathlib import Path

TRUE = {"actuator_gain": "actuator_gain_N_per_A", "negative_stiffness": "negative_stiffness_N_per_m",
        "damping": "damping_N_s_per_m"}  # fmt: skip


def said(folder: Path, command: str, tree: Path, again: bool) -> tuple[str, dict | None]:
    """What a command prints, and its JSON; with a last line of its seconds."""
    out = folder / "out"
    out.mkdir(exist_ok=True)
    text, data = out / f"{command}.txt", out / f"{command}.json"
    if again or not text.exists():
        data.unlink(missing_ok=True)
        environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "160"}
        page = out / ("diagnosis" if command == "diagnose" else f"{command}.html")
        began = time.time()
        done = subprocess.run(
            ["maglev", command, str(folder), "--out", str(page), "--json", str(data)],
            env=environment, cwd=tree, capture_output=True, text=True, timeout=3600,
        )  # fmt: skip
        text.write_text(f"{done.stdout}{done.stderr}\n({done.returncode}, {time.time() - began:.0f} s)\n")
    return text.read_text(), json.loads(data.read_text()) if data.exists() else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--command", nargs="*", default=["estimate", "diagnose"])
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[3])
    parser.add_argument("--again", action="store_true", help="forget earlier answers")
    parser.add_argument("--read", action="store_true", help="only those that are answered")
    options = parser.parse_args()
    for folder in sorted(p.parent for p in options.out.glob("*/truth.json")):
        if options.only and folder.name not in options.only:
            continue
        truth = json.loads((folder / "truth.json").read_text())
        for command in options.command:
            if options.read and not (folder / "out" / f"{command}.txt").exists():
                continue
            text, data = said(folder, command, options.tree.resolve(), options.again)
            lines = text.strip().splitlines()
            print(f"{folder.name:16} {command} {lines[-1]}", end="  ")
            if command == "diagnose":
                print(lines[0][:150], flush=True)
                continue
            if data is None or "pooled" not in data:
                print(lines[0][:200] if data is None else "nothing pooled", flush=True)
                continue
            print(f"misfit {data['pooled']['misfit']:.2f}")
            for c in data["pooled"]["coefficients"]:
                true = truth.get(TRUE.get(c["name"], ""), truth.get("delay_s"))
                z = (c["value"] - true) / c["se"] if c["se"] else 0.0
                inside = "not bounded" if c["interval"] is None else "inside" if abs(z) < 1.96 else "OUTSIDE"
                print(
                    f"      {c['name']:18} {c['value']:10.5g} +- {c['se']:8.2g}  true {true:10.5g}  {z:+7.1f} {inside}"
                )
            for line in data["pooled"]["disagreements"]:
                print("      says:", line)


if __name__ == "__main__":
    main()
