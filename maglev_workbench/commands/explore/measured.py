"""What the page of a rig or campaign begins with: default gains filled in, and recordings identified."""

from dataclasses import replace

from maglev_env.design.defaults import with_defaults
from maglev_env.recordings.campaign import Campaign
from maglev_workbench.commands.estimate.recordings import identify_campaign
from maglev_workbench.commands.explore.asked import Asked
from maglev_workbench.console import progress_bar
from maglev_workbench.explore.server import Explored, Measured
from maglev_workbench.warned import warned


def explored(asked: Asked) -> Explored:
    """The rig with its gains, those of the first recording with a controller where there is one, and the recordings.

    Raises:
        ValueError: The rig has no gains that hold it, or a recording cannot be used; the message says why.
    """
    rig = with_defaults(asked.rig)
    assert rig.gains is not None  # filled in
    if asked.campaign is None:
        return Explored(rig, rig.gains, asked.source, rig.name)
    driven = tuple(r for r in asked.campaign.recordings if any(e.kind != "none" for e in r.excitations))
    campaign = replace(asked.campaign, recordings=driven)
    warned(campaign)
    first = next((r.gains for r in driven if r.gains is not None), rig.gains)
    title = f"{rig.name}, campaign {campaign.folder.resolve().name}"
    return Explored(rig, first, asked.source, title, _measured(campaign))


def _measured(campaign: Campaign) -> tuple[Measured, ...]:
    with progress_bar() as bar:  # bands side by side, as of the simulated experiment
        found = identify_campaign(
            campaign, campaign.mass, False, None, 0.0,
            lambda recordings: bar.track(list(recordings), description="identify"),
        )  # fmt: skip
    gains = {r.file: r.gains for r in campaign.recordings}
    rows = []
    for name, one in found.axes:
        file = name.removesuffix(", x").removesuffix(", y")
        rows.append(Measured(name, int(name.endswith(", y")), gains[file], one))
    return tuple(rows)
