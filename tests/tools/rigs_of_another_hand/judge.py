"""Run `maglev diagnose` on sealed campaigns and open the envelopes.

    python tests/tools/rigs_of_another_hand/judge.py OUT [--tree TREE] [--only 000 003] [--again]

OUT/NNN/verdict.json keeps each answer, so a run that was stopped continues. Each campaign is one of: named (the effect
alone, or with the law), beside (it, and another one that is not there), ambiguous (it is among the alternatives),
abstained (unexplained, or what acts before the current is said not to show), refused (in words), missed ("no gap", or
the law alone), wrong (another cause), false alarm (a cause where there is none), clear (no cause, none named),
traceback, or form (no effect is there, and the law is named or among the alternatives: every ball is pulled by an
exponential, and a square is stated, so that is true). A weighed mass must never be named.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

GOOD = ("named", "ambiguous", "abstained", "clear", "form")


def outcome(truth: dict, verdict: str, cause: list[str], unseen: list[str]) -> str:
    right = set(truth["right"])
    if verdict == "unexplained":
        return "abstained"
    if not right:
        return "clear" if verdict == "no_gap" else "form" if "force_law" in cause else "false alarm"
    if right <= set(unseen) and set(cause) <= {"force_law"}:
        return "abstained"
    if verdict == "no_gap" or (cause == ["force_law"] and "force_law" not in right):
        return "missed"
    named = {name for c in cause for name in c.split("+")}
    if not right & named:
        return "wrong"
    if verdict != "explained":
        return "ambiguous"
    return "named" if named <= right | {"force_law"} else "beside"


def diagnosed(folder: Path, tree: Path) -> dict:
    environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "160"}
    began = time.time()
    command = ["maglev", "diagnose", str(folder), "--out", str(folder / "diagnosis"), "--json", str(folder / "d.json")]
    done = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, timeout=3600)
    found = {"seconds": time.time() - began, "code": done.returncode, "said": (done.stdout + done.stderr)[:3000]}
    if done.returncode == 0:
        answer = json.loads((folder / "d.json").read_text())
        gap = {k: answer["gap"].get(k) for k in ("before", "after", "closed_fraction")}
        found |= {"gap": gap, "which": answer["which"][:4]} | {k: answer[k] for k in ("verdict", "cause", "unseen")}
    else:
        found |= {"verdict": "unexplained", "cause": [], "refused": True}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[3])
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--again", action="store_true", help="forget earlier answers")
    options = parser.parse_args()
    count: Counter[str] = Counter()
    masses, slow = [], []
    for folder in sorted(p.parent for p in options.out.glob("*/truth.json")):
        if options.only and folder.name not in options.only:
            continue
        kept = folder / "verdict.json"
        if options.again or not kept.exists():
            kept.write_text(json.dumps(diagnosed(folder, options.tree.resolve()), indent=1))
        found, truth = json.loads(kept.read_text()), json.loads((folder / "truth.json").read_text())
        result = outcome(truth, found["verdict"], found["cause"], found.get("unseen", []))
        if found.get("refused"):
            result = "traceback" if "Traceback" in found["said"] else "refused"
        count[result] += 1
        if any("mass" in c.split("+") for c in found["cause"]):
            masses.append(folder.name)
        slow.append(found["seconds"])
        case = f"{folder.name}  {truth['effect']:16} {truth['size']:+.3g}"
        first = found["said"].splitlines()[0][:110] if found["said"] else ""
        print(f"{case}  {result:12} {found['cause']} {found['seconds']:.0f} s {first}", flush=True)
    total = sum(count.values())
    good = sum(count[k] for k in (*GOOD, "refused"))
    share = good / max(total, 1)
    print(f"{total} campaigns: {dict(count)}; right or rightly abstained {share:.0%}; mass named in {masses}")
    print(
        f"seconds: median {sorted(slow)[len(slow) // 2]:.0f}, most {max(slow):.0f}" if slow else "none", file=sys.stderr
    )


if __name__ == "__main__":
    main()
