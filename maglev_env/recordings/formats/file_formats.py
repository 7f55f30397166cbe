"""Readers of the file formats: for each, its top-level names and a function that reads one value below them.

Nothing in a file is executed: there is no unpickling, links to other files are not followed, and sizes are checked
before memory is allocated.
"""

import difflib
import re
import zipfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.recordings.formats.cf_packing import is_packed, unpacked
from maglev_env.recordings.formats.matlab5 import open_variables
from maglev_lanes.price import MOST_BYTES

MAX_DATA_BYTES = MOST_BYTES  # of a file, unpacked; reading takes up to three times as much memory
MAX_SAMPLES = 1 << 26  # of a column: 56 minutes at 20 kHz
_STEP = re.compile(r"\.([A-Za-z_]\w*)|\[(\d{1,9})\]")
_MOST_TEXT = 4096  # characters of a text that are read
_MOST_NAME = 80  # characters of what an attribute calls a column
_MOST_NAMED = 12  # columns in one sentence
_LISTED = ("channel_names", "channels", "column_names", "columns", "names", "labels", "signals", "fields")
_CALLED = ("long_name", "name", "label", "description", "title")  # attributes that say what a column is called

Steps = list[str | int]
Reader = Callable[[str, Steps], Any]


class Refused(ValueError):
    """A fault of one column or file, still without their names."""


def bounded(size: int, what: str) -> None:
    """Raise Refused if `what` would take more than MAX_DATA_BYTES."""
    if size > MAX_DATA_BYTES:
        raise Refused(f"{what} holds {size} bytes, more than the limit of {MAX_DATA_BYTES}; split the recording")


def _unknown(name: str, names: Sequence[str], what: str) -> Refused:
    close = difflib.get_close_matches(name, names, 1)
    hint = f"; did you mean {close[0]!r}?" if close else "."
    shown = ", ".join(names[:30]) + (f" and {len(names) - 30} more" if len(names) > 30 else "")
    return Refused(f"there is no {what} {name!r}{hint} Available: {shown or 'nothing'}")


def split_name(name: str, roots: Sequence[str]) -> tuple[str, Steps]:
    """A top-level name and the steps below it, Refused if unknown; the name may contain dots, as CSV headers do."""
    for root in sorted(roots, key=len, reverse=True):
        rest = name.removeprefix(root)
        if name.startswith(root) and re.fullmatch(f"(?:{_STEP.pattern})*", rest):
            return root, [m[1] or int(m[2]) for m in _STEP.finditer(rest)]
    raise _unknown(re.split(r"[.\[]", name)[0] or name, roots, "column")


def follow(value: Any, steps: Steps, open_level: Callable[[Any], Any] = lambda value: value) -> Any:
    """Follow steps through structs (dict), struct or cell arrays (list) and matrix columns (ndarray)."""
    value = open_level(value)
    for step in steps:
        if isinstance(value, np.ndarray) and value.dtype.names:
            value = fields_of(value)
        if isinstance(value, str) or (isinstance(step, str) and isinstance(value, np.ndarray)):
            raise Refused(f"there is nothing below the values where {step!r} is asked for")
        if isinstance(step, str):
            if isinstance(value, list):
                raise Refused(f"an array of {len(value)} elements has no field {step!r}; choose one with [n], from 0")
            if step not in value:
                raise _unknown(step, list(value), "field")
            value = open_level(value[step])
        elif isinstance(value, dict):
            if step:
                raise Refused(f"[{step}] of a single struct; only [0] exists")
        elif isinstance(value, np.ndarray):
            matrix = value.size > max(value.shape, default=1)
            value = columns_of(value)
            if step >= (columns := value.shape[1] if matrix else 1):
                raise Refused(f"[{step}] is beyond its {columns} column{'s' * (columns > 1)}, counted from 0")
            value = value.take(step, axis=1) if matrix else value
        else:
            if step >= len(value):
                raise Refused(f"[{step}] is beyond its {len(value)} elements, counted from 0")
            value = open_level(value[step])
    return value


def columns_of(value: np.ndarray) -> np.ndarray:
    """A matrix with its signals as columns: they lie along the longer side, as rows in Simulink's To File."""
    return value.T if value.ndim == 2 and min(value.shape) > 1 and value.shape[1] > value.shape[0] else value


