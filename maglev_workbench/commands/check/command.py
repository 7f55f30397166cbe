"""`maglev check`: every recording of a campaign judged before anything is identified from it."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, friendly, require_campaign, require_file

app = typer.Typer()


@app.command(epilog="Example: maglev check my-rig")
@friendly
def check(
    campaign: Annotated[Path, typer.Argument(help="Campaign folder, or one data file.")],
    rate: Annotated[float | None, typer.Option(help="One file: sample rate, Hz, if the file does not give it.")] = None,
    out: Annotated[Path | None, typer.Option(help="HTML page (default: beside the campaign or file).")] = None,
    json_file: JsonOption = None,
) -> None:
    """Check what a campaign is good for, by each command's own rules: alarms, noise, transients, lines, channels."""
    require_campaign(campaign)
    from maglev_env.recordings.campaign import load_campaign
    from maglev_env.recordings.files import is_data_file

    # What is wrong with it is told before the imports that take longer.
    stated = None if is_data_file(campaign) else load_campaign(campaign)
    if stated is not None and rate is not None:
        raise ValueError("--rate is for one file; campaign.toml states the sample_rate of every recording")
    from importlib.metadata import version

    from maglev_env.loop.axes import AXES
    from maglev_env.recordings.alarms.alarm import alarms_of
    from maglev_env.recordings.formats.json_data import plain
    from maglev_env.recordings.guess.verified import guessed_campaign
    from maglev_env.recordings.longest_stretch import without_gaps
    from maglev_env.recordings.quality import recording_quality
    from maglev_env.recordings.recording import read_recording
    from maglev_env.recordings.signals import recorded_signals
    from maglev_env.recordings.spectra import axis_signals
    from maglev_env.redundancy.rules import as_data, examine, refusals
    from maglev_env.rig.rig import axis_rig
    from maglev_workbench.commands.check.report import (
        aperiodic_table,
        is_of,
        problem_data,
        quality_tables,
        said_once,
        spoiled,
        uses_json,
        uses_sections,
        uses_table,
    )
    from maglev_workbench.commands.check.uses import check_answer, uses
    from maglev_workbench.console import console, marked, write_json
    from maglev_workbench.page import write_page
    from maglev_workbench.warned import refusing, shown

    said: list[object] = []
    notes: list[tuple[str, str]] = []
    guessed = ()
    if stated is None:
        loaded, guess = guessed_campaign(campaign, rate)
        page = out or campaign.with_name(f"{campaign.stem}-check.html")
        guessed = guess.guesses
        said += [f"guess: {one.what}: {one.reason}" for one in guessed]
    else:
        loaded = stated
        page = out or loaded.folder / "check.html"
    require_file(page, "--out")
    findings = examine(loaded)
    warnings = as_data(findings)
    found, datasets, used, alarmed = [], [], [], 0
    for spec in loaded.recordings:
        dataset = read_recording(loaded, spec, alarmed=True)
        alarms = alarms_of(dataset)
        alarmed += bool(alarms)
        refused = next((f.message for f in refusals(findings) if is_of(f.recording, spec.name)), "")
        used.append((spec.name, uses(loaded, spec, alarms, refused)))
        whole, cut = without_gaps(loaded, spec, dataset)
        if cut is not dataset:
            said.append(f"{spec.name}: levels and noise are those of the longest stretch, {whole.start} .. "
                        f"{whole.start + (whole.samples or 0)}")  # fmt: skip
        signals = recorded_signals(loaded, whole, cut, excited=False)
        for axis in range(signals.axes):
            own = axis_signals(signals, axis)
            name = spec.name if signals.axes == 1 else f"{spec.name}, {AXES[axis]}"
            if not own.excitations and any(e.kind != "none" for e in spec.excitations):
                said.append(f"{name}: nothing is excited along this axis")
                continue
            rig = loaded.rig if loaded.rig is None or own.axis is None else axis_rig(loaded.rig, own.axis)
            quality = spoiled(recording_quality(own, rig, alarms=alarms), (spec.name, name), warnings)
            found.append((name, quality))
            said += quality_tables(name, quality)
            said += [marked("  !", problem) for problem in quality.problems]
            warnings += [problem_data(name, problem) for problem in quality.problems]
        notes += [(spec.name, note) for note in signals.assumed]
        datasets.append((spec.name, dataset))
    named = [f.recording for f in refusing(findings)]
    blocking = [spec.name for spec in loaded.recordings if any(is_of(name, spec.name) for name in named)]
    answer = check_answer(used, alarmed, blocking)
    console.print(answer, style="bold")
    shown(findings)
    console.print(uses_table(used))
    if still := [(name, quality) for name, quality in found if not quality.periods]:
        console.print(aperiodic_table(still))
    for part in said:
        console.print(part)
    for note in said_once(notes, len(used)):
        console.print(f"  note: {note}", soft_wrap=True)
    from maglev_workbench.record_page import record_page  # here because it takes long to import

    html = record_page(f"Check of {loaded.folder.resolve().name}", datasets, answer, uses_sections(used))
    write_page(page, html, [json_file])
    console.print(f"page  {page}")
    write_json(
        json_file,
        {
            "schema": "maglev-check/1",
            "version": version("maglev-workbench"),
            "answer": answer,
            "warnings": warnings,
            "guesses": plain(guessed),
            "notes": [{"recording": file, "note": text} for file, text in notes],
            "commands": [{"file": file, **{u.command: uses_json(u) for u in of}} for file, of in used],
            "recordings": [{"file": f, **plain(q)} for f, q in found],
        },
    )
