"""`maglev train`: trains a policy that tunes unseen rigs, tests it on held-out rigs, and stores it."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    ControllerOption,
    JsonOption,
    RigOption,
    SchedulerOption,
    SeedOption,
    friendly,
    require_apart,
    require_choice,
    require_folder,
)

SCHEMA = "maglev-training/1"
BY = ("imitation", "ppo", "sac", "familiar")
SPEC, POLICY, GROUPS = "training.json", "policy.npz", "groups"
EXPERIMENTS = 100_000  # default number of experiments of ppo and sac
app = typer.Typer()


@app.command(
    epilog="Example: maglev train --rigs 1200 --out mine && maglev tune --method learned --policy mine/policy.npz"
)
@friendly
def train(
    rig: RigOption = "hmb_free",
    by: Annotated[
        str,
        typer.Option(
            help="imitation (of searched optima), or ppo or sac (Stable-Baselines3); familiar: the weights of --init "
            "stay, and only what is familiar to it is found anew."
        ),
    ] = "imitation",
    controller: ControllerOption = None,
    protocol: Annotated[str, typer.Option(help="Experiment that the policy observes: full, or quick.")] = "full",
    rigs: Annotated[
        int | None, typer.Option(min=1, help="Total number of rigs of imitation (default: 6000) and familiar (1000).")
    ] = None,
    experiments: Annotated[
        int | None, typer.Option(min=1, help="ppo and sac: total number of experiments (default: 100,000).")
    ] = None,
    judged: Annotated[int, typer.Option("--held-out", min=2, help="Number of held-out rigs for the test.")] = 100,
    init: Annotated[Path | None, typer.Option(help="ppo, sac and familiar: initial policy.")] = None,
    seed: SeedOption = 0,
    scheduler: SchedulerOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the policy; an interrupted imitation resumes there.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Train a policy that tunes unseen rigs: drawn widely, with different targets and effects.

    Imitation, the default, takes half an hour on two cores.
    """
    from dataclasses import asdict, replace
    from shlex import quote
    from time import perf_counter

    from maglev_env.design.controllers import with_controller
    from maglev_env.design.defaults import with_defaults
    from maglev_env.recordings.formats.json_data import plain
    from maglev_env.recordings.result_folder import claim, locked
    from maglev_env.rig.rig_file import load_rig
    from maglev_lanes.code_version import code_version
    from maglev_lanes.price import check_experiments
    from maglev_lanes.schedule import workers
    from maglev_workbench.console import console, progress_bar, write_json
    from tuning.learned.worlds import World

    require_choice(by, BY, "--by")
    searched, kept = by == BY[0], by == BY[-1]  # nothing is kept of a policy, or all but what is familiar to it
    if kept and init is None:
        raise ValueError("--by familiar: name the policy whose weights stay (--init)")
    if init is not None and searched:
        raise ValueError("--init: imitation begins anew; leave it out, or use --by ppo or sac")
    if scheduler is not None and not searched:
        raise ValueError("--scheduler: only imitation is spread over workers")
    if rigs is not None and not (searched or kept):
        raise ValueError(f"--rigs: of imitation and familiar; {by} draws as many as --experiments take")
    if experiments is not None and (searched or kept):
        raise ValueError(f"--experiments: of ppo and sac; {by} takes --rigs")
    check_experiments(max(rigs or 0, judged), 0, "--rigs and --held-out")
    centre = load_rig(rig) if controller is None else with_controller(with_defaults(load_rig(rig)), controller)
    world = World(centre, protocol)
    world = replace(world, tuned=world.task().box.names)  # raises for invalid settings before any work
    from maglev_workbench.commands.train.report import held_out_table
    from maglev_workbench.commands.train.training import judge, reinforced
    from tuning.learned.encounters import RIGS, acquainted, check_fits
    from tuning.learned.policy import load_policy, save_policy
    from tuning.learned.training import Plan
    from tuning.learned.training import train as train_by_imitation

    rigs, experiments = rigs or (RIGS if kept else Plan().rigs), experiments or EXPERIMENTS
    plan = Plan(rigs=rigs) if searched else Plan()
    begun, origin = (None, {}) if init is None else load_policy(init)
    if kept:
        check_fits(begun, world.task())
    elif not searched:
        from tuning.learned.reinforcement import check_training

        check_training([world.task()], by, experiments, begun)
    folder = out or Path(f"train-{world.rig.name}")
    require_folder(folder)
    require_apart(json_file, folder, (SPEC, POLICY))
    made_by = {
        "schema": SCHEMA, "version": code_version(), "by": by, "seed": seed,
        "world": plain(asdict(world)), "init": None if init is None else str(init),
        "plan": asdict(plan) if searched else {"rigs": rigs} if kept else {"experiments": experiments},
    }  # fmt: skip
    started = perf_counter()
    with workers(scheduler) as spread, locked(folder):
        claim(folder / SPEC, made_by, "training")
        (folder / GROUPS).mkdir(exist_ok=True)
        with progress_bar() as bar:
            total = rigs if searched or kept else experiments
            line = bar.add_task("train", total=total)

            def advance(text: str, count: int) -> None:
                bar.update(line, advance=count, description=text)

            try:
                if kept:
                    policy, log = begun, []
                    policy.familiar = acquainted(world.draw, policy, rigs, seed, lambda n: advance(by, n))
                elif searched:
                    policy, log = train_by_imitation(world.draw, plan, seed, folder / GROUPS, advance, spread)
                else:
                    policy, log = reinforced(world, by, experiments, seed, begun, advance)
            except KeyboardInterrupt:
                if searched:
                    console.print(
                        f"stopped; finished groups of rigs are in {folder}: run the command again to continue"
                    )
                raise
        found = judge(world, policy, judged, seed)
        seconds = perf_counter() - started
        amount = (f"--rigs {rigs}" if searched or kept else f"--experiments {experiments}") + (
            f" --init {quote(str(init))}" if init else ""
        )
        command = f"maglev train --rig {quote(rig)} --by {by} --protocol {protocol} {amount} --seed {seed}"
        command += f" --controller {quote(controller)}" if controller else ""
        made = {**made_by, "held_out": found, "command": command}
        # What made the weights stays on record beside what made the rest.
        save_policy(folder / POLICY, policy, {**origin, "familiar": made} if kept else made)
    data = {"schema": SCHEMA, "made_by": made_by, "log": log, "held_out": found, "seconds": seconds}
    write_json(folder / "train.json", data)
    write_json(json_file, data)
    console.print(held_out_table(found, judged))
    console.print(f"{seconds:.0f} s\npolicy  {folder / POLICY}")
