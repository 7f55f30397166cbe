"""Self-sensing at the level of switching edges: alone, in a levitation loop, and beside a general integrator."""

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from maglev_env.rig.rig_file import load_rig
from maglev_env.rig.self_sensor import rig_sensors
from maglev_lanes.layout import LANES
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.kernels import quiet_experiment
from maglev_workbench.commands.bench.timing import Size, alternately, stepper
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

_LANES, _SECONDS = 32, 0.2  # simulated
_IVP_SECONDS = 2e-3


def self_sensing_figures(size: Size) -> dict[str, Figure]:
    """Milliseconds of one core per simulated second and lane.

    They are measured for supply, coil, converter and estimator at 250 kHz; for the same in the loop of hmb_free; and
    for solve_ivp with the switching edges as events, for one coil without estimator.
    """
    sensor = rig_sensors(load_rig("hmb_free"))[0]
    samples = int(_SECONDS * sensor.acquisition.rate)
    time = np.arange(1, samples + 1) / sensor.acquisition.rate
    gap, drive = (mean + swing * np.sin(2 * np.pi * 100 * time) for mean, swing in ((sensor.gap, 5e-5), (0.0, 0.2)))
    e = replace(quiet_experiment(), sensor="self_sensing")
    calls = 3 * size.repeats
    works = {
        "alone": lambda: simulate([sensor] * _LANES, gap, drive, every=10),
        "loop": stepper([replace(e, seed=i) for i in range(LANES)], calls),
        "solve_ivp": lambda: _switched(sensor),
    }
    works["alone"]()
    seconds = alternately(works, calls)
    alone = seconds["alone"] / _LANES / _SECONDS
    loop = seconds["loop"] / LANES * e.fundamental
    reference = seconds["solve_ivp"] / _IVP_SECONDS
    unit = "ms per s and lane"
    return {
        "self_sensing_ms_per_second_and_lane": Figure(1e3 * alone, unit),
        "self_sensing_loop_ms_per_second_and_lane": Figure(1e3 * loop, unit),
        "self_sensing_solve_ivp_ms_per_second": Figure(1e3 * reference, "ms per s", None),
        "self_sensing_times_faster_than_solve_ivp": Figure(reference / alone, "ratio", "higher"),
    }


def _switched(s: SelfSensor) -> None:
    """The current of a coil whose gap moves, at rtol 1e-6; every edge is an event that ends a piece."""
    state, time, on = np.zeros(1), 0.0, True

    def slope(t: float, i: np.ndarray) -> list[float]:
        inductance = s.coil.inductance(s.gap + 5e-5 * np.sin(2 * np.pi * 100 * t))
        return [((s.supply.voltage if on else -s.supply.voltage) - s.coil.resistance * i[0]) / inductance]

    def edge(t: float, i: np.ndarray) -> float:
        return t - stop

    edge.terminal = True
    while time < _IVP_SECONDS:
        stop = time + 0.5 / s.supply.frequency
        piece = solve_ivp(slope, (time, time + 1 / s.supply.frequency), state, rtol=1e-6, atol=1e-9, events=edge)
        time, state, on = piece.t[-1], piece.y[:, -1], not on
