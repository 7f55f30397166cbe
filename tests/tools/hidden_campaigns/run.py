"""Rigs hidden behind `maglev tune --campaign`: it proposes, another integrator records, and its claims are judged.

    python tests/tools/hidden_campaigns/run.py OUT [--count 15] [--seed 1] [--quiet] [--tree TREE] [--again] [--read]

OUT/000 .. hold the campaign, what was said after each recording, and judged.json: whether the rotor touched down, and
each requirement's claimed interval beside what the hidden rig does. --quiet: by the least noise current within margins
and a recovery, instead of `engineer`. --again judges anew what was said; --read shows it.
"""

import argparse
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
from draws import drawn
from rigs import record
from truth import truth

from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import goal_of, with_goal
from maglev_env.rig.goal import QUANTITIES, parse_goal
from maglev_env.rig.rig_file import load_rig

sys.path.append(str(Path(__file__).parents[1]))
from shares import wilson

MOST = 8  # recordings of a campaign


def quiet(source):
    """The least noise current within margins and recovery of `engineer`; its scale is what the default gains make."""
    rig = with_defaults(load_rig(source))
    asked = {r.name: r for r in goal_of(with_goal(rig, "engineer")).requirements}
    own = [asked[name].text for name in ("peak_sensitivity", "phase_margin", "gain_margin", "recovery_time")]
    return ", ".join([*own, f"best noise_current near {rig.noise.displacement * rig.gains.kd / rig.gains.td:.2g}"])


def campaign(folder, seed, index, tree, silent=False):
    """One campaign to its end; its touchdowns, or what went wrong in words."""
    hidden, toml, _ = drawn(seed, index)
    rng = np.random.default_rng([7, seed, index])
    folder.mkdir(parents=True, exist_ok=True)
    if toml:
        (folder / "rig.toml").write_text(toml)
    text = f'schema = "maglev-campaign/1"\nrig = "{"rig.toml" if toml else "hmb_free"}"\n'
    (folder / "campaign.toml").write_text(text)
    goal = quiet(folder / "rig.toml" if toml else "hmb_free") if silent else "engineer"
    downs = 0
    for turn in range(MOST + 2):
        data = folder / f"said{turn}.json"
        environment = os.environ | {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
        done = subprocess.run(
            ["maglev", "tune", "--campaign", folder, "--goal", goal, "--budget", str(MOST), "--json", data],
            env=environment, capture_output=True, text=True,
        )  # fmt: skip
        (folder / f"said{turn}.txt").write_text(done.stdout + done.stderr)
        if done.returncode:
            return done.stderr[-300:]
        if json.loads(data.read_text())["stop"]:
            return downs
        block = tomllib.loads((folder / "tune" / "next.toml").read_text())["recording"][0]
        downs += record(folder, hidden, block, rng)
        text += "\n" + (folder / "tune" / "next.toml").read_text()
        (folder / "campaign.toml").write_text(text)
    return "it never stopped"


def judged(folder, seed, index, downs):
    """The last claim of a campaign beside what its hidden rig does."""
    hidden, _, name = drawn(seed, index)
    turn = max(int(p.stem.removeprefix("said")) for p in folder.glob("said*.json"))
    said = json.loads((folder / f"said{turn}.json").read_text())
    row = {"name": name, "stop": said["stop"], "recordings": turn, "touchdowns": downs, "notes": said["notes"]}
    if said["keep"] is None:
        return row | {"kept": False}
    goal, block = (
        parse_goal(said["made_by"]["goal"]),
        tomllib.loads((folder / "campaign.toml").read_text())["recording"][0],
    )
    own = truth(hidden, said["keep"], block, goal, np.random.default_rng([8, seed, index]))
    claim, values = said["claim"], {}
    for r in goal.measured:
        v, true = claim["values"][r.name], own[r.name]
        met = true <= r.limit if r.quantity.most else true >= r.limit
        inside = v["low"] <= true <= v["high"] if None not in (v["low"], v["high"]) else None
        values[r.name] = {
            "limit": r.limit, "claim": [v["value"], v["low"], v["high"]], "true": true, "met": bool(met), "in": inside,
        }  # fmt: skip
    return row | {"kept": True, "missed": claim["missed"], "unsure": claim["unsure"], "values": values}


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


def counted(rows):
    """What all cases come to: a truth is worse than claimed where it lies beyond the claim's worse end."""
    kept = [r for r in rows if r.get("kept")]
    met = [all(v["met"] for v in r["values"].values()) for r in kept]
    told = [all(v["met"] or n in r["missed"] or n in r["unsure"] for n, v in r["values"].items()) for r in kept]
    every = [(n, v) for r in kept for n, v in r["values"].items() if v["in"] is not None]
    worse = sum(v["true"] > v["claim"][2] if QUANTITIES[n].most else v["true"] < v["claim"][1] for n, v in every)
    return (
        f"{len(rows)} cases, {len(kept)} kept gains, {sum('error' in r for r in rows)} ended in an error; every "
        f"requirement truly met: {wilson(sum(met), len(rows))}; that, or each miss claimed or unsure, or no gains kept "
        f"for a stated reason: {wilson(sum(told) + sum(r.get('kept') is False for r in rows), len(rows))}; truths "
        f"in their interval: {wilson(sum(v['in'] for _, v in every), len(every))}, worse than claimed {worse}; "
        f"recordings, median {np.median([r['recordings'] for r in kept] or [0]):g}; touchdowns "
        f"{sum(r.get('touchdowns', 0) for r in rows)}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quiet", action="store_true")
    parser.add_argument("--tree", type=Path, default=Path(__file__).parents[3])
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--read", action="store_true")
    options = parser.parse_args()
    rows = []
    for index in range(options.count):
        folder = options.out / f"{index:03d}"
        path = folder / "judged.json"
        if options.again and path.exists():
            downs = json.loads(path.read_text()).get("touchdowns", 0)
            path.write_text(json.dumps(judged(folder, options.seed, index, downs), indent=1))
        elif not path.exists() and not options.read:
            end = campaign(folder, options.seed, index, options.tree.resolve(), options.quiet)
            wrong = {"name": drawn(options.seed, index)[2], "error": end}
            row = wrong if isinstance(end, str) else judged(folder, options.seed, index, end)
            path.write_text(json.dumps(row, indent=1))
        if not path.exists():
            continue
        rows.append(json.loads(path.read_text()))
        print(f"{index:03d} {shown(rows[-1])}", flush=True)
    if rows:
        print(counted(rows))


if __name__ == "__main__":
    main()