def fields_of(value: np.ndarray) -> dict[str, np.ndarray]:
    """An array of records as a struct of its fields."""
    return {name: value[name] for name in value.dtype.names or ()}


def vector(value: Any) -> np.ndarray:
    """The value as float64 (samples,); Refused unless it is one non-empty row or column of real numbers."""
    if isinstance(value, np.ndarray) and value.dtype.names:
        value = fields_of(value)
    if isinstance(value, dict):
        raise Refused(f"is a struct; choose a field of it: {', '.join(value)}")
    if isinstance(value, list):
        raise Refused(f"is an array of {len(value)} structs or cells; choose one with [n], from 0")
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiub":
        raise Refused("holds text, complex values or objects, not real numbers")
    if value.size == 0:
        raise Refused("is empty")
    if max(value.shape, default=1) > MAX_SAMPLES:
        raise Refused(f"has {max(value.shape)} values, more than the limit of {MAX_SAMPLES}; split the recording")
    if value.size != max(value.shape, default=1):
        raise Refused(f"has the shape {value.shape}; choose one column with a last [j], from 0")
    return np.array(value.reshape(-1), dtype=np.float64)


def open_mat5(path: Path) -> tuple[tuple[str, ...], Reader]:
    """Names and reader of a MATLAB v5 file."""
    variables = open_variables(path)

    size = 0

    @cache  # a dSPACE struct holds every channel, so it is parsed once
    def variable(root: str) -> Any:
        nonlocal size  # of all that stay in memory
        bounded(size + variables.size(root), "unpacked")
        size += variables.size(root)
        return variables.read(root)

    return tuple(variables.elements), lambda root, steps: follow(variable(root), steps)


def open_hdf5(path: Path, matlab: bool) -> tuple[tuple[str, ...], Reader]:
    """Names and reader of an HDF5 file; `matlab`: written by MATLAB v7.3."""
    import h5py

    def read(root: str, steps: Steps) -> Any:
        with h5py.File(path, "r") as file:
            above: set[int] = set()
            return follow(file, [root, *steps], lambda node: _open_hdf5(file, node, matlab, above))

    with h5py.File(path, "r") as file:
        return tuple(name for name in file if not name.startswith("#")), read


def hdf5_attributes(path: Path) -> tuple[dict[str, str], dict[str, float], tuple[str, ...]]:
    """What the attributes of an HDF5 or netCDF file say.

    Returns:
        What it calls its columns, where an attribute names them or states their unit: the name with what the attribute
        calls it, and the unit in brackets; single numbers by their names below the groups and columns that they
        belong to; and which columns are unpacked, in words.
    """
    import h5py

    found: dict[str, str] = {}
    numbers: dict[str, float] = {}
    packed: list[str] = []

    def note(name: str, node: Any) -> None:
        for key, value in node.attrs.items():
            if isinstance(value, (np.ndarray, np.generic)) and value.size == 1 and value.dtype.kind in "fiu":
                unit = _text_of(node, [f"{key}_{word}" for word in ("unit", "units")])  # "V/m" of a sensitivity
                called = f"{key} [{unit}]" if unit else key
                numbers[_one_line(".".join(filter(None, [name.replace("/", "."), called])))] = float(np.ravel(value)[0])
        if not isinstance(node, h5py.Dataset):
            return
        if is_packed(node.attrs):
            packed.append(_one_line(name.replace("/", ".")))
        if names := _texts_of(node, _LISTED):  # of a matrix, one for each column
            units = _texts_of(node, ("units", "unit"))
            units = units if len(units) == len(names) else [""] * len(names)
            for i, (one, of_it) in enumerate(zip(names, units, strict=True)):
                found[f"{name.replace('/', '.')}[{i}]"] = f"{one} [{of_it}]" if of_it else one
            return
        own = _one_line(name.rpartition("/")[2])
        called, unit = _text_of(node, _CALLED), _text_of(node, ("units", "unit"))
        if called or unit:
            words = [own, called] if called and called != own else [own]
            found[name.replace("/", ".")] = " ".join([*words, f"[{unit}]"] if unit else words)

    with h5py.File(path, "r") as file:
        note("", file)
        file.visititems(note)
    columns = f"{', '.join(packed[:_MOST_NAMED])}{' and others' * (len(packed) > _MOST_NAMED)}"
    return found, numbers, (f"unpacked by the scale_factor and add_offset beside them: {columns}",) if packed else ()


