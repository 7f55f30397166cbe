"""The rigs and rotors that come with the package, by name; it imports little, because `maglev --help` loads it."""

from importlib.util import find_spec
from pathlib import Path

# A preset is a file. Its folder is found without importing the simulator, which would delay --help.
_PACKAGE = Path(find_spec("maglev_env").submodule_search_locations[0])
PRESETS = {  # option -> its presets
    option: tuple(sorted(file.stem for file in _PACKAGE.joinpath(f"{option}s").glob("*.toml")))
    for option in ("rig", "rotor")
}
MOST_AHEAD = 4000  # characters of a file ahead of its schema


def is_rotor(source: str) -> bool:
    """Whether this names a rotor: one of the presets, or a file whose schema says so."""
    if source in PRESETS["rotor"]:
        return True
    if not source.endswith(".toml"):
        return False
    from maglev_env.fields import toml_text

    try:
        return "maglev-rotor/1" in toml_text(Path(source), "rotor")[:MOST_AHEAD]
    except (OSError, ValueError):
        return False  # whoever loads it says what is wrong
