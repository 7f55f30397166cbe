"""Models as a MATLAB file, as JSON, and as Python code for python-control."""

import json
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from maglev_env.recordings.files import atomic_file, write_text_atomic
from maglev_workbench.commands.export.models import CONVENTIONS, Model

SCHEMA = "maglev-export/1"


def write_mat(path: Path, source: str, models: Sequence[Model]) -> None:
    """A MATLAB v5 file: a struct for each model, for `ss(A, B, C, D, Ts)`, `tf(num, den, Ts)`, `frd(response, w)`."""
    from scipy.io import savemat

    content: dict[str, Any] = {"about": "\n".join((_made(source), *CONVENTIONS))}
    for one in models:
        response = one.response if one.response.ndim == 1 else np.moveaxis(one.response, 0, -1)  # MATLAB's order
        content[one.name] = {
            "about": one.about,
            **dict(zip(("input", "input_unit", "output", "output_unit"), one.signals, strict=True)),
            **dict(zip("ABCD", one.state_space or (), strict=False)),
            **dict(zip(("num", "den"), one.transfer_function or (), strict=False)),
            **({} if one.sample_time is None else {"Ts": one.sample_time}),
            "frequency_Hz": one.frequency,
            "response": response,
            **({} if one.variance is None else {"variance": one.variance}),
        }
    with atomic_file(path) as file:
        savemat(file, content, long_field_names=True, oned_as="row")


def write_models_json(path: Path, source: str, models: Sequence[Model]) -> None:
    """Strict JSON, schema maglev-export/1; complex responses as pairs of real and imaginary parts."""
    data = {
        "schema": SCHEMA,
        "version": version("maglev-workbench"),
        "source": source,
        "conventions": list(CONVENTIONS),
        "models": [_as_data(one) for one in models],
    }
    write_text_atomic(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def write_python(path: Path, source: str, models: Sequence[Model]) -> None:
    """A Python file that defines every model for python-control; state space before transfer function before data."""
    lines = [*map(_comment, (_made(source), *CONVENTIONS)), "", "import control", "import numpy as np", ""]
    for one in models:
        given, unit, answer, of = one.signals
        lines += [_comment(f"{one.about}: from {given} ({unit}) to {answer} ({of})"), f"{one.name} = {_code(one)}", ""]
    write_text_atomic(path, "\n".join(lines))


WRITERS: dict[str, Callable[[Path, str, Sequence[Model]], None]] = {
    ".mat": write_mat,
    ".json": write_models_json,
    ".py": write_python,
}


def _made(source: str) -> str:
    return f"Made by maglev export from {source}, version {version('maglev-workbench')}."


def _comment(text: str) -> str:
    """On one line, whatever the name of a file holds, so that nothing of it is run."""
    return f"# {' '.join(text.split())}"


def _code(one: Model) -> str:
    if one.state_space is not None:
        matrices = ",\n    ".join(map(_array, one.state_space))
        return f"control.ss(\n    {matrices},\n    {one.sample_time!r},\n)"
    if one.transfer_function is not None:
        return f"control.tf({', '.join(map(_array, one.transfer_function))}, {one.sample_time or 0!r})"
    return f"control.frd(\n    {_array(one.response)},\n    2 * np.pi * {_array(one.frequency)},\n)"


def _array(values: np.ndarray) -> str:
    """Every digit, so that what is read back is the same."""
    return f"np.array({values.tolist()!r})"


def _as_data(one: Model) -> dict[str, Any]:
    given, unit, answer, of = one.signals
    matrices = zip("ABCD", one.state_space or (), strict=False)
    polynomials = zip(("numerator", "denominator"), one.transfer_function or (), strict=False)
    return {
        "name": one.name,
        "about": one.about,
        "input": given,
        "input_unit": unit,
        "output": answer,
        "output_unit": of,
        "sample_time": one.sample_time,
        **{name: m.tolist() for name, m in (*matrices, *polynomials)},
        "frequency": one.frequency.tolist(),
        "response": np.stack([np.real(one.response), np.imag(one.response)], axis=-1).tolist(),
        "variance": None if one.variance is None else one.variance.tolist(),
    }
