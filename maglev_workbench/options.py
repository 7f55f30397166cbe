"""Options and errors that every command shares."""

from collections.abc import Callable
from functools import wraps
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer

# A preset is a file. Its folder is looked up without loading the simulator, which would delay every --help.
_RIGS = Path(find_spec("maglev_env").submodule_search_locations[0], "rigs")
_PRESETS = ", ".join(sorted(file.stem for file in _RIGS.glob("*.toml")))
RigOption = Annotated[str, typer.Option(help=f"Preset ({_PRESETS}) or a rig TOML.")]
EffectOption = Annotated[
    list[str],
    typer.Option("--effect", help="Effect beside the rig's own, e.g. delay=75e-6; repeat. See: maglev effects."),
]
JsonOption = Annotated[Path | None, typer.Option("--json", help="Also write the result as JSON to this file.")]
SensorOption = Annotated[
    str, typer.Option(help="What reads the displacement: probe, or self_sensing (the rig's own coils).")
]
SeedOption = Annotated[int, typer.Option(min=0, help="Seed of every noise and random choice.")]
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


def given(context: typer.Context) -> list[str]:
    """Names of the parameters that are on the command line."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return [name for name, source in sources.items() if source and source.name == "COMMANDLINE"]


def friendly(command: Callable[..., None]) -> Callable[..., None]:
    """Bad input or files end with one message and exit code 2, Ctrl-C with 130."""

    @wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except (ValueError, OSError) as error:
            typer.secho(f"maglev: {error}", fg=typer.colors.RED, err=True)
            raise typer.Exit(2) from error
        except KeyboardInterrupt:
            typer.secho("maglev: interrupted", fg=typer.colors.YELLOW, err=True)
            raise typer.Exit(130) from None

    return run
