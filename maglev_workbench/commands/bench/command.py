"""`maglev bench`: the kernel, whole evaluations, every estimator and memory, beside references of the same run."""

import os
from collections.abc import Callable
from pathlib import Path

from maglev_workbench.commands.bench.environments import environment_figures
from maglev_workbench.commands.bench.estimators import estimator_figures
from maglev_workbench.commands.bench.figures import Figure, as_json, read_results, results_here
from maglev_workbench.commands.bench.kernels import kernel_figures, reference_figures
from maglev_workbench.commands.bench.memory import memory_figures
from maglev_workbench.commands.bench.pipeline import part_figures, rate_figures, thread_figures
from maglev_workbench.commands.bench.report import bench_page, show
from maglev_workbench.commands.bench.rotor import rotor_figures
from maglev_workbench.commands.bench.self_sensing import self_sensing_figures
from maglev_workbench.commands.bench.timing import Size
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page

SECTIONS: dict[str, Callable[[Size], dict[str, Figure]]] = {
    "kernel": kernel_figures,
    "other simulators": reference_figures,
    "kernel on threads": thread_figures,
    "parts of an evaluation": part_figures,
    "gain sets per second": rate_figures,
    "environments": environment_figures,
    "estimators": estimator_figures,
    "self-sensing": self_sensing_figures,
    "rotor": rotor_figures,
    "memory": memory_figures,
}
_BUSY = 0.75  # load average per core from which on other work is in the way


def run(out: Path, json_file: Path | None, compare: Path | None, size: Size | None = None) -> None:
    """See `maglev_workbench.cli.bench`; size: how much is run."""
    require_folder(out, "--out")
    require_folder(json_file, "--json")
    old = read_results(compare) if compare else None
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0  # not on Windows
    if load > _BUSY * (os.cpu_count() or 1):
        console.print(f"warning: other work is running here (load average {load:.1f}): figures will be worse for it")
    results = results_here(measure(size or Size()))
    write_json(json_file, as_json(results))
    write_page(out, bench_page(results, old))
    show(results, old)
    console.print(f"page  {out}")


def measure(size: Size) -> dict[str, Figure]:
    """Every figure of the benchmark, by name: about a minute, and as much again where kernels are not yet compiled."""
    found: dict[str, Figure] = {}
    with progress_bar() as bar:
        task = bar.add_task("measuring", total=len(SECTIONS))
        for name, section in SECTIONS.items():
            bar.update(task, description=name)
            found |= section(size)
            bar.advance(task)
    return found
