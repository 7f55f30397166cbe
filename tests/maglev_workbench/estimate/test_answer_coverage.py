"""The interval of the first sentence of `maglev estimate` covers where an error is common to all bands.

Rigs are simulated, each of another true mass and noise, and estimated with the mass that their file states.
"""

from dataclasses import replace

import numpy as np
import pytest

from maglev_env.evaluation import identification
from maglev_env.evaluation.identification import identify
from maglev_env.evaluation.known_mass import within_tolerance_of_mass
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.gains import NO_CONTROLLER
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.excitation import Excitation
from maglev_env.rig.rig_file import load_rig
from maglev_workbench.commands.estimate.answer import over_bands, trusted

RIGS = 40
FEWEST, MOST = 35, 40  # of 40 that cover by chance 95 %: fewer than 35 would be one case in 30


def answers(name, at, tolerance, size, lines):
    """Stiffness over the trusted bands of each simulated rig, and how much of a tolerance its mass is off."""
    rig, rng = load_rig(name), np.random.default_rng(5)
    off = rng.standard_normal(RIGS)
    drive = (Excitation("sphs", at, 1.0, lines, size),)
    experiments = [
        Experiment(replace(rig, mass=rig.mass * (1 + tolerance * z)), rig.gains or NO_CONTROLLER, drive, 4, 1, seed=i)
        for i, z in enumerate(off)
    ]
    found = []
    for e, record in zip(experiments, simulate_records(experiments), strict=True):
        dataset = simulated_recording(e, record)
        channels = {str(n): dataset[n].values for n in dataset.data_vars}
        signals = RecordedSignals(channels, rig.control_rate, e.excitations, rig.control_rate, e.gains)
        sure = trusted(within_tolerance_of_mass(identify(signals, rig, rig.mass), tolerance).bands)
        assert len(sure) > 5
        found.append(over_bands(sure, "stiffness"))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "at", "tolerance", "size", "lines"),
    [
        ("hmb_free", "current", 0.005, 0.1, tuple(range(1, 250, 2))),  # the mass sets the scale
        ("hmb_free", "current", 0.0, 0.02, tuple(range(1, 250, 2))),  # noise alone makes the gain's error
        ("pedestal", "force", 0.02, 1.7, tuple(range(1, 200))),  # the mass moves the upper bands most
    ],
)
def test_the_answer_covers_where_all_bands_have_an_error_in_common(name, at, tolerance, size, lines, monkeypatch):
    # Margins and their intervals would take longer than all the rest, and the answer has nothing of them.
    monkeypatch.setattr(identification, "stability_of", lambda *_: (None, ""))
    rig = load_rig(name)
    truth = rig.negative_stiffness if at == "current" else rig.support_stiffness
    found = answers(name, at, tolerance, size, lines)
    assert not any(one.varies for one in found)
    inside = sum(one.interval[0] <= truth <= one.interval[1] for one in found)
    assert FEWEST <= inside <= MOST
    # The intervals are hardly wider than the answers scatter: 3 instead of 2, as the gain's error is in the bands, too.
    spread = np.std([one.value for one in found])
    half = np.median([(one.interval[1] - one.interval[0]) / 2 for one in found])
    assert half < 3.3 * spread
