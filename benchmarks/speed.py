"""`maglev bench`: the kernel, the whole pipeline and its parts against scipy's and python-control's simulators."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from platform import machine, processor
from time import perf_counter
from typing import Any

import numpy as np
import scipy.fft
import scipy.signal
from rich.table import Table
from scipy.integrate import solve_ivp

from estimation.bands import sliding_bands
from estimation.frequency_response import frequency_response
from estimation.max_likelihood import maximum_likelihood
from estimation.stability import margin_arrays
from maglev_env import kernel
from maglev_env.evaluation import evaluate, force_statistics
from maglev_env.excitation import lines_at
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.linear import closed_loop
from maglev_env.magnetics import force, force_law
from maglev_env.rig import Noise, load_rig
from maglev_env.simulate import block_periods, simulate_statistics
from tuning.output import console, write_json
from tuning.page import COLOURS, number, page, styled, table, write_page

LANES = 64
REFERENCES = ("dlsim", "forced_response", "solve_ivp")
REPEATS = 5


def run(out: Path, json_file: Path | None) -> None:
    """See `tuning.cli.bench`."""
    with console.status("measuring for about half a minute"):
        results = measure()
    _show(results)
    write_page(out, _page(results))
    console.print(f"page  {out}")
    write_json(json_file, results)


def measure() -> dict[str, Any]:
    """Every figure of the benchmark, by name."""
    rig = load_rig("hmb_free")
    noisy = [replace(protocol_experiment(rig), seed=i) for i in range(LANES)]
    quiet = [replace(e, rig=replace(rig, noise=Noise())) for e in noisy]
    per_experiment = (noisy[0].periods + noisy[0].transient_periods) * noisy[0].samples_per_period
    results: dict[str, Any] = {"schema": "maglev-bench/1", "machine": machine(), "processor": processor()}

    many, one = _kernel(quiet), _kernel(quiet[:1])
    results["kernel_ns_per_step_and_lane"] = 1e9 * many / per_experiment / LANES
    results["kernel_with_noise_ns_per_step_and_lane"] = 1e9 * _kernel(noisy) / per_experiment / LANES
    results["one_lane_ns_per_step"] = 1e9 * one / per_experiment
    results["lanes_speedup"] = one * LANES / many
    mine = many / LANES
    results["experiments_per_second_and_core"] = 1 / mine
    for name, seconds in _references(quiet[0]).items():
        results[f"{name}_seconds"] = seconds
        results[f"times_faster_than_{name}"] = None if seconds is None else seconds / mine

    evaluate(noisy)
    many_sets = [replace(noisy[0], seed=i) for i in range(8 * LANES)]
    results["gain_sets_per_second"] = len(many_sets) / _best(lambda: evaluate(many_sets), 3)
    results["gain_sets_per_second_one_thread"] = LANES / _best(lambda: evaluate(noisy, threads=1), 3)
    results |= {f"share_{k}": v for k, v in _shares(noisy).items()}
    return results


def _best(work: Callable[[], object], repeats: int = REPEATS) -> float:
    times = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def _kernel(experiments: list[Experiment]) -> float:
    """Seconds of one core to step all experiments, displacement and command written out, from the best period."""
    times = []
    for _ in range(3):
        blocks = list(block_periods(experiments))
        for periods in blocks:
            next(periods)  # compiles, allocates and carries the transient
        for _ in range(experiments[0].periods):
            start = perf_counter()
            for periods in blocks:
                next(periods)
            times.append(perf_counter() - start)
    return min(times) * (experiments[0].periods + experiments[0].transient_periods)


def _references(e: Experiment) -> dict[str, float | None]:
    """Seconds per 6 s experiment: linear closed loops by dlsim and forced_response, the nonlinear one by solve_ivp."""
    a, b, c = closed_loop(e)
    dt = 1 / e.rig.control_rate
    wave = next(x for x in e.excitations if x.at == "force").waveform(e.rig.control_rate)
    u = np.tile(wave, e.periods + e.transient_periods)
    d = np.zeros((1, 1))
    found: dict[str, float | None] = {"dlsim": _best(lambda: scipy.signal.dlsim((a, b, c, d, dt), u[:, None]), 3)}
    try:
        import control
    except ImportError:
        console.print("python-control is not installed: its row is left out (pip install 'maglev-workbench[bench]')")
        found["forced_response"] = None
    else:
        system = control.ss(a, b, c, d, dt)
        time = np.arange(u.size) * dt
        found["forced_response"] = _best(lambda: control.forced_response(system, time, u), 3)
    share = 20  # a twentieth of the experiment, scaled up
    found["solve_ivp"] = share * _best(lambda: _continuous(e, u[: u.size // share]), 1)
    return found


def _continuous(e: Experiment, wave: np.ndarray) -> None:
    """The nonlinear loop with a continuous PID, at rtol 1e-6."""
    rig, g, law, rate = e.rig, e.gains, force_law(e.rig), e.rig.control_rate

    def rhs(t: float, x: np.ndarray) -> list[float]:
        y, v, i, s, d, xi = x
        u = -g.kp * s - g.kd * (s - d) / g.td - g.ki * xi
        f = wave[min(int(t * rate), wave.size - 1)]
        return [
            v, (force(law, y, i) + f) / rig.mass, (u - i) / rig.amplifier_time_constant,
            (y - s) / rig.sensor_time_constant, (s - d) / g.td, (s - xi) / g.ti,
        ]  # fmt: skip

    solve_ivp(rhs, (0, wave.size / rate), np.zeros(6), rtol=1e-6, atol=1e-9)


def _shares(experiments: list[Experiment]) -> dict[str, float]:
    """Milliseconds per gain set and core of each part of an evaluation."""
    e = experiments[0]
    s = simulate_statistics(experiments, threads=1).statistics
    forces = force_statistics(s, e)
    bands = sliding_bands(forces.frequency, e.rig.protocol.band_width, e.rig.protocol.band_overlap)
    loop = s.at_lines(lines_at(e.excitations, "current"))
    sensitivity, _ = frequency_response(loop, "command", "injection")
    block = np.random.default_rng(0).standard_normal((2, kernel.LANES, e.samples_per_period))
    per_set = {
        "kernel": _kernel(experiments),
        "fft": _best(lambda: scipy.fft.rfft(block)) * e.periods * LANES / kernel.LANES,
        "ml_points_all_bands": _best(lambda: maximum_likelihood(forces, bands, e.rig.mass, intervals=False)),
        "ml_intervals_all_bands": _best(lambda: maximum_likelihood(forces, bands, e.rig.mass)),
        "margins": _best(lambda: margin_arrays(loop.frequency, sensitivity)),
    }
    return {f"{name}_ms": 1e3 * seconds / LANES for name, seconds in per_set.items()}


def _page(results: dict[str, Any]) -> str:
    import plotly.graph_objects as go

    seconds = {"this simulator": 1 / results["experiments_per_second_and_core"]}
    seconds |= {name: results[f"{name}_seconds"] for name in REFERENCES if results[f"{name}_seconds"]}
    figure = go.Figure(go.Bar(x=list(seconds.values()), y=list(seconds), orientation="h", marker_color=COLOURS[0]))
    figure.update_xaxes(type="log", title_text="seconds per experiment of 6 s and core")
    parts = {k.removeprefix("share_").removesuffix("_ms"): v for k, v in results.items() if k.startswith("share_")}
    shares = go.Figure(go.Bar(x=list(parts.values()), y=list(parts), orientation="h", marker_color=COLOURS[1]))
    shares.update_xaxes(title_text="milliseconds per gain set and core")
    rows = [(name.replace("_", " "), number(value)) for name, value in results.items() if isinstance(value, float)]
    sections = [
        ("Simulators", styled(figure, 300)),
        ("Parts of an evaluation", styled(shares, 320)),
        ("All figures", table(("figure", "value"), rows)),
    ]
    rate = results["gain_sets_per_second"]
    return page("Benchmark", f"{rate:.0f} gain sets per second.", sections, {"Processor": results["processor"]})


def _show(results: dict[str, Any]) -> None:
    grid = Table("figure", "value", title="maglev bench: hmb_free, 6 s at 20 kHz, 64 lanes")
    for name, value in results.items():
        if isinstance(value, float):
            grid.add_row(name.replace("_", " "), f"{value:.4g}")
    console.print(grid)
