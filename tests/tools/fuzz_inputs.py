"""Hostile inputs for `fuzz.py`: TOML files, data files and command lines, each drawn from a random generator."""

import inspect
import json
import os
import tomllib
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, get_type_hints

import h5py
import numpy as np
import typer
from scipy.io import savemat

from maglev_workbench.cli import app

Rng = np.random.Generator
HOSTILE: tuple[Any, ...] = (
    0, -1, 1, 2, 10**30, 0.0, -0.0, 1e-308, 1e308, -1e9, 1e-9, 3.5, float("nan"), float("inf"), True, False, "", "x",
    "hmb_free", "\u202e\x1b[31m", "n" * 500, [], [5], [[]], ["x"], [1.0, 2.0], [2, 1], {}, {"x": 1}, [{}],
)  # fmt: skip
FILES = ("c/run1.npz", "c/run1.mat", "c/run1.csv", "c/run1.h5", "c/run1.nc")
TEXTS = (
    "",
    "x",
    "1:2",
    "kp",
    "a=b",
    "1e9",
    "nan",
    "-1",
    "../x",
    "\u202e",
    "n" * 300,
    "1:2:3",
    "1:0:3",
    "@",
    "[0]",
    "1,2",
    ":::",
)
NUMBERS = ("0", "1", "2", "-1", "1.5", "nan", "inf", "1e-9", "1e20", "100000000000000000000", "x", "")
PATHS = (
    "x",
    "missing/x",
    "c",
    "c/run1.npz",
    ".",
    "",
    "n" * 300,
    "pipe.npz",
    "pipe.toml",
    "loop",
    "rig.toml",
    "c/campaign.toml",
)
# What makes a command quick; the options drawn come after it. Without it the call is left out.
QUICK: dict[str, list[str]] = {
    "sweep": ["--rig", "rig.toml", "--kp", "7000:9000:2", "--threads", "1", "--out", "out"],
    "simulate": ["--rig", "rig.toml", "--out", "out"],
    "tune": ["--rig", "rig.toml", "--method", "sobol", "--budget", "2", "--threads", "1", "--out", "out"],
    "check": ["c"],
    "estimate": ["c"],
    "export": ["rig.toml", "--out", "out.json"],
    "new": ["bare"],
    "runup": ["--rotor", "rotor.toml", "--speeds", "0", "--threads", "1", "--out", "out"],
    "effects": [],
    "selfsense record": ["--seconds", "0.02", "--out", "out"],
    "selfsense estimate": ["c"],
    "selfsense design": [],
    "diagnose": ["missing"],
    "compare": ["sobol", "--rigs", "0"],
    "train": ["--rigs", "0"],
    "bench": ["--compare", "c/campaign.toml"],
    "blind generate": ["--seed", "1", "--count", "0", "--out", "out"],
    "blind answer": ["c"],
    "blind open": ["c"],
    "blind run": ["--seed", "1", "--count", "0", "--out", "out"],
}


def prepare(folder: Path) -> None:
    """Small sound files, of which each call gets copies: a rig, a rotor, a campaign in five formats, a bare folder."""
    from importlib import resources

    presets = resources.files("maglev_env")
    rig = tomllib.loads((presets / "rigs" / "hmb_free.toml").read_text())
    push = {
        "kind": "sphs",
        "at": "force",
        "fundamental": 20.0,
        "amplitude": 0.3,
        "lines": [n for n in range(1, 24) if n % 3],
    }
    drive = {
        "kind": "sphs",
        "at": "current",
        "fundamental": 20.0,
        "amplitude": 0.1,
        "lines": [3, 6, 9, 15, 21, 30, 45, 60],
    }
    rig["protocol"] = {"periods": 3, "band_width": 120.0, "band_overlap": 60.0, "excitation": [push, drive]}
    rig["target"]["band"] = [20.0, 140.0]
    (folder / "rig.toml").write_text(toml_of(rig))
    (folder / "rotor.toml").write_text((presets / "rotors" / "pump.toml").read_text())
    from typer.testing import CliRunner

    here = Path.cwd()
    os.chdir(folder)
    made = CliRunner().invoke(app, ["simulate", "--rig", "rig.toml", "--out", "c"])
    assert made.exit_code == 0, made.output
    os.chdir(here)
    campaign = folder / "c"
    (campaign / "recordings.html").unlink()
    with np.load(campaign / "run1.npz") as stored:
        columns = dict(stored)
    savemat(campaign / "run1.mat", columns, oned_as="column", do_compression=True)
    header = ",".join(columns)
    np.savetxt(campaign / "run1.csv", np.column_stack(list(columns.values())), "%.8g", ",", header=header, comments="")
    for name in ("run1.h5", "run1.nc"):
        with h5py.File(campaign / name, "w") as file:
            for key, values in columns.items():
                file.create_dataset(key, data=values, compression="gzip")
    (folder / "bare").mkdir()
    (folder / "bare" / "a.csv").write_bytes((campaign / "run1.csv").read_bytes())
    os.mkfifo(folder / "pipe.npz")
    os.mkfifo(folder / "pipe.toml")
    (folder / "loop").symlink_to("loop")


