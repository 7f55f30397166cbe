"""Numbers of self-sensing beside the probe in a levitation loop, and the comparison as JSON."""

from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.evaluation.score import WEIGHTS
from maglev_env.loop.axes import AXES
from maglev_env.loop.gains import as_table
from maglev_env.recordings.formats.json_data import plain
from maglev_workbench.commands.selfsense.levitate.experiments import SEEDS, SENSORS, Comparison
from maglev_workbench.commands.selfsense.loop_facts import mean_with_half_width

# Label with unit, factor from SI.
QUANTITIES = {
    "stiffness": ("stiffness, kN/m", 1e-3),
    "damping": ("damping, N s/m", 1.0),
    "peak_sensitivity": ("peak |S|", 1.0),
    "phase_margin": ("phase margin, °", 1.0),
    "gain_margin_high": ("gain margin up, factor", 1.0),
    "gain_margin_low": ("gain margin down, factor", 1.0),
    "disk_margin": ("disk margin", 1.0),
    "score": ("score", 1.0),
    "current_rms": ("coil current, mA rms", 1e3),
    "peak_displacement": ("largest reading, µm", 1e6),
}
ERRORS = {
    "gap_error_rms": ("gap error, rms, µm", 1e6),
    "gap_error_bias": ("gap error, mean, µm", 1e6),
    "gap_error_worst": ("gap error, largest, µm", 1e6),
    "added_phase": ("lag beyond the probe's at the crossover, °", 1.0),
    "margin_lost": ("phase margin lost to self-sensing, °", 1.0),
}
ESTIMATED = ("stiffness", "damping")
MODELLED = ("peak_sensitivity", "phase_margin", "gain_margin_high", "gain_margin_low", "disk_margin")


def values(e: Evaluation, name: str) -> np.ndarray:
    """One quantity of every experiment (n,), SI."""
    return e.margins[name] if name in e.margins else getattr(e, name)


def levitates(c: Comparison, sensor: str) -> bool:
    """Whether the rotor never touched down at the rig's gains, on a stable loop, in all experiments."""
    return bool(c.preset[sensor].feasible.all())


def worse_axis(c: Comparison, sensor: str) -> str | None:
    """Name of the axis that the first experiment is scored by, None on a rig with one axis."""
    return AXES[int(c.preset[sensor].axis[0])] if c.rig.axes == 2 else None


def levitate_json(c: Comparison) -> dict[str, Any]:
    """The comparison as JSON data, schema maglev-selfsense-levitate/1, SI and degrees."""
    data: dict[str, Any] = {
        "schema": "maglev-selfsense-levitate/1",
        "version": version("maglev-workbench"),
        "rig": c.rig.name,
        "gains": as_table(c.rig.gains),
        "seed": c.seed,
        "experiments": SEEDS,
        "sensors": [asdict(sensor) for sensor in c.sensors],
        "levitates_without_noise": c.quiet_holds,
    }
    for s in SENSORS:
        e, curve = c.preset[s], c.curves[s]
        one = {"levitates": levitates(c, s), "touchdown_time": e.touchdown_time[0], "axis": worse_axis(c, s)}
        one |= {name: values(e, name)[0] for name in (*QUANTITIES, *ERRORS)}
        one |= {f"{name}_ci": (getattr(e, f"{name}_low")[0], getattr(e, f"{name}_high")[0]) for name in ESTIMATED}
        one["peak_sensitivity_se"] = e.peak_sensitivity_se[0]
        one["terms"] = {name: e.terms[name][0] for name in WEIGHTS}
        one["bands"] = {
            "hz": e.bands,
            **{name: getattr(e, name)[0] for n in ESTIMATED for name in (f"band_{n}", f"band_{n}_se")},
        }
        one["sensitivity"] = {
            "frequency": curve.frequency,
            "magnitude": np.abs(curve.measured),
            "se": np.sqrt(curve.variance / 2),
        }
        one["linear_model"] = {name: curve.model_margins.get(name) for name in MODELLED}
        data[s] = one
    both = {name: values(c.preset["self_sensing"], name) - values(c.preset["probe"], name) for name in QUANTITIES}
    data["difference"] = {name: _pair(samples) for name, samples in both.items()}
    data["errors"] = {name: _pair(values(c.preset["self_sensing"], name)) for name in ERRORS}
    held, shape = {s: c.map[s].feasible for s in SENSORS}, (len(c.gains["kp"]), len(c.gains["kd"]))
    of_map: dict[str, Any] = {"kp": c.gains["kp"], "kd": c.gains["kd"], "order": "[kp][kd]"}
    for s in SENSORS:
        names = ("feasible", "score", "phase_margin", "peak_sensitivity")
        of_map[s] = {name: values(c.map[s], name).reshape(shape) for name in names}
    for name in ("margin_lost", "gap_error_rms"):
        of_map["self_sensing"][name] = values(c.map["self_sensing"], name).reshape(shape)
    of_map["model_margin_lost"] = c.lost.reshape(shape)
    of_map["held"] = {s: int(held[s].sum()) for s in SENSORS}
    of_map["held_by_probe_only"] = int((held["probe"] & ~held["self_sensing"]).sum())
    return plain(data | {"map": of_map})


def _pair(samples: np.ndarray) -> dict[str, float]:
    return dict(zip(("mean", "half_width"), mean_with_half_width(samples), strict=True))
