"""What a nonlinearity adds to a recording without a period, beside one whose periods show the noise of the bench."""

from dataclasses import replace

import numpy as np
import pytest
from bench_loop import Bench
from bench_loop import write_campaign as write_bench

from estimation.lines.line_windows import KEPT
from maglev_env.rig.rig import Noise
from sim2real.blind.benchmark import at
from sim2real.blind.benchmark.drives import draw_drive
from sim2real.blind.benchmark.rigs import draw_rig
from sim2real.blind.benchmark.simulate import Controller, Recording, Truth, simulate
from sim2real.blind.benchmark.write import Recorded, write_campaign
from sim2real.compared.bench_noise import NO_BOUND, bench_noise
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.compared.stated_noise import left_alone, louder_in_words, louder_than_stated, scattered
from sim2real.diagnosis import diagnose
from sim2real.recorded.open_record import OpenRecord
from sim2real.recorded.records import read_records
from sim2real.report import sentence
from sim2real.search import attribute


def recorded(tmp_path, effects, drives=(("multisine", 0.01, "current"), ("steps", 0.05, "reference")), noisy=1.0):
    """Recordings of a stand, and the noise that its rig states; that of the force is `noisy` times the usual one."""
    rng = np.random.default_rng(4)
    rig = draw_rig("stand", rng)
    rig = replace(rig, noise={**rig.noise, "force": noisy * rig.noise["force"]})
    controller = Controller(rig.pid, "pid", 1 / rig.parameters["control_rate"])
    truth = Truth(rig, {}, effects(rig))
    drawn = [drive_at(place, shape, rig, level, rng) for shape, level, place in drives]
    rows = [Recording(d.shape, "fit", controller, d) for d in drawn]
    made = [Recorded(r, True, simulate(truth, r, i)) for i, r in enumerate(rows)]
    write_campaign(tmp_path / "c", rig, "full", made)
    return read_records(tmp_path / "c")[1]


def drive_at(place, *drawn):
    """The first drive that is drawn at a place."""
    shape, rig, level, rng = drawn
    return next(d for d in (draw_drive(shape, rig, True, level, rng) for _ in range(50)) if d.at == place)


def left(tmp_path, effects):
    """Reduced chi-square of the nominal rig in the steps, without and with the bound, and whether this is reached."""
    records = recorded(tmp_path, effects)
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


def test_a_stop_that_is_touched_by_the_steps_alone_is_no_noise(tmp_path):
    free, bounded, reached = left(
        tmp_path,
        lambda rig: {
            at.STOP_STIFFNESS: 5 * rig.parameters["mass"] * rig.bandwidth**2,
            at.STOP: 0.02 * rig.parameters["gap"],
            at.STOP_ABOVE: 1.0,
        },
    )
    assert free < 1.3 and bounded > 10 and reached


def test_the_noise_in_the_reading_of_a_force_is_that_of_what_it_drives(tmp_path):
    """It is part of the drive, which explains it away in the window with the fewest lines, the lowest one."""
    drives = (("multisine", 0.01, "current"), ("noise", 0.01, "force"))
    records = recorded(tmp_path, lambda rig: {}, drives, noisy=10.0)
    problem = assemble(records, near=Point({}, {}), bench=bench_noise(records))
    (part,) = (p for p in problem.parts if isinstance(p.record, OpenRecord))
    residual = (problem.data - problem.simulate([Point({}, {})])[0])[part.place]
    lowest = problem.frequency[part.place] < 1.5 * problem.frequency[part.place].min()
    assert lowest.sum() > 15 and np.mean(abs(residual[lowest]) ** 2) / 2 < 1.6


@pytest.mark.parametrize(("times", "said", "gap"), [(1.0, False, False), (2.5, True, False), (4.0, True, True)])
def test_what_is_louder_than_stated_is_said_where_nothing_repeats(tmp_path, times, said, gap):
    """Up to three times as loud is said and no more."""
    _, records = read_records(write_bench(tmp_path, Bench(noise=times * 5e-7), {"noise": "fit"}, 1.0, 0))
    (part,) = assemble(records).parts
    noisy = [(part.record, part.opened.outputs, part.noise)]
    loud = louder_than_stated(noisy)
    assert loud == ({"noise.npz": pytest.approx(times, rel=0.2)} if said else {})
    assert scattered(noisy) == (pytest.approx(2 * (1 - times**-2) * part.noise[0].size, rel=0.1) if gap else 0.0)
    assert [words[:27] for words in louder_in_words(loud)] == (["noise.npz: what is left is "] if said else [])
    silent = replace(part.record, nominal=replace(part.record.nominal, noise=Noise()))
    assert louder_than_stated([(silent, part.opened.outputs, part.noise)]) == {}


@pytest.mark.parametrize("everywhere", [True, False])
def test_what_is_left_in_one_window_does_not_make_those_around_look_loud(tmp_path, everywhere):
    """A fit takes noise that is pooled over windows, of which one with a peak makes those around it loud."""
    _, records = read_records(write_bench(tmp_path, Bench(noise=5e-7), {"noise": "fit"}, 1.0, 0))
    problem = assemble(records)
    (part,) = problem.parts
    window = np.arange(part.noise.shape[-1]) // KEPT
    times = np.broadcast_to(np.where(everywhere | (window == 10), 4.0, 1.0), part.noise.shape)[..., part.used].ravel()
    pooled = replace(problem, parts=(replace(part, noise=4.0 * part.noise),))
    left = (problem.data - problem.simulate([Point({}, {})])[0]) * times / 4.0
    said = {"noise.npz": pytest.approx(4.0, rel=0.2)} if everywhere else {}
    assert louder_than_stated(left_alone(pooled, left)) == said


@pytest.mark.slow
def test_noise_far_beyond_what_is_stated_is_a_gap_where_nothing_repeats(tmp_path, monkeypatch):
    """Its size is the only witness of an effect that scatters."""
    monkeypatch.setattr(attribute, "single_effects", lambda rig: ("delay", "mass", "friction", "soft_stop", "pickup"))
    times = 4.0
    found = diagnose(write_bench(tmp_path, Bench(noise=times * 5e-7), {"noise": "fit", "steps": "holdout"}, 1.0, 0))
    assert found.verdict == "unexplained"
    assert max(found.loud.values()) == pytest.approx(times, rel=0.15)
    assert f"{max(found.loud.values()):.2g} times as loud as the noise that the rig states" in sentence(found)
