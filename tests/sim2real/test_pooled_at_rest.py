"""Means at rest of recordings whose motion is not simulated."""

import numpy as np
import pytest
from ball_bench import BALL, record, write_campaign

from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.pooled import AT_REST, pooled
from sim2real.recorded.records import read_records

CONTROLLER = """{ form = "pid", kp = 200.0, ki = 1500.0, kd = 3.5, td = 2e-3, derivative_on = "measurement",
setpoint_filter = 0.05, limit = [-0.77, 1.23], anti_windup = "tracking" }""".replace("\n", " ")


@pytest.mark.slow
def test_a_recording_tells_its_means_at_rest_although_its_motion_is_left_out(tmp_path):
    rig = rig_from_toml(BALL, "ball.toml")
    seconds = 6.0
    n = int(seconds * rig.control_rate)
    levels = np.repeat([0.0, 4e-4, -4e-4], -(-n // 3))[:n]
    noise = 0.02 * np.random.default_rng(1).normal(size=n)
    runs = {
        "levels": record(rig, seconds, 1, reference=levels, gain=1.2),
        "noise": record(rig, 2.0, 2, injection=noise[: int(2.0 * rig.control_rate)], gain=1.2),
    }
    folder = write_campaign(tmp_path, BALL, CONTROLLER, runs)
    text = (folder / "campaign.toml").read_text()
    for channel, sure in (("displacement", 1e-5), ("current", 2e-3)):
        told = f'{channel} = {{ from = "{channel}", offset_tolerance = {sure}, scale_tolerance = 0.002 }}'
        text = text.replace(f'{channel} = {{ from = "{channel}" }}', told)
    (folder / "campaign.toml").write_text(text)
    _, records = read_records(load_campaign(folder))
    moving = [r for r in records if r.name == "noise.npz"]
    told = {c.name: c for c in pooled(moving, resting=records).of_each[AT_REST]}
    nominal, _ = linearise(force_law(rig))
    # A fifth more force for a current carries the weight with a smaller one: 2 m g / I grows by its root.
    assert told["actuator_gain"].value == pytest.approx(nominal * np.sqrt(1.2), rel=0.03)
    assert told["negative_stiffness"].bounded
    assert AT_REST not in pooled(moving, resting=[]).of_each
