"""`maglev selfsense record`: a simulated coil, its current and switching voltage beside the true displacement."""

from dataclasses import asdict, dataclass
from importlib.metadata import version
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.channels import unit_of
from maglev_env.loop.axes import suffixes
from maglev_env.recordings.campaign_writer import write_campaign
from maglev_env.recordings.json_data import plain
from maglev_workbench.commands.selfsense.demodulate.study import check_motion
from maglev_workbench.commands.selfsense.rig_sensor import load_sensor, reading_text
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from selfsense.sensor import SelfSensor
from selfsense.simulate import simulate

if TYPE_CHECKING:
    import xarray as xr

NAME = "coil"
FORMATS = ("npz", "mat", "csv")
LONGEST = 10.0  # s: 2.6 million samples at 262.5 kHz


@dataclass(frozen=True)
class Motion:
    """What is recorded for so many seconds: the gap moves by amplitude (m) sin at frequency (Hz), the duty by
    duty_swing cos about one half."""

    frequency: float
    amplitude: float
    duty_swing: float
    seconds: float


def run(rig: str, motion: Motion, seed: int, data_format: str, out: Path, json_file: Path | None) -> None:
    """See `maglev_workbench.commands.selfsense.cli.record`."""
    if data_format not in FORMATS:
        raise ValueError(f"--format {data_format}: use one of {', '.join(FORMATS)}")
    if (out / "campaign.toml").exists():
        raise ValueError(f"{out / 'campaign.toml'} exists; choose another --out or delete the folder")
    require_folder(json_file, "--json")
    loaded, sensor = load_sensor(rig)
    check_motion(sensor, motion.frequency, motion.amplitude)
    if not 0 <= motion.duty_swing <= 0.5:
        raise ValueError(f"--duty-swing {motion.duty_swing:g}: the duty varies about one half; use 0 to 0.5")
    if motion.seconds > LONGEST:
        raise ValueError(f"--seconds {motion.seconds:g}: use up to {LONGEST:g}; a recording holds every sample")
    with progress_bar() as bar:
        task = bar.add_task(f"record {loaded.name}", total=2)
        dataset = recorded_coil(sensor, motion, seed, suffixes(loaded.axes)[0])
        bar.advance(task)
        toml = write_campaign(out, rig, {}, [(NAME, "fit", dataset, None)], data_format)
        bar.advance(task)
    samples, rate = dataset.sizes["time"], sensor.acquisition.rate
    console.print(
        f"{samples} samples of {loaded.name}'s coil at {rate / 1e3:g} kHz, {reading_text(sensor)}", markup=False
    )
    console.print(f"campaign  {toml}\nnext      maglev selfsense estimate {out}", markup=False)
    summary = {
        "schema": "maglev-selfsense-record/1",
        "version": version("maglev-workbench"),
        "rig": loaded.name,
        "sensor": sensor,
        "seed": seed,
        "settings": {**asdict(motion), "format": data_format},
        "campaign": str(toml),
        "samples": samples,
        "sample_rate": rate,
        "channels": list(map(str, dataset.data_vars)),
    }
    write_json(json_file, plain(summary))


def recorded_coil(sensor: SelfSensor, motion: Motion, seed: int, suffix: str = "") -> "xr.Dataset":
    """The coil's current (A, as read), switching voltage (V, mean since the sample before) and the displacement (m): at
    rest less gap; over time (s) from 0, the first sample being one interval after the coil was without current.

    suffix: of the channels' names, _x on an x-y rig.
    """
    import xarray as xr

    rate = sensor.acquisition.rate
    elapsed = (np.arange(round(motion.seconds * rate)) + 1) / rate
    phase = 2 * pi * motion.frequency * elapsed
    gap = sensor.gap + motion.amplitude * np.sin(phase)
    sensed = simulate([sensor], gap, 2 * motion.duty_swing * np.cos(phase), seed=seed)
    channels = {
        "current": sensed.current[0],
        "voltage": sensor.supply.voltage * sensed.switching[0],
        "displacement": sensor.gap - gap,
    }
    variables = {f"{name}{suffix}": ("time", v, {"units": unit_of(name)}) for name, v in channels.items()}
    time = ("time", np.arange(elapsed.size) / rate, {"units": "s"})
    return xr.Dataset(variables, {"time": time}, {"sample_rate": rate})