def _texts_of(node: Any, keys: Sequence[str]) -> list[str]:
    """The first of the attributes `keys` of a matrix that holds a text for each column; empty without one."""
    columns = min(node.shape) if len(node.shape) == 2 else 0
    for key in keys:
        value = np.asarray(node.attrs[key]).reshape(-1) if key in node.attrs else np.zeros(0)
        texts = [v.decode(errors="replace") if isinstance(v, bytes) else v for v in value.tolist()]
        if columns > 1 and len(texts) == columns and all(isinstance(text, str) for text in texts):
            return [_short(text) for text in texts]
    return []


def _text_of(node: Any, keys: Sequence[str]) -> str:
    """The first of the attributes `keys` of a node that holds a text; "" without one."""
    for key in keys:
        value = node.attrs.get(key, "")
        value = value.decode(errors="replace") if isinstance(value, bytes) else value
        if isinstance(value, str) and value.strip():
            return _short(value)
    return ""


def _short(text: str) -> str:
    """What an attribute says, in so many characters as name a column."""
    text = _one_line(text)
    return text if len(text) <= _MOST_NAME else f"{text[: _MOST_NAME - 1]}…"


def _one_line(text: str) -> str:
    """The printable characters of a text, with one blank for all others between two words."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())


def _open_hdf5(file: Any, node: Any, matlab: bool, above: set[int]) -> Any:
    """One level; MATLAB v7.3 keeps cells and struct arrays as object references, matrices transposed.

    The addresses of the groups on the way down gather in `above`: a group that holds one of them would never end.
    """
    import h5py

    if isinstance(node, h5py.Reference):
        node = file[node]
    if isinstance(node, h5py.Group):
        # Only hard links, because soft and external ones could lead out of the file.
        members = {n: node[n] for n in node if isinstance(node.get(n, getlink=True), h5py.HardLink)}
        above.add(h5py.h5o.get_info(node.id).addr)
        members = {n: m for n, m in members.items() if h5py.h5o.get_info(m.id).addr not in above}
        if matlab and members and all(_holds_references(m) and "MATLAB_class" not in m.attrs for m in members.values()):
            bounded(sum(m.nbytes for m in members.values()), node.name)
            fields = {name: m[()].ravel() for name, m in members.items()}
            return [dict(zip(fields, row, strict=True)) for row in zip(*fields.values(), strict=True)]
        return members
    if not isinstance(node, h5py.Dataset):
        return node
    if node.is_virtual or node.external:
        raise Refused("its values lie in another file; store them in this one")
    bounded(max(node.nbytes, 8 * node.size), node.name)
    if _holds_references(node):
        return list(node[()].ravel())
    if node.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, np.asarray(node[()]).ravel(order="F").tolist()[:_MOST_TEXT]))
    if node.attrs.get("MATLAB_empty", 0):
        return np.empty(0)
    values = np.asarray(node[()])
    return values.T if matlab else unpacked(values, node.attrs)


def _holds_references(node: Any) -> bool:
    import h5py

    return isinstance(node, h5py.Dataset) and h5py.check_ref_dtype(node.dtype) is h5py.Reference


def open_npz(path: Path) -> tuple[tuple[str, ...], Reader]:
    """Names and reader of an .npz file, never unpickling."""
    with zipfile.ZipFile(path) as archive:
        bounded(sum(entry.file_size for entry in archive.infolist()), "unpacked")

    def read(root: str, steps: Steps) -> Any:
        with np.load(path, allow_pickle=False) as archive:
            try:
                value = archive[root]
            except ValueError as error:
                if "allow_pickle" in str(error):
                    raise Refused("holds pickled objects, which are never loaded; save plain numbers") from None
                raise
            return follow(value, steps)

    with np.load(path, allow_pickle=False) as archive:
        return tuple(archive.files), read


def open_npy(path: Path) -> tuple[tuple[str, ...], Reader]:
    """Names and reader of an .npy file, never unpickling: the fields of its records, or the matrix "array"."""
    values = np.load(path, mmap_mode="r", allow_pickle=False)
    names = values.dtype.names or ("array",)
    return names, lambda root, steps: follow(np.asarray(values[root] if values.dtype.names else values), steps)
