"""JSON as scripts and pandas write it, arrays of records, and tables of other shapes that are told what to do."""

import json

import h5py
import numpy as np
import pytest

from maglev_env.recordings.contents import contents
from maglev_env.recordings.files import read_columns
from maglev_env.recordings.guess.recording import guess_recording
from maglev_workbench.commands.new.files import data_files

T = np.arange(40) / 1000
GAP, CURRENT = np.round(np.sin(50 * T), 4), np.round(1 + np.cos(50 * T), 4)
WIDE = {"t": T.tolist(), "gap_mm": GAP.tolist(), "i_A": CURRENT.tolist()}
ROWS = [dict(zip(WIDE, row, strict=True)) for row in zip(*WIDE.values(), strict=True)]


@pytest.mark.parametrize(
    ("written", "above"),
    [
        (WIDE, ""),
        ({"rig": "ball", "fs_hz": 1000, "data": WIDE}, "data."),
        ({"log": {"runs": {"first": ROWS}}}, "log.runs.first."),
        (ROWS, ""),
        ({name: {str(i): v for i, v in enumerate(values)} for name, values in WIDE.items()}, ""),  # pandas: to_json
    ],
)
def test_json_is_read_in_the_forms_that_programs_write(tmp_path, written, above):
    (tmp_path / "run.json").write_text(json.dumps(written))
    found = contents(read_columns(tmp_path / "run.json")).columns
    np.testing.assert_array_equal(found[f"{above}gap_mm"], GAP)
    np.testing.assert_array_equal(found[f"{above}i_A"], CURRENT)
    guess = guess_recording(tmp_path / "run.json")
    assert guess.channels["displacement"].column == f"{above}gap_mm" and guess.channels["displacement"].scale == 1e-3


def test_json_lines_are_read_under_either_suffix_and_null_is_missing(tmp_path):
    rows = [{**row, "i_A": None} if i == 7 else row for i, row in enumerate(ROWS)]
    (tmp_path / "lines.json").write_text("\n".join(map(json.dumps, rows)))
    (tmp_path / "whole.json").write_text(json.dumps({name: [row[name] for row in rows] for name in WIDE}))
    for name in ("lines.json", "whole.json"):
        current = read_columns(tmp_path / name).column("i_A")
        assert np.isnan(current[7]) and np.isfinite(np.delete(current, 7)).all()


@pytest.mark.parametrize(
    "text", ["[" * 100_000, '{"a": [1, 2', "[1, 2, 3]", '"text"', "12", '{"a": {"b": [[1], "x"]}}', "[]"]
)
def test_other_json_is_an_error_and_never_a_crash(tmp_path, text):
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(ValueError, match=r"run\.json"):
        contents(read_columns(tmp_path / "run.json"))


def test_of_a_folder_json_counts_only_without_other_data(tmp_path):
    (tmp_path / "run.json").write_text(json.dumps(WIDE))
    assert data_files([tmp_path]) == [tmp_path / "run.json"]
    (tmp_path / "run.csv").write_text("t,y\n0,1\n")
    assert data_files([tmp_path]) == [tmp_path / "run.csv"]


@pytest.mark.parametrize("kind", ["npz", "npy", "h5"])
def test_arrays_of_records_are_columns(tmp_path, kind):
    table = np.zeros(T.size, [("t", "f8"), ("gap_mm", "f4"), ("i_A", "f8")])
    table["t"], table["gap_mm"], table["i_A"] = T, GAP, CURRENT
    path, above = tmp_path / f"run.{kind}", {"npz": "log.", "npy": "", "h5": "daq.table."}[kind]
    if kind == "npz":
        np.savez(path, log=table)
    elif kind == "npy":
        np.save(path, table)
    else:
        with h5py.File(path, "w") as file:
            file.create_dataset("daq/table", data=table)
    columns = read_columns(path)
    np.testing.assert_array_equal(columns.column(f"{above}i_A"), CURRENT)
    np.testing.assert_allclose(contents(columns).columns[f"{above}gap_mm"], GAP, atol=1e-7)
    if above:
        with pytest.raises(ValueError, match="choose a field of it: t, gap_mm, i_A"):
            columns.column(above.removesuffix("."))


@pytest.mark.parametrize("sorted_by_name", [False, True])
def test_several_lines_of_one_sample_are_refused_with_what_to_do(tmp_path, sorted_by_name):
    lines = [f"{t},{name},{v}" for t, row in zip(T, ROWS, strict=True) for name, v in list(row.items())[1:]]
    lines = sorted(lines, key=lambda line: line.split(",")[1]) if sorted_by_name else lines
    (tmp_path / "long.csv").write_text("\n".join(["time,signal,value", *lines]))
    with pytest.raises(ValueError, match=r"'signal' says what each line holds .*: 2 lines make one sample.* pivot"):
        read_columns(tmp_path / "long.csv")


def test_words_beside_samples_are_no_long_form(tmp_path):
    state = ["RUN" if i % 2 else "STOP" for i in range(T.size)]
    rows = [f"{t},{s},{y}" for t, s, y in zip(T, state, GAP, strict=True)]
    (tmp_path / "run.csv").write_text("\n".join(["t,state,gap_mm", *rows]))
    np.testing.assert_array_equal(read_columns(tmp_path / "run.csv").column("gap_mm"), GAP)


def test_channels_in_lines_are_to_be_transposed(tmp_path):
    rows = [",".join([name, *(f"{v:.4f}" for v in np.tile(values, 3))]) for name, values in WIDE.items()]
    (tmp_path / "run.csv").write_text("\n".join(rows))
    with pytest.raises(ValueError, match=r"121 columns of at most 3 numbers: .* transpose it"):
        contents(read_columns(tmp_path / "run.csv"))


def test_a_row_of_units_or_of_times_above_the_numbers_is_none_of_names(tmp_path):
    twincat = ["Name\tMAIN.fPosition\tName\tMAIN.fCurrent", "Unit\tmm\tUnit\tA", ""]
    twincat += [f"{i}\t{y}\t{i}\t{c}" for i, (y, c) in enumerate(zip(GAP, CURRENT, strict=True))]
    yokogawa = ['"TraceName","pos","cur"', '"VUnit","mm","A"', '"Time","10:11:12.000","10:11:12.000"', ""]
    yokogawa += [f",{y:.6E},{c:.6E}" for y, c in zip(GAP, CURRENT, strict=True)]
    for name, text, headers in (
        ("twincat.csv", twincat, ["MAIN.fPosition [mm]", "MAIN.fCurrent [A]"]),
        ("yokogawa.csv", yokogawa, ["pos [mm]", "cur [A]"]),
    ):
        (tmp_path / name).write_text("\n".join(text))
        found = read_columns(tmp_path / name).headers
        assert [header for header in found.values() if "[" in header] == headers
