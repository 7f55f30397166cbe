"""`maglev blind answer`: diagnoses every campaign of a sealed set."""

from typing import Annotated, Literal

import typer

from maglev_workbench.commands.blind.options import FolderArgument, ProcessesOption
from maglev_workbench.options import JsonOption, SchedulerOption, friendly

app = typer.Typer()
Method = Literal["diagnose", "nothing", "refit"]


@app.command(epilog="Example: maglev blind answer sealed")
@friendly
def answer(
    folder: FolderArgument,
    processes: ProcessesOption = None,
    scheduler: SchedulerOption = None,
    method: Annotated[Method, typer.Option(help="What answers: diagnose, or a foil of the benchmark.")] = "diagnose",
    json_file: JsonOption = None,
) -> None:
    """Diagnose every campaign of a sealed set without reading the labels; an interrupted run resumes.

    A foil's answers go to answers-NAME in the folder. Campaigns are sent to the workers of a --scheduler, which need
    no access to the folder. A campaign takes 10 to 45 s of a core.
    """
    from maglev_lanes.schedule import workers
    from maglev_workbench.commands.blind import sealed_set
    from maglev_workbench.console import write_json
    from sim2real.blind.cases import seal_of

    with workers(scheduler, processes) as spread:
        found = sealed_set.answer(folder, processes, spread, method)
    data = {"schema": "maglev-blind-answers/1", "version": sealed_set.version_of(method), "method": method}
    data |= {"set": str(folder), "labels_sha256": seal_of(folder)}
    data |= {"answered": found.new, "again": found.again, "reused": found.reused, "failed": found.failed}
    write_json(json_file, data)
