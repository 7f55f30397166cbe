"""`maglev diagnose`: a campaign to what makes simulator and rig differ, and the corrected rig."""

import os
from pathlib import Path

from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.json_data import plain
from maglev_workbench.commands.diagnose.report import diagnose_page, terminal
from maglev_workbench.console import console, progress_bar, require_folder, write_json
from maglev_workbench.page import write_page
from sim2real.corrected import write_corrected
from sim2real.diagnosis import diagnose


def run(source: Path, seed: int, out: Path | None, json_file: Path | None) -> None:
    """See `maglev_workbench.cli.diagnose`."""
    campaign = load_campaign(source)
    folder = out or campaign.folder / "diagnosis"
    require_folder(json_file, "--json")
    _make(folder)
    with progress_bar() as bar:
        task = bar.add_task("diagnose", total=None)

        def advance(step: str) -> None:
            bar.update(task, description=f"diagnose: {step}", advance=1)

        found = diagnose(campaign, seed, advance)
    report = plain(found.to_json())
    files = {"rig ": folder / "corrected.toml", "data": folder / "diagnosis.json", "page": folder / "diagnosis.html"}
    write_corrected(found, files["rig "])
    write_json(files["data"], report)
    write_page(files["page"], diagnose_page(found))
    write_json(json_file, report)
    for part in terminal(found):
        console.print(part)
    for kind, path in files.items():
        console.print(f"{kind}  {path}", soft_wrap=True)


def _make(folder: Path) -> None:
    """The folder of the results, before any work; ValueError when it is a file or cannot be written to."""
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; name a folder")
    if not folder.parent.is_dir():
        raise ValueError(f"--out {folder}: the folder {folder.parent} does not exist; create it or choose another")
    folder.mkdir(exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise ValueError(f"--out {folder} cannot be written to; choose another")
