"""`maglev compare`: compares tuners with the same budgets on the same rigs, as table, page, markdown and JSON."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    ControllerOption,
    DocsOption,
    EffectOption,
    GoalOption,
    JsonOption,
    PolicyOption,
    RigOption,
    SchedulerOption,
    SeedOption,
    friendly,
    given,
    require_apart,
    require_folder,
)
from tuning.methods import METHODS, STARTS, method_of

SLOW = ", ".join(name for name, method in METHODS.items() if method.longest is not None)
app = typer.Typer()


@app.command(
    epilog="Examples: maglev compare model cma-es@preset rule --rigs 12 --protocol quick --out my-comparison; "
    "maglev compare model nelder-mead@preset --goal engineer --rigs 6 --budgets 5,10; maglev compare --twin sealed"
)
@friendly
def compare(
    context: typer.Context,
    methods: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="METHOD",
            help=f"Tuners as in maglev tune (default: all, and quadratic and cma-es at good gains, but not {SLOW}, "
            f"which is slow). A general search may start at good gains: cma-es@{', cma-es@'.join(STARTS)}.",
        ),
    ] = None,
    rig: RigOption = "hmb_free",
    rigs: Annotated[int, typer.Option(help="Number of rigs, drawn widely around the nominal one.")] = 20,
    budgets: Annotated[
        str,
        typer.Option(
            help="Numbers of experiments after which to compare; with --twin (60) on each, or on simulators,twin."
        ),
    ] = "10,30",
    repeats: Annotated[int, typer.Option(help="Runs on every rig, with different noise.")] = 1,
    protocol: Annotated[str, typer.Option(help="full, or quick: an eighth of the time, less accurate.")] = "full",
    controller: ControllerOption = None,
    goal: GoalOption = None,
    effect: EffectOption = [],  # noqa: B006
    affected: Annotated[
        bool, typer.Option("--affected", help="Every other rig has an effect of its own, drawn as for maglev train.")
    ] = False,
    twin: Annotated[
        Path | None,
        typer.Option(help="Instead of drawn rigs: folder of an opened sealed set, to score its diagnoses on its twin."),
    ] = None,
    cases: Annotated[int, typer.Option(min=1, help="With --twin: number of its large single effects.")] = 24,
    processes: Annotated[int | None, typer.Option(min=1, help="With --twin: processes (default: all cores).")] = None,
    seed: SeedOption = 0,
    policy: PolicyOption = None,
    scheduler: SchedulerOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; an interrupted run resumes there.")] = None,
    docs: DocsOption = None,
    json_file: JsonOption = None,
) -> None:
    """Compare tuners on the same unseen rigs with equal budgets: regret with intervals, touchdowns, time.

    With --twin: tune on the nominal simulator, on the one that a diagnosis corrected, and on the sealed twin itself,
    and score all three on the twin. This shows the benefit of the diagnosis in score, peak sensitivity and touchdowns.

    Under a goal of requirements the score is that of the goal, and the table also says on how many rigs all are met.

    The default comparison takes some minutes on two cores, an eighth of it with --protocol quick.
    """
    for name in methods or ():
        method_of(name).check_installed()
    from maglev_workbench.commands.compare.asked import check_options, default_methods, parse_budgets, twin_budgets

    named = given(context)
    check_options(twin is not None, named)
    if twin is not None:
        from sim2real.blind.cases import seal_of

        METHODS["gp"].check_installed()
        experiments = twin_budgets(budgets if "budgets" in named else None)
        seal_of(twin)  # a folder without a seal is told before the long imports
        from maglev_workbench.commands.compare import twin as on_twin

        on_twin.run(twin, experiments, cases, processes, seed, out, docs, json_file)
        return
    from shlex import quote

    from maglev_env.loop.effect import parse_effects
    from maglev_env.recordings.files import write_text_atomic
    from maglev_env.rig.rig_file import load_rig
    from maglev_env.task.task import make_task
    from maglev_lanes.schedule import workers
    from maglev_workbench.commands.compare.numbers import figures
    from maglev_workbench.commands.compare.report import (
        compare_json,
        compare_markdown,
        compare_page,
        compare_table,
        summary,
    )
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.goal_label import goal_label
    from maglev_workbench.page import write_page
    from tuning.comparison import compare as comparison
    from tuning.methods import policy_of

    own = policy_of(policy)
    steps = parse_budgets(budgets)
    comparison.check_comparison(methods or tuple(METHODS), rigs, steps, repeats)
    loaded = load_rig(rig)
    task = make_task(
        loaded, effects=parse_effects(effect), protocol=protocol, randomization="wide", budget=steps[-1],
        controller=controller, goal=goal,
    )  # fmt: skip
    chosen = list(methods or ()) or default_methods(task, own)
    comparison.check_policy(task, chosen, own)
    folder, runs = out or Path(f"compare-{loaded.name}{goal_label(goal)}"), rigs * repeats
    require_folder(folder)
    require_apart(json_file, folder, (comparison.SPEC, comparison.RIGS))
    with workers(scheduler) as spread, progress_bar() as bar:
        line = bar.add_task(
            "", total=comparison.SEARCH * rigs + sum(runs * comparison.budget_of(m, steps) for m in set(chosen))
        )

        def advance(name: str, count: int) -> None:
            bar.update(line, advance=count, description=name)

        try:
            found = comparison.compare(task, chosen, rigs, steps, repeats, seed, folder, advance, own, spread, affected)
        except KeyboardInterrupt:
            console.print(f"stopped; finished work is in {folder}: run the same command again to continue")
            raise
    of = figures(found)
    page, data = folder / "compare.html", compare_json(found, of)
    write_page(page, compare_page(found, of), [folder / "compare.json"])
    write_json(folder / "compare.json", data)
    write_json(json_file, data)
    if docs is not None:
        asked = "".join(f" --effect {quote(e)}" for e in effect)
        asked += f" --controller {quote(controller)}" if controller else ""
        asked += f" --goal {quote(goal)}" if goal else ""
        asked += " --affected" * affected + (f" --policy {quote(str(policy))}" if policy else "")
        options = f"--rigs {rigs} --budgets {budgets} --repeats {repeats} --protocol {protocol}{asked} --seed {seed}"
        command = " ".join(["maglev compare", *found.results, f"--rig {quote(rig)}", options])
        write_text_atomic(docs, compare_markdown(found, of, command))
    console.print(compare_table(found, of))
    reused = [m for m, r in found.results.items() if r.reused]
    if reused:
        console.print(f"reused from {folder}: {', '.join(reused)}")
    console.print(f"{summary(found, of)}\npage  {page}")