def pick(rng: Rng, among: Any) -> Any:
    return among[int(rng.integers(len(among)))]


def toml_of(value: Any, name: str = "") -> str:
    """TOML of parsed TOML: scalars and arrays inline, tables below."""
    lines, tables = [], []
    for key, v in value.items():
        if isinstance(v, dict):
            tables.append(f"[{name}{json.dumps(key)}]\n" + toml_of(v, f"{name}{json.dumps(key)}."))
        elif isinstance(v, list) and v and all(isinstance(x, dict) for x in v):
            tables += [f"[[{name}{json.dumps(key)}]]\n" + toml_of(x, f"{name}{json.dumps(key)}.") for x in v]
        else:
            lines.append(f"{json.dumps(key)} = {_inline(v)}")
    return "\n".join([*lines, *tables]) + "\n"


def _inline(v: Any) -> str:
    if isinstance(v, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_inline(x)}" for k, x in v.items()) + " }"
    if isinstance(v, list):
        return "[" + ", ".join(map(_inline, v)) + "]"
    return json.dumps(v).replace("NaN", "nan").replace("Infinity", "inf") if isinstance(v, float) else json.dumps(v)


def change_toml(rng: Rng, path: Path) -> None:
    """Change values, keys or characters of a TOML file."""
    text = path.read_text()
    if rng.random() < 0.1:
        return change_bytes(rng, path)
    if rng.random() < 0.1:  # other characters
        letters = list(text)
        for _ in range(int(rng.integers(1, 4))):
            letters[int(rng.integers(len(letters)))] = chr(int(rng.integers(32, 127)))
        path.write_text("".join(letters))
        return None
    data = tomllib.loads(text)
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        table: Any = data
        while True:
            keys = list(table) if isinstance(table, dict) else list(range(len(table)))
            if not keys:
                break
            key = pick(rng, keys)
            if isinstance(table[key], dict | list) and rng.random() < 0.8:
                table = table[key]
                continue
            what = rng.random()
            if what < 0.5 and isinstance(table[key], int | float) and not isinstance(table[key], bool):
                factor = pick(rng, (0.0, -1.0, 0.5, 0.9, 1.1, 2.0, 10.0, 1e3, 1e-3, 1e-9, 1e9))
                table[key] = type(table[key])(table[key] * factor)
            elif what < 0.85:
                table[key] = deepcopy(pick(rng, HOSTILE))  # the next call must not find it changed
            elif what < 0.93:
                del table[key]
            elif isinstance(table, dict):
                table[pick(rng, TEXTS) or "k"] = deepcopy(table[key])
            else:
                table.append(deepcopy(table[key]))
            break
    path.write_text(toml_of(data))


