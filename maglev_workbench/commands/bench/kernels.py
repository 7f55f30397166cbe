"""Speed of the lane kernel's variants, and of general simulators of the same loop."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.signal
from scipy.integrate import solve_ivp

from maglev_env.design.defaults import with_defaults
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.linear.poles import closed_loop
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import effect
from maglev_env.loop.gains import Gains, LinearController, state_space
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rig.rig import Noise, Rig
from maglev_env.rig.rig_file import load_rig
from maglev_lanes.layout import LANES
from maglev_workbench.commands.bench.figures import Figure
from maglev_workbench.commands.bench.timing import Size, alternately, stepper
from maglev_workbench.console import console

# Beside the quiet one-axis kernel; names of figures.
VARIANTS = (
    "xy", "xy_coupled", "linear_controller", "electromagnet", "magnet_coil", "amplifier_lag", "delay", "eddy_current",
)  # fmt: skip
CROSS = Cross(stiffness_xy=100.0, stiffness_yx=-100.0, damping_xy=0.1, gain_xy=0.2, sensor_xy=0.01)
_LAGS = {"amplifier_time_constant": 1e-4, "sensor_time_constant": 1.6e-5, "control_rate": 20e3}  # those of hmb_free
_LINEAR_SHARE, _IVP_SHARE = 30, 600  # the slow simulators run one over this number of the experiment


def kernel_figures(size: Size) -> dict[str, Figure]:
    """Nanoseconds per control step and lane (of x-y: both axes) of one core, and ratios to the one-axis kernel."""
    quiet = quiet_experiment()
    noisy = protocol_experiment(load_rig("hmb_free"))
    kinds = {"one_axis": quiet, "with_noise": noisy} | variants(quiet)
    calls = 24 * size.repeats  # of milliseconds each: some fall between the time slices of other work
    works = {name: stepper(_lanes(e), calls) for name, e in kinds.items()}
    works["one_lane"] = stepper([quiet], calls)
    seconds = alternately(works, calls)
    per_step = {name: 1e9 * seconds[name] / kinds[name].samples_per_period / LANES for name in kinds}
    one = per_step["one_axis"]
    unit = "ns per step and lane"
    found = {
        "kernel_ns_per_step_and_lane": Figure(one, unit),
        "kernel_with_noise_ns_per_step_and_lane": Figure(per_step["with_noise"], unit),
        "one_lane_ns_per_step": Figure(1e9 * seconds["one_lane"] / quiet.samples_per_period, "ns per step"),
        "lanes_speedup": Figure(seconds["one_lane"] * LANES / seconds["one_axis"], "ratio", "higher"),
    }
    for name in VARIANTS:
        found[f"kernel_{name}_ns_per_step_and_lane"] = Figure(per_step[name], unit)
        found[f"kernel_{name}_over_one_axis"] = Figure(per_step[name] / one, "ratio")
    return found


def quiet_experiment() -> Experiment:
    """The protocol of hmb_free without noise, with which the kernel alone is measured."""
    return protocol_experiment(replace(load_rig("hmb_free"), noise=Noise()))


def _lanes(e: Experiment) -> list[Experiment]:
    """One full block."""
    return [replace(e, seed=i) for i in range(LANES)]


def variants(one: Experiment) -> dict[str, Experiment]:
    """Experiments that need other variants of the kernel, with the rate, lags and converters of the one-axis one."""
    turned = tuple(replace(x, direction=45.0) for x in one.excitations)  # both axes move
    xy = replace(one, rig=replace(one.rig, axes=2), excitations=turned)
    ball = Rig("ball", "electromagnet", mass=0.058, gap=10e-3, turns=1000, pole_area=3e-4, **_LAGS)
    coil = Rig("coil", "magnet_coil", mass=0.02, gap=15e-3, force_constant=2e-8, force_exponent=4.0, **_LAGS)
    return {
        "xy": xy,
        "xy_coupled": replace(xy, rig=replace(xy.rig, cross=CROSS)),
        "linear_controller": replace(one, gains=fifth_order(one.gains, 1 / one.rig.control_rate)),
        "electromagnet": protocol_experiment(with_defaults(ball)),
        "magnet_coil": protocol_experiment(with_defaults(coil)),
        "amplifier_lag": replace(one, effects=effect("amplifier_lag", 1e-4)),
        "delay": replace(one, effects=effect("delay", 75e-6)),
        "eddy_current": replace(one, effects=effect("eddy_current", 1400.0)),
    }


def fifth_order(gains: Gains, dt: float) -> LinearController:
    """The PID as a linear controller with three cancelling pairs of pole and zero, so that the loop stays the same."""
    a, b, c, d = state_space(gains, dt)
    numerator, denominator = scipy.signal.ss2tf(a, b[:, None], c[None], np.array([[d]]))
    pairs = np.poly([0.1, 0.3, 0.5])
    return LinearController(*(tuple(np.polymul(p, pairs).tolist()) for p in (numerator[0], denominator)))


def reference_figures(size: Size) -> dict[str, Figure]:
    """Seconds of one core for the 6 s experiment, by this kernel in lanes and by simulators of one loop at a time.

    dlsim and python-control's forced_response step the linearised loop, solve_ivp the nonlinear one with a continuous
    PID; each runs a part of the experiment, scaled up.
    """
    e, calls = quiet_experiment(), 3 * size.repeats
    periods = e.periods + e.transient_periods
    works, scales = {"kernel": stepper(_lanes(e), calls)}, {"kernel": periods / LANES}
    for name, (work, scale) in _references(e, periods * e.samples_per_period).items():
        works[name], scales[name] = work, scale
    best = alternately(works, calls)
    seconds = {name: best[name] * scale for name, scale in scales.items()}
    kernel = seconds.pop("kernel")
    found = {"experiments_per_second_and_core": Figure(1 / kernel, "1/s", "higher")}
    for name, value in seconds.items():
        found[f"{name}_seconds"] = Figure(value, "s", None)
        found[f"times_faster_than_{name}"] = Figure(value / kernel, "ratio", "higher")
    return found


def _references(e: Experiment, samples: int) -> dict[str, tuple[Callable[[], object], float]]:
    """Functions to time, and the factors from their seconds to the seconds for all samples."""
    a, b, c = closed_loop(e)
    dt, d = 1 / e.rig.control_rate, np.zeros((1, 1))
    u = e.waveform("force")[: samples // _LINEAR_SHARE]
    found = {
        "dlsim": (lambda: scipy.signal.dlsim((a, b, c, d, dt), u[:, None]), _LINEAR_SHARE),
        "solve_ivp": (lambda: _continuous(e, u[: samples // _IVP_SHARE]), _IVP_SHARE),
    }
    try:
        import control
    except ImportError:
        console.print("python-control is not installed: its row is left out (pip install 'maglev-workbench[bench]')")
        return found
    system, time = control.ss(a, b, c, d, dt), np.arange(u.size) * dt
    return found | {"forced_response": (lambda: control.forced_response(system, time, u), _LINEAR_SHARE)}


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
