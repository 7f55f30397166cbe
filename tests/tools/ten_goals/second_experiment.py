"""What the default tuner's second experiment loses against the preset, its first, under each single effect.

    python tests/tools/ten_goals/second_experiment.py OUT.jsonl [--rigs 4] [--seed 1] [--goals match engineer]

The rigs are those of run.py, all drawn within tolerance, so that a preset which suits is there to be lost. Each effect
of the sealed twins' menu acts alone, in a size drawn over the menu's whole range (in proportion to the rig where its
bounds are, and nearer to its small end where the preset itself does not hold); the tuner is not told. Both sets are
measured again under the same fresh noise. OUT.jsonl keeps each case, so a run that was stopped continues.
"""

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from kinds import FULL, RIGS, nominal, wilson

from maglev_env.design.defaults import with_defaults
from maglev_env.loop.card import SMALL_ROTOR
from maglev_env.loop.effect import EFFECTS, check_effects, effect, meaningful
from maglev_env.loop.gains import of_axis
from maglev_env.task.task import make_task
from sim2real.blind.menu import EFFECTS as MENU
from tuning.lockstep import rescored, side_by_side
from tuning.methods import DEFAULT, make_tuner

LOST = 0.05
TRIES = 5  # sizes, each nearer to the small end


def sized(name, rig, rng):
    """Sizes of an effect, the first drawn from the menu's range, the others nearer to its small end."""
    menu, card = MENU[name], EFFECTS[name]
    share, sign = rng.uniform(), float(rng.choice([-1, 1])) if menu.low else 1.0
    others = {k: v for k, v in menu.others(rng).items() if k in card.parameters and k not in card.shapes}
    first = menu.parameter if menu.parameter in card.parameters else next(iter(card.parameters))
    per = card.parameters[first].per
    unit = rig.scales.of(per) / SMALL_ROTOR.of(per)
    for turn in range(TRIES):
        size = menu.start * (menu.high / menu.start) ** (share * (1 - turn / TRIES))
        if sign < 0:
            size = min(size, abs(menu.low))
        try:
            made = effect(name, **{**others, first: sign * size**menu.power * unit})
            check_effects(made, rig)
        except ValueError:
            continue
        yield made


def answered(name, index, goal, seed, folder):
    rng = np.random.default_rng([909, seed, list(MENU).index(name), index])
    rig = with_defaults(nominal(RIGS[index % len(RIGS)], rng, folder)[0])
    row = {"effect": name, "index": index, "goal": goal, "rig": RIGS[index % len(RIGS)]}
    if not meaningful(name, rig.capabilities):
        return row | {"left out": "the rig cannot have it"}
    task = make_task(
        rig, randomization="tolerances", goal=goal, protocol="full" if RIGS[index % len(RIGS)] in FULL else "quick"
    )
    drawn = task.draw(rng)
    preset = task.box.point(of_axis(task.rig.gains, 0))
    for made in sized(name, drawn.rig, rng):
        episode = replace(drawn, rig=replace(drawn.rig, effects={**drawn.rig.effects, **made}), start=preset)
        first = float(rescored(task, [episode], preset[None], seed, 1)[0])
        if first > 0:
            break
    else:
        return row | {"left out": "the preset does not hold"}
    tuner = make_tuner(DEFAULT, task, episode, seed + index, 10)
    trials = side_by_side(task, [episode], [tuner], 2, threads=1)[0]
    second = float(rescored(task, [episode], trials.points[1:], seed, 1)[0])
    return row | {"size": made[name], "first": first, "second": second, "down": int(trials.touchdown.sum())}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--rigs", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--goals", nargs="*", default=["match", "engineer"])
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.out.read_text().splitlines()] if options.out.exists() else []
    done = {(r["effect"], r["index"], r["goal"]) for r in rows}
    with tempfile.TemporaryDirectory() as folder:
        for index in range(options.first, options.first + options.rigs):
            for name in MENU:
                for goal in options.goals:
                    if (name, index, goal) in done:
                        continue
                    rows.append(answered(name, index, goal, options.seed, Path(folder)))
                    with options.out.open("a") as file:
                        file.write(json.dumps(rows[-1]) + "\n")
                    print(rows[-1], flush=True)
    for goal in options.goals:
        own = [r for r in rows if r["goal"] == goal and "first" in r]
        lost = [r for r in own if r["second"] < r["first"] - LOST]
        print(f"{goal}: not below by more than {LOST}: {wilson(len(own) - len(lost), len(own))}; touchdowns "
              f"{sum(r['down'] for r in own)}; left out {sum(r['goal'] == goal for r in rows) - len(own)}")  # fmt: skip
        for r in sorted(lost, key=lambda r: r["second"] - r["first"]):
            print(f"  {r['effect']} on {r['rig']} {r['index']}: {r['first']:.3f} to {r['second']:.3f} {r['size']}")


if __name__ == "__main__":
    main()
