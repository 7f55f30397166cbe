"""Counts of conditions in a folder, one file each, so that an interrupted study resumes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from maglev_env.recordings.files import write_text_atomic
from maglev_lanes.code_version import code_version
from maglev_workbench.commands.coverage.counts import Coverage

SCHEMA = "maglev-coverage-condition/1"


def kept(
    folder: Path, name: str, draws: int, seed: int, count: Callable[[], tuple[Coverage, ...]]
) -> tuple[Coverage, ...]:
    """The counts of a condition, from the folder if it has them, else counted and written there.

    Args:
        folder: is made if it is missing.
        name: of the condition.
        draws, seed: of the study.
        count: gives the counts.

    Raises:
        ValueError: the folder has counts of other draws, of another seed or by other code, or its file is damaged.
    """
    path, made_by = folder / f"{name}.json", {"schema": SCHEMA, "code": code_version(), "seed": seed, "draws": draws}
    if path.exists():
        return _read(path, made_by)
    folder.mkdir(parents=True, exist_ok=True)
    rows = count()
    write_text_atomic(path, json.dumps({**made_by, "rows": [vars(row) for row in rows]}, indent=1) + "\n")
    return rows


def _read(path: Path, made_by: dict[str, Any]) -> tuple[Coverage, ...]:
    try:
        data = json.loads(path.read_text())
        other = [key for key in made_by if data[key] != made_by[key]]
        rows = tuple(Coverage(**row) for row in data["rows"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{path} is no file of counts ({error}); delete it, or give another folder as --out"
        ) from error
    if other:
        raise ValueError(
            f"{path} was counted with another {', '.join(other)}; give another folder as --out, or the same --draws "
            "and --seed"
        )
    return rows
