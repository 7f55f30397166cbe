"""One SPHS experiment with the probe and with self-sensing: at a rig's gains, and over kp and kd."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from estimation.lines.frequency_response import frequency_response
from estimation.stability_margins import margin_arrays
from estimation.xy.planar import axis_statistics
from maglev_env.evaluation.evaluate import evaluate
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.experiment import Experiment, axis_experiment, protocol_experiment, recorded_channels, without_noise
from maglev_env.kernel.simulate import simulate_records, simulate_statistics
from maglev_env.linear.loop import loop_response
from maglev_env.linear.poles import closed_loop_poles
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import of_axis
from maglev_env.rig.excitation import lines_at
from maglev_env.rig.rig import Rig
from maglev_env.rig.self_sensor import rig_sensors
from selfsense.sensor import SelfSensor
from tuning.axis import Axis
from tuning.sweep import Sweep, gain_sets

SENSORS = ("probe", "self_sensing")
SEEDS = 8  # experiments with noise of their own, half of the lanes of a block
PIECE = 0.05  # s of the time series shown
_CURVE = 150  # frequencies of the linear model


@dataclass(frozen=True)
class Curve:
    """S of one sensor's loop: measured (n,) with variance at the injection lines (Hz), both nan after a touchdown;
    model (m,) at model_frequency (Hz), None when the linear loop is unstable."""

    frequency: np.ndarray
    measured: np.ndarray
    variance: np.ndarray
    model_frequency: np.ndarray
    model: np.ndarray | None
    model_margins: Mapping[str, float]


@dataclass(frozen=True)
class Piece:
    """A piece of the self-sensing record: time (s), position and sensed reading (m), each (n,).

    why: The reason this stretch was chosen for the plot.
    """

    time: np.ndarray
    position: np.ndarray
    reading: np.ndarray
    why: str


@dataclass(frozen=True)
class Comparison:
    """Both sensors on one rig; the mappings are by SENSORS.

    preset: evaluations of SEEDS experiments at the rig's gains; gains: of the map, kp (p,) and kd (p,), spaced evenly
    in their logarithms with `log`; map: evaluations of p x p experiments, kd fastest; lost (p p,): phase margin
    (degrees) lost by the linear model, nan where a sensor does not hold the rotor. quiet_holds: whether self-sensing
    levitates without noise and rounding, None where it does with them.
    """

    rig: Rig
    sensors: tuple[SelfSensor, ...]
    seed: int
    preset: Mapping[str, Evaluation]
    curves: Mapping[str, Curve]
    piece: Piece
    quiet_holds: bool | None
    gains: Mapping[str, np.ndarray]
    log: bool
    map: Mapping[str, Evaluation]
    lost: np.ndarray


def map_plan(rig: Rig, points: int, seed: int) -> Sweep:
    """The map's gain sets: points x points of kp and kd over the rig's bounds, the other gains at the preset."""
    missing = [name for name in ("kp", "kd") if name not in rig.bounds]
    if missing:
        raise ValueError(f"rig {rig.name}: [bounds] lacks {', '.join(missing)}; the map needs lowest and highest gains")
    axes = {name: Axis(*rig.bounds[name], points) for name in ("kp", "kd")}
    plan = Sweep(rig, axes, all(axis.low > 0 for axis in axes.values()), seed=seed)
    gain_sets(plan)  # raises for a controller without gains
    return plan


def compare(plan: Sweep, threads: int | None = None, progress: Callable[[int], None] | None = None) -> Comparison:
    """Run the rig's protocol with both sensors at its gains, with SEEDS noises, and at the gain sets of `map_plan`.

    ValueError when the rig's coils cannot sense or its protocol lacks a force or a current excitation.
    """
    rig, seed, sets = plan.rig, plan.seed, gain_sets(plan)
    preset = {
        s: evaluate([protocol_experiment(rig, seed=(seed, i), sensor=s) for i in range(SEEDS)], threads, progress)
        for s in SENSORS
    }
    plans = {s: [protocol_experiment(rig, g, seed=(seed, i), sensor=s) for i, g in enumerate(sets)] for s in SENSORS}
    of_map = {s: evaluate(plans[s], threads, progress) for s in SENSORS}
    lost = np.full(len(sets), np.nan)
    for i in np.flatnonzero(of_map["probe"].feasible & of_map["self_sensing"].feasible):
        axis = int(of_map["self_sensing"].axis[i])
        with_probe, sensed = (_model(plans[s][i], axis)[2]["phase_margin"] for s in SENSORS)
        lost[i] = with_probe - sensed
    first = {s: protocol_experiment(rig, seed=(seed, 0), sensor=s) for s in SENSORS}
    quiet_holds = None
    if not preset["self_sensing"].feasible.all():
        quiet = without_noise(first["self_sensing"])
        alive = np.isnan(simulate_statistics([quiet], threads=threads).touchdown_time[0])
        quiet_holds = bool(alive and np.abs(closed_loop_poles(quiet)).max() < 1)
    axes = {s: int(preset[s].axis[0]) for s in SENSORS}
    n = plan.axes["kp"].points
    gains = {
        "kp": np.array([of_axis(g, 0).kp for g in sets]).reshape(n, n)[:, 0],
        "kd": np.array([of_axis(g, 0).kd for g in sets]).reshape(n, n)[0],
    }
    return Comparison(
        rig=rig,
        sensors=rig_sensors(rig),
        seed=seed,
        preset=preset,
        curves={s: _curve(first[s], axes[s]) for s in SENSORS},
        piece=_piece(first["self_sensing"], axes["self_sensing"]),
        quiet_holds=quiet_holds,
        gains=gains,
        log=plan.log,
        map=of_map,
        lost=lost,
    )


def _model(e: Experiment, axis: int) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Frequencies (Hz) over the injection lines, S of an axis there by the linear model, and its margins."""
    lines = lines_at(axis_experiment(e, axis).excitations, "current") * e.fundamental
    frequency = np.geomspace(lines[0], lines[-1], _CURVE)
    s = loop_response(e, frequency).sensitivity
    s = s[:, axis, axis] if e.rig.axes == 2 else s
    return frequency, s, {name: float(value) for name, value in margin_arrays(frequency, s).items()}


