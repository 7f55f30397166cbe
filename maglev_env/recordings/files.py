"""Data files: columns read from .mat (v5, v7.3), text, JSON, .npz, .npy, .h5 and .nc, and written atomically."""

import os
import re
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maglev_env.recordings.formats import file_formats as formats
from maglev_env.recordings.formats.json_file import open_json
from maglev_env.recordings.formats.json_lines import open_json_lines
from maglev_env.recordings.formats.text_files import open_text
from maglev_env.recordings.formats.text_layout import TextLayout

TEXT = (".csv", ".tsv", ".txt", ".dat", ".lvm", ".log", ".asc", ".prn", ".tab")
HDF5 = (".h5", ".hdf5", ".hdf", ".nc")
JSON = (".json", ".jsonl", ".ndjson")
NUMPY = (".npz", ".npy")
SUFFIXES = (".mat", *TEXT, *JSON, *NUMPY, *HDF5)
# Files of measurements that are not read, and what to do with them.
SAVE_AS = {
    **dict.fromkeys((".xlsx", ".xls", ".xlsm", ".ods"), "save the sheet as CSV"),
    **dict.fromkeys((".tdms", ".tdm"), "export it as text or HDF5"),
    **dict.fromkeys((".mf4", ".mdf"), "export it as MATLAB or CSV"),
    **dict.fromkeys(
        (".pkl", ".pickle", ".parquet", ".feather", ".arrow"), "save it as CSV (pandas: to_csv), or with numpy.savez"
    ),
}
KEPT = 2**28  # bytes of the files of a campaign whose columns stay in memory
_HDF5 = b"\x89HDF\r\n\x1a\n"


@dataclass(frozen=True)
class Columns:
    """The columns of one data file, and `column` to read them.

    Attributes:
        path: Its path.
        names: Top-level names.
        positions: Of a text file, the names by position, "[0]", "[1]", ..., which every column has.
        notes: What was told from the file rather than stated, in words.
        headers: What a text, HDF5 or netCDF file calls a column, with the unit in brackets, where that says more than
            the name.
        numbers: Numbers that stand above the table of a text file, or as attributes in an HDF5 or netCDF file, by what
            the file calls them.
    """

    path: Path
    names: tuple[str, ...]
    _read: formats.Reader
    positions: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    headers: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[str, float] = field(default_factory=dict)

    def column(self, name: str) -> np.ndarray:
        """One column, shape (samples,), float64, in the file's own unit.

        Args:
            name: A top-level name, or an expression such as "mb10.Y[0].Data": .field of a struct, [n] (from 0) of a
                struct or cell array, and last [j] for column j of a matrix; or, of a text file, "[j]" for column j.

        Raises:
            ValueError: The name is unknown (the message lists what exists), the column is not one row of numbers, or
                the file is damaged.
        """
        return self._at(name, formats.vector)

    def value(self, name: str) -> Any:
        """What stands at a name or expression, as `column` takes it.

        Returns:
            An array, a struct (dict) or struct or cell array (list), whose parts are named by longer expressions, or
            a text.

        Raises:
            ValueError: As `column`.
        """
        return self._at(name, lambda value: value)

    def _at(self, name: str, read_as: Callable[[Any], Any]) -> Any:
        try:
            known = self.positions if name in self.positions else self.names
            return read_as(self._read(*formats.split_name(name, known)))
        except formats.Refused as problem:
            raise ValueError(f"{self.path}: column {name!r}: {problem}") from None
        except Exception as error:  # a damaged file can make the libraries raise almost anything
            raise ValueError(f"{self.path}: column {name!r}: the file is truncated or damaged ({error})") from error


def is_data_file(path: Path) -> bool:
    """Whether a path names a file that `read_columns` reads."""
    return path.is_file() and path.suffix.lower() in SUFFIXES


