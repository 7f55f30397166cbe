"""What a rig file leaves out is not known to be zero: poles of amplifier and probe, tolerances of time constants."""

import re
from dataclasses import replace

import numpy as np
import pytest
from ball_bench import BALL, record

from maglev_env.recordings.campaign import load_campaign
from maglev_env.rig.rig_file import load_rig, rig_from_toml
from maglev_workbench.commands.estimate.recordings import identify_campaign
from sim2real.search.hypotheses import REPLACED, USUAL, WIDER, Hypothesis, usual_tolerances

FREE = load_rig("hmb_free")
POLES = ("amplifier_time_constant", "sensor_time_constant")


@pytest.mark.slow
def test_poles_and_curved_laws_do_not_move_what_is_estimated_of_a_named_rig(tmp_path):
    # A ball that sweeps a sixth of its gap, whose amplifier (2 ms) and probe (0.6 ms) nobody described.
    rig = replace(rig_from_toml(BALL, "ball"), amplifier_time_constant=2e-3, sensor_time_constant=6e-4)
    t = np.arange(4000) / rig.control_rate
    reference = 0.8e-3 * np.sin(2 * np.pi * (0.5 * t + 2.4 * t**2))
    run = record(rig, 4.0, 1, reference=reference, noise=(4e-6, 2e-3))
    np.savez(tmp_path / "chirp.npz", reference=reference, **run)
    text = re.sub(rf"({'|'.join(POLES)}) = .*\n", "", BALL)
    (tmp_path / "rig.toml").write_text(text.replace("[gains]", "adc_bits = 0\ndac_bits = 0\n\n[gains]"))
    controller = re.search(r"\[gains\]\n(.*)", BALL, re.S)[1]
    controller = ", ".join(line.partition("#")[0].strip() for line in controller.strip().splitlines())
    (tmp_path / "campaign.toml").write_text(
        'schema = "maglev-campaign/1"\nrig = "rig.toml"\n[[recording]]\nfile = "chirp.npz"\nsample_rate = 1000.0\n'
        f'controller = {{ {controller} }}\nexcitation = {{ kind = "recorded", at = "reference" }}\n'
        "[recording.channels]\n"
        + "".join(f'{name} = {{ from = "{name}" }}\n' for name in ("reference", "displacement", "command", "current"))
    )
    campaign = load_campaign(tmp_path)
    found = identify_campaign(campaign, False, None, None, lambda specs: specs)
    assert found.pooled is not None
    # i = I + di, at the gap g: m g = K (I / g)^2, so df/di = 2 m g / I and df/dx = 2 m g / g.
    bias = rig.gap * np.sqrt(rig.mass * rig.gravity / (4e-7 * np.pi * rig.turns**2 * rig.pole_area / 4))
    true = {
        "actuator_gain": 2 * rig.mass * rig.gravity / bias,
        "negative_stiffness": -2 * rig.mass * rig.gravity / rig.gap,
    }
    told = {c.name: c for c in found.pooled.coefficients}
    assert set(told) >= {"actuator_gain", "negative_stiffness", "delay"} and not set(told) & set(REPLACED)
    for name, value in true.items():
        low, high = told[name].interval
        assert low < value < high and high - low < 0.2 * abs(value), name


def test_a_time_constant_without_tolerance_moves_beside_its_lag_alone():
    rig = replace(FREE, tolerance={"mass": 0.005})
    usual = usual_tolerances(rig)
    assert usual == dict.fromkeys(POLES, USUAL)
    assert usual_tolerances(replace(rig, tolerance=dict.fromkeys(POLES, 0.0))) == {}
    assert usual_tolerances(replace(rig, **dict.fromkeys(POLES, 0.0))) == {}
    plain = Hypothesis((), {"mass": 0.005}, usual=usual)
    assert plain.calibrated == ("mass",)
    lag = plain.instead("sensor_lag")
    assert lag.calibrated == ("mass", "sensor_time_constant") and lag.prior[-1] == pytest.approx(1 / WIDER**2)
    longer = np.zeros(lag.size)
    longer[-1] = 12.0
    assert lag.point(lag.bounded(longer)).changes["sensor_time_constant"] == pytest.approx(12 * USUAL)
    assert plain.instead("delay").calibrated == ("mass",)
