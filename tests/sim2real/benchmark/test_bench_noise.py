"""What a nonlinearity adds to a recording without a period, beside one whose periods show the noise of the bench."""

import numpy as np
import pytest

from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import write_campaign
from sim2real.compared.bench_noise import NO_BOUND, bench_noise
from sim2real.compared.problem import assemble
from sim2real.compared.simulated import Point
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records


def left(tmp_path, effects):
    """Reduced chi-square of the nominal rig in the steps, without and with the bound, and whether this is reached."""
    rng = np.random.default_rng(4)
    rig = draw_rig("stand", rng)
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    truth = Truth(rig, {}, effects(rig))
    drives = [draw_drive(shape, rig, False, level, rng) for shape, level in (("multisine", 0.01), ("steps", 0.05))]
    recorded = [Recording(drive.shape, "fit", controller, drive) for drive in drives]
    made = [(r, True, simulate(truth, r, seed)) for seed, r in enumerate(recorded)]
    write_campaign(tmp_path / "c", rig, "no_force", made)
    _, records = read_records(tmp_path / "c")
    found = []
    for bench in (NO_BOUND, bench_noise(records)):
        problem = assemble(records, near=Point({}, {}), bench=bench)
        (part,) = (p for p in problem.parts if isinstance(p.record, OpenRecord))
        residual = (problem.data - problem.simulate([Point({}, {})])[0])[part.place]
        found.append(float(np.mean(abs(residual) ** 2) / 2))
    return *found, bench.reached(part.record, part.opened.outputs, part.noise)


def test_noise_alone_stays_below_the_bound(tmp_path):
    free, bounded, reached = left(tmp_path, lambda rig: {})
    assert free == bounded == pytest.approx(1.0, abs=0.1) and not reached


def test_a_seal_that_is_touched_by_the_steps_alone_is_no_noise(tmp_path):
    free, bounded, reached = left(
        tmp_path,
        lambda rig: {
            at.SEAL_STIFFNESS: 5 * rig.parameters["mass"] * rig.bandwidth**2,
            at.SEAL: 0.02 * rig.parameters["gap"],
        },
    )
    assert free < 1.3 and bounded > 10 and reached
