"""The commands that tune: `maglev tune`, `compare` and `train`."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    EffectOption,
    JsonOption,
    PolicyOption,
    RigOption,
    SchedulerOption,
    SeedOption,
    SensorOption,
    ThreadsOption,
    friendly,
    given,
)
from tuning.methods import METHODS

_SLOW = ", ".join(name for name, method in METHODS.items() if method.longest is not None)
app = typer.Typer()


@app.command(epilog="Example: maglev tune --method model --budget 10 --effect delay=75e-6 --out my-study")
@friendly
def tune(
    context: typer.Context,
    rig: RigOption = "hmb_free",
    method: Annotated[str, typer.Option(help=f"Tuner: {', '.join(METHODS)}.")] = "model",
    budget: Annotated[int, typer.Option(min=1, help="Experiments.")] = 10,
    batch: Annotated[int, typer.Option(min=1, help="Experiments asked for together.")] = 1,
    tuned: Annotated[list[str], typer.Option("--tune", help="A gain to tune (default: kp, ki, kd); repeat.")] = [],  # noqa: B006
    protocol: Annotated[str, typer.Option(help="full, or quick: an eighth of the time, coarser.")] = "full",
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    policy: PolicyOption = None,
    threads: ThreadsOption = None,
    scheduler: SchedulerOption = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="A real rig's campaign folder: propose the next recording, or stop (--budget: recordings)."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the study; an interrupted one resumes there.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Spend a budget of experiments on a simulated rig, and recommend gains that hold up, or say why none does.

    With --campaign the rig is real: what is recorded so far says which gains to record next, or which to keep.
    """
    if campaign is not None:
        from maglev_workbench.commands.tune import campaign as command_tune_campaign

        command_tune_campaign.run(campaign, budget, tuned, seed, out, json_file, given(context))
        return
    from maglev_workbench.commands.tune import command as command_tune

    command_tune.run(
        rig, method, budget, batch, tuned, protocol, effect, sensor, seed, policy, threads, scheduler, out, json_file
    )


@app.command(
    epilog="Examples: maglev compare de tpe model --rigs 12 --protocol quick --out my-comparison; "
    "maglev compare --twin sealed"
)
@friendly
def compare(
    context: typer.Context,
    methods: Annotated[
        list[str] | None,
        typer.Argument(metavar="METHOD", help=f"As of maglev tune (default: all but {_SLOW}, which takes long)."),
    ] = None,
    rig: RigOption = "hmb_free",
    rigs: Annotated[int, typer.Option(help="How many rigs, drawn wide around the nominal.")] = 20,
    budgets: Annotated[
        str,
        typer.Option(help="Experiments after which to compare; with --twin (60) on each, or on simulators,twin."),
    ] = "10,30",
    repeats: Annotated[int, typer.Option(help="Runs on every rig, with other noise.")] = 1,
    protocol: Annotated[str, typer.Option(help="full, or quick: an eighth of the time, coarser.")] = "full",
    effect: EffectOption = [],  # noqa: B006
    twin: Annotated[
        Path | None,
        typer.Option(help="Instead: folder of an opened sealed set; what its diagnoses are worth, scored on its twin."),
    ] = None,
    cases: Annotated[int, typer.Option(min=1, help="With --twin: so many of its large single effects.")] = 24,
    processes: Annotated[int | None, typer.Option(min=1, help="With --twin (default: all cores).")] = None,
    seed: SeedOption = 0,
    policy: PolicyOption = None,
    scheduler: SchedulerOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; an interrupted run resumes there.")] = None,
    docs: Annotated[Path | None, typer.Option(help="Also write the tables as markdown to this file.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Compare tuners on the same unseen rigs with equal budgets: regret with intervals, touchdowns, time.

    With --twin: tune on the nominal simulator, on the one that a diagnosis corrected, and on the sealed twin itself,
    and score all three on the twin: what diagnosis is worth in score, peak sensitivity and touchdowns.
    """
    from maglev_workbench.commands.compare import command as command_compare
    from maglev_workbench.commands.compare import twin as command_twin

    named = given(context)
    command_twin.check_options(twin is not None, named)
    if twin is not None:
        own = budgets if "budgets" in named else None
        command_twin.run(twin, own, cases, processes, seed, out, docs, json_file)
        return
    command_compare.run(
        methods or (), rig, rigs, budgets, repeats, protocol, effect, seed, policy, scheduler, out, docs, json_file
    )


@app.command(
    epilog="Example: maglev train --rigs 1200 --out mine && maglev tune --method learned --policy mine/policy.npz"
)
@friendly
def train(
    rig: RigOption = "hmb_free",
    by: Annotated[
        str, typer.Option(help="imitation (of searched optima), or ppo or sac (Stable-Baselines3).")
    ] = "imitation",
    protocol: Annotated[str, typer.Option(help="What the policy is to observe: full, or quick.")] = "full",
    rigs: Annotated[int | None, typer.Option(min=1, help="Imitation: rigs drawn in all (default: 6000).")] = None,
    experiments: Annotated[
        int | None, typer.Option(min=1, help="ppo and sac: experiments in all (default: 100,000).")
    ] = None,
    judged: Annotated[int, typer.Option("--held-out", min=2, help="Rigs kept back, on which it is judged.")] = 100,
    init: Annotated[Path | None, typer.Option(help="ppo and sac: a policy to begin with.")] = None,
    seed: SeedOption = 0,
    scheduler: SchedulerOption = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the policy; an interrupted imitation resumes there.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Train a policy that tunes rigs it has not seen: drawn wide, with targets and effects of their own."""
    from maglev_workbench.commands.train import command as command_train

    command_train.run(rig, by, protocol, rigs, experiments, judged, init, seed, scheduler, out, json_file)
