"""The rotor in five degrees of freedom: its kernel beside the one-axis one, and whole run-ups."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from maglev_env.kernel.sensing_lanes import NO_SENSORS
from maglev_env.rotor.kernel import TILE, kernel
from maglev_env.rotor.lanes import Run, block
from maglev_env.rotor.rotor import Rotor, load_rotor
from maglev_env.rotor.rows import CHANNELS
from maglev_env.rotor.run_up import run_up
from maglev_lanes.layout import LANES
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import quiet_experiment
from maglev_workbench.commands.bench.timing import Size, alternately, stepper

_SAMPLES = 2400


def rotor_figures(size: Size) -> dict[str, Figure]:
    """Nanoseconds per control step and lane of one core, its ratio to the one-axis kernel, and seconds of run-ups."""
    rotor, one = load_rotor("pump"), quiet_experiment()
    calls = 6 * size.repeats
    works = {"rotor": _stepper(rotor), "one_axis": stepper([replace(one, seed=i) for i in range(LANES)], calls)}
    best = alternately(works, calls)
    step = best["rotor"] / _SAMPLES / LANES
    axis = best["one_axis"] / one.samples_per_period / LANES
    sets = [rotor] * size.lanes
    whole = alternately({"one": lambda: run_up([rotor], threads=1), "many": lambda: run_up(sets)}, min(size.repeats, 2))
    return {
        "rotor_kernel_ns_per_step_and_lane": Figure(1e9 * step, "ns per step and lane"),
        "rotor_kernel_over_one_axis": Figure(step / axis, "ratio"),
        "run_up_of_29_speeds_one_thread_seconds": Figure(whole["one"], "s"),
        "run_ups_per_second": Figure(size.lanes / whole["many"], "1/s", "higher"),
        "run_ups_together_over_one_thread": Figure(whole["one"] * size.lanes / whole["many"], "ratio", "higher"),
    }


def _stepper(rotor: Rotor) -> Callable[[], None]:
    """The kernel alone, on one block at 29 speeds' spread."""
    rows, seeds = (part.reshape(-1) for part in block([Run(rotor, v) for v in np.linspace(0, 14_000, LANES)]))
    step, h = kernel(1), 1 / rotor.axis.control_rate
    force, injection = np.zeros(5 * _SAMPLES), np.zeros(4 * _SAMPLES)
    tile, out = np.empty(TILE * len(CHANNELS) * LANES), np.empty(len(CHANNELS) * LANES * _SAMPLES)

    def run() -> None:
        step(rows, seeds, 0, h, np.array(NO_SENSORS), force, injection, tile, out)

    run()
    return run
