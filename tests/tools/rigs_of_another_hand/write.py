"""Records as other programs leave them (text with preambles and decimal commas, MATLAB structs), and the tomls."""

import json
from pathlib import Path

import numpy as np
import scipy.io
from bench import Bench, run
from regulators import Cascade
from rigs import Record, Rig


def columns(rig: Rig, logs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """File columns by name, in the engineer's own units: positions count from the coil, `displacement` toward it."""
    out = {}
    for channel, (name, scale, offset, decimals) in rig.channels.items():
        out[name] = np.round(in_si(rig, channel, logs) / scale - offset / scale, decimals)
    return out


def in_si(rig: Rig, channel: str, logs: dict[str, np.ndarray]) -> np.ndarray:
    """What campaign.toml's scale and offset make of a column: currents are deviations from the nominal rest."""
    key = {"time": "t", "command": "wanted", "voltage": "command", "injection": "injection"}.get(channel, channel)
    values = logs[key]
    return values - rig.truth["nominal"]["rest_current_A"] if channel in ("command", "current") else values


def write_data(folder: Path, rig: Rig, record: Record, logs: dict[str, np.ndarray]) -> str:
    layout, data = rig.layout, columns(rig, logs)
    path = folder / f"{record.name}.{layout['ending']}"
    if layout["ending"] == "mat":
        scipy.io.savemat(path, {layout["struct"]: {k: v.reshape(-1, 1) for k, v in data.items()}})
        return path.name
    lines = list(layout["preamble"])
    if layout.get("names", True):
        lines.append(layout["separator"].join(data))
    widths = [spec[3] for spec in rig.channels.values()]
    for row in zip(*data.values(), strict=True):
        cells = (f"{v:.{w}f}" for v, w in zip(row, widths, strict=True))
        lines.append(layout["separator"].join(c.replace(".", layout["decimal"]) for c in cells))
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode("latin-1"))
    return path.name


def recording_table(rig: Rig, record: Record, file: str, use: tuple[str, ...], gains: bool) -> str:
    """One [[recording]]; `use` are the channels that the engineer maps, and gains whether the controller is stated."""
    controller = record.controller()
    top, bottom = (controller.outer if isinstance(controller, Cascade) else controller).polynomials()
    excitation = '{ kind = "recorded", at = "current" }' if "injection" in use else '{ kind = "none" }'
    stated = f"controller = {{ numerator = {[float(v) for v in top]}, denominator = {[float(v) for v in bottom]} }}"
    lines = [
        "[[recording]]",
        f'file = "{file}"',
        f'role = "{record.role}"',
        f"sample_rate = {1 / rig.bench.dt:g}",
        f"excitation = {excitation}",
        stated if gains else "# nothing is known of the controller",
        "",
        "[recording.channels]",
    ]
    for channel in use:
        name, scale, offset, _ = rig.channels[channel]
        chain = dict(rig.chain.get(channel, {}))
        offset = 0.0 if chain.get("total") else offset
        source = f"{rig.layout['struct']}.{name}" if rig.layout["ending"] == "mat" else name
        more = "".join(f", {key} = {json.dumps(value)}" for key, value in chain.items())
        lines.append(f'{channel} = {{ from = "{source}", scale = {scale!r}, offset = {offset!r}{more} }}')
    return "\n".join(lines)


def write_campaign(
    folder: Path,
    rig: Rig,
    use: tuple[str, ...],
    logs: dict[str, dict[str, np.ndarray]],
    gains: bool = True,
) -> None:
    """Data files, rig.toml, campaign.toml and truth.json of a rig; `logs` of each record, see `run_all`."""
    folder.mkdir(parents=True, exist_ok=True)
    tables = ['schema = "maglev-campaign/1"\nrig = "rig.toml"']
    for record in rig.records:
        file = write_data(folder, rig, record, logs[record.name])
        tables.append(recording_table(rig, record, file, use, gains))
    (folder / "rig.toml").write_text(rig.rig_toml)
    (folder / "campaign.toml").write_text("\n\n".join(tables) + "\n")
    (folder / "truth.json").write_text(json.dumps(rig.truth, indent=1, default=float) + "\n")


def run_all(rig: Rig, seed: int) -> dict[str, dict[str, np.ndarray]]:
    """Name -> log of each record of a rig."""
    return {r.name: record_logs(rig.bench, r, np.random.default_rng([seed, n])) for n, r in enumerate(rig.records)}


def record_logs(bench: Bench, record: Record, rng: np.random.Generator) -> dict[str, np.ndarray]:
    logs = run(bench, record.controller(), record.reference, record.injection, rng, record.start)
    logs["injection"] = np.zeros(len(record.reference)) if record.injection is None else record.injection
    return logs
