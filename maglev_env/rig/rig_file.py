"""Rig files (schema maglev-rig/1), and the presets among them."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from maglev_env.fields import check_known, increasing_pair, is_number, table_as, toml_tables, toml_text
from maglev_env.loop.axes import Cross
from maglev_env.loop.effect import check_effects
from maglev_env.loop.gains import GAIN_CARDS
from maglev_env.loop.self_sensor import SelfSensing
from maglev_env.rig.controller_tables import controllers_from_table
from maglev_env.rig.rig import PARAMETERS, Noise, Rig, default_band_of
from maglev_env.rig.tables import effects_from_table, protocol_from_table
from maglev_env.rig.target import Target

SCHEMA = "maglev-rig/1"
RIG_FOLDER, ROTOR_FOLDER = (resources.files("maglev_env") / name for name in ("rigs", "rotors"))


def _presets(folder: Traversable) -> tuple[str, ...]:
    """Names of the TOML files in a folder of this package."""
    return tuple(sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml")))


PRESETS, ROTORS = _presets(RIG_FOLDER), _presets(ROTOR_FOLDER)  # a preset is a file; `rotor.rotor` reads the rotors


def load_rig(source: str | Path) -> Rig:
    """A preset by name, or a rig TOML by path.

    Args:
        source: name of a preset, or path of a .toml file.

    Raises:
        ValueError: The rig is not valid; the message names file and key.
        OSError: The file cannot be read.
    """
    if not isinstance(source, str | Path):
        raise ValueError(f"rig = {source!r:.100}: give a preset's name, a .toml file, or a Rig")
    if str(source) in PRESETS:
        text = (RIG_FOLDER / f"{source}.toml").read_text()
        return rig_from_toml(text, str(source))
    path = Path(source)
    if str(source) in ROTORS:
        raise ValueError(
            f"{source} is a spinning rotor in five degrees of freedom, not a rig: use maglev runup, or maglev tune"
        )
    if path.suffix != ".toml":
        raise ValueError(f"rig {str(source)!r} is neither a preset ({', '.join(PRESETS)}) nor a .toml file")
    if not path.exists():
        raise FileNotFoundError(
            f"rig file {str(path)!r} does not exist; name a .toml with / between folders, or a preset"
        )
    return rig_from_toml(toml_text(path, "rig"), str(path))


def rig_from_toml(text: str, where: str) -> Rig:
    """A checked rig from the text of a rig TOML (schema maglev-rig/1).

    Args:
        text: of the file.
        where: name of the file for messages.

    Raises:
        ValueError: The rig is not valid; the message names file and key.
    """
    try:
        return _build(toml_tables(text))
    except RecursionError:
        raise ValueError(f"{where}: tables or lists are nested too deeply; a rig file has one level of them") from None
    except (ValueError, TypeError, ArithmeticError) as error:
        raise ValueError(f"{where}: {error}") from error


_TABLES = (
    *("parameters", "axis", "cross", "gains", "noise", "bounds"),
    *("protocol", "target", "tolerance", "randomization", "self_sensing", "effects"),
)


def _build(data: dict[str, Any]) -> Rig:
    if data.get("schema") != SCHEMA:
        raise ValueError(f'schema = {data.get("schema")!r}; this version reads schema = "{SCHEMA}"')
    for key, value in data.items():
        if key in _TABLES and not isinstance(value, dict):
            raise ValueError(f"[{key}] = {value!r} must be a table")
        check_known((key,), ("schema", "name", "magnet", "axes", *_TABLES), "top level")
    for key in ("name", "magnet", "parameters"):
        if key not in data:
            raise ValueError(f"{key} is missing")
    check_known(data["parameters"], PARAMETERS, "[parameters]")
    if "mass" not in data["parameters"]:
        raise ValueError("[parameters]: mass is missing")
    bounds = {k: increasing_pair(v, f"[bounds] {k}") for k, v in data.get("bounds", {}).items()}
    check_known(bounds, GAIN_CARDS, "[bounds]")
    for key, value in data.get("tolerance", {}).items():
        check_known((key,), PARAMETERS, "[tolerance]")
        _check_continuous(key, "[tolerance]")
        if not (is_number(value) and 0 <= value < 1):
            raise ValueError(f"[tolerance]: {key} = {value} must be a relative 1-sigma uncertainty in 0 .. 1")
    drawn = data.get("randomization", {})
    randomization = {key: increasing_pair(value, f"[randomization] {key}") for key, value in drawn.items()}
    for key, pair in randomization.items():
        check_known((key,), [name for name, meta in PARAMETERS.items() if meta["unit"]], "[randomization]")
        _check_continuous(key, "[randomization]")
        if not pair[0] > 0:
            raise ValueError(f"[randomization]: {key} = {list(pair)} must be two factors above 0")
    target = dict(data.get("target", {}))
    if "band" in target:
        target["band"] = increasing_pair(target["band"], "[target] band")
    rig = Rig(
        name=data["name"],
        magnet=data["magnet"],
        axes=data.get("axes", 1),
        **data["parameters"],
        per_axis=data.get("axis", {}),
        cross=table_as(Cross, data, "cross"),
        gains=controllers_from_table(data["gains"], "gains") if "gains" in data else None,
        noise=table_as(Noise, data, "noise"),
        bounds=bounds,
        protocol=protocol_from_table(data["protocol"]) if "protocol" in data else None,
        target=table_as(Target, {"target": target}, "target"),
        tolerance=data.get("tolerance", {}),
        randomization=randomization,
        self_sensing=table_as(SelfSensing, data, "self_sensing"),
        effects=effects_from_table(data.get("effects", {})),
    )
    # Here alone: a recording may be simulated under a slower stand-in for the controller.
    if "band" in target and not target["band"][1] < rig.control_rate / 2:
        raise ValueError(
            f"[target] band = {list(target['band'])} Hz does not lie below half of the control rate of "
            f"{rig.control_rate:g} Hz; leave it out, or give one such as {list(default_band_of(rig))}"
        )
    check_effects(rig.effects, rig)
    return rig


def _check_continuous(name: str, where: str) -> None:
    """Raise ValueError for a parameter that no factor can multiply: a text, or a whole number."""
    if name == "flux_path" or isinstance(PARAMETERS[name]["low"], int):
        kind = "a text" if name == "flux_path" else "a whole number"
        raise ValueError(f"{where}: {name} is {kind}, which has no relative uncertainty; leave it out")