def read_columns(path: str | Path, layout: TextLayout | None = None) -> Columns:
    """Open a data file by its suffix: .mat (v5 or v7.3), text (TEXT), JSON, .npz, .npy, HDF5 (netCDF 4 too).

    Args:
        path: The file.
        layout: What is known of how a text file is written; the rest is told from its lines.

    Raises:
        OSError: It cannot be read.
        ValueError: It is too large, damaged or of another kind.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in SUFFIXES:
        instead = f"{SAVE_AS[kind]}; read are" if kind in SAVE_AS else "use"
        raise ValueError(f"{path}: files of kind {kind!r} are not read; {instead} {', '.join(SUFFIXES)}")
    if path.exists() and not path.is_file():
        raise ValueError(f"{path}: not a regular file")
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(520)
    hdf5 = _HDF5 in (head[:8], head[512:])
    if kind in HDF5 and not hdf5:
        raise ValueError(f"{path}: not an HDF5 file (classic netCDF is not read); it is truncated or damaged")
    try:
        formats.bounded(size, "the file")
        if hdf5:
            matlab = kind == ".mat"
            headers, numbers, notes = ({}, {}, ()) if matlab else formats.hdf5_attributes(path)
            return Columns(path, *formats.open_hdf5(path, matlab=matlab), (), notes, headers, numbers)
        if kind in TEXT:
            text = open_text(path, layout or TextLayout())
            return Columns(path, text.names, text.read, text.positions, text.notes, text.headers, text.numbers)
        if kind in JSON:
            names, read, notes = open_json(path) if kind == ".json" else open_json_lines(path)
            return Columns(path, names, read, notes=notes)
        opened = {".mat": formats.open_mat5, ".npz": formats.open_npz, ".npy": formats.open_npy}
        return Columns(path, *opened[kind](path))
    except formats.Refused as problem:
        raise ValueError(f"{path}: {problem}") from None
    except Exception as error:
        raise ValueError(f"{path}: cannot be read as {kind}: it is truncated or damaged ({error})") from error


class OpenedFiles:
    """Data files that are asked for again and again, each read once while all together are not too large.

    The rules and then a command ask for the same recordings; a copy in another process begins anew.
    """

    def __init__(self) -> None:
        self._room = KEPT
        self._files: dict[tuple[Path, TextLayout | None], Columns] = {}

    def columns(self, path: Path, layout: TextLayout | None = None) -> Columns:
        """A file's columns; errors as `read_columns`."""
        if (path, layout) not in self._files:
            opened = read_columns(path, layout)
            if (size := path.stat().st_size) > self._room:
                return opened
            self._room -= size
            self._files[path, layout] = replace(opened, _read=_once(opened._read))
        return self._files[path, layout]

    def __reduce__(self) -> tuple:
        return OpenedFiles, ()


def _once(read: formats.Reader) -> formats.Reader:
    found: dict[tuple, Any] = {}

    def known(root: str, steps: formats.Steps) -> Any:
        key = root, *steps
        if key not in found:
            found[key] = read(root, steps)
        return found[key]

    return known


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """A file that appears under its name only when it is complete and on the disk."""
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomic(path: str | Path, text: str) -> None:
    """Write UTF-8 text so that a reader sees either the old file or the complete new one.

    Raises:
        OSError: It cannot be written.
    """
    with atomic_file(Path(path)) as file:
        file.write(text.encode())


def write_npz(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns (samples,) to an .npz file, atomically.

    Raises:
        ValueError: They differ in length.
    """
    columns = _writable(path, columns)
    with atomic_file(Path(path)) as file:
        np.savez(file, **columns)


def write_mat(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns (samples,) to a MATLAB v5 file as column vectors, atomically.

    Raises:
        ValueError: As `write_npz`.
    """
    from scipy.io import savemat

    columns = _writable(path, columns)
    with atomic_file(Path(path)) as file:
        savemat(file, columns, oned_as="column")


def write_csv(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns (samples,) as CSV with a header line and 17 digits, atomically.

    Raises:
        ValueError: As `write_npz`.
    """
    columns = _writable(path, columns)
    with atomic_file(Path(path)) as file:
        np.savetxt(file, np.column_stack(list(columns.values())), "%.17g", ",", header=",".join(columns), comments="")


def _writable(path: str | Path, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in columns.items()}
    for name, values in arrays.items():
        if not re.fullmatch(r"[A-Za-z]\w{0,30}", name):
            raise ValueError(f"{path}: column name {name!r}: use letters, digits and _, 31 at most")
        if values.ndim != 1 or values.size != next(iter(arrays.values())).size:
            raise ValueError(f"{path}: column {name!r} has the shape {values.shape}; all must be of one length")
    return arrays
