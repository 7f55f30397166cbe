"""Options, checks and error messages for all commands.

This module imports little, because `maglev --help` loads it.
"""

import errno
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, nullcontext
from functools import wraps
from importlib.metadata import version
from importlib.util import find_spec
from inspect import Parameter, signature
from pathlib import Path
from time import monotonic
from traceback import format_exc
from typing import Annotated, Any

import typer

from maglev_workbench.early import require_valid
from maglev_workbench.heartbeat import heartbeat
from maglev_workbench.presets import PRESETS
from maglev_workbench.printable import printable

RigOption = Annotated[
    str,
    typer.Option(
        help=f"Preset ({', '.join(PRESETS['rig'])}) or a rig TOML.",
        autocompletion=lambda incomplete: [name for name in PRESETS["rig"] if name.startswith(incomplete)],
    ),
]
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
ControllerOption = Annotated[
    str | None,
    typer.Option(
        help="Controller with the rig's PID gains: pid, or pid with filters such as 'pid + notch 650 depth=0.1 + "
        "low_pass 3000' (Hz; notch, lead_lag, low_pass; default: the rig's). See docs/controllers.md.",
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
ThreadsOption = Annotated[
    int | None, typer.Option(min=1, help="Threads or processes (default: all cores); results do not change.")
]
DeviceOption = Annotated[
    str,
    typer.Option(help="Where experiments are simulated: cpu, or cuda (extra [cuda]; differs in the last digits)."),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler, tcp://host:8786, or local:N for N processes here; results do not change.",
    ),
]
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_DENIED = (errno.EACCES, errno.EPERM, errno.EROFS)
_EXTRAS = {  # module that may be missing -> the extra that installs it
    "cmaes": "search", "filterpy": "filter", "matplotlib": "plot", "optuna": "search",
    "slycot": "reference", "stable_baselines3": "rl", "torch": "rl",
}  # fmt: skip
_READ = ("source", "campaign", "folder", "twin", "compare", "init", "policy")  # parameters that name what is read
_WRITTEN = {"json_file": "--json", "docs": "--docs", "picture": "--picture"}  # options that name a file to write

_EVERYWHERE = {  # options that every command has
    "quiet": Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")],
    "verbose": Annotated[
        bool, typer.Option("--verbose", "-v", help="Print the time taken, and with an error where it was raised.")
    ],
}


def given(context: typer.Context) -> list[str]:
    """Names of the command's own parameters that the user has given on the command line."""
    sources = {name: context.get_parameter_source(name) for name in context.params if name not in _EVERYWHERE}
    return [name for name, source in sources.items() if source and source.name == "COMMANDLINE"]


def require_choice(value: str, known: Iterable[str], option: str) -> None:
    """Check that an option has one of the known values.

    Raises:
        ValueError: It has not; the message lists the known values.
    """
    if value not in (choices := tuple(known)):
        raise ValueError(f"{option} {value}: use one of {', '.join(choices)}")


def require_package(name: str) -> None:
    """Check, before any work, that a package of an extra is installed.

    Raises:
        ModuleNotFoundError: It is not; the command says how to install it.
    """
    if find_spec(name) is None:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)


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


def require_campaign(path: Path) -> None:
    """Check, before the imports that take long, that a folder holds a campaign, or a TOML file is one; others pass.

    Raises:
        ValueError: It is not TOML of a campaign's schema.
        OSError: It does not exist, or cannot be read.
    """
    if path.is_dir() or path.suffix == ".toml":
        from maglev_env.recordings.campaign_file import campaign_tables

        campaign_tables(path)


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


def require_apart(path: Path | None, folder: Path, kept: Iterable[str]) -> None:
    """Check, before any work, that --json names none of those files from which a folder of results goes on.

    Args:
        path: the file; None if the option was not given.
        folder: the folder of results, which need not exist.
        kept: names of those files.

    Raises:
        ValueError: It is one of them.
    """
    if path is not None and path.resolve() in {(folder / name).resolve() for name in kept}:
        raise ValueError(f"--json {path} is a file of the results in {folder} from which they go on; name another")


