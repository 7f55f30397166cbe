"""A workbench for magnetically levitated rotors: the `maglev` command, and its functions for use from Python.

The public names are those of `maglev_env` (rigs, experiments, simulation, evaluation, recordings, environments) and of
`sim2real` (diagnosis). They are imported on first use, so that `maglev --help` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from maglev_env import *  # noqa: F403
    from sim2real import *  # noqa: F403

    __version__: str

_PACKAGES = ("maglev_env", "sim2real")


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("maglev-workbench")
    if not name.startswith("__"):
        for package in map(import_module, _PACKAGES):
            if name in package.__all__:
                return getattr(package, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({"__version__", *(name for package in _PACKAGES for name in import_module(package).__all__)})
