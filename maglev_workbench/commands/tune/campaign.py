"""`maglev tune --campaign`: proposes the next experiment on a real rig, or to stop."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from maglev_env.recordings.campaign_file import SCHEMA, campaign_tables
from maglev_workbench.options import require_folder

if TYPE_CHECKING:
    from maglev_env.recordings.campaign import Campaign
    from maglev_env.rig.rig import Rig

# Findings that `recorded_sets` judges itself: the gains have failed, or the recording is left out.
FAILURES = ("rail", "lost levitation", "off centre", "stuck reading", "clearance")
MEANT = (
    "campaign",
    "budget",
    "tuned",
    "goal",
    "seed",
    "out",
    "json_file",
)  # options for a real rig


def run(
    source: Path,
    budget: int,
    tuned: Sequence[str],
    seed: int,
    out: Path | None,
    json_file: Path | None,
    named: Sequence[str] = (),
    goal: str | None = None,
) -> None:
    """Propose the next recording, or say why to stop; the options are those of `maglev tune`.

    Args:
        named: names of all options on the command line.

    Raises:
        ValueError: An option has no meaning with a campaign, the campaign has no rig, or the recordings are not usable.
    """
    if extra := [name for name in named if name not in MEANT]:
        words = {"json_file": "json", "tuned": "tune"}
        those = ", ".join(f"--{words.get(name, name)}" for name in extra)
        raise ValueError(
            f"{those}: not with --campaign, which takes rig and recordings from its folder and proposes one experiment "
            "at a time; it goes with --budget, --tune, --goal, --seed, --out and --json"
        )
    folder, rig, campaign = _read(source)
    target = out or folder / "tune"
    require_folder(target)
    # What is asked for is right: now the imports that take longer.
    from maglev_env.recordings.files import write_text_atomic
    from maglev_env.recordings.left_out import left_out_data
    from maglev_env.task.gain_box import parse_tuned
    from maglev_workbench.commands.tune.campaign_report import campaign_json, campaign_page, campaign_tables
    from maglev_workbench.commands.tune.next_recording import commented, excitation_words, summary, toml_block
    from maglev_workbench.console import console, marked, write_json
    from maglev_workbench.page import write_page
    from maglev_workbench.warned import warned
    from tuning.campaign.disagreement import disagreement
    from tuning.campaign.next_step import next_step
    from tuning.campaign.recorded_sets import recorded_sets

    names, bounds = parse_tuned(tuned)
    warnings = warned(campaign, FAILURES) if campaign else []
    used, sets = recorded_sets(campaign) if campaign and rig.axes == 1 else (None, [])
    left_out = used.left_out if used else ()
    advice = next_step(
        rig, sets, names, budget, seed, goal, (lambda: disagreement(campaign, seed)) if campaign else None, bounds
    )
    target.mkdir(parents=True, exist_ok=True)
    block = toml_block(advice, campaign)
    made_by = {
        "campaign": str(folder), "budget": budget, "tuned": advice.task.box.names,
        "goal": advice.task.rig.target.goal, "seed": seed, "version": version("maglev-workbench"),
    }  # fmt: skip
    data = campaign_json(advice, made_by) | {"warnings": warnings, "left_out": left_out_data(left_out)}
    write_text_atomic(target / "next.toml", commented(advice, block))
    write_json(target / "tune.json", data)
    write_json(json_file, data)
    further = ["Left out: " + str(one) for one in left_out]
    html = campaign_page(advice, block, {k.capitalize(): str(v) for k, v in made_by.items()}, further)
    write_page(target / "tune.html", html, [target / "tune.json", target / "next.toml"])
    for one in left_out:
        console.print(marked("  left out", str(one)), soft_wrap=True)
    for part in campaign_tables(advice):
        console.print(part)
    if not advice.stop:
        console.print(f"to paste into {folder / 'campaign.toml'} when it is recorded:\n")
        console.print(block, highlight=False, soft_wrap=True)
        console.print("excitation: " + "; ".join(excitation_words(advice)))
    console.print(summary(advice), style="bold")
    count = len(left_out)
    unused = f", and {count} left out, which {'does' if count == 1 else 'do'} not count" if count else ""
    console.print(
        f"{advice.recordings} of {budget} recordings{unused}\n"
        f"page  {target / 'tune.html'}\ntoml  {target / 'next.toml'}"
    )


def _read(source: Path) -> tuple[Path, Rig, Campaign | None]:
    """Folder, nominal rig and, if there are recordings, the campaign."""
    path = source / "campaign.toml" if source.is_dir() else source
    if not path.exists():
        raise FileNotFoundError(
            f'{path} does not exist; begin with a campaign.toml of two lines: schema = "{SCHEMA}" and '
            'rig = "..." (a preset or a rig TOML beside it)'
        )
    path, data = campaign_tables(path)
    from maglev_env.recordings.campaign import campaign_rig, load_campaign

    try:
        begun = bool(data.get("recording"))
        rig = None if begun else campaign_rig(path.parent, data.get("rig"), data.get("parameters", {}))[0]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    campaign = load_campaign(path) if begun else None
    rig = campaign.rig if campaign else rig
    if rig is None:
        raise ValueError(f"{path}: rig is missing; tuning needs the nominal rig: name a preset or a rig TOML")
    return path.parent, rig, campaign
