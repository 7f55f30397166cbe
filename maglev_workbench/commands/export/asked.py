"""What the user names: a rig, or a campaign whose recordings are identified."""

from collections.abc import Sequence
from pathlib import Path

from maglev_env.loop.effect import parse_effects
from maglev_workbench.commands.explore.asked import is_campaign
from maglev_workbench.commands.export.models import Model, identified_models, rig_models


def models_of(source: str, effects: Sequence[str]) -> list[Model]:
    """The models of a rig, or of a campaign's recordings.

    Args:
        source: Preset, rig TOML, or campaign folder or its campaign.toml.
        effects: As on the command line, beyond those of the rig.

    Raises:
        ValueError: It is neither, or nothing of it can be given as a linear model; the message says why.
        OSError: It cannot be read.
    """
    added = parse_effects(effects)
    if not is_campaign(source):
        from maglev_env.design.defaults import with_defaults
        from maglev_env.rig.rig_file import load_rig

        return rig_models(with_defaults(load_rig(source)), added)
    if added:
        raise ValueError("--effect goes with a rig; a campaign's recordings have the effects of the rig they are from")
    from maglev_env.recordings.campaign import load_campaign
    from maglev_workbench.console import progress_bar
    from maglev_workbench.warned import LEAVING_OUT, warned

    campaign = load_campaign(source)
    warned(campaign, LEAVING_OUT)
    from maglev_workbench.commands.estimate.recordings import identify_campaign

    with progress_bar() as bar:
        found = identify_campaign(campaign, False, None, None, lambda specs: bar.track(specs, description="identify"))
    if not found.axes:
        raise ValueError(f"{Path(source)}: no recording has an excitation whose response could be given")
    return identified_models(found.axes)
