"""A ball whose recordings tell nothing by motion, but rest at several levels."""

import numpy as np
import pytest
from ball_bench import BALL, record, write_campaign

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import load_campaign
from maglev_env.recordings.left_out import NoneTells
from maglev_env.rig.rig_file import rig_from_toml
from maglev_workbench.commands.check.uses import uses
from maglev_workbench.commands.estimate.answer import estimate_answer
from maglev_workbench.commands.estimate.recordings import identify_campaign
from sim2real.recorded.records import read_records

SETTLED = 800  # samples after which the ball rests at its level
CHANNELS = ("displacement", "current")


@pytest.mark.slow
def test_levels_and_weight_tell_gain_and_stiffness_where_motion_tells_nothing(tmp_path):
    rig = rig_from_toml(BALL, "ball.toml")
    runs = {
        f"level{i}": {name: v[SETTLED:] for name, v in record(rig, 2.0, i, reference=np.full(2000, level),
                                                             noise=(1e-6, 5e-3), gain=1.2).items() if name in CHANNELS}
        for i, level in enumerate((-8e-4, -4e-4, 0.0, 4e-4, 8e-4))
    }  # fmt: skip
    folder = write_campaign(tmp_path, BALL, "", runs, CHANNELS)
    path = folder / "campaign.toml"
    text = path.read_text().replace("controller = \n", "")
    path.write_text(text)
    with pytest.raises(NoneTells, match="tells anything"):
        identify_campaign(load_campaign(folder), False, None, None, iter)
    for channel, sure in (("displacement", 1e-5), ("current", 2e-3)):
        text = text.replace(f'{{ from = "{channel}" }}', f'{{ from = "{channel}", offset_tolerance = {sure} }}')
    path.write_text(text)
    campaign = load_campaign(folder)
    with pytest.raises(NoneTells):
        read_records(campaign)
    found = identify_campaign(campaign, False, None, None, iter).pooled
    gain, stiffness = linearise(force_law(rig))
    # A fifth more force for a current carries the weight with a smaller one: 2 m g / I grows by its root.
    for c, true in zip(found.coefficients, (gain * np.sqrt(1.2), stiffness), strict=True):
        assert abs(c.value - true) < 2.5 * c.se and c.se < 0.03 * abs(true)
    said = estimate_answer([], found)
    assert said.startswith("At rest, by means and weight: actuator gain") and "of its motion nothing is told" in said
    assert any(note.startswith("motion is not used") for note in found.notes)
    use = uses(campaign, campaign.recordings[0])[0]
    assert use.verdict == "with care" and use.reason.startswith("by means and weight alone")
