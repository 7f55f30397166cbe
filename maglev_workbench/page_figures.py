"""The figures of a page as compact data, and the drawing library that a page carries along."""

import json
from base64 import b64decode, b64encode
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

ASSETS = Path(__file__).with_name("page_assets")
PLOTLY = "plotly-cartesian-4.1.1.min.js.gz"  # the lines, bars, maps and contours of plotly.js; a third of all of it
LICENCE = "plotly.js v4.1.1 (cartesian), Copyright 2012-2026, Plotly, Inc., MIT licence"
_RTOL = 1e-6  # as good as a screen or a saved table of seven digits shows


@cache
def plotly_packed() -> str:
    """The drawing library, gzipped and in base64: 0.7 MB where the script itself takes 1.5 MB and all of plotly 4.8."""
    return b64encode((ASSETS / PLOTLY).read_bytes()).decode()


@cache
def asset(name: str) -> str:
    """The text of a style sheet or script of the pages."""
    return (ASSETS / name).read_text(encoding="utf-8")


def figures_json(figures: "Iterable[Figure]") -> str:
    """JSON of figures for page.js: every array once, in single precision where that shows the same.

    Templates are left out, because the page has one for light and one for dark screens.
    """
    numbers: dict[str, int] = {}  # of the arrays, by their JSON
    compact = []
    for figure in figures:
        data = json.loads(figure.to_json())
        data["layout"].pop("template", None)
        compact.append(_shared({name: data[name] for name in ("data", "layout")}, numbers))
    arrays = ",".join(numbers)
    text = f'{{"arrays":[{arrays}],"figures":{json.dumps(compact, separators=(",", ":"), ensure_ascii=False)}}}'
    return text.replace("<", "\\u003c")  # no text may end the script that holds it


def _shared(value: Any, numbers: dict[str, int]) -> Any:
    if isinstance(value, list):
        return [_shared(one, numbers) for one in value]
    if not isinstance(value, dict):
        return value
    if "bdata" not in value:
        return {name: _shared(one, numbers) for name, one in value.items()}
    text = json.dumps(_single(value), separators=(",", ":"))
    return {"array_number": numbers.setdefault(text, len(numbers))}


def _single(array: dict[str, Any]) -> dict[str, Any]:
    """An array as plotly writes it, in single precision where no figure can show the difference."""
    if array["dtype"] != "f8":
        return array
    values = np.frombuffer(b64decode(array["bdata"]), "<f8")
    with np.errstate(over="ignore"):
        shorter = values.astype("<f4")
    if not np.allclose(shorter, values, rtol=_RTOL, atol=0, equal_nan=True):
        return array
    return array | {"dtype": "f4", "bdata": b64encode(shorter.tobytes()).decode()}
