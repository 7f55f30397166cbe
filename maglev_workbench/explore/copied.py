"""A setting as text to copy: as a command, as tables of a rig file, and as a program."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass
from shlex import quote
from typing import Any

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import Gains, as_table
from maglev_env.recordings.campaign_writer import toml_table
from maglev_env.rig.rig import Rig

_OPTIONS = ("kp", "ki", "kd", "td", "ti")


@dataclass(frozen=True)
class Source:
    """Where the rig comes from.

    Args:
        option: what follows --rig; None if no command can name the rig, as of a campaign with parameters of its own.
        python: an expression that gives the rig.
    """

    option: str | None
    python: str


def copies(experiment: Experiment, rig: Rig, source: Source) -> dict[str, str]:
    """Command, TOML and Python that repeat the experiment.

    Args:
        experiment: of the page.
        rig: as its file has it, with its own effects.
        source: where the rig comes from.
    """
    return {
        "command": _command(experiment, rig, source),
        "toml": _toml(experiment),
        "python": _python(experiment, rig, source),
    }


def _command(experiment: Experiment, rig: Rig, source: Source) -> str:
    off = [name for name in rig.effects if name not in experiment.effects]
    why = ""
    if source.option is None:
        why = "the rig is that of a campaign"
    elif off:
        why = f"the rig's own {', '.join(off)} is off"
    elif not isinstance(experiment.gains, Gains):
        why = "the controller has other gains than --kp, --ki, ..."
    if why or source.option is None:
        return f"# No command says this, because {why}: put the TOML into a rig file."
    words = ["maglev simulate", f"--rig {quote(source.option)}"]
    words += [f"--{name} {getattr(experiment.gains, name)!r}" for name in _OPTIONS]
    for name, values in experiment.effects.items():
        (first, size), *more = values.items()
        words.append("--effect " + ",".join([f"{name}.{first}={size!r}", *(f"{key}={v!r}" for key, v in more)]))
    return " ".join([*words, f"--seed {experiment.seed}", "--out explored"])


def _toml(experiment: Experiment) -> str:
    table = as_table(experiment.gains)
    tables = {f"[gains.{axis}]": own for axis, own in table.items()} if "x" in table else {"[gains]": table}
    tables |= {f"[effects.{name}]": dict(values) for name, values in experiment.effects.items()}
    return "\n".join(line for header, values in tables.items() for line in toml_table(header, values)).strip() + "\n"


def _kinds(part: Any) -> Iterator[type]:
    """The classes that the text of a controller names: its own, and those of its parts."""
    yield type(part)
    for f in fields(part):
        if is_dataclass(own := getattr(part, f.name)):
            yield from _kinds(own)


def _python(experiment: Experiment, rig: Rig, source: Source) -> str:
    effects = {name: dict(values) for name, values in experiment.effects.items()}
    gains = experiment.gains
    kinds = {kind for one in (gains if isinstance(gains, tuple) else (gains,)) for kind in _kinds(one)} - {Gains}
    loader = source.python.partition("(")[0]
    imports = [f"from maglev_workbench import Gains, evaluate, {loader}, protocol_experiment, with_defaults"]
    for module in sorted({kind.__module__ for kind in kinds}):
        names = sorted(kind.__name__ for kind in kinds if kind.__module__ == module)
        imports.append(f"from {module} import {', '.join(names)}")
    rig_line = f"rig = with_defaults({source.python})"
    if set(rig.effects) - set(effects):
        imports.insert(0, "from dataclasses import replace\n")
        rig_line = f"rig = replace(with_defaults({source.python}), effects={{}})"
    return "\n".join(
        [
            *imports,
            "",
            rig_line,
            f"experiment = protocol_experiment(rig, {gains!r}, effects={effects!r}, seed={experiment.seed!r})",
            "found = evaluate([experiment])",
            'print(found.stiffness[0], found.damping[0], found.margins["peak_sensitivity"][0])',
            "",
        ]
    )
