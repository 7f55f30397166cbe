"""Campaign folders in the form that every command reads, without anything that reveals the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from sim2real.blind.benchmark.drives import CHANNEL, Drive
from sim2real.blind.benchmark.rigs import BenchRig
from sim2real.blind.benchmark.simulate import Recording

CHANNELS: Mapping[str, tuple[str, ...]] = {
    "full": ("displacement", "command", "current", "force"),
    "no_force": ("displacement", "command", "current"),
    "displacement": ("displacement", "force"),
}


@dataclass(frozen=True)
class Recorded:
    """A recording that was made.

    Attributes:
        recording: The experiment.
        stored: Whether its drive is stored.
        values: Its channels.
        more: Channels that are stored beside those of the campaign.
    """

    recording: Recording
    stored: bool
    values: Mapping[str, np.ndarray]
    more: tuple[str, ...] = ()


def write_campaign(folder: Path, rig: BenchRig, channels: str, recorded: Sequence[Recorded]) -> None:
    """Write campaign.toml, rig.toml and one .npz per recording.

    Args:
        folder: New folder.
        rig: The rig.
        channels: One of CHANNELS.
        recorded: The recordings.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True)
    lines = ['schema = "maglev-campaign/1"', 'rig = "rig.toml"']
    for made in recorded:
        recording, values = made.recording, made.values
        driven = [CHANNEL[drive.at] for drive in recording.drives]
        own = [name for name in CHANNELS[channels] if name != "force" or "force" in driven]
        own += [*(driven if made.stored else ()), *made.more, *(("reference",) if recording.offset else ())]
        own = list(dict.fromkeys(own))
        columns: dict[str, np.ndarray] = {}
        tables = []
        for name in own:
            for axis in range(rig.axes):
                channel = name + ("" if rig.axes == 1 else "_" + "xy"[axis])
                column = values[name][:, axis]
                scale = rig.counts.get(name)
                columns[channel] = np.float32(column) if scale is None else np.rint(column / scale).astype(np.int32)
                tables.append(f'{channel} = {{ from = "{channel}"' + (f", scale = {scale!r}" if scale else "") + " }")
        np.savez(folder / f"{recording.name}.npz", **columns)
        lines += [*_head(rig, recording, made.stored), "", "[recording.channels]", *tables]
    (folder / "rig.toml").write_text(rig.toml(), encoding="utf-8")
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _head(rig: BenchRig, recording: Recording, stored: bool) -> list[str]:
    lines = [
        *("", "[[recording]]", f'file = "{recording.name}.npz"', f'role = "{recording.role}"'),
        *(f"sample_rate = {rig.parameters['control_rate']!r}", "start = 0", 'intersample = "zoh"'),
        f"speed_rpm = {recording.speed * 30 / pi!r}",
        f"controller = {recording.controller.toml()}",
    ]
    for drive in recording.drives:
        lines += ["", "[[recording.excitation]]", *_excitation(rig, drive, stored)]
    return lines


def _excitation(rig: BenchRig, drive: Drive, stored: bool) -> list[str]:
    periodic = drive.shape == "multisine"
    values: dict[str, object] = {"kind": '"none"'}
    if periodic:
        values = {
            "kind": '"multisine"',
            "at": f'"{drive.at}"',
            "period_samples": drive.wave.size // drive.periods,
            "amplitude": float(np.abs(drive.wave).max()),
            "periods": drive.periods,
            "lines": list(drive.lines),
        }
    elif stored and drive.shape in ("chirp", "noise"):
        values = {"kind": '"recorded"', "at": f'"{drive.at}"'}
    if rig.axes == 2 and (periodic or stored) and drive.shape in ("chirp", "noise", "multisine"):
        values["direction"] = drive.direction
    return [f"{key} = {value}" for key, value in values.items()]
