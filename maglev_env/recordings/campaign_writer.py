"""Write simulated recordings as a campaign folder that `load_campaign` reads back."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Literal

from maglev_env.experiment import Experiment
from maglev_env.fields import check_known
from maglev_env.loop.gains import Controllers, Gains, as_table
from maglev_env.recordings.campaign import ROLES
from maglev_env.recordings.campaign_file import SCHEMA
from maglev_env.recordings.campaign_tables import CAMPAIGN_CHANNELS
from maglev_env.recordings.files import write_csv, write_mat, write_npz, write_text_atomic
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import PRESETS, load_rig

if TYPE_CHECKING:
    import xarray as xr

FORMATS = {
    "npz": write_npz,
    "mat": write_mat,
    "csv": write_csv,
}  # by the ending of the file
_LINE = 120
_WRAP = {"initial_indent": "    ", "subsequent_indent": "    ", "break_long_words": False, "break_on_hyphens": False}


def write_campaign(
    folder: str | Path,
    rig_source: str,
    parameters: Mapping[str, Any],
    recordings: Sequence[tuple[str, str, "xr.Dataset", Experiment | None]],
    data_format: Literal["npz", "mat", "csv"] = "npz",
    overwrite: bool = False,
) -> Path:
    """Write a campaign folder; its campaign.toml is written last.

    Effects, offset and seed are not written, because a campaign holds what an engineer knows. Reading gives the same
    variables back, bit for bit.

    Args:
        folder: The folder.
        rig_source: A preset, or the path of a rig TOML, which is copied to rig.toml in the folder.
        parameters: Values that override those of the rig.
        recordings: Name, role, simulated dataset and its experiment. The whole dataset is written with a time column,
            transient periods included; the experiment gives gains and excitations. It is None where no loop ran and
            nothing was excited, as for a coil alone.
        data_format: Format of the data files.
        overwrite: Whether an existing campaign is replaced.

    Returns:
        Path of campaign.toml.

    Raises:
        ValueError: Something does not fit the format, or one of the files exists and overwrite is not set.
    """
    folder = Path(folder)
    target = folder / "campaign.toml"
    if not overwrite:
        require_room(folder, rig_source, [name for name, *_ in recordings], data_format)
    if data_format not in FORMATS:
        raise ValueError(f"data_format = {data_format!r}; use one of {', '.join(FORMATS)}")
    with_parameters(load_rig(rig_source), parameters)
    _check(recordings)
    preset = rig_source in PRESETS
    rig_text = "" if preset else Path(rig_source).read_text(encoding="utf-8")
    lines = [f"schema = {toml_value(SCHEMA)}", f"rig = {toml_value(str(rig_source) if preset else 'rig.toml')}"]
    lines += toml_table("[parameters]", parameters) if parameters else []
    for name, role, dataset, experiment in recordings:
        lines += _recording(f"{name}.{data_format}", role, dataset, experiment)
    folder.mkdir(parents=True, exist_ok=True)
    if not preset:
        write_text_atomic(folder / "rig.toml", rig_text)
    for name, _, dataset, _ in recordings:
        columns = {str(channel): dataset[channel].values for channel in dataset.data_vars}
        FORMATS[data_format](folder / f"{name}.{data_format}", {"time": dataset["time"].values, **columns})
    write_text_atomic(target, "\n".join(lines) + "\n")
    return target


def require_room(folder: Path, rig_source: str, names: Sequence[str], data_format: str) -> None:
    """Check that nothing in a folder would be replaced by a campaign; a rig.toml of the same contents may be there.

    Args:
        folder: The folder, which need not exist.
        rig_source: As `write_campaign`.
        names: Of the recordings.
        data_format: Format of the data files.

    Raises:
        ValueError: One of its files exists; the message names it.
    """
    own, files = folder / "rig.toml", ["campaign.toml", *(f"{name}.{data_format}" for name in names)]
    if rig_source not in PRESETS and own.exists() and own.read_bytes() != Path(rig_source).read_bytes():
        files.append(own.name)
    if taken := [file for file in files if (folder / file).exists()]:
        raise ValueError(f"{folder / taken[0]} exists and would be replaced; choose another folder")


def _check(recordings: Sequence[tuple[str, str, "xr.Dataset", Experiment | None]]) -> None:
    if not recordings:
        raise ValueError("a campaign needs at least one recording")
    names = [name for name, *_ in recordings]
    for name, role, dataset, _ in recordings:
        if not re.fullmatch(r"\w[\w-]*", name):
            raise ValueError(f"recording name {name!r}: use letters, digits, _ and -")
        if names.count(name) > 1:
            raise ValueError(f"recording name {name!r} is used twice")
        if role not in ROLES:
            raise ValueError(f"recording {name!r}: role = {role!r}; use one of {', '.join(ROLES)}")
        check_known(dict.fromkeys(map(str, dataset.data_vars)), CAMPAIGN_CHANNELS, f"recording {name!r}")
        if dataset.sizes["time"] < 2:
            raise ValueError(f"recording {name!r} has fewer than two samples")


def _recording(file: str, role: str, dataset: "xr.Dataset", experiment: Experiment | None) -> list[str]:
    rate = float(dataset.attrs["sample_rate"])
    head = {"file": file, "role": role, "sample_rate": rate, "start": 0}
    if experiment is not None:
        head |= {"intersample": "zoh"} | ({"speed_rpm": experiment.speed_rpm} if experiment.speed_rpm else {})
    lines = toml_table("[[recording]]", head)
    if experiment is not None and experiment.rig.controlled:
        lines += _controllers(experiment.gains)
    for excitation in (Excitation("none"),) if experiment is None else experiment.excitations:
        table = excitation_table(excitation)
        if excitation.periodic:
            whole, rest = divmod(dataset.sizes["time"], excitation.samples_per_period(rate))
            table |= {} if rest else {"periods": whole}
        lines += toml_table("[[recording.excitation]]", table)
    channels = ["time", *map(str, dataset.data_vars)]
    return [*lines, "", "[recording.channels]", *(f"{name} = {{ from = {toml_value(name)} }}" for name in channels)]


def _controllers(controllers: Controllers) -> list[str]:
    if isinstance(controllers, tuple):
        key = "gains" if isinstance(controllers[0], Gains) else "controller"
        tables = as_table(controllers).items()
        return [line for axis, table in tables for line in toml_table(f"[recording.{key}.{axis}]", table)]
    return toml_table(
        f"[recording.{'gains' if isinstance(controllers, Gains) else 'controller'}]", as_table(controllers)
    )


def excitation_table(excitation: Excitation) -> dict[str, Any]:
    """A [[recording.excitation]] without its periods."""
    table = asdict(excitation)
    lines = table.pop("lines")
    if excitation.kind == "sphs":
        del table["seed"]
    for name in ("direction", "band"):
        if not table[name]:
            del table[name]
    if not excitation.periodic:
        return {name: table[name] for name in ("kind", "at", "direction", "band") if name in table}
    gapless = len(lines) > 1 and lines[-1] - lines[0] == len(lines) - 1
    return {**table, **({"harmonics": [lines[0], lines[-1]]} if gapless else {"lines": lines})}


def toml_table(header: str, values: Mapping[str, Any]) -> list[str]:
    """The lines of one TOML table after an empty one, in the values' order."""
    return ["", header, *(f"{key} = {toml_value(value)}" for key, value in values.items())]


def toml_value(value: Any) -> str:
    """A string, a truth value, a number, a list of them or a table of them as TOML."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {toml_value(v)}' for key, v in value.items())} }}"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        text = ", ".join(map(toml_value, value))
        if len(text) < _LINE // 2 or any(isinstance(v, str) for v in value):  # a line break would change a string
            return f"[{text}]"
        return "[\n" + fill(text, _LINE, **_WRAP) + "\n]"
    return repr(int(value)) if isinstance(value, int) else repr(float(value))
