"""Goals of ten kinds, and the rigs on which they are stated."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy
from exhaustive import axes_of, worst

from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import engineer
from maglev_env.rig.goal import QUANTITIES, parse_goal
from maglev_env.rig.rig_file import load_rig
from maglev_env.task.task import make_task
from tuning.learned.worlds import drawn_effect

sys.path += [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "hidden_campaigns")]
import draws  # rigs as another hand describes them
from shares import wilson  # noqa: F401  of the tables

RIGS = ("hmb_free", "ball", "eframe", "pair")  # of one axis: the reference closes one loop at a time
FULL = ("ball",)  # rigs for which the quick protocol has no line low enough
ANCHORS = 512  # gain sets among which one is drawn, by what it reaches limits are stated
SOUND = {"peak_sensitivity": 2.6, "phase_margin": 32.0, "gain_margin": 1.7}  # what such a set reaches at least
CREST = 1.15  # of a peak current beyond what the linear loop says of it, by saturation and the largest of the noise
TIGHT, LOOSE = 0.97, 1.3  # factors of what it reaches, between which a limit is drawn
# What is asked for: = as it is stated, ~ drawn at what one set reaches, * as in the goal `engineer` of the rig.
KINDS = {
    "zone A, least noise": ("peak_sensitivity = 3", "best noise_current"),
    "stiffest within a current": (
        "peak_sensitivity = 3", "noise_current ~", "impulse_displacement ~", "current_peak ~", "best stiffness",
    ),
    "engineer": (),
    "disk margin, least compliance": ("disk_margin ~", "noise_current ~", "best compliance"),
    "damped, largest disk margin": ("damping ~", "compliance ~", "best disk_margin"),
    "least current": ("phase_margin = 30", "compliance ~", "best current_rms"),
    "quiet, most phase": ("noise_current ~", "impulse_displacement ~", "best phase_margin"),
    "fastest recovery": ("peak_sensitivity = 3", "phase_margin = 30", "noise_current ~", "best recovery_time"),
    "stiff and damped, least |S|": ("stiffness ~", "damping ~", "best peak_sensitivity"),
    "gain margin, most damping": ("gain_margin ~", "noise_current ~", "best damping"),
}  # fmt: skip


def nominal(name, rng, folder):
    """The rig that an engineer describes, and the range in which the real one is drawn."""
    if name not in ("ball", "pair"):
        return load_rig(name), "wide"
    toml = draws.ball(rng)[1] if name == "ball" else draws.pair(rng, False)[1]
    path = folder / f"{name}.toml"
    path.write_text(toml)
    return load_rig(path), "tolerances"


def case(seed, kind, index, folder):
    """A task with its goal and an episode of it; every other rig has an effect that the tuner is not told."""
    rng = np.random.default_rng([877, seed, list(KINDS).index(kind), index])
    name = RIGS[index % len(RIGS)]
    protocol = "full" if name in FULL else "quick"
    rig, spread = nominal(name, rng, folder)
    rig = with_defaults(rig)
    asked = {r.name: r for r in engineer(rig).measured}
    every = [r.text for r in asked.values() if r.name != "lift_off_time"]
    more = ("disk_margin >= 0.1", "stiffness >= 1", "damping >= 0.001", "current_rms <= 100", "current_peak <= 100")
    task = make_task(rig, randomization=spread, goal=", ".join([*every, *more]), protocol=protocol)
    episode = task.draw(rng)
    effects = drawn_effect(episode.rig, rng) if (index // len(RIGS) + index + list(KINDS).index(kind)) % 2 else {}
    episode = replace(episode, rig=replace(episode.rig, effects={**episode.rig.effects, **effects}))
    text = "engineer" if kind == "engineer" else stated(kind, task, episode, asked, rng)
    task = make_task(rig, randomization=spread, goal=text, protocol=protocol)
    # The limits are those of the goal, on whichever rig.
    target = replace(episode.rig.target, goal=task.rig.target.goal)
    return task, replace(episode, rig=replace(episode.rig, target=target), target=task.target), name, list(effects)


def stated(kind, task, episode, asked, rng):
    """The text of a goal whose limits are what some sound gain set of the real rig reaches, or a little less."""
    any_of = [
        r if r.name == "recovery_time" else replace(r, limit=1e9 if r.quantity.most else 1e-9)
        for r in task.layout.goal.requirements
    ]
    loose = replace(task.layout.goal, requirements=tuple(any_of))
    points = 2 * scipy.stats.qmc.Sobol(len(task.box.names), seed=rng).random(ANCHORS) - 1
    values = worst(axes_of(task, episode, loose), task.box.gains(points))
    sound = np.isfinite(values["recovery_time"])
    for name, limit in SOUND.items():
        better = values[name] < limit if QUANTITIES[name].most else values[name] > limit
        sound = sound & better if (sound & better).any() else sound
    anchor = rng.choice(np.flatnonzero(sound))
    out = []
    for one in KINDS[kind]:
        words = one.split()
        quantity = words[1] if words[0] == "best" else words[0]
        value, most = float(values[quantity][anchor]), QUANTITIES[quantity].most
        at = f" after {asked[quantity].size:.6g}" if QUANTITIES[quantity].event in ("impulse", "step") else ""
        if words[0] == "best":
            least = asked["recovery_time"].limit / 10 if quantity == "recovery_time" else 0.0
            out.append(f"best {quantity} near {max(value, least):.3g}{at}")
        elif words[1] == "=":
            out.append(f"{quantity} {'<=' if most else '>='} {words[2]}")
        else:
            value *= CREST if quantity == "current_peak" else 1.0
            factor = float(np.exp(rng.uniform(np.log(TIGHT), np.log(LOOSE))))
            out.append(f"{quantity} {'<=' if most else '>='} {value * factor if most else value / factor:.3g}{at}")
    text = ", ".join(out)
    parse_goal(text)
    return text
