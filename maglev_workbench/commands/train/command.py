"""`maglev train`: a policy that tunes rigs it has not seen, trained, judged on rigs kept back, and stored."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.table import Table

from maglev_env.recordings.json_data import plain
from maglev_env.rig.rig import load_rig
from maglev_env.task.task import make_task
from maglev_lanes.code_version import code_version
from maglev_lanes.schedule import workers
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from tuning.comparison.compare import held_out
from tuning.learned.policy import HistoryPolicy, load_policy, save_policy
from tuning.learned.training import Plan, train
from tuning.learned.tuner import LearnedTuner
from tuning.learned.worlds import World
from tuning.lockstep import course, judged, side_by_side
from tuning.study.folder import claim, locked

SCHEMA = "maglev-training/1"
BY = ("imitation", "ppo", "sac")
SPEC, POLICY, GROUPS = "training.json", "policy.npz", "groups"
TASKS = 16  # groups of rigs that differ in their effect, side by side in ppo and sac
EXPERIMENTS = 100_000  # of ppo and sac, where none are asked for
CHECKPOINTS = (1, 2, 3, 5, 10)  # experiments after which a policy is judged


def run(
    rig: str, by: str, protocol: str, rigs: int | None, experiments: int | None, judged: int, init: Path | None,
    seed: int, scheduler: str | None, out: Path | None, json_file: Path | None,
) -> None:  # fmt: skip
    """See `maglev_workbench.cli_tuning.train`."""
    require_folder(json_file, "--json")
    if by not in BY:
        raise ValueError(f"--by {by}: use one of {', '.join(BY)}")
    if init is not None and by == BY[0]:
        raise ValueError("--init: imitation begins anew; leave it out, or use --by ppo or sac")
    if scheduler is not None and by != BY[0]:
        raise ValueError("--scheduler: only imitation is spread over workers")
    if rigs is not None and by != BY[0]:
        raise ValueError(f"--rigs: of imitation; {by} draws as many as --experiments take")
    if experiments is not None and by == BY[0]:
        raise ValueError("--experiments: of ppo and sac; imitation takes --rigs")
    rigs, experiments = rigs or Plan().rigs, experiments or EXPERIMENTS
    world = World(load_rig(rig), protocol)
    world.task()  # says what is wrong with it before any work
    plan = Plan(rigs=rigs)
    begun = None if init is None else load_policy(init)[0]
    if by != BY[0]:
        from tuning.learned.reinforcement import check_training

        check_training([world.task()], by, experiments, begun)
    folder = out or Path(f"train-{world.rig.name}")
    made_by: dict[str, Any] = {
        "schema": SCHEMA, "version": code_version(), "by": by, "seed": seed,
        "world": plain(asdict(world)), "plan": asdict(plan) if by == "imitation" else {"experiments": experiments},
        "init": None if init is None else str(init),
    }  # fmt: skip
    started = perf_counter()
    with locked(folder, "another process trains there; wait, or choose another folder"):
        claim(folder / SPEC, made_by, "training")
        (folder / GROUPS).mkdir(exist_ok=True)
        with workers(scheduler) as spread, progress_bar() as bar:
            total = rigs if by == "imitation" else experiments
            line = bar.add_task("train", total=total)

            def advance(text: str, count: int) -> None:
                bar.update(line, advance=count, description=text)

            try:
                if by == "imitation":
                    policy, log = train(world.draw, plan, seed, folder / GROUPS, advance, spread)
                else:
                    policy, log = _reinforced(world, by, experiments, seed, begun, advance)
            except KeyboardInterrupt:
                if by == BY[0]:
                    console.print(f"stopped; finished groups of rigs are in {folder}: run it again to go on")
                raise
        found = judge(world, policy, judged, seed)
        seconds = perf_counter() - started
        amount = (
            f"--rigs {rigs}" if by == BY[0] else f"--experiments {experiments}" + (f" --init {init}" if init else "")
        )
        command = f"maglev train --rig {rig} --by {by} --protocol {protocol} {amount} --seed {seed}"
        save_policy(folder / POLICY, policy, {**made_by, "held_out": found, "command": command})
    data = {"schema": SCHEMA, "made_by": made_by, "log": log, "held_out": found, "seconds": seconds}
    write_json(folder / "train.json", data)
    write_json(json_file, data)
    console.print(_table(found, judged))
    console.print(f"{seconds:.0f} s\npolicy  {folder / POLICY}")


def _reinforced(
    world: World, by: str, experiments: int, seed: int, init: HistoryPolicy | None, advance: Callable[[str, int], None]
) -> tuple[HistoryPolicy, list[dict[str, float]]]:
    from tuning.learned.reinforcement import train_by_reinforcement

    rng, done = np.random.default_rng(seed), 0

    def told(made: int) -> None:
        nonlocal done
        advance(by, made - done)
        done = made

    tasks = [world.draw(rng)[0] for _ in range(TASKS)]
    return train_by_reinforcement(tasks, by, experiments, seed, init, progress=told)


def judge(world: World, policy: HistoryPolicy, rigs: int, seed: int) -> dict[str, Any]:
    """Mean score with standard error of the best gains so far, after CHECKPOINTS experiments on rigs drawn wide with
    the preset's target and no effect, as `maglev compare` draws them; touchdowns on the way."""
    task = make_task(
        world.rig, world.tuned, randomization="wide", protocol=world.protocol, sensor=world.sensor,
        budget=CHECKPOINTS[-1],
    )  # fmt: skip
    _, lanes, seeds = held_out(task, rigs, 1, seed)
    tuners = [LearnedTuner(task, e, policy, s) for e, s in zip(lanes, seeds, strict=True)]
    found = course(side_by_side(task, lanes, tuners, CHECKPOINTS[-1]))
    score, touchdowns = judged(task, lanes, found, CHECKPOINTS, seed)
    se = score.std(axis=0, ddof=1) / np.sqrt(rigs)
    return {
        "rigs": rigs, "after": list(CHECKPOINTS), "score": score.mean(axis=0).tolist(), "se": se.tolist(),
        "touchdowns": int(touchdowns[:, -1].sum()),
    }  # fmt: skip


def _table(found: dict[str, Any], rigs: int) -> Table:
    grid = Table(title=f"{rigs} rigs not met in training; {found['touchdowns']} touchdowns")
    for name in ("experiments", "mean score", "95 %"):
        grid.add_column(name, justify="right")
    for n, score, se in zip(found["after"], found["score"], found["se"], strict=True):
        grid.add_row(str(n), f"{score:.4f}", f"± {1.96 * se:.4f}")
    return grid
