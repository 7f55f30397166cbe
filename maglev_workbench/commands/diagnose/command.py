"""`maglev diagnose`: finds why simulator and rig differ from a campaign, and writes the corrected rig."""

from pathlib import Path
from typing import Annotated

import typer

from maglev_workbench.options import JsonOption, SeedOption, friendly, require_campaign, require_folder

app = typer.Typer()


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
    """Find out why simulator and rig differ: where, by which effect (or an unknown one), and what to measure next.

    It takes one to two minutes, or some minutes for recordings without a period.
    """
    require_campaign(campaign)
    from maglev_env.recordings.campaign import load_campaign

    loaded = load_campaign(campaign)
    from importlib.metadata import version

    from maglev_workbench.console import console, progress_bar, write_json
    from maglev_workbench.page import write_page
    from maglev_workbench.warned import LEAVING_OUT, warned

    folder = out or loaded.folder / "diagnosis"
    require_folder(folder)
    if not folder.parent.is_dir():
        raise ValueError(f"--out {folder}: the folder {folder.parent} does not exist; create it or choose another")

    warnings = warned(loaded, LEAVING_OUT) if loaded.rig else []  # without a rig the diagnosis says what is missing
    from maglev_env.recordings.formats.json_data import plain
    from maglev_workbench.commands.diagnose.minded import minded
    from maglev_workbench.commands.diagnose.report import diagnose_page, terminal
    from sim2real import diagnosis
    from sim2real.corrected import write_corrected
    from sim2real.report import sentence

    folder.mkdir(exist_ok=True)
    with progress_bar() as bar:
        task = bar.add_task("diagnose", total=None)

        def advance(step: str) -> None:
            bar.update(task, description=f"diagnose: {step}", advance=1)

        found = diagnosis.diagnose(loaded, seed, advance)
    data = plain(found.to_json())
    made_by = {"version": version("maglev-workbench"), "answer": sentence(found), "warnings": warnings}
    report = {"schema": data["schema"]} | made_by | data | {"mind": minded(found, warnings)}
    files = {"rig ": folder / "corrected.toml", "data": folder / "diagnosis.json", "page": folder / "diagnosis.html"}
    write_corrected(found, files["rig "])
    write_json(files["data"], report)
    write_page(files["page"], diagnose_page(found, warnings), [files["data"], files["rig "]])
    write_json(json_file, report)
    for part in terminal(found, warnings):
        console.print(part)
    for kind, path in files.items():
        console.print(f"{kind}  {path}", soft_wrap=True)
