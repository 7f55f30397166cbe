"""The corrected rig as a rig TOML: the nominal rig with what closes the gap, for sweeps and environments."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER, as_table
from maglev_env.recordings.files import write_text_atomic
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import PARAMETERS, SCHEMA, Rig
from sim2real.compared.simulated import experiment_at
from sim2real.diagnosis import Diagnosis
from sim2real.report import corrections, sentence
from sim2real.words import AT_BOUND

_LINE = 100


def corrected_rig(diagnosis: Diagnosis) -> Rig:
    """The campaign's rig at the point that closes its gap; its name ends in "-corrected".

    Args:
        diagnosis: of the campaign.
    """
    rig = diagnosis.rig
    at = experiment_at(Experiment(rig, rig.gains or NO_CONTROLLER, ()), diagnosis.corrected)
    return replace(at.rig, name=f"{rig.name}-corrected", effects=at.effects)


def corrected_toml(diagnosis: Diagnosis) -> str:
    """`corrected_rig` as a rig TOML that `load_rig` reads back unchanged; comments state its origin."""
    head = [
        f"Made by maglev diagnose from the campaign {diagnosis.campaign.folder.resolve().name}.",
        sentence(diagnosis),
    ]
    if diagnosis.gap.after is not None:
        head.append(
            f"Gap on the {diagnosis.gap.judged_on}, in units of the noise: "
            f"{'no levitation' if diagnosis.gap.before is None else f'{diagnosis.gap.before:.4g}'} before, "
            f"{diagnosis.gap.after:.4g} after."
        )
    if diagnosis.free is not None and (diagnosis.free.gained or diagnosis.free.trend):
        head.append(diagnosis.free.sentence())
    for c in corrections(diagnosis):
        head.append(
            f"{c.name} = {c.value:.6g} {c.unit}".rstrip()
            + (f" +- {c.se:.2g} (standard error)" if c.se else "")
            + (f" ({AT_BOUND})" if c.at_bound else "")
        )
    comment = "".join(f"# {' '.join(line.split())}\n" for line in head)
    return comment + rig_toml(corrected_rig(diagnosis))


def write_corrected(diagnosis: Diagnosis, path: str | Path) -> None:
    """Write `corrected_toml` atomically.

    Args:
        diagnosis: of a campaign.
        path: of the rig file to write.

    Raises:
        OSError: The file cannot be written.
    """
    write_text_atomic(path, corrected_toml(diagnosis))


def rig_toml(rig: Rig) -> str:
    """A rig as a TOML (schema maglev-rig/1); values equal to their defaults are left out."""
    top = {"schema": SCHEMA, "name": rig.name, "magnet": rig.magnet} | ({"axes": rig.axes} if rig.axes != 1 else {})
    defaults = {f.name: f.default for f in fields(Rig)}
    parameters = {name: getattr(rig, name) for name in PARAMETERS if getattr(rig, name) != defaults[name]}
    lines = [*_pairs(top), *_table("parameters", parameters)]
    for axis, own in rig.per_axis.items():
        lines += _table(f"axis.{axis}", own)
    lines += _table("cross", _changed(rig.cross))
    if rig.gains is not None:
        gains = as_table(rig.gains)
        tables = {f"gains.{axis}": gains[axis] for axis in gains} if isinstance(rig.gains, tuple) else {"gains": gains}
        lines += [line for name, table in tables.items() for line in _table(name, table)]
    for name in ("noise", "target", "self_sensing"):
        lines += _table(name, _changed(getattr(rig, name)))
    for name in ("bounds", "tolerance", "randomization"):
        lines += _table(name, getattr(rig, name))
    for name, values in rig.effects.items():
        lines += _table(f"effects.{name}", values)
    if rig.protocol is not None:
        lines += ["", "[protocol]", *_pairs({k: v for k, v in _all(rig.protocol).items() if k != "excitations"})]
        for e in rig.protocol.excitations:
            lines += ["", "[[protocol.excitation]]", *_pairs(_excitation(e))]
    return "\n".join(lines) + "\n"


def _excitation(e: Excitation) -> dict[str, Any]:
    table = {"kind": e.kind, **_changed(e)}
    lines = table.pop("lines", ())
    if len(lines) > 1 and lines[-1] - lines[0] == len(lines) - 1:
        return {**table, "harmonics": [lines[0], lines[-1]]}
    return {**table, "lines": lines} if lines else table


def _all(part: Any) -> dict[str, Any]:
    return {f.name: getattr(part, f.name) for f in fields(part)}


def _changed(part: Any) -> dict[str, Any]:
    """Fields of a dataclass that differ from their defaults."""
    return {f.name: v for f in fields(part) if f.default is not MISSING and (v := getattr(part, f.name)) != f.default}


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    return ["", f"[{name}]", *_pairs(values)] if values else []


def _pairs(values: Mapping[str, Any]) -> list[str]:
    return [f"{key} = {_toml(value)}" for key, value in values.items()]


def _toml(value: Any) -> str:
    """A text, a number or a sequence of numbers."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Sequence):
        rows, row = [], ""
        for text in map(_toml, value):
            if row and len(row) + len(text) > _LINE:
                rows, row = [*rows, row], ""
            row += f"{text}, "
        return f"[{row.rstrip(', ')}]" if not rows else "[\n    " + "\n    ".join([*rows, row]).rstrip() + "\n]"
    return repr(int(value)) if isinstance(value, int) else repr(float(value))
