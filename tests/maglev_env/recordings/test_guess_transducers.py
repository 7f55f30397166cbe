"""Forces in volts, and stated sensitivities."""

import h5py
import numpy as np
import pytest
from scipy.signal import lfilter

from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.words import meaning

N = 4000
RNG = np.random.default_rng(3)
MOVED, PUSHED = lfilter([0.02], [1, -0.98], RNG.standard_normal((2, N)))


@pytest.mark.parametrize(
    "name", ["Load cell", "LoadCell", "load_cell_1", "Hammer", "Impulse hammer", "Force transducer"]
)
def test_what_reads_a_force_is_one(name):
    assert meaning(name, "V").channel == "force" == meaning(name, "").channel


@pytest.mark.parametrize(("unit", "scale"), [("V/N", 10.0), ("mV/N", 1e4), ("V/kN", 1e4), ("V/m", None), ("", None)])
def test_a_stated_sensitivity_is_the_scale(tmp_path, unit, scale):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs["fs"] = 1000.0
        for name, label, values in (("ch0", "Eddy probe", MOVED), ("ch2", "Load cell", PUSHED)):
            file[f"daq/{name}"] = values
            node = file[f"daq/{name}"]
            node.attrs["label"], node.attrs["unit"] = label, "V"
        node.attrs["sensitivity"], node.attrs["sensitivity_unit"] = 0.1, unit
    found = guess_recording(tmp_path / "a.h5").channels["force"]
    assert found.column == "daq.ch2"
    assert found.scale == (pytest.approx(scale) if scale else 1.0)
    assert ("scale in N per V" in found.ask) == (scale is None)
