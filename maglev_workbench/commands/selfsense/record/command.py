"""`maglev selfsense record`: records a simulated coil: current, switching voltage and true displacement."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.commands.selfsense.options import AmplitudeOption, FrequencyOption, SwingOption
from maglev_workbench.options import JsonOption, RigOption, SeedOption, friendly, require_choice, require_folder

NAME = "coil"
LONGEST = 10.0  # s: 2.6 million samples at 262.5 kHz
app = typer.Typer()


@app.command(epilog="Example: maglev selfsense record --format mat --out coil && maglev selfsense estimate coil")
@friendly
def record(
    rig: RigOption = "hmb_free",
    frequency: FrequencyOption = 100.0,
    amplitude: AmplitudeOption = 50e-6,
    duty_swing: SwingOption = 0.1,
    seconds: Annotated[float, typer.Option(min=0.01, help="Length of the recording, s.")] = 0.1,
    seed: SeedOption = 0,
    data_format: Annotated[str, typer.Option("--format", help="npz, mat or csv.")] = "npz",
    out: Annotated[Path, typer.Option(help="Folder of the campaign to write.")] = Path("coil"),
    json_file: JsonOption = None,
) -> None:
    """Record a simulated coil (current, switching voltage, true displacement) as a campaign folder."""
    from dataclasses import asdict
    from importlib.metadata import version

    from maglev_env.loop.axes import suffixes
    from maglev_env.recordings.campaign_writer import FORMATS, require_room, write_campaign
    from maglev_env.recordings.formats.json_data import plain
    from maglev_workbench.commands.selfsense.demodulate.study import check_motion
    from maglev_workbench.commands.selfsense.record.recording import Motion, recorded_coil
    from maglev_workbench.commands.selfsense.rig_sensor import load_sensor, reading_text
    from maglev_workbench.console import console, progress_bar, write_json

    require_choice(data_format, FORMATS, "--format")
    require_folder(out)
    if (out / "campaign.toml").exists():
        raise ValueError(f"{out / 'campaign.toml'} exists; choose another --out or delete the folder")
    require_room(out, rig, [NAME], data_format)
    loaded, sensor = load_sensor(rig)
    check_motion(sensor, frequency, amplitude)
    if not 0 <= duty_swing <= 0.5:
        raise ValueError(f"--duty-swing {duty_swing:g}: the duty varies about one half; use 0 to 0.5")
    if seconds > LONGEST:
        raise ValueError(f"--seconds {seconds:g}: use up to {LONGEST:g}; a recording holds every sample")
    motion = Motion(frequency, amplitude, duty_swing, seconds)
    with progress_bar() as bar:
        task = bar.add_task(f"record {loaded.name}", total=2)
        dataset = recorded_coil(sensor, motion, seed, suffixes(loaded.axes)[0])
        bar.advance(task)
        toml = write_campaign(out, rig, {}, [(NAME, "fit", dataset, None)], data_format)
        bar.advance(task)
    samples, rate = dataset.sizes["time"], sensor.acquisition.rate
    console.print(f"{samples} samples of {loaded.name}'s coil at {rate / 1e3:g} kHz, {reading_text(sensor)}")
    console.print(f"campaign  {toml}\nnext      maglev selfsense estimate {out}")
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
