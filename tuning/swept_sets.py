"""What a sweep gave, column by column as it lies in its file.

The command reads it by this: importing xarray, and what that imports, takes longer than many hundred gain sets.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.loop.gains import GAIN_CARDS, card_of
from tuning.sweep_file import BAND_ENDS

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class SweptSets:
    """Columns of a sweep, each read when it is used first.

    Args:
        attrs: attributes of its file.
        gains: names of the gains, which are columns, too.
        names: of all other columns with a value for each experiment, but for the number `experiment`.
        read: gives some rows, all as None, of a column, a band's end, or an array (n, bands).
    """

    attrs: Mapping[str, str]
    gains: tuple[str, ...]
    names: tuple[str, ...]
    read: Callable[[str, np.ndarray | None], np.ndarray]
    _known: dict[str, np.ndarray] = field(default_factory=dict, repr=False)

    @classmethod
    def of_file(cls, path: Path) -> "SweptSets":
        """Of a file that `write_sweep` wrote."""
        import h5py

        def read(name: str, rows: np.ndarray | None) -> np.ndarray:
            with h5py.File(path) as file:
                stored = file[name]
                # A file takes rows in their own order only, and each once.
                some = stored[:] if rows is None else np.stack([stored[row] for row in rows])
                return some.astype(bool) if stored.attrs.get("dtype") == "bool" else some

        with h5py.File(path) as file:
            gains = tuple(n for n in str(file["score"].attrs["coordinates"]).split() if n not in BAND_ENDS)
            others = {"experiment", "band", *BAND_ENDS, *gains}
            names = tuple(name for name in file if name not in others and file[name].ndim == 1)
            attributes = {name: value for name, value in file.attrs.items() if not name.startswith("_")}
            return cls(attributes, gains, names, read)

    @classmethod
    def of_dataset(cls, dataset: "xr.Dataset") -> "SweptSets":
        """Of the dataset that `run_sweep` gives."""
        gains = tuple(str(n) for n in dataset.coords if n not in ("experiment", "band", *BAND_ENDS))
        names = tuple(str(name) for name, v in dataset.data_vars.items() if v.dims == ("experiment",))

        def read(name: str, rows: np.ndarray | None) -> np.ndarray:
            return dataset[name].values if rows is None else dataset[name].values[rows]

        return cls(dataset.attrs, gains, names, read)

    def __len__(self) -> int:
        return len(self["experiment"])

    def __getitem__(self, name: str) -> np.ndarray:
        """A column, (n,), or the lower or upper ends of the bands, (bands,)."""
        if name not in self._known:
            self._known[name] = self.read(name, None)
        return self._known[name]

    @cached_property
    def shown(self) -> dict[str, tuple[float, str]]:
        """Factor from SI, and unit, in which pages and tables show each gain, by name in the order of the cards."""
        return {name: card_of(name, self.gains).on_pages for name in GAIN_CARDS if name in self.gains}

    def some(self, rows: np.ndarray) -> "SweptSets":
        """Some of the experiments (k,) by their places, without bands."""
        return SweptSets(
            self.attrs, self.gains, self.names, lambda name, of: self[name][rows][slice(None) if of is None else of]
        )

    def in_bands(self, name: str, rows: np.ndarray) -> np.ndarray:
        """Rows (k, bands) of an array over the bands, by the places of their experiments (k,)."""
        return self.read(name, rows)