def _curve(e: Experiment, axis: int) -> Curve:
    statistics = simulate_statistics([e]).statistics
    if e.rig.axes == 2:
        statistics = axis_statistics(statistics, AXES[axis])
    injection = statistics.at_lines(lines_at(axis_experiment(e, axis).excitations, "current"))
    measured, variance = frequency_response(injection, "command", "injection")
    stable = np.abs(closed_loop_poles(e)).max() < 1
    frequency, model, margins = _model(e, axis)
    return Curve(
        injection.frequency, measured[0], variance[0], frequency, model if stable else None, margins if stable else {}
    )


def _piece(e: Experiment, axis: int) -> Piece:
    """The stretch around the largest error of the kept period, or before a touchdown."""
    record = simulate_records([replace(e, periods=1)])[0]
    names = recorded_channels(e)
    reading, position = (record[names.index(name) * e.rig.axes + axis] for name in ("displacement", "position"))
    alive, n = np.flatnonzero(np.isfinite(position)), e.samples_per_period
    length = max(round(PIECE * e.rig.control_rate), 10)
    if alive.size < position.size:
        span, why = slice(max(0, alive.size - length), alive.size), "until the rotor touched down"
    else:
        kept = slice(position.size - n, None)
        worst = position.size - n + int(np.abs((reading - position)[kept]).argmax())
        start = int(np.clip(worst - length // 2, 0, max(0, position.size - length)))
        span, why = slice(start, start + length), "around the largest error of a period"
    time = np.arange(position.size)[span] / e.rig.control_rate
    return Piece(time, position[span], reading[span], why)
