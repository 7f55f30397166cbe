"""The gain sets of a sweep as a map on the page."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

MOST = 20_000  # gain sets; more would make the page slow
QUANTITIES = {"score": "", "peak_sensitivity": "", "stiffness": "N/m", "damping": "N s/m"}  # with SI units
AXES = ("kp", "kd", "ki")  # in the order in which they are chosen for x and y


@dataclass(frozen=True)
class SweepMap:
    """Gain sets and what each gave; None: unstable or touched down.

    Args:
        x, y: names of the gains on the axes.
        log: whether the axes are logarithmic.
        gains: by name, in SI, one value a set.
        values: by quantity, in SI.
        best: index of the best set; None: no set is feasible.
    """

    x: str
    y: str
    log: bool
    gains: Mapping[str, list[float]]
    values: Mapping[str, list[float | None]]
    best: int | None

    def gains_of(self, index: int) -> dict[str, float]:
        return {name: values[index] for name, values in self.gains.items()}


def read_sweep(path: Path, rig_name: str) -> SweepMap:
    """The map of a sweep's folder or its sweep.nc.

    Raises:
        ValueError: It is no sweep, one of another rig, of fewer than two gains, or too large.
        FileNotFoundError: It does not exist.
    """
    import json

    import xarray as xr

    file = path / "sweep.nc" if path.is_dir() else path
    if not file.is_file():
        raise FileNotFoundError(f"--sweep {path}: there is no {file}; make it with maglev sweep --out {path}")
    try:
        dataset = xr.load_dataset(file)
        swept_rig = json.loads(dataset.attrs["rig"])["name"]
    except (OSError, ValueError, KeyError):
        raise ValueError(f"--sweep {path}: {file} is not the sweep.nc of maglev sweep") from None
    if swept_rig != rig_name:
        raise ValueError(f"--sweep {path}: it swept {swept_rig}, and the page is about {rig_name}; name the same rig")
    sets = dataset.sizes["experiment"]
    swept = [name for name in AXES if np.unique(dataset[name].values).size > 1]
    if len(swept) < 2:
        raise ValueError(f"--sweep {path}: {len(swept)} gain was swept; a map needs two of {', '.join(AXES)}")
    if sets > MOST:
        raise ValueError(f"--sweep {path}: {sets} gain sets; a map has at most {MOST}")
    feasible = dataset["feasible"].values.astype(bool)
    best = int(np.where(feasible, dataset["score"].values, -np.inf).argmax()) if feasible.any() else None
    gains = {str(name): dataset[name].values.tolist() for name in (*AXES, "td", "ti") if name in dataset.coords}
    values = {name: _known(dataset[name].values, feasible) for name in QUANTITIES}
    return SweepMap(swept[0], swept[1], dataset.attrs.get("log") == "true", gains, values, best)


def _known(values: np.ndarray, feasible: np.ndarray) -> list[Any]:
    return [float(v) if ok and np.isfinite(v) else None for v, ok in zip(values, feasible, strict=True)]
