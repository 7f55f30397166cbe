"""Campaign folders in the form that the workbench reads, without anything that reveals the truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim2real.blind.excitation import FUNDAMENTAL, Drive
from sim2real.blind.rigs import PID, TwinRig

CHANNELS: Mapping[str, tuple[str, ...]] = {
    "full": ("displacement", "command", "current", "force", "injection"),
    "no_force": ("displacement", "command", "current", "injection"),
    "displacement": ("displacement", "force", "injection"),
}
_PLACES = (("force", "force"), ("injection", "current"))  # channel, and the place at which it excites


@dataclass(frozen=True)
class Written:
    """A recording to be written: its name, role, origin, and channels (samples,) in SI units."""

    name: str
    role: str
    gains: PID
    drive: Drive
    speed_rpm: float
    channels: Mapping[str, np.ndarray]


def write_campaign(folder: Path, rig: TwinRig, channels: str, recordings: Sequence[Written]) -> None:
    """Write campaign.toml, one .npz per recording, and rig.toml where the rig is not a preset.

    Converter readings are written as counts with their scale, as a converter gives them; other readings in single
    precision. The reference is written where it is not zero.

    Raises:
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True)
    p = rig.parameters
    counts = {
        "displacement": 2 * p["voltage_range"] / 2 ** p["adc_bits"] / p["probe_gain"],
        "command": 2 * p["voltage_range"] / 2 ** p["dac_bits"],
    }
    lines = ['schema = "maglev-campaign/1"', f'rig = "{rig.source}"']
    for r in recordings:
        names = [*CHANNELS[channels], *(["reference"] if r.drive.reference else [])]
        columns = {"time": np.arange(r.channels["displacement"].size) / p["control_rate"]}
        for name in names:
            values = r.channels[name]
            columns[name] = np.rint(values / counts[name]).astype(np.int32) if name in counts else np.float32(values)
        np.savez(folder / f"{r.name}.npz", **columns)
        lines += _recording(r, list(columns), counts, p["control_rate"])
    if rig.toml:
        (folder / "rig.toml").write_text(rig.toml, encoding="utf-8")
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _recording(r: Written, names: list[str], counts: Mapping[str, float], rate: float) -> list[str]:
    gains = ", ".join(f"{key} = {value!r}" for key, value in vars(r.gains).items())
    lines = [
        *("", "[[recording]]", f'file = "{r.name}.npz"', f'role = "{r.role}"', f"sample_rate = {rate!r}", "start = 0"),
        *('intersample = "zoh"', f"speed_rpm = {r.speed_rpm!r}", f"gains = {{ {gains} }}"),
    ]
    for channel, place in _PLACES:
        excited = getattr(r.drive.grid, channel)
        if excited:
            wave = getattr(r.drive, channel)
            values = {
                "kind": '"multisine"',
                "at": f'"{place}"',
                "fundamental": FUNDAMENTAL,
                "amplitude": float(np.abs(wave).max()),
                "periods": r.channels["displacement"].size // wave.size,
                "lines": list(excited),
            }
            lines += ["", "[[recording.excitation]]", *(f"{key} = {value}" for key, value in values.items())]
    lines += ["", "[recording.channels]"]
    for name in names:
        scale = f", scale = {counts[name]!r}" if name in counts else ""
        lines.append(f'{name} = {{ from = "{name}"{scale} }}')
    return lines
