"""The gain sets of a sweep as a map on the page."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.loop.gains import Controllers, gain_values, of_axis
from maglev_env.rig.goal import MATCH
from maglev_env.rig.rig import Rig

_HDF5 = b"\x89HDF\r\n\x1a\n"  # with which such a file begins
MOST = 20_000  # gain sets; more would make the page slow
_INDICES = ("experiment", "band", "band_low", "band_high")  # coordinates that are no gains
QUANTITIES = {"score": "", "peak_sensitivity": "", "stiffness": "N/m", "damping": "N s/m"}  # with SI units
AXES = ("kp", "kd", "ki")  # in the order in which they are chosen for x and y
# What a rig states beside itself: the page has its own gains, goal and ranges.
_BESIDE = ("gains", "bounds", "protocol", "target", "tolerance", "randomization", "effects")


@dataclass(frozen=True)
class SweepMap:
    """Gain sets and what each gave; None: unstable or touched down.

    Args:
        x, y: names of the gains on the axes.
        log: whether the axes are logarithmic.
        gains: by name, in SI, one value a set.
        values: by quantity, in SI.
        best: index of the best set; None: no set is feasible.
        note: a sentence where the sets were scored by another goal than the page's; else empty.
    """

    x: str
    y: str
    log: bool
    gains: Mapping[str, list[float]]
    values: Mapping[str, list[float | None]]
    best: int | None
    note: str = ""

    def gains_of(self, index: int) -> dict[str, float]:
        return {name: values[index] for name, values in self.gains.items()}


def sweep_file(path: Path) -> Path:
    """The file of a sweep, from its folder or that file itself.

    Raises:
        ValueError: It is not written in HDF5, as the file of a sweep is.
        FileNotFoundError: It does not exist.
    """
    file = path / "sweep.nc" if path.is_dir() else path
    if not file.is_file():
        raise FileNotFoundError(f"--sweep {path}: there is no {file}; make it with maglev sweep --out {path}")
    with file.open("rb") as stored:
        if stored.read(len(_HDF5)) != _HDF5:
            raise ValueError(f"--sweep {path}: {file} is not the sweep.nc of maglev sweep")
    return file


def read_sweep(path: Path, rigs: Sequence[Rig], controllers: Controllers) -> SweepMap:
    """The map of a sweep's folder or its sweep.nc.

    Args:
        path: of the folder or file.
        rigs: with their defaults: that of the page, and the one before its diagnosis; the sweep is of one of them.
        controllers: of the page, whose gains are those of the sweep.

    Raises:
        ValueError: It is no sweep, one of another rig, controller or sensor, of fewer than two gains, or too large.
        FileNotFoundError: It does not exist.
    """
    import xarray as xr

    file = sweep_file(path)
    try:
        dataset = xr.load_dataset(file)
        swept_rig = json.loads(dataset.attrs["rig"])
        name, effects = swept_rig["name"], json.loads(dataset.attrs.get("effects", "{}"))
    except (OSError, ValueError, KeyError):
        raise ValueError(f"--sweep {path}: {file} is not the sweep.nc of maglev sweep") from None
    differing = [_differing(rig, swept_rig, effects) for rig in rigs]
    if all(differing):
        other = "" if "name" in differing[0] else f" with another {differing[0][0].replace('_', ' ')}"
        raise ValueError(
            f"--sweep {path}: it swept {name}{other}, and the page is about {rigs[0].name}; "
            "name the same rig, and sweep it as it is"
        )
    if (sensor := dataset.attrs.get("sensor", "probe")) != "probe":
        raise ValueError(f"--sweep {path}: it was read by {sensor}, and the page by the probe; sweep without --sensor")
    known = gain_values(of_axis(controllers, 0))
    if other := sorted({str(name) for name in dataset.coords} - {*_INDICES} ^ known.keys()):
        raise ValueError(
            f"--sweep {path}: it swept another controller than the page has ({', '.join(other)} stand in one of them "
            "only); sweep the rig without --controller, or state it in the rig's file"
        )
    sets = dataset.sizes["experiment"]
    swept = [name for name in AXES if name in known and np.unique(dataset[name].values).size > 1]
    if len(swept) < 2:
        raise ValueError(f"--sweep {path}: {len(swept)} gain was swept; a map needs two of {', '.join(AXES)}")
    if sets > MOST:
        raise ValueError(f"--sweep {path}: {sets} gain sets; a map has at most {MOST}")
    feasible = dataset["feasible"].values.astype(bool)
    best = int(np.where(feasible, dataset["score"].values, -np.inf).argmax()) if feasible.any() else None
    gains = {str(name): dataset[name].values.tolist() for name in known}
    values = {name: _known(dataset[name].values, feasible) for name in QUANTITIES}
    note = _other_goal(swept_rig.get("target", {}).get("goal", MATCH), rigs[0].target.goal)
    return SweepMap(swept[0], swept[1], dataset.attrs.get("log") == "true", gains, values, best, note)


def _other_goal(swept: str, shown: str) -> str:
    """A sentence where a sweep was scored by another goal than the page shows; else empty."""
    if swept == shown:
        return ""
    named = " ".join(swept.split())
    return f"The sweep's scores, and so its best set, are by its own goal ({named}), not by the one of this page."


def _differing(rig: Rig, swept: Mapping[str, Any], effects: Mapping[str, Any]) -> list[str]:
    """What the stored rig of a sweep states otherwise, its name first, and then its effects."""
    own = json.loads(json.dumps(asdict(rig)))
    keys = [key for key in own if key in swept and key not in _BESIDE]
    found = [key for key in keys if own[key] != swept[key]]
    return found + ["set of effects"] * (own["effects"] != {**swept.get("effects", {}), **effects})


def _known(values: np.ndarray, feasible: np.ndarray) -> list[Any]:
    return [float(v) if ok and np.isfinite(v) else None for v, ok in zip(values, feasible, strict=True)]
