"""The sections of the benchmark, in the order in which they are measured."""

from collections.abc import Callable

from maglev_workbench.commands.bench.compiling import compile_figures
from maglev_workbench.commands.bench.diagnoses import diagnosis_figures
from maglev_workbench.commands.bench.environments import environment_figures
from maglev_workbench.commands.bench.estimators import estimator_figures
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import kernel_figures, reference_figures
from maglev_workbench.commands.bench.memory import memory_figures
from maglev_workbench.commands.bench.pipeline import part_figures, rate_figures, thread_figures
from maglev_workbench.commands.bench.rotor import rotor_figures
from maglev_workbench.commands.bench.self_sensing import self_sensing_figures
from maglev_workbench.commands.bench.timing import Size
from maglev_workbench.console import progress_bar

SECTIONS: dict[str, Callable[[Size], dict[str, Figure]]] = {
    "kernel": kernel_figures,
    "compiling": compile_figures,
    "other simulators": reference_figures,
    "kernel on threads": thread_figures,
    "parts of an evaluation": part_figures,
    "gain sets per second": rate_figures,
    "environments": environment_figures,
    "estimators": estimator_figures,
    "self-sensing": self_sensing_figures,
    "rotor": rotor_figures,
    "diagnoses": diagnosis_figures,
    "memory": memory_figures,
}


def measure(size: Size) -> dict[str, Figure]:
    """Every figure of the benchmark, by name.

    It takes about two minutes, and half a minute more where kernels are not yet compiled.
    """
    found: dict[str, Figure] = {}
    with progress_bar() as bar:
        task = bar.add_task("measuring", total=len(SECTIONS))
        for name, section in SECTIONS.items():
            bar.update(task, description=name)
            found |= section(size)
            bar.advance(task)
    return found
