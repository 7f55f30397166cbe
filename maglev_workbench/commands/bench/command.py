"""`maglev bench`: speed and memory of kernel, evaluations and estimators, with references measured in the same run."""

import os
from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, friendly, require_file

_BUSY = 0.75  # load average per core above which other processes disturb the measurement
app = typer.Typer()


@app.command(epilog="Example: maglev bench --compare old.json --json new.json")
@friendly
def bench(
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("bench.html"),
    compare: Annotated[Path | None, typer.Option(help="JSON file of an earlier run to compare with.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Measure speed and memory of simulator and estimators, and of references in the same run; about two minutes."""
    from maglev_workbench.commands.bench.figures import as_json, read_results, results_here
    from maglev_workbench.commands.bench.report import bench_page, show
    from maglev_workbench.console import console, write_json
    from maglev_workbench.page import write_page

    require_file(out, "--out")
    old = read_results(compare) if compare else None
    from maglev_workbench.commands.bench import sections
    from maglev_workbench.commands.bench.timing import Size

    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0  # not on Windows
    if load > _BUSY * (os.cpu_count() or 1):
        console.print(f"warning: other work is running here (load average {load:.1f}), so the figures will be worse")
    results = results_here(sections.measure(Size()))
    write_json(json_file, as_json(results))
    write_page(out, bench_page(results, old), [json_file])
    show(results, old)
    console.print(f"page  {out}")