def friendly(command: Callable[..., None]) -> Callable[..., None]:
    """A command with --quiet and --verbose that ends bad input with one message and code 2, and Ctrl-C with 130.

    Files that are to be read and the files of --json, --docs and --picture are checked before the command begins.
    """

    @wraps(command)
    def run(*args: Any, quiet: bool, verbose: bool, **kwargs: Any) -> None:
        started = monotonic()
        try:
            for name, option in _WRITTEN.items():
                require_file(kwargs.get(name), option)
            for name in _READ:
                _require_there(kwargs.get(name))
            for name, presets in PRESETS.items():
                _require_preset(kwargs.get(name), name, presets)
            require_valid(kwargs)
            with nullcontext() if quiet else heartbeat(command.__name__.strip("_").replace("_", "-")), _silent(quiet):
                command(*args, **kwargs)
        except (ValueError, OSError, ArithmeticError, ModuleNotFoundError, MemoryError, BrokenExecutor) as error:
            if isinstance(error, ModuleNotFoundError) and error.name not in _EXTRAS:
                raise
            if verbose:
                typer.echo(printable(format_exc()), err=True, nl=False)
            _say(_said(error), typer.colors.RED)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:
            _say("interrupted", typer.colors.YELLOW)
            raise typer.Exit(130) from None
        if verbose:
            _say(f"{monotonic() - started:.1f} s, version {version('maglev-workbench')}")

    own = signature(command)
    more = [Parameter(n, Parameter.KEYWORD_ONLY, default=False, annotation=o) for n, o in _EVERYWHERE.items()]
    # What typer reads the options from.
    run.__signature__ = own.replace(parameters=[*own.parameters.values(), *more])  # pyright: ignore
    run.__annotations__ = {**command.__annotations__, **_EVERYWHERE}
    return run


@contextmanager
def _silent(quiet: bool) -> Iterator[None]:
    """While the context lasts, nothing is printed, if that is wanted."""
    if not quiet:
        yield
        return
    from maglev_workbench.console import console

    console.quiet = True
    try:
        yield
    finally:
        console.quiet = False


def _say(text: str, colour: str | None = None) -> None:
    """A line on standard error, without colour where the environment variable NO_COLOR is set (no-color.org)."""
    line = f"maglev: {printable(text)}"
    typer.echo(line if colour is None or os.environ.get("NO_COLOR") else typer.style(line, fg=colour), err=True)


def _require_there(given: Any) -> None:
    """Check, before the imports that take long, that the paths among what was given exist."""
    for path in given if isinstance(given, list | tuple) else (given,):
        if isinstance(path, str) and not (_is_preset(path) or path.endswith(".toml")):
            path = Path(path)  # of explore and export, which take a preset, too
        if isinstance(path, Path) and not path.exists():
            raise FileNotFoundError(f"{path} does not exist; check its name and the folder you are in")


def _is_preset(name: str) -> bool:
    """Whether this is a preset, if only of another kind, which whoever loads it then says."""
    return any(name in names for names in PRESETS.values())


def _require_preset(given: str | None, option: str, presets: tuple[str, ...]) -> None:
    """Check, before the imports that take long, that this names a preset or an existing .toml file."""
    if given is None or _is_preset(given):
        return
    if not given.endswith(".toml"):
        raise ValueError(f"--{option} {given}: neither a preset ({', '.join(presets)}) nor a .toml file")
    _require_there(Path(given))


def _said(error: BaseException) -> str:
    """An error in one sentence, with what to do about it."""
    if isinstance(error, OSError) and error.errno in _FULL:
        return f"{error}; nothing that was finished is lost: make room, and run the same command again"
    if isinstance(error, OSError) and error.errno in _DENIED and error.filename:
        return f"{error.filename}: no permission for it; change its rights, or name another file or folder"
    if isinstance(error, ArithmeticError):
        why = f"a number of the input is too large or too small to calculate with ({error})"
        return f"{why}; check the magnitudes of its values"
    if isinstance(error, ModuleNotFoundError):
        return f"this needs {error.name}: pip install 'maglev-workbench[{_EXTRAS[error.name or '']}]'"
    if isinstance(error, MemoryError):
        return "not enough memory: give it less to do at a time"
    if isinstance(error, BrokenExecutor):
        return "one of its processes was ended: give it less to do at a time"
    return str(error)
