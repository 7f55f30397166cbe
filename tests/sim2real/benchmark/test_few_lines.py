"""A campaign that the generator drew and a diagnosis could not read: fewer lines than its windows are wide."""

import numpy as np

from sim2real.blind.benchmark.drives import PERIODIC, Drive
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.compared.drift import drift_of
from sim2real.compared.problem import assemble
from sim2real.recorded.records import read_records
from sim2real.search.fitting import begin
from sim2real.search.hypotheses import Hypothesis


def test_a_multisine_of_nine_lines_is_read_and_has_no_drift(tmp_path):
    rig = draw_rig("ball", np.random.default_rng(3))
    rate = rig.parameters["control_rate"]
    lines, t = tuple(range(1, 19, 2)), np.arange(round(0.5 * rate)) / round(0.5 * rate)
    wave = sum(np.cos(2 * np.pi * n * t + n * n) for n in lines)
    wave = np.tile(1e-3 * rig.parameters["gap"] * wave, PERIODIC)
    drive = Drive("multisine", "reference", wave, lines, rate / t.size)
    recording = Recording("one", "fit", Controller(rig.pid, "pid", 1 / rate), drive)
    write_campaign(tmp_path / "c", rig, "displacement", [Recorded(recording, True, simulate(Truth(rig), recording, 5))])
    _, records = read_records(tmp_path / "c")
    problem = assemble(records)
    h = Hypothesis((), {})
    (nominal,) = begin([h], [np.zeros(h.size)], problem.data, problem.simulate)
    assert not drift_of(problem, h.point(nominal.u)).shown
    rest = nominal.residual
    assert 0.5 < np.vdot(rest, rest).real / (2 * problem.data.size) < 2.0
