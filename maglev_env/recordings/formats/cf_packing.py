"""Values that HDF5 and netCDF files pack, and those that stand for none: the CF conventions, 2.5 and 8.1."""

from collections.abc import Mapping
from typing import Any

import numpy as np

_FACTOR, _OFFSET = "scale_factor", "add_offset"
_NONE = ("_FillValue", "missing_value")


def is_packed(attributes: Mapping[str, Any]) -> bool:
    """Whether the attributes of a data set state a factor or an offset of its values."""
    return any(_numbers(attributes, key).size == 1 for key in (_FACTOR, _OFFSET))


def unpacked(values: np.ndarray, attributes: Mapping[str, Any]) -> np.ndarray:
    """The values of a data set as its attributes mean them.

    Args:
        values: as they are stored, of any shape.
        attributes: of the data set.

    Returns:
        Numbers times scale_factor plus add_offset, with nan where they are _FillValue or missing_value, which stand
        for no value and are themselves packed; anything else as it is.
    """
    if values.dtype.kind not in "fiu":
        return values
    none = np.concatenate([_numbers(attributes, key) for key in _NONE])
    none = none.astype(values.dtype) if values.dtype.kind == "f" else none  # -9999.9 in single precision
    gone = np.isin(values, none)
    if is_packed(attributes):
        factor, offset = _numbers(attributes, _FACTOR), _numbers(attributes, _OFFSET)
        values = values.astype(float) * (factor[0] if factor.size == 1 else 1.0) + (
            offset[0] if offset.size == 1 else 0.0
        )
    return np.where(gone, np.nan, values) if gone.any() else values


def _numbers(attributes: Mapping[str, Any], key: str) -> np.ndarray:
    """The numbers of an attribute (n,); empty where it holds none."""
    value = np.asarray(attributes[key]).reshape(-1) if key in attributes else np.empty(0)
    return value.astype(float) if value.dtype.kind in "fiu" else np.empty(0)
