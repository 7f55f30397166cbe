"""`maglev tune`: spends a budget of simulated experiments and recommends gains."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    ControllerOption,
    EffectOption,
    GoalOption,
    JsonOption,
    PolicyOption,
    SchedulerOption,
    SeedOption,
    SensorOption,
    ThreadsOption,
    friendly,
    given,
    require_apart,
    require_choice,
    require_folder,
)
from maglev_workbench.presets import PRESETS, is_rotor
from tuning.methods import DEFAULT, METHODS, STARTS, method_of

BUDGET = 10  # experiments, or recordings of a campaign
app = typer.Typer()


@app.command(
    epilog="Examples: maglev tune --method model --budget 10 --effect delay=75e-6 --out my-study; maglev tune --goal "
    "engineer --reference lqg --reference h-infinity"
)
@friendly
def tune(
    context: typer.Context,
    rig: Annotated[
        str,
        typer.Option(
            help=f"Preset ({', '.join((*PRESETS['rig'], *PRESETS['rotor']))}) or the TOML of a rig or a rotor.",
            autocompletion=lambda incomplete: [
                name for names in PRESETS.values() for name in names if name.startswith(incomplete)
            ],
        ),
    ] = "hmb_free",
    method: Annotated[
        str | None,
        typer.Option(
            help=f"Tuner: {', '.join(METHODS)} (default: {DEFAULT}; of a rotor nelder-mead). A general search may "
            f"start with small steps at good gains: cma-es@{', cma-es@'.join(STARTS)}."
        ),
    ] = None,
    budget: Annotated[
        int | None, typer.Option(min=1, help="Number of experiments (default: 10; of a rotor 400).")
    ] = None,
    batch: Annotated[
        int | None,
        typer.Option(min=1, help="Number of experiments that are proposed together (default: 1; of a rotor 8)."),
    ] = None,
    tuned: Annotated[
        list[str],
        typer.Option(
            "--tune",
            metavar="NAME[=LO:HI]",
            help="A gain to tune, within LO:HI or the rig's bounds (default: kp, ki, kd and those of filters); repeat.",
        ),
    ] = [],  # noqa: B006
    controller: ControllerOption = None,
    protocol: Annotated[str, typer.Option(help="full, or quick: an eighth of the time, less accurate.")] = "full",
    goal: GoalOption = None,
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    policy: PolicyOption = None,
    threads: ThreadsOption = None,
    scheduler: SchedulerOption = None,
    campaign: Annotated[
        Path | None,
        typer.Option(help="A real rig's campaign folder: propose the next recording, or stop (--budget: used ones)."),
    ] = None,
    speeds: Annotated[
        str | None, typer.Option(help="Of a rotor: speeds of all requirements, lo:hi:step in rpm (0:14000:2000).")
    ] = None,
    rejection: Annotated[
        float | None, typer.Option(help="Of a rotor: reject unbalance forces at this rate, 1/s (default: its own).")
    ] = None,
    reference: Annotated[
        list[str],
        typer.Option(
            metavar="KIND",
            help="Under requirements: also the best linear controller of a kind, to hold the gains against: lqg, "
            "h-infinity (extra [reference]); repeat. See docs/goals.md.",
        ),
    ] = [],  # noqa: B006
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the study, which resumes there (default: by rig, method and --goal)."),
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Spend a budget of experiments on a simulated rig and recommend robust gains, or say why there are none.

    With --campaign the rig is real: from the recordings so far, the next gains to record or to keep are proposed.
    Ten experiments take about 20 s with the check of what is recommended, two hundred by de no longer. A rotor
    (--rig pump) is tuned in five degrees of freedom over its speeds, in a minute or two. A campaign takes seconds, and
    minutes where its recordings contradict the rig, because they are diagnosed then.
    """
    if campaign is not None:
        from maglev_workbench.commands.tune import campaign as real

        real.run(campaign, budget or BUDGET, tuned, seed, out, json_file, given(context), goal)
        return
    if method is not None:
        method_of(method).check_installed()  # before the imports that take long
    if is_rotor(rig):
        if speeds is not None:
            from maglev_workbench.commands.runup.asked import parse_speeds

            parse_speeds(speeds)  # before the imports that take long
        from maglev_workbench.commands.tune import rotor as spinning

        spinning.run(
            rig, method, budget, batch, tuned, goal, speeds, rejection, seed, threads, scheduler, out, json_file,
            given(context),
        )  # fmt: skip
        return
    if reference:
        from tuning.reference.kinds import kind_of

        for kind in reference:
            kind_of(kind)
    for name, value in (("speeds", speeds), ("rejection", rejection)):
        if value is not None:
            raise ValueError(f"--{name} is for rotors; leave it out, or tune one: --rig {', '.join(PRESETS['rotor'])}")
    method, budget, batch = method or DEFAULT, budget or BUDGET, batch or 1
    from maglev_env.channels import SENSORS
    from maglev_env.task.protocol import PROTOCOLS

    require_choice(sensor, SENSORS, "--sensor")
    require_choice(protocol, PROTOCOLS, "--protocol")
    from dataclasses import asdict
    from time import perf_counter

    import numpy as np

    from maglev_env.loop.effect import parse_effects
    from maglev_env.loop.gains import of_axis
    from maglev_env.recordings.formats.json_data import plain
    from maglev_env.rig.rig_file import load_rig
    from maglev_env.task.episodes import Episode
    from maglev_env.task.gain_box import parse_tuned
    from maglev_env.task.task import make_task
    from maglev_lanes.schedule import workers
    from maglev_workbench.goal_label import goal_label

    loaded, chosen = load_rig(rig), parse_effects(effect)
    folder = out or Path(f"tune-{loaded.name}-{method}{goal_label(goal)}")
    require_folder(folder)
    names, bounds = parse_tuned(tuned)
    task = make_task(
        loaded, names, bounds, effects=chosen, protocol=protocol, sensor=sensor, budget=budget, goal=goal,
        controller=controller,
    )  # fmt: skip
    wanted = task.layout.goal
    if reference and wanted is None:
        raise ValueError("--reference: references go with a goal of requirements; give one, as --goal engineer")
    # What is asked for is right: now the imports that take longer.
    from maglev_workbench.commands.tune import references as held_against
    from maglev_workbench.commands.tune.report import tune_json, tune_page, tune_tables
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page
    from tuning.methods import LEARNED, digest_or_none, make_tuner, policy_of
    from tuning.study.recommendation import recommend
    from tuning.study.study import JOURNAL, SPEC, run_study

    require_apart(json_file, folder, (SPEC, JOURNAL))
    start = task.box.point(of_axis(task.rig.gains, 0))
    episode = Episode(task.rig, task.target, start, seed)
    own = policy_of(policy)
    tuner = make_tuner(method, task, episode, seed, budget, own)
    made_by = {
        "method": method, "seed": seed, "rig": plain(asdict(task.rig)), "effects": plain(chosen), "sensor": sensor,
        "tuned": list(task.box.names), "steps": budget if method == "grid" else None,
        **({"bounds": plain(bounds)} if bounds else {}),
        **({"policy": digest_or_none(task, own)} if method == LEARNED else {}),
    }  # fmt: skip
    started = perf_counter()
    with workers(scheduler, threads) as spread, progress_bar() as bar:
        line = bar.add_task(f"tune {loaded.name} by {method}", total=budget)
        try:
            found = run_study(
                folder, task, episode, tuner, made_by, budget, batch, threads, lambda n, _: bar.advance(line, n), spread
            )
        except KeyboardInterrupt:
            console.print(f"stopped; finished work is in {folder}: run the same command again to continue")
            raise
    advice = recommend(task, episode, found.trials, seed)
    beside = None
    if reference:
        beside = held_against.made(task, episode, reference, seed, threads)
    seconds = perf_counter() - started
    data = tune_json(task, found, advice, made_by, seconds)
    data |= held_against.reference_json(wanted, beside) if beside else {}
    more = held_against.reference_sections(wanted, advice, beside) if beside else []
    page = folder / "tune.html"
    write_page(page, tune_page(task, found, advice, data, more), [folder / "tune.json"])
    write_json(folder / "tune.json", data)
    write_json(json_file, data)
    for part in tune_tables(task, found, advice):
        console.print(part)
    if beside:
        console.print(held_against.reference_table(wanted, advice, beside))
        console.print(held_against.reference_in_words(wanted, advice, beside))
    if note := getattr(tuner, "note", None):
        console.print(f"note: {note}")
    if found.dropped:
        console.print("the journal ended in a broken record: its experiments were made again")
    down = int(np.sum(found.trials.touchdown))
    reused = f", {found.reused} reused from {folder / JOURNAL}" if found.reused else ""
    console.print(f"{len(found.trials)} experiments, {down} touchdowns; {seconds:.1f} s{reused}\npage  {page}")
