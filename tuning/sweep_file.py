"""The file of a sweep's results: written chunk by chunk, so that memory does not grow with the number of gain sets."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.evaluation.evaluation import unit_of
from maglev_env.loop.gains import unit_of_gain

if TYPE_CHECKING:
    import h5netcdf
    import xarray as xr

BAND_ENDS = ("band_low", "band_high")
TOGETHER = 32  # chunks that are written at a time
LARGE = 20_000  # experiments; the results of more stay in their file


def write_sweep(
    path: Path,
    parts: Iterable[Mapping[str, np.ndarray]],
    gains: Mapping[str, np.ndarray],
    attributes: Mapping[str, str],
) -> None:
    """Write the results of all chunks as one netCDF file.

    Args:
        path: of the file.
        parts: the arrays of each chunk, by name, in order.
        gains: of all experiments, (n,), by name.
        attributes: of the file.
    """
    import h5netcdf

    parts = _fewer(parts)
    first = next(parts)
    n, bands = len(next(iter(gains.values()))), first["bands"]
    whole = {"experiment": np.arange(n), **gains, "band_low": bands[:, 0], "band_high": bands[:, 1]}
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"experiment": n, "band": len(bands)}
        file.attrs.update(attributes)
        for name, values in whole.items():
            unit = "Hz" if name.startswith("band_") else unit_of_gain(name, gains) if name in gains else ""
            of = "band" if name.startswith("band_") else "experiment"
            file.create_variable(name, (of,), data=values).attrs.update(_units(unit))
        stored = {name: _begun(file, name, array, gains) for name, array in first.items() if name != "bands"}
        start = 0
        for part in chain([first], parts):
            stop = start + len(part["score"])
            for name, variable in stored.items():
                variable[start:stop] = part[name]
            start = stop


def _fewer(parts: Iterable[Mapping[str, np.ndarray]]) -> Iterator[Mapping[str, np.ndarray]]:
    """The same arrays in longer parts: to write one takes as long for few numbers as for many."""
    parts = iter(parts)
    while several := list(islice(parts, TOGETHER)):
        yield {n: a if n == "bands" else np.concatenate([one[n] for one in several]) for n, a in several[0].items()}


def _begun(file: "h5netcdf.File", name: str, array: np.ndarray, gains: Iterable[str]) -> "h5netcdf.Variable":
    """An empty variable for arrays like this one, with the attributes by which xarray knows coordinates and truths."""
    truth = array.dtype == bool
    made = file.create_variable(name, ("experiment", "band")[: array.ndim], np.int8 if truth else array.dtype)
    made.attrs.update(_units(unit_of(name)) | ({"dtype": "bool"} if truth else {}))
    made.attrs["coordinates"] = " ".join([*gains, *(("band_low", "band_high") if array.ndim == 2 else ())])
    return made


def read_sweep(path: Path) -> "xr.Dataset":
    """What `write_sweep` wrote; of more than LARGE experiments each variable is read when it is used."""
    import xarray as xr

    opened = xr.open_dataset(path, engine="h5netcdf")
    if opened.sizes["experiment"] > LARGE:
        return opened
    with opened:
        return opened.load()


def _units(unit: str) -> dict[str, str]:
    return {"units": unit} if unit else {}
