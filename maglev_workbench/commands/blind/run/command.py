"""`maglev blind run`: generates, answers and opens a sealed set in one run."""

from typing import Annotated

import typer

from maglev_workbench.commands.blind.options import (
    COUNT,
    BenchmarkOption,
    CountOption,
    FolderOption,
    PageDocsOption,
    ProcessesOption,
    SetSeedOption,
)
from maglev_workbench.options import JsonOption, SchedulerOption, friendly, given, require_package

app = typer.Typer()


@app.command(epilog="Example: maglev blind run --benchmark --count 160 --seed 7 --out sealed --docs docs/blind.md")
@friendly
def run(
    context: typer.Context,
    out: FolderOption,
    seed: SetSeedOption,
    count: CountOption = COUNT,
    quick: Annotated[bool, typer.Option("--quick", help="Only 24 campaigns: a test run that proves little.")] = False,
    benchmark: BenchmarkOption = False,
    processes: ProcessesOption = None,
    scheduler: SchedulerOption = None,
    docs: PageDocsOption = None,
    json_file: JsonOption = None,
) -> None:
    """Generate, answer and open a sealed set in one run; an interrupted run resumes.

    With --benchmark its foils answer, too, and all stand beside the oracle. The workers of a
    --scheduler answer; the set itself is generated on this machine. A campaign takes 10 to 45 s
    of a core: the set of --quick ten minutes on two cores.
    """
    if quick and "count" in given(context):
        raise ValueError("give --quick or --count, not both")
    if docs is not None and not benchmark:
        require_package("matplotlib")
    from maglev_lanes.schedule import workers
    from maglev_workbench.commands.blind import sealed_set
    from maglev_workbench.console import console
    from sim2real.blind.cases import seal_of

    count = 24 if quick else count
    with workers(scheduler) as spread:
        if (out / sealed_set.SET).exists():
            made = sealed_set.made_of(out)
            if bool(made.get("benchmark")) != benchmark:
                kind = "a set of the benchmark" if made.get("benchmark") else "no set of the benchmark"
                raise ValueError(f"{out} is {kind}: {'leave out' if benchmark else 'give'} --benchmark")
            if (made["count"], made["seed"]) != (count, seed):
                raise ValueError(f"{out} holds {made['count']} campaigns of seed {made['seed']}; choose another --out")
            console.print(f"{count} campaigns of seed {seed} are there; SHA-256 of their labels\n{seal_of(out)}")
        else:
            sealed_set.generate(out, count, seed, processes, benchmark)
        for method in sealed_set.METHODS if benchmark else sealed_set.METHODS[:1]:
            sealed_set.answer(out, processes, spread, method)
    if benchmark:
        from maglev_workbench.commands.blind.score.scoring import score_folder

        score_folder(out, [], docs, json_file)
    else:
        from maglev_workbench.commands.blind.open.opening import open_folder

        open_folder(out, docs, json_file)
