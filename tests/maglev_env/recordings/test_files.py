import pickle
import struct
import zlib

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from maglev_env.recordings import files
from maglev_env.recordings.files import read_columns, write_csv, write_mat, write_npz, write_text_atomic
from maglev_env.recordings.formats import file_formats

WRITERS = {".npz": write_npz, ".mat": write_mat, ".csv": write_csv}
A, B = np.array([1.0, -2.5, 3e-9]), np.array([4.0, 5.0, 6.0])


@pytest.mark.parametrize("suffix", WRITERS)
@settings(max_examples=20, deadline=None)
@given(values=st.lists(st.floats(allow_nan=True, allow_infinity=True, width=64), min_size=1, max_size=30))
def test_written_columns_come_back_bit_for_bit(tmp_path_factory, suffix, values):
    path = tmp_path_factory.mktemp("x") / f"data{suffix}"
    columns = {"force": np.array(values), "displacement_x": np.arange(len(values)) / 3}
    WRITERS[suffix](path, columns)
    read = read_columns(path)
    assert set(read.names) == set(columns)
    for name, expected in columns.items():
        got = read.column(name)
        assert got.dtype == np.float64
        np.testing.assert_array_equal(got, expected)
        assert (np.signbit(got) == np.signbit(expected))[~np.isnan(expected)].all()
    assert [p.name for p in path.parent.iterdir()] == [path.name]  # no temporary file is left


def dspace_v5(path, compressed):
    y = np.empty((1, 2), dtype=[("Name", object), ("Data", object)])
    y[0, 0], y[0, 1] = ("y_left", A[None]), ("F", B[None].astype(np.float32))
    cells = np.empty((1, 2), dtype=object)
    cells[0, 0], cells[0, 1] = A, "text"
    variables = {"mb10": {"X": {"Data": A}, "Y": y}, "M": np.array([[1, 2], [3, 4], [5, 6]]), "C": cells}
    savemat(path, variables, do_compression=compressed)


def dspace_v73(path):
    """As MATLAB writes it: a user block, arrays transposed, struct arrays and cells as object references."""
    with h5py.File(path, "w", userblock_size=512) as file:
        refs = file.create_group("#refs#")
        for name, data in {"a": A[:, None], "b": B[:, None], "n": np.array([[102], [103]], np.uint16)}.items():
            refs[name] = data
        refs["n"].attrs["MATLAB_class"] = np.bytes_("char")

        def references(group, name, targets, cell=False):
            values = np.array([[refs[t].ref] for t in targets], dtype=h5py.ref_dtype)
            data = group.create_dataset(name, data=values, dtype=h5py.ref_dtype)
            if cell:
                data.attrs["MATLAB_class"] = np.bytes_("cell")

        struct = file.create_group("mb10")
        struct.create_group("X")["Data"] = A[:, None]
        array = struct.create_group("Y")
        references(array, "Data", "ab")
        references(array, "Name", "nn")
        references(file, "C", "an", cell=True)
        file["M"] = np.array([[1, 2], [3, 4], [5, 6]]).T
        file["E"] = np.array([0, 0], np.uint64)
        file["E"].attrs["MATLAB_empty"] = np.uint8(1)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


@pytest.fixture(params=["v5", "v5 compressed", "v7.3"])
def dspace(request, tmp_path):
    path = tmp_path / "run1.mat"
    if request.param == "v7.3":
        dspace_v73(path)
    else:
        dspace_v5(path, "compressed" in request.param)
    return path


def test_nested_dspace_expressions(dspace):
    columns = read_columns(dspace)
    for name, expected in {
        "mb10.Y[0].Data": A,
        "mb10.Y[1].Data": B,
        "mb10.X.Data": A,
        "mb10[0].X.Data": A,
        "C[0]": A,
        "M[1]": [2, 4, 6],
    }.items():
        np.testing.assert_array_equal(columns.column(name), expected)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mb1.Y[0].Data", ["there is no column 'mb1'", "did you mean 'mb10'", "Available:"]),
        ("mb10.Y[0].Dat", ["there is no field 'Dat'", "did you mean 'Data'", "Name"]),
        ("mb10.Y[2].Data", ["[2] is beyond its 2 elements"]),
        ("mb10.Y.Data", ["array of 2 elements has no field 'Data'", "[n]"]),
        ("mb10[1]", ["only [0] exists"]),
        ("mb10", ["is a struct", "X, Y"]),
        ("mb10.Y", ["array of 2 structs"]),
        ("mb10.X.Data.more", ["nothing below"]),
        ("M", ["shape (3, 2)", "[j]"]),
        ("M[2]", ["beyond its 2 columns"]),
        ("C[1]", ["text"]),
    ],
)
def test_bad_expressions_say_what_there_is(dspace, name, words):
    with pytest.raises(ValueError) as error:
        read_columns(dspace).column(name)
    for word in [str(dspace), repr(name), *words]:
        assert word in str(error.value)


def test_complex_sparse_and_empty_are_refused(tmp_path):
    path = tmp_path / "x.mat"
    savemat(path, {"z": A + 1j, "e": np.empty((0, 0)), "s": {"k": "v"}})
    for name, word in {"z": "complex", "e": "empty", "s.k": "text"}.items():
        with pytest.raises(ValueError, match=word):
            read_columns(path).column(name)
    dspace_v73(path)
    with pytest.raises(ValueError, match="empty"):
        read_columns(path).column("E")


def make(path):
    if path.suffix == ".mat":
        dspace_v5(path, False)
    elif path.suffix == ".h5":
        dspace_v73(path)
    else:
        WRITERS[path.suffix](path, {"F": A, "y": B})


