"""`maglev simulate`: records a simulated rig as a campaign folder."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import (
    EffectOption,
    JsonOption,
    RigOption,
    SeedOption,
    SensorOption,
    friendly,
    require_choice,
    require_folder,
)

app = typer.Typer()


@app.command(epilog="Example: maglev simulate --rig hmb_free --effect delay=75e-6 --seed 1 --out my-rig")
@friendly
def simulate(
    rig: RigOption = "hmb_free",
    kp: Annotated[float | None, typer.Option(help="A/m (default: the rig's).")] = None,
    ki: Annotated[float | None, typer.Option(help="A/m; ki / ti is the integral gain.")] = None,
    kd: Annotated[float | None, typer.Option(help="A s/m.")] = None,
    td: Annotated[float | None, typer.Option(help="Time constant of the derivative's filter, s.")] = None,
    ti: Annotated[float | None, typer.Option(help="Time constant of the integral's filter, s.")] = None,
    protocol: Annotated[str, typer.Option(help="sphs (the rig's own) or diagnosis (for maglev diagnose).")] = "sphs",
    excite: Annotated[
        list[str],
        typer.Option(
            help="Instead of the rig's: place=first:last[:step]@peak[@degrees], e.g. force=1:249:2@0.4; repeatable."
        ),
    ] = [],  # noqa: B006
    kind: Annotated[
        str, typer.Option(help="Kind of --excite: sphs, multisine (random phases), low_crest or impulse.")
    ] = "sphs",
    fundamental: Annotated[float | None, typer.Option(help="Fundamental of --excite, Hz (default: the rig's).")] = None,
    periods: Annotated[int | None, typer.Option(min=2, help="Periods kept after the transient.")] = None,
    sample_rate: Annotated[
        float | None,
        typer.Option(help="Rate of the recording, Hz: a multiple or integer fraction of the control rate."),
    ] = None,
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    data_format: Annotated[str, typer.Option("--format", help="npz, mat or csv.")] = "npz",
    out: Annotated[Path, typer.Option(help="Folder of the campaign to write.")] = Path("campaign"),
    json_file: JsonOption = None,
) -> None:
    """Record a simulated rig as a campaign folder, in the format of real recordings."""
    from maglev_env.channels import SENSORS

    require_choice(sensor, SENSORS, "--sensor")
    from maglev_env.design.defaults import with_defaults
    from maglev_env.loop.effect import parse_effects
    from maglev_env.loop.gains import with_gains
    from maglev_env.recordings.campaign_writer import FORMATS, require_room, write_campaign
    from maglev_env.recordings.result_folder import locked
    from maglev_env.rig.rig_file import load_rig
    from maglev_workbench.commands.simulate.recordings import PROTOCOLS, Recorded, excited, record, summary
    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page

    require_choice(protocol, PROTOCOLS, "--protocol")
    require_choice(data_format, FORMATS, "--format")
    require_folder(out)
    page = out / "recordings.html"
    if taken := [file for file in (out / "campaign.toml", page) if file.exists()]:
        raise ValueError(f"{taken[0]} exists; choose another --out or delete the folder")
    if excite and protocol != "sphs":
        raise ValueError(f"--excite: --protocol {protocol} plans its own lines; leave one of them out")
    asked = Recorded(tuple(excite), kind, fundamental, periods, sample_rate)
    loaded = with_defaults(excited(load_rig(rig), asked))
    own = {"kp": kp, "ki": ki, "kd": kd, "td": td, "ti": ti}
    chosen = {name: value for name, value in own.items() if value is not None}
    if chosen and not loaded.controlled:
        raise ValueError(f"rig {loaded.name} has no magnets, so it has no gains")
    planned = PROTOCOLS[protocol](loaded, with_gains(loaded.gains, **chosen), parse_effects(effect), seed)
    require_room(out, rig, [plan.name for plan in planned], data_format)
    recordings = []
    with progress_bar() as bar:
        for plan in bar.track(planned, description=f"simulate {loaded.name}"):
            recordings.append((plan.name, plan.role, *record(plan, asked, sensor)))
    with locked(out):
        toml = write_campaign(out, rig, {}, recordings, data_format)
    from maglev_workbench.record_page import record_page  # here because it takes long to import

    html = record_page(f"Simulated {loaded.name}", [(name, d) for name, _, d, _ in recordings])
    write_page(page, html, [toml, json_file])
    console.print(f"{len(recordings)} recording(s) of {loaded.name}\ncampaign  {toml}\npage      {page}")
    write_json(json_file, summary(loaded, recordings, toml))
