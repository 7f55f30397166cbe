"""Magnets between the probes, whose curved force a rig along the probes does not have."""

import numpy as np
import pytest

from maglev_env.experiment import Experiment
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.rig.rig_file import rig_from_toml
from sim2real.compared.crossed import TURNED, turned_force
from sim2real.compared.problem import assemble
from sim2real.recorded.records import read_records

RIG = """schema = "maglev-rig/1"
name = "two pairs"
magnet = "electromagnet_pair"
axes = 2
[parameters]
mass = 1.0
gap = 0.5e-3
bias_current = 2.0
actuator_gain = 40.0
negative_stiffness = -4e4
"""


def test_a_cubic_pull_between_the_axes_is_half_of_its_own_and_the_rest_of_the_other():
    e = Experiment(rig_from_toml(RIG, "rig.toml"), NO_CONTROLLER, ())
    nothing, x, y = np.zeros((2, 1)), 2e-5, 1e-5
    # Without current a pair pulls by k x + 2 k x^3 / g^2 + ..., with the magnet's k = 4e4 N/m and the gap g.
    cubic = 2 * 4e4 / 0.5e-3**2
    (along, across), (both, _) = (turned_force(e, np.array([[x], [v]]), nothing).ravel() for v in (0.0, y))
    assert along == pytest.approx(-0.5 * cubic * x**3, rel=0.02)
    assert across == pytest.approx(0.0, abs=0.02 * abs(along))
    assert both - along == pytest.approx(1.5 * cubic * x * y**2, rel=0.02)


def test_it_is_a_nuisance_of_an_estimate_and_a_gap_of_a_diagnosis(tmp_path):
    """Otherwise a cross-coupling of some per cent would not be named."""
    rng = np.random.default_rng(0)
    names = [f"{kind}_{axis}" for kind in ("displacement", "command", "current") for axis in "xy"]
    np.savez(tmp_path / "hover.npz", **{name: 1e-6 * rng.standard_normal(8000) for name in names})
    text = ['schema = "maglev-campaign/1"', 'rig = "hmb_radial"', "[[recording]]", 'file = "hover.npz"', 'role = "fit"']
    text += ["sample_rate = 20000.0", "gains = { kp = 8000.0, ki = 2000.0, kd = 5.2, td = 1e-4, ti = 0.0318 }"]
    text += ['excitation = { kind = "none" }', "[recording.channels]"]
    text += [f'{name} = {{ from = "{name}" }}' for name in names]
    (tmp_path / "campaign.toml").write_text("\n".join(text))
    _, records = read_records(tmp_path)
    across = {TURNED, "gain across the axes", "gain around the axes", "stiffness across the axes"}
    diagnosed, estimated = assemble(records), assemble(records, for_estimate=True)
    assert not across.intersection(diagnosed.nuisances.names)
    assert across <= set(estimated.nuisances.names)
