"""Goals of ten kinds on drawn rigs: what the default tuner reaches, beside an exhaustive search that is told the rig.

    python tests/tools/ten_goals/run.py OUT [--rigs 4] [--seed 1] [--first 0] [--only K:I ...] [--read]

Each kind of goal is stated on as many rigs: hmb_free and eframe drawn wide, balls and pairs described by another hand
and drawn within tolerance, every other with an effect of which the tuner knows nothing. It makes ten experiments and
recommends; the reference computes some 7000 gain sets of the true rig's linear loop, corrects by 72 experiments, and is
judged under the same noise. OUT keeps each case, so a run that was stopped continues. The table: requirements met,
unmeetable (every set of the search misses by 1 % or more, also of 576 whose experiments are simulated, or a bound of
linear controllers says so), undecided (the search finds none, and is not as sure), or missed (it finds one). Then what
is made best within 3 % of the reference's, whose requirements are met to the edge, or with 4 % to spare, as much as the
score keeps; and the score within 3 % of the reference's best.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from kinds import KINDS, RIGS, case, wilson
from reference import is_met, misses, reference

from maglev_env.loop.gains import of_axis
from tuning.lockstep import side_by_side
from tuning.methods import DEFAULT, make_tuner
from tuning.reference.reference import limits_of
from tuning.study.recommendation import judged_again, recommend

BUDGET, NEAR = 10, 0.03
SURELY = 0.01  # by which every set of the search misses a limit where a goal counts as unmeetable


def told(task, goal, verdict):
    """What is kept of a verdict."""
    if verdict is None:
        return None
    gains = dict(zip(task.box.names, map(float, task.box.gains(verdict.point)), strict=True))
    reached = {r.name: verdict.required.get(f"required_{r.name}") for r in goal.measured}
    return {
        "gains": gains, "reached": reached, "score": verdict.score, "reason": verdict.reason,
        "met": bool(is_met(goal, verdict)), "point": verdict.point.tolist(),
    }  # fmt: skip


def answered(seed, kind, index, folder):
    task, episode, name, effects = case(seed, kind, index, folder)
    goal, row = task.layout.goal, {"kind": kind, "index": index, "rig": name, "effects": effects}
    row |= {"goal": goal.text}
    start = replace(episode, start=task.box.point(of_axis(task.rig.gains, 0)))
    began = time.perf_counter()
    tuner = make_tuner(DEFAULT, task, start, 1000 * seed + index, BUDGET)
    trials = side_by_side(task, [start], [tuner], BUDGET, threads=1)[0]
    advice = recommend(task, start, trials, seed)
    chosen = advice.chosen and judged_again(task, start, advice.chosen.point, seed)
    row |= {"tuner": told(task, goal, advice.chosen), "refused": [v.reason for v in advice.refused]}
    row |= {"same noise": told(task, goal, chosen), "trials": [float(s) for s in trials.score]}
    row |= {"touchdowns": int(trials.touchdown.sum()), "tuner seconds": time.perf_counter() - began}
    began = time.perf_counter()
    found = reference(task, episode, seed)
    row |= {name: told(task, goal, getattr(found, name)) for name in ("best", "reserved", "scored")}
    bounds = limits_of(task, episode) if found.best is None else {}
    row["proved"] = [r.name for r in goal.requirements if r.name in bounds and (
        misses(r.name, r.limit, np.array(bounds[r.name])) > 0)]  # fmt: skip
    return row | {"miss": found.least_miss, "tried": found.tried, "reference seconds": time.perf_counter() - began}


def outcome(row, of="best"):
    """Whether all is met, missed, unmeetable by the search, or undecided; and what is made best beside the reference's.

    That is the logarithm of its ratio, above 0 where it is better.

    of: "best" of the reference's sets that meet every requirement, or "reserved", of those with some to spare.
    """
    best, own = row[of], row["same noise"]
    if own is None or not own["met"]:
        if row["best"]:
            return "missed", None
        return ("unmeetable" if row["proved"] or row["miss"] > SURELY else "undecided"), None
    if best is None:
        return "met", None
    name = row["goal"].split("best ")[1].split(" ")[0].rstrip(",")
    gained = [misses(name, 1.0, np.array(one["reached"][name])) for one in (best, own)]
    return "met", float(gained[0] - gained[1])


def counted(rows):
    """The columns of the table."""
    every = [outcome(row) for row in rows]
    reached = [g for _, g in every if g is not None]
    alike = [g for _, g in (outcome(row, "reserved") for row in rows) if g is not None]
    scored = [(r["same noise"], r["scored"]) for r in rows if r["scored"]["reason"] is None]
    near = sum(bool(own) and own["score"] >= (1 - NEAR) * ref["score"] for own, ref in scored)
    return (
        *(sum(o == name for o, _ in every) for name in ("met", "unmeetable", "undecided", "missed")),
        wilson(sum(o in ("met", "unmeetable") for o, _ in every), len(rows)),
        wilson(sum(g >= -NEAR for g in reached), len(reached)), wilson(sum(g >= -NEAR for g in alike), len(alike)),
        wilson(near, len(scored)), sum(r["touchdowns"] for r in rows),
    )  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[], metavar="K:I", help="number of a kind, and of a rig")
    parser.add_argument("--read", action="store_true")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for index in range(options.first, options.first + options.rigs):
        for k, kind in enumerate(KINDS):
            if options.only and f"{k}:{index}" not in options.only:
                continue
            path = options.out / f"{options.seed}-{k}-{index}.json"
            if not path.exists() and not options.read:
                path.write_text(json.dumps(answered(options.seed, kind, index, options.out)))
            if not path.exists():
                continue
            rows.append(row := json.loads(path.read_text()))
            result, gained = outcome(row)
            shown = "" if gained is None else f" {gained:+.1%}"
            scores = [one["score"] if one else 0.0 for one in (row["same noise"], row["scored"])]
            seconds = row["tuner seconds"], row["reference seconds"]
            print(
                f"{path.stem} {row['rig']} {','.join(row['effects'])}: {result}{shown}; score {scores[0]:.3f} of "
                f"{scores[1]:.3f}; {seconds[0]:.0f} and {seconds[1]:.0f} s", flush=True,
            )  # fmt: skip
    head = (
        "met", "unmeetable", "undecided", "missed", "met or unmeetable", "best within 3 %", "of that with 4 % to spare",
        "score within 3 %", "touchdowns",
    )  # fmt: skip
    print("|  | " + " | ".join(head) + " |\n" + "|---" * (len(head) + 1) + "|")
    for what, of in (("kind", KINDS), ("rig", RIGS)):
        for name in of:
            if some := [row for row in rows if row[what] == name]:
                print(f"| {name} | " + " | ".join(map(str, counted(some))) + " |")
    if rows:
        print("| all | " + " | ".join(map(str, counted(rows))) + " |")


if __name__ == "__main__":
    main()
