"""Iron of a single magnet that saturates is found beside another effect, too."""

import pytest
from ball_bench import BALL
from campaigns import write

from maglev_env.experiment import Experiment
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from sim2real.diagnosis import diagnose
from sim2real.search import attribute

KNOWN = """
[noise]
displacement = 1e-6
current = 1e-3
[tolerance]
mass = 0.005
actuator_gain = 0.02
negative_stiffness = 0.02
probe_gain = 0.01
"""
RIVALS = ("sensor_gain", "actuator_gain", "delay", "saturation", "eccentricity", "force_law")


@pytest.mark.slow
def test_a_knee_is_sought_beside_a_delay_where_the_knee_alone_explains_little(tmp_path, monkeypatch):
    """Alone it ends where nothing leads to the knee beside the delay: it has a form on this rig, and no plain size."""
    monkeypatch.setattr(attribute, "single_effects", lambda rig: RIVALS)
    (path := tmp_path / "ball.toml").write_text(BALL + KNOWN)
    rig = load_rig(path)
    knee = {"current": 1.3 * rig.scales.rest, "sharpness": 3.0, "distance_share": 1.0}
    effects, odd = {"delay": {"time": 1e-3}, "saturation": knee}, tuple(range(1, 40, 2))
    rows = [
        (name, role, Experiment(
            rig, rig.gains, (Excitation("sphs", "current", 2.0, odd, peak),), periods=4, effects=effects, seed=seed
        ))
        for seed, (name, role, peak) in enumerate((("a", "fit", 0.12), ("b", "fit", 0.06), ("c", "holdout", 0.1)))
    ]  # fmt: skip
    found = diagnose(write(tmp_path / "campaign", rows, str(path)))
    assert found.verdict == "explained" and {*found.cause} == {"delay", "saturation"}
    fit = found.attribution.of("delay", "saturation").fit
    at = fit.hypothesis.point(fit.u).effects
    assert at["delay"]["time"] == pytest.approx(1e-3, rel=0.02)
    assert at["saturation"]["current"] == pytest.approx(knee["current"], rel=0.05)
