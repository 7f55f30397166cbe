"""What the page of a rig or campaign begins with: default gains filled in, and recordings identified."""

from dataclasses import replace
from pathlib import Path

from maglev_env.design.defaults import with_defaults
from maglev_env.design.goals import with_goal
from maglev_env.loop.gains import Controllers, with_gains
from maglev_env.recordings.campaign import Campaign
from maglev_workbench.commands.estimate.recordings import identify_campaign
from maglev_workbench.commands.explore.asked import Asked
from maglev_workbench.console import progress_bar
from maglev_workbench.explore.server import Explored, Measured
from maglev_workbench.explore.sweep_map import SweepMap, read_sweep
from maglev_workbench.warned import warned


def explored(asked: Asked, goal: str | None = None, sweep: Path | None = None) -> Explored:
    """The rig with its gains, those of the first recording with a controller where there is one, and the recordings.

    Args:
        asked: rig and campaign.
        goal: as of `with_goal`.
        sweep: folder or file of a sweep of the rig, with whose best gains the page begins.

    Raises:
        ValueError: The rig has no gains that hold it, or a recording, the goal or the sweep cannot be used; the message
            says why.
        OSError: A file cannot be read.
    """
    rig = with_goal(with_defaults(asked.rig), goal)
    nominal = with_defaults(asked.campaign.rig) if asked.campaign and asked.campaign.rig else rig
    assert rig.gains is not None  # filled in

    def begun(controllers: Controllers) -> tuple[Controllers, SweepMap | None]:
        swept = read_sweep(sweep, (rig, nominal), controllers) if sweep else None
        best = swept.gains_of(swept.best) if swept and swept.best is not None else {}
        return with_gains(controllers, **best), swept

    if asked.campaign is None:
        controllers, swept = begun(rig.gains)
        return Explored(rig, controllers, asked.source, rig.name, swept=swept)
    driven = tuple(r for r in asked.campaign.recordings if any(e.kind != "none" for e in r.excitations))
    campaign = replace(asked.campaign, recordings=driven)
    warned(campaign)
    controllers, swept = begun(next((r.gains for r in driven if r.gains is not None), rig.gains))
    title = f"{rig.name}, campaign {campaign.folder.resolve().name}"
    diagnosed = rig.effects if asked.diagnosed else {}
    return Explored(rig, controllers, asked.source, title, _measured(campaign), swept, diagnosed)


def _measured(campaign: Campaign) -> tuple[Measured, ...]:
    with progress_bar() as bar:  # bands side by side, as of the simulated experiment
        found = identify_campaign(
            campaign, False, None, 0.0,
            lambda recordings: bar.track(list(recordings), description="identify"),
        )  # fmt: skip
    gains = {r.name: r.gains for r in campaign.recordings}
    rows = []
    for name, one in found.axes:
        file = name.removesuffix(", x").removesuffix(", y")
        rows.append(Measured(name, int(name.endswith(", y")), gains[file], one))
    return tuple(rows)
