"""Figures of a benchmark and the machine they were measured on, as JSON, and the comparison with an earlier run."""

import json
import os
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from platform import machine, processor, python_version
from typing import Any, Literal

SCHEMA = "maglev-bench/2"
TOLERANCE = 1.2  # a figure worse by this factor is marked
_MAX_BYTES = 1_000_000
_PACKAGES = ("maglev-workbench", "numpy", "scipy", "numba")
_HOST = ("machine", "processor", "cores", "versions")

Better = Literal["lower", "higher"] | None


@dataclass(frozen=True)
class Figure:
    """One measured number; better: "lower" or "higher", None if neither is better."""

    value: float
    unit: str
    better: Better = "lower"


@dataclass(frozen=True)
class Results:
    """All figures of a run by name, with the time (UTC, ISO 8601) and the machine."""

    date: str
    machine: str
    processor: str
    cores: int
    versions: dict[str, str]
    figures: dict[str, Figure]


@dataclass(frozen=True)
class Change:
    """A figure in two runs; ratio: new over old, None if the old one is zero; worse: by more than TOLERANCE."""

    old: float
    new: float
    ratio: float | None
    worse: bool


def results_here(figures: dict[str, Figure]) -> Results:
    """The figures with this machine's description."""
    versions = {"python": python_version()} | {name: version(name) for name in _PACKAGES}
    now = datetime.now(UTC).isoformat(timespec="seconds")
    return Results(now, machine(), _processor(), os.cpu_count() or 1, versions, figures)


def _processor() -> str:
    """The processor's model, if the system gives it."""
    listed = Path("/proc/cpuinfo")
    if listed.exists():  # on Linux processor() gives the architecture or nothing
        for line in listed.read_text().splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return processor() or "unknown"


def as_json(results: Results) -> dict[str, Any]:
    """Plain JSON data of schema maglev-bench/2."""
    return {"schema": SCHEMA, **asdict(results)}


def read_results(path: Path) -> Results:
    """Results from a file with the data of `as_json`.

    Raises:
        ValueError: The file is not valid; the message says what is wrong and what to do.
    """
    advice = "give a file that `maglev bench --json` wrote"
    if not path.is_file():
        raise ValueError(f"--compare {path}: no such file; {advice}")
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"--compare {path}: larger than {_MAX_BYTES} bytes; {advice}")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"--compare {path}: not JSON ({error}); {advice}") from None
    try:
        return _results(data)
    except ValueError as error:
        raise ValueError(f"--compare {path}: {error}; {advice}") from None


def _results(data: Any) -> Results:
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        found = data.get("schema") if isinstance(data, dict) else data
        raise ValueError(f'schema = {str(found)[:40]!r}, and this version compares "{SCHEMA}"')
    texts = {name: _typed(data, name, str) for name in ("date", "machine", "processor")}
    versions = {name: _typed(data["versions"], name, str) for name in _typed(data, "versions", dict)}
    figures = {}
    for name, table in _typed(data, "figures", dict).items():
        where = f"figures.{name}"
        if not isinstance(table, dict):
            raise ValueError(f"{where} = {str(table)[:40]!r} is not a table of value, unit and better")
        value = table.get("value")
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise ValueError(f"{where}: value = {value!r} is not a finite number")
        if table.get("better", "") not in ("lower", "higher", None):
            raise ValueError(f"{where}: better = {table.get('better')!r} is not lower, higher or null")
        figures[name] = Figure(float(value), _typed(table, "unit", str, where), table["better"])
    return Results(**texts, cores=_typed(data, "cores", int), versions=versions, figures=figures)


def _typed(data: dict[str, Any], name: str, kind: type, where: str = "top level") -> Any:
    if not isinstance(data.get(name), kind):
        raise ValueError(f"{where}: {name} is missing or not a {kind.__name__}")
    return data[name]


def changes(old: Results, new: Results) -> dict[str, Change]:
    """Every figure that both runs have in the same unit."""
    found = {}
    for name, figure in new.figures.items():
        before = old.figures.get(name)
        if before is None or before.unit != figure.unit:
            continue
        ratio = figure.value / before.value if before.value else None
        loss = {"lower": ratio, "higher": 1 / ratio if ratio else None, None: None}[figure.better]
        found[name] = Change(before.value, figure.value, ratio, loss is not None and loss > TOLERANCE)
    return found


def differences(old: Results, new: Results) -> list[str]:
    """Differences between two runs other than the code (machine, versions), in words."""
    before, now = ({**asdict(r), **r.versions} for r in (old, new))
    names = [name for name in (*_HOST, *sorted({*old.versions, *new.versions})) if name != "versions"]
    return [f"{n}: {before.get(n)} then, {now.get(n)} now" for n in names if before.get(n) != now.get(n)]
