"""Common parts of pages on self-sensing in a loop: means over seeds with intervals, and facts on the loop."""

from collections.abc import Mapping
from dataclasses import asdict

import numpy as np

from maglev_env.loop.gains import Gains, as_table
from maglev_env.rig.rig import Rig
from maglev_workbench.commands.selfsense.rig_sensor import made_by
from maglev_workbench.page import number, rig_facts, with_interval
from selfsense.sensor import SelfSensor


def mean_with_half_width(samples: np.ndarray) -> tuple[float, float]:
    """Mean of the finite samples (n,) and half its 95 % interval by Student's t; nan if too few are finite."""
    from scipy.stats import t

    good = samples[np.isfinite(samples)]
    if good.size < 2:
        return (float(good.mean()) if good.size else np.nan), np.nan
    return float(good.mean()), float(t.ppf(0.975, good.size - 1) * good.std(ddof=1) / np.sqrt(good.size))


def mean_in_words(samples: np.ndarray) -> str:
    """The mean of samples (n,) with its 95 % interval, as text."""
    mean, half = mean_with_half_width(samples)
    return with_interval(mean, mean - half, mean + half) if np.isfinite(half) else number(mean)


def loop_facts(rig: Rig, sensor: SelfSensor, **settings: object) -> Mapping[str, object]:
    """Names and values for a page's foot: rig, sensor (of the first axis), excitation, gains and settings."""
    gains = asdict(rig.gains) if isinstance(rig.gains, Gains) else as_table(rig.gains)
    words = ", ".join(f"{name} {value}" for name, value in gains.items())
    return made_by(rig, sensor, Excitation=rig_facts(asdict(rig))["Excitation"], Gains=words, **settings)
