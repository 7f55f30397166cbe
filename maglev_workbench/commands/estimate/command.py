"""`maglev estimate`: stiffness, damping and margins from a campaign, or from one file for a first look."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, friendly, given, require_campaign, require_choice, require_file

METHODS = ("ls", "ml", "both")
# A file that is described by one of these is read by them alone; without any, it is guessed what it holds.
ONE_FILE = {"rate", "fundamental", "lines", "recorded", "force", "displacement", "start", "samples", "intersample"}
app = typer.Typer()


@app.command(epilog="Example: maglev estimate my-rig --method both --json estimate.json")
@friendly
def estimate(
    context: typer.Context,
    source: Annotated[Path, typer.Argument(help="Campaign folder, or one .mat, .csv, .npz or .h5 file.")],
    method: Annotated[str, typer.Option(help="ls (least squares), ml (maximum likelihood) or both.")] = "both",
    estimate_mass: Annotated[bool, typer.Option("--estimate-mass", help="Fit the moving mass too.")] = False,
    band_width: Annotated[float | None, typer.Option(help="Width of the estimation bands, Hz.")] = None,
    band_overlap: Annotated[float | None, typer.Option(help="Overlap of neighbouring bands, Hz.")] = None,
    rate: Annotated[float | None, typer.Option(help="One file: sample rate, Hz.")] = None,
    fundamental: Annotated[float, typer.Option(help="One file: fundamental of the excitation, Hz.")] = 1.0,
    lines: Annotated[str, typer.Option(help="One file: excited harmonics, first:last[:step].")] = "1:250",
    recorded: Annotated[bool, typer.Option("--recorded", help="One file: the force is not periodic.")] = False,
    force: Annotated[str, typer.Option(help="One file: column of the force, name[*scale].")] = "force",
    displacement: Annotated[
        str, typer.Option(help="One file: column of the displacement, name[*scale].")
    ] = "displacement",
    mass: Annotated[float | None, typer.Option(help="Moving mass, kg (overrides the campaign's).")] = None,
    start: Annotated[int, typer.Option(min=0, help="One file: first sample used.")] = 0,
    samples: Annotated[
        int | None, typer.Option(min=1, help="One file: number of samples (default: to the end).")
    ] = None,
    intersample: Annotated[
        str | None,
        typer.Option(help="One file: the force between samples, bl (continuous) or zoh (held by a converter)."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="HTML page (default: beside the source).")] = None,
    json_file: JsonOption = None,
) -> None:
    """Estimate stiffness, damping, margins and distortion from recordings, with confidence intervals.

    A recording takes a few seconds, one of two axes some 15; fitting a rig to recordings without a period may take
    minutes.
    """
    require_choice(method, METHODS, "--method")
    if mass is not None and not mass > 0:
        raise ValueError(f"--mass {mass} kg must be positive")
    if mass is not None and estimate_mass:
        raise ValueError("give --mass or --estimate-mass, not both")
    if not source.exists():
        raise FileNotFoundError(f"{source} does not exist; name a campaign folder or a data file")
    if band_width is not None and not band_width > 0:
        raise ValueError(f"--band-width {band_width} Hz must be positive")
    require_campaign(source)
    from maglev_env.recordings.campaign import load_campaign, with_mass

    # What is wrong with it is told before the imports that take longer.
    is_campaign = source.is_dir() or source.suffix == ".toml"
    of_one_file = [f"--{name}" for name in given(context) if name in ONE_FILE]
    if is_campaign and of_one_file:
        raise ValueError(f"{', '.join(of_one_file)} for one file only; the campaign {source} states its own")
    stated = load_campaign(source) if is_campaign else None
    from html import escape as html

    from maglev_env.recordings.guess.verified import guessed_campaign
    from maglev_env.recordings.left_out import left_out_data
    from maglev_workbench.commands.estimate.one_file import OneFile, one_file_campaign
    from maglev_workbench.console import console, marked, progress_bar, write_json
    from maglev_workbench.page import write_page
    from maglev_workbench.warned import LEAVING_OUT, shown, warned

    if stated is not None:
        campaign = stated
        page = out or campaign.folder / "estimate.html"
    elif not of_one_file:
        campaign, guess = guessed_campaign(source, mass=mass)
        page = out or source.with_suffix(".html")
        for found in guess.guesses:
            console.print(f"guess: {found.what}: {found.reason}")
    else:
        one = OneFile(rate, fundamental, lines, recorded, force, displacement, start, samples, intersample)
        campaign = one_file_campaign(source, mass, one)
        page = out or source.with_suffix(".html")
    require_file(page, "--out")

    if mass is not None:
        campaign = with_mass(campaign, mass)
    warnings = warned(replace(campaign, mass=None) if estimate_mass else campaign, LEAVING_OUT)
    from maglev_env.redundancy.result import doubtful, without_contradicted_margins
    from maglev_workbench.commands.estimate.answer import estimate_answer
    from maglev_workbench.commands.estimate.gain_report import gain_table
    from maglev_workbench.commands.estimate.planar_report import planar_json, planar_sections, planar_table
    from maglev_workbench.commands.estimate.pooled_report import (
        apart_lines,
        each_table,
        pooled_json,
        pooled_lines,
        pooled_sections,
        pooled_table,
    )
    from maglev_workbench.commands.estimate.recordings import identify_campaign
    from maglev_workbench.commands.estimate.report import estimate_json, estimate_page, estimate_table
    from maglev_workbench.commands.estimate.terminal import say

    with progress_bar() as bar:
        found = identify_campaign(
            campaign, estimate_mass, band_width, band_overlap, lambda s: bar.track(s, description="estimate")
        )
    warnings += shown(finding for file, one in found.axes for finding in doubtful(file, one))
    axes = [(file, without_contradicted_margins(file, one, warnings)) for file, one in found.axes]
    found = replace(found, axes=axes)
    rig = f"{campaign.rig.name}, {campaign.mass:g} kg" if campaign.rig else "not given"
    unused = {one.recording for one in found.left_out}
    recordings = ", ".join(spec.name for spec in campaign.recordings if spec.name not in unused)
    made_by = {"Recordings": recordings, "Rig": rig, "Campaign": str(campaign.folder)}
    answer = estimate_answer(found.axes, found.pooled, found.linear, campaign.rig)
    more = [planar_sections(*both) for both in found.planar]
    apart = apart_lines(found.axes, found.pooled) if found.pooled else []
    more += [pooled_sections(found.pooled, apart)] if found.pooled else []
    if found.left_out:
        more.append([("Left out", "<ul>" + "".join(f"<li>{html(str(one))}</li>" for one in found.left_out) + "</ul>")])
    if found.notes:
        more.append([("Notes", "<ul>" + "".join(f"<li>{html(note)}</li>" for note in found.notes) + "</ul>")])
    write_page(page, estimate_page(found.axes, made_by, more, answer), [json_file])
    report = estimate_json(found.axes, method) | {"answer": answer}
    planar = {"planar": [planar_json(*both) for both in found.planar]} if found.planar else {}
    together = {"pooled": pooled_json(found.pooled) | {"responses_apart": apart}} if found.pooled else {}
    left_out = {"left_out": left_out_data(found.left_out), "notes": list(found.notes)}
    write_json(json_file, report | {"warnings": warnings} | left_out | planar | together)
    console.print(answer, style="bold")
    for one in found.left_out:
        console.print(marked("  left out", str(one)), soft_wrap=True)
    for note in found.notes:
        console.print(f"  note: {note}", soft_wrap=True)
    for file, one_axis in found.axes:
        console.print(f"\n{file}", style="bold")
        console.print(estimate_table(one_axis, method))
        say(one_axis, found.pooled is not None)
    for files, both in found.planar:
        console.print(f"\nx and y together: {files}", style="bold")
        console.print(planar_table(both))
        for note in both.notes:
            console.print(f"  note: {note}")
    if found.pooled is not None:
        console.print(
            f"\n{campaign.rig.name} in "
            f"{len(campaign.recordings) - len(unused) - len(found.pooled.held_out)} recording(s)",
            style="bold",
        )
        console.print(pooled_table(found.pooled))
        if found.pooled.of_each:
            console.print(each_table(found.pooled))
        if found.pooled.gain is not None:
            console.print(gain_table(found.pooled.gain))
        for line in (*apart, *pooled_lines(found.pooled)):
            console.print(marked("  !", line))
    console.print(f"page  {page}")
