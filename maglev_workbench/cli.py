"""The `maglev` command. Every command imports what it needs when it runs, so that `--help` answers at once."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench import cli_tuning
from maglev_workbench.commands.blind import cli as cli_blind
from maglev_workbench.commands.selfsense import cli as cli_selfsense
from maglev_workbench.options import (
    EffectOption,
    JsonOption,
    RigOption,
    SchedulerOption,
    SeedOption,
    SensorOption,
    ThreadsOption,
    friendly,
)

app = typer.Typer(
    name="maglev",
    help="Tune and identify magnetically levitated rotors: gains in; stiffness, damping and stability out.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(cli_tuning.app)
app.add_typer(cli_selfsense.app)
app.add_typer(cli_blind.app)


@app.command(epilog="Example: maglev sweep --rig hmb_free --kp 4000:16000:16 --kd 2:12:16 --out my-sweep")
@friendly
def sweep(
    rig: RigOption = "hmb_free",
    kp: Annotated[str | None, typer.Option(help="lo:hi:n in A/m, or one value.")] = None,
    ki: Annotated[str | None, typer.Option(help="lo:hi:n in A/(m s), or one value.")] = None,
    kd: Annotated[str | None, typer.Option(help="lo:hi:n in A s/m, or one value.")] = None,
    log: Annotated[
        bool | None, typer.Option("--log/--linear", help="Spacing (default: log over the rig's bounds).")
    ] = None,
    sobol: Annotated[int, typer.Option(min=0, help="So many Sobol points instead of the grid.")] = 0,
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    scheduler: SchedulerOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the results; an interrupted sweep resumes there.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Score every gain set of a grid (or Sobol set) by a simulated SPHS experiment: table, dataset and HTML maps.

    Without --kp, --ki and --kd it sweeps the rig's bounds; with some of them, the others stay at the preset.
    """
    from maglev_workbench.commands.sweep import command as command_sweep

    axes = {"kp": kp, "ki": ki, "kd": kd}
    command_sweep.run(rig, axes, log, sobol, effect, seed, sensor, threads, scheduler, out, json_file)


@app.command(epilog="Example: maglev estimate my-rig --method both --json estimate.json")
@friendly
def estimate(
    source: Annotated[Path, typer.Argument(help="Campaign folder, or one .mat, .csv, .npz or .h5 file.")],
    method: Annotated[str, typer.Option(help="ls (the dissertation's), ml or both.")] = "both",
    estimate_mass: Annotated[bool, typer.Option("--estimate-mass", help="Fit the moving mass too.")] = False,
    band_width: Annotated[float | None, typer.Option(help="Width of the estimation bands, Hz.")] = None,
    band_overlap: Annotated[float | None, typer.Option(help="Overlap of neighbouring bands, Hz.")] = None,
    rate: Annotated[float | None, typer.Option(help="One file: sample rate, Hz.")] = None,
    fundamental: Annotated[float, typer.Option(help="One file: fundamental of the excitation, Hz.")] = 1.0,
    lines: Annotated[str, typer.Option(help="One file: excited harmonics, first:last[:step].")] = "1:250",
    recorded: Annotated[bool, typer.Option("--recorded", help="One file: the force is not periodic.")] = False,
    force: Annotated[str, typer.Option(help="One file: column of the force, name[*scale].")] = "force",
    displacement: Annotated[str, typer.Option(help="One file: column of the displacement.")] = "displacement",
    mass: Annotated[float | None, typer.Option(help="Moving mass, kg (overrides the campaign's).")] = None,
    start: Annotated[int, typer.Option(min=0, help="One file: first sample used.")] = 0,
    samples: Annotated[
        int | None, typer.Option(min=1, help="One file: how many samples (default: to the end).")
    ] = None,
    intersample: Annotated[
        str | None,
        typer.Option(help="One file: the force between samples, bl (continuous) or zoh (held by a converter)."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="HTML page (default: beside the source).")] = None,
    json_file: JsonOption = None,
) -> None:
    """Stiffness, damping, margins and distortion of recordings, with honest intervals."""
    from maglev_workbench.commands.estimate import command as command_estimate

    one = command_estimate.OneFile(rate, fundamental, lines, recorded, force, displacement, start, samples, intersample)
    command_estimate.run(source, method, estimate_mass, band_width, band_overlap, mass, one, out, json_file)


@app.command(epilog="Example: maglev check my-rig")
@friendly
def check(
    campaign: Annotated[Path, typer.Argument(help="Campaign folder.")],
    out: Annotated[Path | None, typer.Option(help="HTML page (default: in the campaign folder).")] = None,
    json_file: JsonOption = None,
) -> None:
    """Is a campaign good enough, and for what: noise, transients, quantisation, crest, lines, missing channels."""
    from maglev_workbench.commands.check import command as command_check

    command_check.run(campaign, out, json_file)


