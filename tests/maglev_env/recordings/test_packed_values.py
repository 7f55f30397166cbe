"""HDF5 and netCDF: packed values, and those that stand for none (CF conventions, 8.1 and 2.5)."""

import h5py
import numpy as np
import pytest

from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.recording import guess_recording
from maglev_env.recordings.guess.verified import guessed_campaign
from maglev_env.recordings.recording import read_recording

N = 400
T = np.arange(N) * 1e-3
GAP = 0.4 + 0.03 * np.sin(40 * T)  # mm


def _written(path, gap, **attributes):
    with h5py.File(path, "w") as file:
        file["time"], file["gap"] = T, gap
        file["current"] = 1 + 0.1 * np.cos(40 * T)
        for name, unit in (("time", "s"), ("gap", "mm"), ("current", "A")):
            file[name].attrs["units"] = unit
        file["gap"].attrs.update(attributes)
    return path


@pytest.mark.parametrize("as_array", [False, True])
def test_packed_values_are_unpacked_by_their_attributes(tmp_path, as_array):
    factor, offset = (np.array([1e-5]), np.array([0.4])) if as_array else (1e-5, 0.4)
    raw = np.round((GAP - 0.4) / 1e-5).astype("i2")
    path = _written(tmp_path / "run.nc", raw, scale_factor=factor, add_offset=offset)
    np.testing.assert_allclose(read_columns(path).column("gap"), GAP, atol=6e-6)
    found = guess_recording(path)
    gap = found.channels["displacement"]
    assert (gap.column, gap.scale, gap.ask) == ("gap", 1e-3, "")
    assert [said for said in found.notes if "scale_factor" in said and "gap" in said]


@pytest.mark.parametrize("key", ["_FillValue", "missing_value"])
@pytest.mark.parametrize("packed", [False, True])
def test_what_stands_for_no_value_is_missing_and_never_clipped(tmp_path, key, packed):
    at = np.array([100, 101, 250])
    if packed:  # the fill value is one of the packed values
        gap, attributes = np.round(GAP / 1e-5).astype("i4"), {"scale_factor": 1e-5, key: np.int32(-9999)}
        gap[at] = -9999
    else:
        gap, attributes = GAP.copy(), {key: np.array([-9999.0, -8888.0]) if key == "missing_value" else -9999.0}
        gap[at] = -9999.0
        gap[at[0]] = -8888.0 if key == "missing_value" else -9999.0
    path = _written(tmp_path / "run.nc", gap, **attributes)
    read = read_columns(path).column("gap")
    assert np.array_equal(np.flatnonzero(np.isnan(read)), at)
    np.testing.assert_allclose(np.delete(read, at), np.delete(GAP, at), atol=6e-6)
    campaign, guess = guessed_campaign(path)
    assert not [said for said in guess.notes if "is clipped" in said]
    moved = read_recording(campaign, campaign.recordings[0], alarmed=True)["displacement"].values
    assert np.ptp(moved) < 0.07e-3


def test_matlabs_files_have_no_packing_and_plain_integers_stay(tmp_path):
    raw = np.arange(N, dtype="i2")
    path = _written(tmp_path / "run.h5", raw, scale_factor="see the manual")
    np.testing.assert_array_equal(read_columns(path).column("gap"), raw)
    matlab = _written(tmp_path / "run.mat", raw, scale_factor=2.0)
    np.testing.assert_array_equal(read_columns(matlab).column("gap"), raw)
