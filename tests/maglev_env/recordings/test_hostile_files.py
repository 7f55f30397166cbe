"""Small files that would take hours or all the memory are read in part, or refused with a sentence."""

import json
import tracemalloc

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from maglev_env.recordings import contents as contents_of
from maglev_env.recordings.contents import contents
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.formats import file_formats
from maglev_env.recordings.formats.labelled import labels_of
from maglev_env.recordings.guess.units import header_unit

T = np.arange(100) * 1e-3


def test_groups_that_hold_themselves_are_not_followed_into_themselves(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        group = file.create_group("a")
        for k in range(8):  # 8^8 paths
            group[f"b{k}"] = group
        group["inner/x"] = np.sin(T)
        file["t"] = T
    assert set(contents(read_columns(tmp_path / "run.h5")).columns) == {"t", "a.inner.x"}


def test_of_too_many_paths_the_first_are_read_and_the_rest_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(contents_of, "_MOST_READ", 50)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["a/t"] = T
        file["b"] = T
        file["c/d/x"] = T
        for k in range(8):  # each group is reached by many paths, and none holds itself
            file[f"c/e{k}"] = file["c/d"]
        for k in range(8):
            file[f"k{k}"] = file["c"]
    found = contents(read_columns(tmp_path / "run.h5"))
    assert {"a.t", "b"} <= set(found.columns) and len(found.columns) < 50
    assert [said for said in found.unused if "more than 50" in said]


@pytest.mark.parametrize("shape", [(10_000,), (50, 2, 100)])  # the second are no columns, and are read to see it
def test_the_limit_holds_for_all_columns_together(tmp_path, monkeypatch, shape):
    monkeypatch.setattr(file_formats, "MAX_DATA_BYTES", 100_000)
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for k in range(20):
            file.create_dataset(f"x{k}", shape, "f8", chunks=shape)  # nothing is allocated
    with pytest.raises(ValueError, match=r"run\.h5: the file, unpacked, .*limit of 100000"):
        contents(read_columns(tmp_path / "run.h5"))


def test_the_limit_holds_for_all_unpacked_variables_together(tmp_path, monkeypatch):
    monkeypatch.setattr(file_formats, "MAX_DATA_BYTES", 100_000)
    savemat(tmp_path / "run.mat", {f"x{k}": np.zeros(5_000) for k in range(20)}, do_compression=True)
    found = contents(read_columns(tmp_path / "run.mat"))
    assert list(found.columns) == ["x0", "x1"]
    assert sum("limit of 100000" in said for said in found.unused) == 18


def test_objects_with_a_name_for_each_sample_take_no_square_of_memory(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps({"t": T.tolist(), "data": [{f"a{k}": k} for k in range(1500)]}))
    tracemalloc.start()
    try:
        assert "data.a0" in contents(read_columns(tmp_path / "run.json")).columns
        assert tracemalloc.get_traced_memory()[1] < 15e6  # 18 MB were it a list of pointers for each name alone
    finally:
        tracemalloc.stop()


def test_long_cells_take_no_square_of_time():
    """A quadratic search would take hours."""
    line = "a" + " " * 1_000_000 + "b"
    assert labels_of([line] * 3) is None
    assert header_unit(line) == (line, None)
    assert header_unit("a [" + " " * 1_000_000) == ("a [", None)
