"""A sine pushes a mass on a spring, and the load cell is noisy: elsewhere than at the sine, it reads noise alone."""

import numpy as np
from pushed_campaign import write_campaign

from estimation.lines.line_windows import WIDTH
from sim2real.compared.point import Point
from sim2real.compared.problem import assemble
from sim2real.judgement.dispersion import _left
from sim2real.recorded.records import read_records

RATE, SAMPLES, FREQUENCY, FORCE, NOISE = 600.0, 5000, 40.03, 2e-3, 2e-4
MASS, STIFFNESS, DAMPING = 5.3e-3, 1000.0, 0.23
RIG = f"""\
schema = "maglev-rig/1"
name = "springs"
magnet = "none"

[parameters]
mass = {MASS}
support_stiffness = {STIFFNESS}
support_damping = {DAMPING}
adc_bits = 0
dac_bits = 0
control_rate = {RATE}

[noise]
force = {NOISE}
"""


def record_of(folder, seed):
    """By the stationary solution; the rotor does not feel the load cell's noise."""
    rng, turned = np.random.default_rng(seed), 2 * np.pi * FREQUENCY
    wave = FORCE * np.exp(1j * (turned * np.arange(SAMPLES) / RATE + rng.uniform(0, 2 * np.pi)))
    moved = wave / (STIFFNESS - MASS * turned**2 + 1j * turned * DAMPING)
    columns = {
        "force": wave.real + NOISE * rng.standard_normal(SAMPLES),
        "displacement": moved.real + 2e-8 * rng.standard_normal(SAMPLES),
    }
    _, (record,) = read_records(write_campaign(folder, RIG, RATE, columns))
    return record


def test_what_only_noise_of_the_load_cell_drives_is_no_evidence(tmp_path):
    """The simulation follows that noise, so all that it makes of it stays in the residual, along what drives it."""
    found = []
    for seed in range(6):
        (folder := tmp_path / str(seed)).mkdir()
        record = record_of(folder, seed)
        driven = np.abs(record.drives).max(axis=(0, 2)) > 0
        at = int((FREQUENCY * SAMPLES / RATE - record.windows.first) // WIDTH)
        assert driven[at] and not np.delete(driven, slice(at - 2, at + 3)).any()
        problem = assemble([record])
        (part,) = problem.parts
        (predicted,) = problem.simulate([Point({}, {})])
        left = _left(part, (problem.data - predicted)[part.place])
        found.append(left.value / left.freedom)
    assert np.mean(found) < 1.5
