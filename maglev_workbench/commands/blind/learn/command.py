"""`maglev blind learn`: makes the judge of diagnoses from campaigns of the benchmark."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.commands.blind.options import CountOption, ProcessesOption, SetSeedOption
from maglev_workbench.options import JsonOption, SchedulerOption, friendly, require_file

app = typer.Typer()
COUNT = 240


@app.command(epilog="Example: maglev blind learn lessons --seed 9600 --out judge.json")
@friendly
def learn(
    lessons: Annotated[Path, typer.Argument(help="Folder of the set, made there if there is none.")],
    seed: SetSeedOption,
    out: Annotated[Path, typer.Option(help="File of the judge.")],
    count: CountOption = COUNT,
    processes: ProcessesOption = None,
    scheduler: SchedulerOption = None,
    json_file: JsonOption = None,
) -> None:
    """Generate and answer a set of the benchmark, and learn from it how far evidence is to be believed.

    The judge is validated on families of causes that it did not learn from, and written as JSON. An interrupted run
    resumes; the same set and the same version give the same bytes. A campaign takes about 10 s of a core.
    """
    require_file(out, "--out")
    from maglev_lanes.schedule import workers
    from maglev_workbench.commands.blind import sealed_set
    from sim2real.blind.answer import OPENED

    with workers(scheduler, processes) as spread:
        if (lessons / sealed_set.SET).exists():
            made = sealed_set.made_of(lessons)
            if (made["count"], made["seed"], made.get("benchmark")) != (count, seed, True):
                kind = "the benchmark" if made.get("benchmark") else "the twin"
                there = f"{made['count']} campaigns of {kind}, seed {made['seed']}"
                raise ValueError(f"{lessons} holds {there}; choose another folder")
        else:
            sealed_set.generate(lessons, count, seed, processes, benchmark=True, oracle=False)
        if not (lessons / OPENED).exists():
            sealed_set.answer(lessons, processes, spread)
    from maglev_workbench.commands.blind.learn.learning import learn_folder

    learn_folder(lessons, out, json_file)
