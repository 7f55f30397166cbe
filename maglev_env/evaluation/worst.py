"""A goal on the worst of rigs within tolerance: the same experiments on drawn rigs, and each quantity's worst value."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from maglev_env.evaluation.goal_score import misses
from maglev_env.experiment import Experiment
from maglev_env.rig.drawn import scaled_rig, tolerance_factors
from maglev_env.rig.goal import QUANTITIES, Goal, Requirement
from maglev_env.rig.self_sensor import rig_sensors

SEED = 1618  # the same rigs for every gain set, so that gain sets are compared on equal ones


def drawn_experiments(experiments: Sequence[Experiment], count: int) -> list[list[Experiment]]:
    """The experiments on `count` rigs each, drawn within the tolerance of the experiment's own rig."""
    rng = np.random.default_rng(SEED)
    factors = [tolerance_factors(experiments[0].rig, rng) for _ in range(count)]
    found = []
    for own in factors:
        scaled = {key: scaled_rig(rig, own) for key, rig in {id(e.rig): e.rig for e in experiments}.items()}
        rigs = [scaled[id(e.rig)] for e in experiments]
        # A self-sensor stays as it was designed, for the rig that is not drawn.
        sensors = [
            rig_sensors(rig, e.rig) if e.sensor == "self_sensing" else e.sensor
            for rig, e in zip(rigs, experiments, strict=True)
        ]
        drawn = zip(experiments, rigs, sensors, strict=True)
        found.append([replace(e, rig=rig, sensor=sensor) for e, rig, sensor in drawn])
    return found


def worst_of(
    goal: Goal, required: Sequence[Mapping[str, np.ndarray]], *bounds: Sequence[Mapping[str, np.ndarray]]
) -> list[dict[str, np.ndarray]]:
    """The worst value of each quantity over several rigs, and the bounds that belong to it.

    Args:
        goal: The goal.
        required: Of each rig, values (n,) by name.
        bounds: Likewise.
    """
    asked = {r.name: r for r in goal.measured}
    found: list[dict[str, np.ndarray]] = [{} for _ in (required, *bounds)]
    for name in required[0]:
        one = asked.get(name) or Requirement(name, 1.0)
        worst = np.argmax([misses(one, values[name]) for values in required], axis=0)
        for own, parts in zip(found, (required, *bounds), strict=True):
            own[name] = np.take_along_axis(np.stack([values[name] for values in parts]), worst[None], axis=0)[0]
    return found


def worst_hidden(parts: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The worst that several rigs or axes have between the lines (see `Evaluation.between_lines`), by quantity.

    One may have the highest peak and another the least margin. The frequency of the peak is that of the highest one.
    """
    found = {}
    for name in parts[0]:
        values = np.stack([part[name] for part in parts])
        if name == "peak_frequency":
            highest = np.nan_to_num([part["peak_sensitivity"] for part in parts]).argmax(axis=0)
            found[name] = np.take_along_axis(values, highest[None], axis=0)[0]
        else:
            found[name] = (np.fmax if QUANTITIES[name].most else np.fmin).reduce(values)
    return found