def change_bytes(rng: Rng, path: Path) -> None:
    """Cut a file off, flip bits of it, or put other bytes anywhere, often into its header."""
    data = bytearray(path.read_bytes())
    what = rng.integers(5)
    if path.suffix == ".csv" and rng.random() < 0.5:
        return change_text(rng, path)
    if what == 0:
        data = data[: int(rng.integers(len(data) + 1))]
    elif what == 1:
        for _ in range(int(rng.integers(1, 50))):
            data[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
    elif what == 2:
        for _ in range(int(rng.integers(1, 6))):
            data[int(rng.integers(min(len(data), 300)))] = int(rng.integers(256))
    elif what == 3:
        at, size = int(rng.integers(len(data))), int(rng.integers(1, 64))
        data[at : at + size] = pick(rng, (b"\xff" * size, b"\0" * size, rng.bytes(size), b""))
    else:
        data += rng.bytes(int(rng.integers(1, 5000)))
    path.write_bytes(bytes(data))


def change_text(rng: Rng, path: Path) -> None:
    """Change lines and characters of a table as an editor or another program would."""
    lines = path.read_text().splitlines()
    for _ in range(int(rng.integers(1, 4))):
        i = int(rng.integers(len(lines))) if rng.random() < 0.5 else int(rng.integers(min(5, len(lines))))
        lines[i] = pick(rng, (
            "", lines[i] + ",", lines[i].replace(",", ";"), lines[i].replace(".", ","), "# " + lines[i], lines[i] * 2,
            lines[i].replace(",", "\t"), "nan" + lines[i], lines[i][: len(lines[i]) // 2], pick(rng, TEXTS),
            '"' + lines[i],
        ))  # fmt: skip
    if rng.random() < 0.3:
        lines = [line.replace(",", pick(rng, (";", "\t", " "))) for line in lines]
    path.write_text(pick(rng, ("\n", "\r\n", "\r")).join(lines))


def change_values(rng: Rng, path: Path) -> None:
    """Well-formed files of hostile contents: values, types, shapes, sizes, names."""
    with np.load(path.with_suffix(".npz")) as stored:
        columns: dict[str, Any] = dict(stored)
    name = pick(rng, list(columns))
    n = len(columns[name])
    columns[name] = pick(
        rng,
        (
            np.full(n, np.nan), np.full(n, np.inf), np.zeros(n), np.full(n, 1e308), columns[name][: n // 3],
            np.zeros(0), columns[name] * 1e300, columns[name].astype(complex), np.array(["x"] * n), np.zeros((n, 2)),
            columns[name] > 0, np.array(3.0), np.arange(n), columns[name][::-1], columns[name].astype("i1"),
            np.where(np.arange(n) % 7, 1e-320, 0),
        ),
    )  # fmt: skip
    if path.suffix == ".mat":
        savemat(path, columns)
    elif path.suffix in (".h5", ".nc"):
        with h5py.File(path, "w") as file:
            for key, values in columns.items():
                file[key] = values.astype("S") if values.dtype.kind == "U" else values
            file.create_dataset("huge", (1 << 40,), "f8", chunks=(1 << 20,))
    elif path.suffix == ".csv":
        rows = [",".join(columns)] + [
            ",".join(str(v[i]) if v.ndim and i < len(v) else "" for v in columns.values()) for i in range(200)
        ]
        path.write_text("\n".join(rows))
    else:
        if rng.random() < 0.2:
            columns[name] = np.array([{}, None], dtype=object)
        np.savez(path, **columns)


def change_data(rng: Rng, folder: Path) -> str:
    """Spoil one data file of the campaign, of any format, and let campaign.toml name it; its path is returned."""
    path = folder / pick(rng, FILES)
    toml = folder / "c" / "campaign.toml"
    toml.write_text(toml.read_text().replace("run1.npz", path.name))
    (change_bytes if rng.random() < 0.6 else change_values)(rng, path)
    if rng.random() < 0.1:
        path = path.rename(path.with_suffix(pick(rng, (".npz", ".mat", ".csv", ".h5", ".lvm", ".txt", ".toml"))))
    return str(path.relative_to(folder))


def commands() -> dict[str, Any]:
    """Every command by what is typed for it."""
    found: dict[str, Any] = {}

    def walk(command: Any, words: tuple[str, ...]) -> None:
        for name, part in command.commands.items():
            walk(part, (*words, name)) if hasattr(part, "commands") else found.update({" ".join((*words, name)): part})

    walk(typer.main.get_command(app), ())
    return found


def drawn_options(rng: Rng, command: Any, few: int = 3) -> list[str]:
    """Up to `few` options of a command with values of any kind."""
    words: list[str] = []
    kinds = get_type_hints(inspect.unwrap(command.callback))
    named = [p for p in command.params if getattr(p, "opts", None) and p.opts[0].startswith("--") and p.name != "help"]
    for p in rng.permutation(np.array(named, dtype=object))[: int(rng.integers(1, few + 1))] if named else ():
        option = pick(rng, [*p.opts, *p.secondary_opts])
        if getattr(p, "is_flag", False):
            words.append(option)
            continue
        kind = str(kinds[p.name]).lower()
        values = NUMBERS if "int" in kind or "float" in kind else PATHS if "path" in kind else (*TEXTS, *PATHS)
        words += [option, pick(rng, values)]
    return words


def case(rng: Rng, folder: Path) -> list[str]:
    """Spoil the files of a folder, and what is typed behind `maglev` there."""
    known = commands()
    kinds: tuple[Callable[[], list[str]], ...] = (
        lambda: _rig(rng, folder),
        lambda: _rotor(rng, folder),
        lambda: _campaign(rng, folder),
        lambda: _data(rng, folder),
        lambda: _data(rng, folder),
        lambda: _options(rng, known),
    )
    return pick(rng, kinds)()


def _rig(rng: Rng, folder: Path) -> list[str]:
    change_toml(rng, folder / "rig.toml")
    name = pick(rng, ("sweep", "simulate", "tune", "selfsense design"))
    return [*name.split(), *QUICK[name], *(["--rig", "rig.toml"] if name == "selfsense design" else [])]


def _rotor(rng: Rng, folder: Path) -> list[str]:
    change_toml(rng, folder / "rotor.toml")
    return ["runup", *QUICK["runup"]]


def _campaign(rng: Rng, folder: Path) -> list[str]:
    change_toml(rng, folder / "c" / "campaign.toml")
    return pick(
        rng,
        (
            ["check", "c"],
            ["estimate", "c"],
            ["export", "c"],
            ["tune", "--campaign", "c"],
            ["selfsense", "estimate", "c"],
        ),
    )


def _data(rng: Rng, folder: Path) -> list[str]:
    path = change_data(rng, folder)
    bare = ["--rate", "20000", "--lines", "1:23", "--fundamental", "20", "--mass", "0.1"]
    return pick(
        rng,
        (
            ["check", "c"], ["estimate", "c"], ["check", path], ["estimate", path, *bare], ["new", path, "--out", "n"],
            ["estimate", path], ["estimate", path, *bare, "--method", "both"], ["check", "c"],
            ["selfsense", "estimate", path, "--rate", "2e5", "--current", "current", "--voltage", "command"],
        ),
    )  # fmt: skip


def _options(rng: Rng, known: dict[str, Any]) -> list[str]:
    name = pick(rng, list(QUICK))
    words = [*name.split(), *QUICK[name], *drawn_options(rng, known[name])]
    return [w for w in words if rng.random() > 0.03]