@app.command(epilog="Example: maglev diagnose my-rig --json diagnosis.json")
@friendly
def diagnose(
    campaign: Annotated[Path, typer.Argument(help="Campaign folder; its campaign.toml names the nominal rig.")],
    seed: SeedOption = 0,
    out: Annotated[
        Path | None, typer.Option(help="Folder of page, JSON and corrected rig (default: diagnosis in the campaign's).")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """Why simulator and rig differ: where, which effect or none that is known, how far it closes, what to measure."""
    from maglev_workbench.commands.diagnose import command as command_diagnose

    command_diagnose.run(campaign, seed, out, json_file)


@app.command(epilog="Example: maglev simulate --rig hmb_free --effect delay=75e-6 --seed 1 --out my-rig")
@friendly
def simulate(
    rig: RigOption = "hmb_free",
    kp: Annotated[float | None, typer.Option(help="A/m (default: the rig's).")] = None,
    ki: Annotated[float | None, typer.Option(help="A/(m s).")] = None,
    kd: Annotated[float | None, typer.Option(help="A s/m.")] = None,
    protocol: Annotated[str, typer.Option(help="sphs (the rig's own) or diagnosis (the good campaign).")] = "sphs",
    excite: Annotated[
        list[str],
        typer.Option(
            help="Instead of the rig's: place=first:last[:step]@peak[@degrees], e.g. force=1:249:2@0.4; repeat."
        ),
    ] = [],  # noqa: B006
    kind: Annotated[str, typer.Option(help="Of --excite: sphs, multisine (random phases) or low_crest.")] = "sphs",
    fundamental: Annotated[float | None, typer.Option(help="Fundamental of --excite, Hz (default: the rig's).")] = None,
    periods: Annotated[int | None, typer.Option(min=2, help="Periods kept after the transient.")] = None,
    sample_rate: Annotated[
        float | None, typer.Option(help="Of the recording, Hz: a multiple or integer fraction of the control rate.")
    ] = None,
    effect: EffectOption = [],  # noqa: B006
    sensor: SensorOption = "probe",
    seed: SeedOption = 0,
    data_format: Annotated[str, typer.Option("--format", help="npz, mat or csv.")] = "npz",
    out: Annotated[Path, typer.Option(help="Folder of the campaign to write.")] = Path("campaign"),
    json_file: JsonOption = None,
) -> None:
    """Record a simulated rig as a campaign folder, in the form that real recordings are read from."""
    from maglev_workbench.commands.simulate import command as command_simulate

    command_simulate.run(
        rig,
        {"kp": kp, "ki": ki, "kd": kd},
        protocol,
        command_simulate.Recorded(tuple(excite), kind, fundamental, periods, sample_rate),
        effect,
        sensor,
        seed,
        data_format,
        out,
        json_file,
    )


@app.command(epilog="Example: maglev runup --speeds 0:14000:500 --gains tilt.kd=6 --out my-runup")
@friendly
def runup(
    rotor: Annotated[str, typer.Option(help="Preset (pump) or a rotor TOML.")] = "pump",
    speeds: Annotated[str, typer.Option(help="lo:hi:step in rpm, or one speed.")] = "0:14000:500",
    kp: Annotated[float | None, typer.Option(help="A/m, of both controllers (default: the rotor's).")] = None,
    ki: Annotated[float | None, typer.Option(help="A/(m s), of both controllers.")] = None,
    kd: Annotated[float | None, typer.Option(help="A s/m, of both controllers.")] = None,
    gains: Annotated[
        list[str], typer.Option(help="One gain of one controller, e.g. translation.kp=9000; repeat.")
    ] = [],  # noqa: B006
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: Annotated[Path | None, typer.Option(help="Folder of the page.")] = None,
    json_file: JsonOption = None,
    picture: Annotated[Path | None, typer.Option(help="Also draw the response to this .png, .svg or .pdf.")] = None,
) -> None:
    """Run a levitated rotor up: how far it moves at each speed, what coils and motor take, touchdowns and margins."""
    from maglev_workbench.commands.runup import command as command_runup

    command_runup.run(rotor, speeds, {"kp": kp, "ki": ki, "kd": kd}, gains, seed, threads, out, json_file, picture)


@app.command(epilog="Example: maglev bench --compare old.json --json new.json")
@friendly
def bench(
    out: Annotated[Path, typer.Option(help="HTML page to write.")] = Path("bench.html"),
    compare: Annotated[Path | None, typer.Option(help="What --json wrote in an earlier run: compare with it.")] = None,
    json_file: JsonOption = None,
) -> None:
    """Speed and memory of simulator and estimators, beside references measured in the same run; about a minute."""
    from maglev_workbench.commands.bench import command as speed

    speed.run(out, json_file, compare)


@app.command(epilog="Example: maglev reproduce pedestal axial --out reproduced --json reproduced.json")
@friendly
def reproduce(
    item: Annotated[
        list[str] | None, typer.Argument(metavar="ITEM", help="Experiments by name, e.g. pedestal (default: all).")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the page.")] = Path("reproduce"),
    docs: Annotated[Path | None, typer.Option(help="Also write the tables as markdown to this file.")] = None,
    seed: SeedOption = 0,
    json_file: JsonOption = None,
) -> None:
    """Run the dissertation's experiments anew: its figures, ours, the difference and what explains it."""
    from maglev_workbench.commands.reproduce import command as command_reproduce

    command_reproduce.run(item or (), out, docs, json_file, seed)


@app.command(epilog="Example: maglev effects")
@friendly
def effects() -> None:
    """List the effects a simulated rig can have, with units, bounds and sources."""
    from maglev_workbench.commands.simulate import command as command_simulate

    command_simulate.list_effects()


if __name__ == "__main__":
    app()
