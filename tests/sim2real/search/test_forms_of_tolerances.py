"""Gain and stiffness of a pair that are off by the bias current and the gap, where the rotor moves far."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns import repeated

from maglev_env.experiment import Experiment
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import force
from maglev_env.rig.drawn import tangent
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig import with_parameters
from maglev_env.rig.rig_file import rig_from_toml
from maglev_env.rig.rig_toml import rig_toml
from sim2real.compared.point import Point, experiment_at
from sim2real.compared.problem import assemble
from sim2real.compared.tolerance_forms import form_tolerances
from sim2real.search import attribute
from sim2real.search.candidates import NO_GAP
from sim2real.search.fitting import begin, iterate
from sim2real.search.hypotheses import Hypothesis

PAIR = """\
schema = "maglev-rig/1"
name = "pair"
magnet = "electromagnet_pair"
[parameters]
mass = 0.5
gap = 4e-4
bias_current = 1.0
actuator_gain = 35.0
negative_stiffness = -87.5e3
amplifier_time_constant = 1.5e-4
probe_gain = 2e4
control_rate = 8000.0
[gains]
kp = 7500.0
ki = 1e5
kd = 8.0
td = 1.5e-4
[noise]
displacement = 2e-7
current = 1e-3
force = 5e-3
[tolerance]
mass = 0.005
actuator_gain = 0.03
negative_stiffness = 0.05
"""
RIG = rig_from_toml(PAIR, "this test")

BY_GEOMETRY = replace(RIG, actuator_gain=None, negative_stiffness=None, turns=150, pole_area=2e-4)
BALL = rig_from_toml(
    PAIR.replace("electromagnet_pair", "electromagnet")
    .replace("gap = 4e-4", "gap = 8e-3\ngap_offset = 2e-3")
    .replace("actuator_gain = 35.0\nnegative_stiffness = -87.5e3\n", "support_damping = 0.05\n"),
    "this test",
)


def problem(folder, size, nominal=RIG):
    """Two recordings of magnets whose gain is 3 % more and whose stiffness is 5 % less than stated, by the bias current
    (the stiffness over the gain is the bias current over the gap)."""
    more, less = 1.03, 0.95
    own = {"bias_current": less / more, "actuator_gain": more, "negative_stiffness": less}
    rig = with_parameters(RIG, {name: getattr(RIG, name) * factor for name, factor in own.items()})
    drives = (Excitation("multisine", "force", 4.0, tuple(range(1, 32, 2)), size),)
    (folder / "pair.toml").write_text(rig_toml(nominal))
    experiments = [Experiment(rig, RIG.gains, drives, 6, 2, seed=seed) for seed in range(2)]
    return assemble(repeated(folder / "c", experiments, str(folder / "pair.toml")))


@pytest.mark.slow
def test_where_it_shows_what_they_are_made_of_is_calibrated(tmp_path, monkeypatch):
    monkeypatch.setattr(attribute, "single_effects", lambda rig: ("force_law",))
    found = problem(tmp_path, 9.0)
    assert max(abs(part.record.series["displacement"]).max() for part in found.parts) > 0.2 * RIG.gap
    plain = Hypothesis((), dict(RIG.tolerance), scales=RIG.scales)
    (fit,) = begin([plain], [np.zeros(plain.size)], found.data, found.simulate)
    iterate([fit], found.data, found.simulate, 10)
    expected, scatter = 2.0 * found.data.size, np.sqrt(4.0 * found.data.size)
    attributed = attribute.attribute(found)
    calibration = attributed.calibration.fit
    assert {"bias_current", "gap"} <= calibration.hypothesis.tolerances.keys()
    assert calibration.cost < min(expected + 3 * scatter, fit.cost - NO_GAP)
    (law,) = (c.fit for c in attributed.candidates if c.effects == ("force_law",))
    assert law.cost > calibration.cost - NO_GAP


def test_small_motions_and_what_is_stated_as_exact_stay(tmp_path):
    """There the linear nuisances do."""
    found = problem(tmp_path, 0.2)
    assert form_tolerances(found.nuisances, RIG) == {}
    both = {"bias_current": 0.5 * np.hypot(0.03, 0.05), "gap": np.hypot(0.03, 0.05)}
    loud = replace(found.nuisances, columns=1e9 * found.nuisances.columns)
    assert form_tolerances(loud, RIG) == pytest.approx(both)
    exact = replace(RIG, tolerance={**RIG.tolerance, "gap": 0.0})
    assert form_tolerances(loud, exact).keys() == {"bias_current"}
    assert form_tolerances(loud, replace(RIG, tolerance={"mass": 0.005})) == {}
    assert form_tolerances(loud, BY_GEOMETRY) == pytest.approx(both)
    assert form_tolerances(loud, BALL) == {}  # of another falloff at this force constant, another current carries it


def test_what_a_geometry_gives_stays_while_the_pull_bends():
    """Gain and stiffness at rest are known to their own tolerance, whatever they are made of."""
    rig, changes = BY_GEOMETRY, {"bias_current": 0.06, "gap": -0.05}
    moved = experiment_at(Experiment(rig, RIG.gains, ()), Point({}, changes)).rig
    assert tangent(moved) == pytest.approx(tangent(rig), rel=1e-9)
    far = 0.3 * rig.gap
    pulls = [force(force_law(r), far, 0.1) - force(force_law(r), -far, 0.1) for r in (moved, rig)]
    assert abs(pulls[0] / pulls[1] - 1) > 5e-3
    stated = replace(rig, tolerance=rig.tolerance | dict.fromkeys(changes, 0.01))
    own = experiment_at(Experiment(stated, RIG.gains, ()), Point({}, changes)).rig
    assert tangent(own) != pytest.approx(tangent(rig), rel=1e-2)  # its own tolerance is that of the geometry