@pytest.mark.parametrize("name", ["x.mat", "x.h5", "x.npz"])
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damage_is_an_error_and_never_a_crash(tmp_path_factory, name, data):
    path = tmp_path_factory.mktemp("d") / name
    make(path)
    content = bytearray(path.read_bytes())
    if data.draw(st.booleans()):
        content = content[: data.draw(st.integers(0, len(content) - 1))]
    for _ in range(3):
        if content:
            content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content)
    for column in ("mb10.Y[1].Data", "F"):
        try:
            read_columns(path).column(column)
        except ValueError as error:
            assert str(path) in str(error)


@pytest.mark.parametrize("name", ["x.mat", "x.h5", "x.npz"])
def test_truncated_files_say_so(tmp_path, name):
    path = tmp_path / name
    make(path)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=rf"{name}: .*truncated or damaged"):
        read_columns(path).column("mb10.Y[1].Data")


def test_pickles_are_never_loaded(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, F=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match=r"x\.npz: column 'F': holds pickled objects"):
        read_columns(path).column("F")


def test_hdf5_links_and_outside_storage_are_not_followed(tmp_path):
    path, other = tmp_path / "x.h5", tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["secret"] = A
    layout = h5py.VirtualLayout((3,), "f8")
    layout[:] = h5py.VirtualSource(str(other), "secret", (3,))
    with h5py.File(path, "w") as file:
        file["y"] = A
        file["link"] = h5py.ExternalLink(str(other), "secret")
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("outside", (3,), "f8", external=[(str(tmp_path / "raw"), 0, 24)])
    np.testing.assert_array_equal(read_columns(path).column("y"), A)
    for name, word in {"link": "no field 'link'", "virtual": "another file", "outside": "another file"}.items():
        with pytest.raises(ValueError, match=word):
            read_columns(path).column(name)


def test_size_limit_counts_what_is_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(file_formats, "MAX_DATA_BYTES", 10_000)
    zeros = np.zeros(100_000)
    np.savez_compressed(tmp_path / "x.npz", F=zeros)
    savemat(tmp_path / "x.mat", {"F": zeros}, do_compression=True)
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("F", data=zeros, compression="gzip")
    write_csv(tmp_path / "x.csv", {"F": zeros})
    for path in tmp_path.iterdir():
        with pytest.raises(ValueError, match="10000"):
            read_columns(path).column("F")


def test_other_files(tmp_path):
    with pytest.raises(ValueError, match=r"x\.xls: files of kind '\.xls' are not read; save the sheet as CSV"):
        read_columns(tmp_path / "x.xls")
    with pytest.raises(ValueError, match=r"x\.docx: files of kind '\.docx' are not read; use \.mat"):
        read_columns(tmp_path / "x.docx")
    with pytest.raises(OSError, match=r"x\.mat"):
        read_columns(tmp_path / "x.mat")
    (tmp_path / "x.nc").write_bytes(b"CDF\x01")
    with pytest.raises(ValueError, match="classic netCDF is not read"):
        read_columns(tmp_path / "x.nc")
    (tmp_path / "d.mat").mkdir()
    with pytest.raises(ValueError, match="not a regular file"):
        read_columns(tmp_path / "d.mat")


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "x.npz"
    write_npz(path, {"F": A})
    with pytest.raises(ValueError, match="one length"):
        write_npz(path, {"F": A, "y": A[:2]})
    with pytest.raises(ValueError, match="column name '__x'"):
        write_mat(path, {"__x": A})
    np.testing.assert_array_equal(read_columns(path).column("F"), A)
    write_text_atomic(tmp_path / "t.toml", "a")
    with pytest.raises(UnicodeEncodeError):
        write_text_atomic(tmp_path / "t.toml", "\ud800")
    assert (tmp_path / "t.toml").read_text() == "a"
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("kind", ["mat", "h5"])
def test_small_files_that_unpack_to_gigabytes_are_refused_unread(tmp_path, kind):
    """Their sizes are stated; none of their values is unpacked, of which nothing is here."""
    path, values = tmp_path / f"a.{kind}", (1 << 27) + 1
    if kind == "h5":
        with h5py.File(path, "w") as file:
            file.create_dataset("y", (values,), "i1", chunks=(1 << 20,), compression="gzip")
    else:
        packed = zlib.compress(struct.pack("<2I4I2I2i2I8s", 14, 8 * values, 6, 8, 6, 0, 5, 8, values, 1, 1, 1, b"y"))
        path.write_bytes(b"MATLAB 5.0".ljust(124) + b"\x00\x01IM" + struct.pack("<2I", 15, len(packed)) + packed)
    with pytest.raises(ValueError, match="bytes, more than the limit of 1073741824; split the recording"):
        read_columns(path).column("y")


def test_a_file_of_a_campaign_is_read_once_by_rules_and_commands(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(files, "read_columns", lambda *asked: opened.append(asked) or read_columns(*asked))
    path, other = tmp_path / "a.csv", tmp_path / "b.npz"
    path.write_text("y\n1\n2\n")
    write_npz(other, {"y": np.array([3.0, 4.0])})
    asked = files.OpenedFiles()
    for _ in range(3):
        np.testing.assert_array_equal(asked.columns(path).column("y"), [1, 2])
        asked.columns(other).column("y")[0] = 9.0  # what one takes and changes the next does not see
        np.testing.assert_array_equal(asked.columns(other).column("y"), [3, 4])
    assert len(opened) == 2
    pickle.loads(pickle.dumps(asked)).columns(path)
    assert len(opened) == 3
    monkeypatch.setattr(files, "KEPT", 10)
    small = files.OpenedFiles()
    small.columns(other), small.columns(other)
    assert len(opened) == 5
