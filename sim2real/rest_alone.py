"""A rig whose motion tells nothing, by what its means say where it rests: levels and weight need no time base."""

from maglev_env.recordings.campaign import Campaign
from maglev_env.recordings.recording import read_recording
from sim2real.pooled import Pooled, at_rest, exact_mass_in_words
from sim2real.recorded.at_rest.static_evidence import drift_in_words, rests_of, static_of


def rest_alone(campaign: Campaign, why: str) -> Pooled | None:
    """Actuator gain and stiffness of a campaign that names its rig, by means and weight.

    Args:
        campaign: Its recordings.
        why: What keeps their motion from being used.

    Returns:
        The estimate; None where no magnet carries the weight alone, the campaign states no uncertainty of the offsets,
        or the rotor never rests.
    """
    rig = campaign.rig
    rests = [rests_of(rig, s, read_recording(campaign, s)) for s in campaign.recordings if s.role == "fit"]
    static = static_of(rig, rests)
    if static is None:
        return None
    notes = (f"motion is not used: {why}", exact_mass_in_words(rig), drift_in_words(static))
    return Pooled(at_rest(rig, static), 1.0, {}, {}, notes=tuple(filter(None, notes)), moving=False)
