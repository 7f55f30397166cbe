"""The `maglev selfsense` commands: the air gap from the coil current."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, RigOption, SeedOption, ThreadsOption, friendly

app = typer.Typer(name="selfsense", help="The air gap from the coil current alone.", no_args_is_help=True)

OutOption = Annotated[Path | None, typer.Option(help="HTML page (default: selfsense-<command>.html here).")]
FrequencyOption = Annotated[float, typer.Option(help="Of the gap's motion, Hz.")]
AmplitudeOption = Annotated[float, typer.Option(help="Of the gap's motion, m.")]
SwingOption = Annotated[float, typer.Option(help="Of the duty cycle (0 to 1) about one half, at the same frequency.")]
RateOption = Annotated[float | None, typer.Option(help="One file: sample rate, Hz; required.")]
SourceArgument = Annotated[Path | None, typer.Argument(help="Campaign folder or .csv table (default: simulate).")]


@app.command(epilog="Example: maglev selfsense demodulate --duty-swing 0.1 --frequency 100")
@friendly
def demodulate(
    rig: RigOption = "hmb_free",
    frequency: FrequencyOption = 100.0,
    amplitude: AmplitudeOption = 50e-6,
    duty_swing: SwingOption = 0.1,
    seed: SeedOption = 0,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """Switching-noise demodulation beside the parameter estimator, with constant and with varying duty."""
    from maglev_workbench.commands.selfsense.demodulate import command as demodulate

    demodulate.run(rig, frequency, amplitude, duty_swing, seed, out, json_file)


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
    from maglev_workbench.commands.selfsense.record import command as record

    motion = record.Motion(frequency, amplitude, duty_swing, seconds)
    record.run(rig, motion, seed, data_format, out, json_file)


@app.command(epilog="Example: maglev selfsense estimate scope.mat --rate 1e6 --current i*0.1 --voltage u")
@friendly
def estimate(
    source: Annotated[Path, typer.Argument(help="Campaign folder, or one .mat, .csv, .npz or .h5 file.")],
    rig: Annotated[
        str | None, typer.Option(help="Preset or rig TOML with the coil (default: the campaign's, else hmb_free).")
    ] = None,
    rate: RateOption = None,
    current: Annotated[str, typer.Option(help="One file: column of the coil current, name[*scale] to A.")] = "current",
    voltage: Annotated[
        str, typer.Option(help="One file: column of the switching voltage, name[*scale] to V.")
    ] = "voltage",
    point_voltage: Annotated[
        bool, typer.Option("--point-voltage", help="The voltage was read at instants, not as a mean between samples.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="HTML page (default: selfsense-estimate.html here); the gap is .npz beside it.")
    ] = None,
    json_file: JsonOption = None,
) -> None:
    """The gap from a recorded coil current and switching voltage; invalid stretches are flagged, never guessed."""
    from maglev_workbench.commands.selfsense.estimate import command as estimate

    one = estimate.OneFile(rate, current, voltage)
    estimate.run(source, rig, one, point_voltage, out, json_file)


@app.command(epilog="Example: maglev simulate --sensor self_sensing --out sensed && maglev selfsense calibrate sensed")
@friendly
def calibrate(
    source: SourceArgument = None,
    rig: Annotated[
        str | None, typer.Option(help="Preset or rig TOML to simulate without SOURCE (default: hmb_free).")
    ] = None,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """Static (gap steps: gain, linearity, range) and dynamic (SPHS: frequency response, delay) calibration.

    SOURCE is a campaign with displacement and gap_estimate, or a .csv of displacement and output for the static one.
    """
    from maglev_workbench.commands.selfsense.calibrate import command as calibrate

    calibrate.run(source, rig, out, json_file)


@app.command(epilog="Example: maglev selfsense design --lag 20")
@friendly
def design(
    rig: RigOption = "hmb_free",
    lag: Annotated[
        float | None, typer.Option(help="Largest lag of the estimate at --at, degrees (default: the rig's).")
    ] = None,
    at: Annotated[float | None, typer.Option(help="Frequency of that lag, Hz (default: the rig's).")] = None,
    droop: Annotated[float, typer.Option(help="Largest droop of the estimate below --at, dB.")] = 1.0,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """PI gains of the estimator: lag against phase margin, with the price in noise."""
    from maglev_workbench.commands.selfsense.design import command as design

    design.run(rig, lag, at, droop, out, json_file)


@app.command("rate-limit", epilog="Example: maglev selfsense rate-limit")
@friendly
def rate_limit(
    rig: RigOption = "hmb_free",
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """Lowest stable sampling rate of the estimator over its PI gains, with a published figure of 165 kHz on it."""
    from maglev_workbench.commands.selfsense.rate_limit import command as rate_limit

    rate_limit.run(rig, out, json_file)


@app.command(epilog="Example: maglev selfsense noise")
@friendly
def noise(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """Error of the estimated gap against converter bits and current noise, beside the Cramer-Rao bound."""
    from maglev_workbench.commands.selfsense.noise import command as noise

    noise.run(rig, seed, out, json_file)


@app.command(epilog="Example: maglev selfsense robustness")
@friendly
def robustness(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """What a wrong supply voltage, resistance, pole area or core does to the gap and to the loop's margin."""
    from maglev_workbench.commands.selfsense.robustness import command as robustness

    robustness.run(rig, seed, threads, out, json_file)


@app.command(epilog="Example: maglev selfsense rivals")
@friendly
def rivals(
    rig: RigOption = "hmb_free",
    seed: SeedOption = 0,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """State-space observer and extended Kalman filter on the averaged current, beside the parameter estimator."""
    from maglev_workbench.commands.selfsense.rivals import command as rivals

    rivals.run(rig, seed, out, json_file)


@app.command(epilog="Example: maglev selfsense levitate --rig hmb_free --points 12")
@friendly
def levitate(
    rig: RigOption = "hmb_free",
    points: Annotated[int, typer.Option(min=2, help="Of kp and of kd in the map over the rig's bounds.")] = 16,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    out: OutOption = None,
    json_file: JsonOption = None,
) -> None:
    """The same SPHS experiment with the probe and with self-sensing, side by side, and over gains what that costs."""
    from maglev_workbench.commands.selfsense.levitate import command as levitate

    levitate.run(rig, points, seed, threads, out, json_file)
