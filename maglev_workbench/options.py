"""Options, checks and error messages for all commands.

This module imports little, because `maglev --help` loads it.
"""

import errno
import os
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

from maglev_workbench.heartbeat import heartbeat

# A preset is a file. Its folder is found without importing the simulator, which would delay --help.
_RIGS = Path(find_spec("maglev_env").submodule_search_locations[0], "rigs")
_PRESETS = ", ".join(sorted(file.stem for file in _RIGS.glob("*.toml")))
RigOption = Annotated[str, typer.Option(help=f"Preset ({_PRESETS}) or a rig TOML.")]
EffectOption = Annotated[
    list[str],
    typer.Option("--effect", help="Effect added to the rig's own, e.g. delay=75e-6; repeat. See: maglev effects."),
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Also write the result as JSON to this file.")]
GoalOption = Annotated[
    str | None,
    typer.Option(
        metavar="FILE_OR_TEXT",
        help="What gains are scored by: match, engineer, a text file, or requirements such as 'peak_sensitivity <= 3, "
        "best compliance near 20e-6' (default: the rig's). See docs/goals.md.",
    ),
]
DocsOption = Annotated[Path | None, typer.Option(help="Also write the tables as markdown to this file.")]
SensorOption = Annotated[
    str, typer.Option(help="Sensor of the displacement: probe, or self_sensing (the rig's own coils).")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of all noise and random choices.")]
PolicyOption = Annotated[
    Path | None, typer.Option(help="Checkpoint of the learned tuner (default: the one of this package).")
]
ThreadsOption = Annotated[int | None, typer.Option(min=1, help="Threads (default: all cores); results do not change.")]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler, tcp://host:8786, or local:N for N processes here; results do not change.",
    ),
]
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_DENIED = (errno.EACCES, errno.EPERM, errno.EROFS)
_EXTRAS = {"torch": "rl", "stable_baselines3": "rl"}  # module that may be missing -> the extra that installs it
_WRITTEN = {"json_file": "--json", "docs": "--docs", "picture": "--picture"}  # options that name a file to write


def given(context: typer.Context) -> list[str]:
    """Names of the parameters that the user has given on the command line."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return [name for name, source in sources.items() if source and source.name == "COMMANDLINE"]


def require_choice(value: str, known: Iterable[str], option: str) -> None:
    """Check that an option has one of the known values.

    Raises:
        ValueError: It has not; the message lists the known values.
    """
    if value not in (choices := tuple(known)):
        raise ValueError(f"{option} {value}: use one of {', '.join(choices)}")


def require_file(path: Path | None, option: str) -> None:
    """Check, before any work, that a file can be written later.

    Args:
        path: the file; None if the option was not given.
        option: its name on the command line, for the message.

    Raises:
        ValueError: The path is a folder or a device, or its folder is missing or read-only.
    """
    if path is None:
        return
    if path.is_dir():
        raise ValueError(f"{option} {path} is a folder; name a file")
    if path.exists() and not path.is_file():  # a device would be replaced by the file
        raise ValueError(f"{option} {path} is not a regular file; name another one")
    if not path.parent.is_dir():
        raise ValueError(f"{option} {path}: the folder {path.parent} does not exist; create it or choose another")
    if not os.access(path.parent, os.W_OK):
        raise ValueError(f"{option} {path}: the folder {path.parent} cannot be written to; choose another")


def require_folder(path: Path, option: str = "--out") -> None:
    """Check, before any work, that results can be written into a folder, which need not exist yet.

    Args:
        path: the folder.
        option: its name on the command line, for the message.

    Raises:
        ValueError: The path is a file, or the folder (or the nearest existing folder above it) is read-only.
    """
    there = next(p for p in (path, *path.absolute().parents) if p.exists())
    if not there.is_dir():
        raise ValueError(f"{option} {path}: {there} is a file; name a folder")
    if not os.access(there, os.W_OK):
        raise ValueError(f"{option} {path}: the folder {there} cannot be written to; choose another")


def friendly(command: Callable[..., None]) -> Callable[..., None]:
    """A command that reports invalid input or files with one message and exit code 2, and Ctrl-C with 130.

    The files of --json, --docs and --picture are checked before the command begins.
    """

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            for name, option in _WRITTEN.items():
                require_file(kwargs.get(name), option)
            with heartbeat(command.__name__.strip("_").replace("_", "-")):
                command(*args, **kwargs)
        except (ValueError, OSError) as error:
            typer.secho(f"maglev: {_said(error)}", fg=typer.colors.RED, err=True)
            raise typer.Exit(2) from error
        except ArithmeticError as error:
            why = f"a number of the input is too large or too small to calculate with ({error})"
            typer.secho(f"maglev: {why}; check the magnitudes of its values", fg=typer.colors.RED, err=True)
            raise typer.Exit(2) from error
        except ModuleNotFoundError as error:
            if error.name not in _EXTRAS:
                raise
            why = f"this needs {error.name}: pip install 'maglev-workbench[{_EXTRAS[error.name]}]'"
            typer.secho(f"maglev: {why}", fg=typer.colors.RED, err=True)
            raise typer.Exit(2) from error
        except (MemoryError, BrokenExecutor) as error:
            why = "not enough memory" if isinstance(error, MemoryError) else "one of its processes was ended"
            typer.secho(f"maglev: {why}: give it less to do at a time", fg=typer.colors.RED, err=True)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:
            typer.secho("maglev: interrupted", fg=typer.colors.YELLOW, err=True)
            raise typer.Exit(130) from None

    return run


def _said(error: ValueError | OSError) -> str:
    """An error in one sentence, with what to do where the system itself refused."""
    if isinstance(error, OSError) and error.errno in _FULL:
        return f"{error}; nothing that was finished is lost: make room, and run the same command again"
    if isinstance(error, OSError) and error.errno in _DENIED and error.filename:
        return f"{error.filename}: no permission for it; change its rights, or name another file or folder"
    return str(error)
