"""Text files as programs of many kinds write them, and what is refused because it can be read in two ways."""

import numpy as np
import pytest

from maglev_env.recordings.files import read_columns
from maglev_env.recordings.formats import text_files
from maglev_env.recordings.formats.text_layout import TextLayout, layout_table
from maglev_env.recordings.guess.rate import stated_step

T, Y = [0.0, 0.001, 0.002], [0.1234, -5.5, 2e-3]
LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Date\t2025/12/17
***End_of_Header***\t

Channels\t1\t
Samples\t3\t
X0\t0.0\t
Delta_X\t0.001\t
***End_of_Header***\t
X_Value\tVoltage\tComment
"""


def rows(separator, decimal=".", end=""):
    lines = [f"{t:.6f}{separator}{y:.6e}{end}" for t, y in zip(T, Y, strict=True)]
    return "".join(line.replace(".", decimal) + "\n" for line in lines)


LAYOUTS = {
    "comma, header.csv": "t,y\n" + rows(","),
    "semicolon.csv": "t;y\n" + rows(";"),
    "semicolon, decimal comma.csv": "t;y\n" + rows(";", ","),
    "tab.tsv": "t\ty\n" + rows("\t"),
    "tab, decimal comma.txt": "t\ty\n" + rows("\t", ","),
    "blanks.dat": "  t   y\n" + rows("    "),
    "exponents of Fortran.dat": "# t y\n" + rows("  ").replace("e", "D"),
    "trailing separators.csv": "t;y;\n" + rows(";", end=";"),
    "trailing in numbers alone.csv": "t,y\n" + rows(",", end=","),
    "comment names.txt": "# recorded yesterday\n# t y\n" + rows(" "),
    "labelled comment.txt": "# Fecha: 2025-12-17T21:01:34.788\n# Columnas: t y\n#\n" + rows("\t"),
    "percent.txt": "% MATLAB\n% t,y\n" + rows(","),
    "units.csv": "t;y\ns;mm\n" + rows(";", ","),
    "bracketed units.csv": "t,y\n(ms),(V)\n" + rows(","),
    "free text.csv": "Oscilloscope 12, serial 3\n\nt,y\n" + rows(","),
    "labview.lvm": LABVIEW.replace("X_Value", "t").replace("Voltage", "y") + rows("\t"),
    "matrix.txt": "   t     y\n\n[" + rows("   ", end=";").rstrip(";\n") + "]\n",
    "windows.csv": ("t,y\n" + rows(",")).replace("\n", "\r\n"),
    "quoted.csv": '"t","y"\n' + rows(","),
}


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_files_of_many_programs_give_the_same_columns(tmp_path, name, encoding):
    path = tmp_path / name
    path.write_bytes(LAYOUTS[name].encode(encoding))
    columns = read_columns(path)
    np.testing.assert_array_equal(columns.column("t"), T)
    np.testing.assert_array_equal(columns.column("y"), Y)
    np.testing.assert_array_equal(columns.column("[1]"), Y)


def test_what_was_told_from_the_file_is_said(tmp_path):
    path = tmp_path / "x.csv"
    path.write_bytes(("Gerät 7\nZeit;Weg\ns;µm\n" + rows(";", ",")).encode("latin-1"))
    notes = " | ".join(read_columns(path).notes)
    for word in ("Latin-1", "semicolons between columns and a decimal comma", "named by line 2", "line 3 holds units"):
        assert word in notes
    path.write_text("t,y\n" + rows(","))
    assert not read_columns(path).notes


def test_a_comment_of_units_below_one_of_names_tells_units(tmp_path):
    """The units became the names, and what was called "um" was the reference in mm."""
    path = tmp_path / "x.txt"
    path.write_text("% stand, axis V\n% t\tpos\n% s\tum\n" + rows("\t"))
    columns = read_columns(path)
    np.testing.assert_array_equal(columns.column("pos"), Y)
    notes = " | ".join(columns.notes)
    assert "named by the comment in line 2" in notes and "line 3 holds units" in notes
    assert columns.headers["pos"] == "pos [um]"
    path.write_text("% s\tum\n" + rows("\t"))  # nothing else may be the names
    np.testing.assert_array_equal(read_columns(path).column("um"), Y)


@pytest.mark.parametrize(
    "above",
    [
        "t,pos\nms,mils\n",
        "t,pos\nmilliseconds,thou\n",
        "t,pos\nms,Mils\n",
        "# t,pos\n# ms,thou\n",
        "# columns: t, pos\n# units: ms, mils\n",
        "# t,pos\n# Units: ms, mils\n",
        "# data: t,pos\n# unit: ms,mil\n",
        "Name,pos\nUnit,mils\n",
        "t,pos\nUnits:,mils\n",
        "# t,pos\n# Units:,mils\n",
    ],
)
def test_units_are_no_names_whatever_they_are_and_whatever_says_so(tmp_path, above):
    """Such a row had named the columns, and what was called "mm" was the reference."""
    path = tmp_path / "x.csv"
    path.write_text(above + rows(","))
    columns = read_columns(path)
    np.testing.assert_array_equal(columns.column("pos"), Y)
    assert columns.headers["pos"].lower() in ("pos [mils]", "pos [mil]", "pos [thou]")
    if above.startswith("# ") and ":," not in above:
        path.write_text(above.replace(",", " ").replace("  ", " ") + rows(" "))
        assert read_columns(path).headers["pos"] == columns.headers["pos"]


@pytest.mark.parametrize("names", ["MV,PV", "X,N", "# Gap: left,Gap: right"])
def test_what_could_be_a_unit_in_other_letters_or_holds_colons_is_a_name(tmp_path, names):
    path = tmp_path / "x.csv"
    path.write_text(names + "\n" + rows(","))
    assert read_columns(path).names == tuple(names.lstrip("# ").split(","))


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", "."), ("   ", ".")])
def test_without_a_header_columns_go_by_position_from_zero(tmp_path, separator, decimal):
    path = tmp_path / "x.txt"
    path.write_text(rows(separator, decimal))
    columns = read_columns(path)
    assert columns.names == ("[0]", "[1]") and 'position, "[0]" to "[1]"' in columns.notes[-1]
    np.testing.assert_array_equal(columns.column("[1]"), Y)
    with pytest.raises(ValueError, match=r"there is no column '\[2\]'"):
        columns.column("[2]")


def test_a_matrix_of_matlab_keeps_all_its_columns_and_names_of_several_words(tmp_path):
    path = tmp_path / "x.txt"
    path.write_text("  Sample   Commanded Pos    Sensor 1 Pos\n\n[ 0   1.5   2;\n  1   2.5   3;\n  2   3.5   4]\n")
    columns = read_columns(path)
    assert columns.names == ("Sample", "Commanded Pos", "Sensor 1 Pos") and "matrix of MATLAB" in columns.notes[0]
    np.testing.assert_array_equal(columns.column("Sensor 1 Pos"), [2, 3, 4])
    path.write_text("data = [\n0, 1.5;\n1, 2.5;\n];\n")
    np.testing.assert_array_equal(read_columns(path).column("[1]"), [1.5, 2.5])


def test_the_minus_of_typography_is_a_minus(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("a,b\n\u22121.5,2\n1.5,\u2212.5\n", encoding="utf-8")
    np.testing.assert_array_equal(read_columns(path).column("a"), [-1.5, 1.5])
    np.testing.assert_array_equal(read_columns(path).column("b"), [2, -0.5])


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("F,y\n1,2\n3,abc\n", "y", ["column 'y'", "'abc' in line 3 (sample 1) is not a number"]),
        ("F,y\n1,2\n3,\n5,\n", "y", ["'' in line 3 (sample 1)"]),
        ("F,y\n1,2\n3\n", "F", ["line 3 (sample 1) has 1 values, the other lines 2 columns"]),
        ("F,y\n1,2\n\n3,4\n", "F", ["line 3 (before sample 1) is blank"]),
        ("F,y\n1.5,2\n# pause\n3.5,4\n", "F", ["line 3 (before sample 1) is blank or a comment"]),
        ("1,2\n3,4\n", "F", ["'3,4'", "a comma between columns or a decimal comma", "format = {"]),
        ("y\n1,234\n5,678\n", "y", ["a comma between columns or a decimal comma", "format = {"]),
        ("F;y\n1;1,234\n2;5,678\n", "y", ["'5,678'", "thousands separator", "format = {"]),
        ('F,y\n1,"1,234"\n2,"5,678"\n', "y", ["'5,678'", "thousands separator"]),
        ("F;y\n1;1.234,5\n2;5.678,5\n", "y", ["'1.234,5' holds a thousands separator"]),
        ('n,F\n"999,999","973"\n"1,500,000","4,620"\n', "F", ["'1,500,000' in line 3 (sample 1)", "thousands sep"]),
        ('n,F,y\n"999,998","973","-2.8"\n"999,999","4,620","-1,002.8"\n', "F", ["'-1,002.8' holds a thousands"]),
        ("n;F\n999;973\n1.500.000;4.620\n", "F", ["'1.500.000' in line 3 (sample 1)", "thousands separators"]),
        ("F;y\n1,5;998\n2,5;1.067\n", "y", ["'1.067' in line 3 (sample 1) holds a thousands separator"]),
        (
            "F;G;y\n1,5;1,5;1.067\n2,5;1,5;2.100.000\n",
            "y",
            ["'1.067' in line 2 (sample 0) holds a thousands separator"],
        ),
        ("F,F\n3.5,4\n", "F", ["there is no column 'F'", "Available: [0], [1]"]),
        ("F,y,z\n1.5,2\n3.5,4\n", "F", ["line 1 has 3 names, the numbers below it 2 columns", "header = 0"]),
        ("", "F", ["is empty"]),
        ("F,y\n", "F", ["column 'F'", "is empty"]),
        ("a\0b", "F", ["zero bytes"]),
    ],
)
def test_errors_name_line_and_column(tmp_path, text, column, words):
    path = tmp_path / "x.csv"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        read_columns(path).column(column)
    for word in [str(path), *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("text", "layout", "name", "expected"),
    [
        ("1,2\n3,4\n", TextLayout(separator=","), "[1]", [2, 4]),
        ("1,2\n3,4\n", TextLayout(decimal=","), "[0]", [1.2, 3.4]),
        ("y\n1,234\n5,678\n", TextLayout(decimal=","), "y", [1.234, 5.678]),
        ("F;y\n1;1,234\n2;5,678\n", TextLayout(decimal=","), "y", [1.234, 5.678]),
        ("a,b\nF,y\n1.5,2\n3.5,4\n", TextLayout(header=1), "a", [1.5, 3.5]),
        ("a,b\nF,y\n1.5,2\n3.5,4\n", TextLayout(header=0), "[0]", [1.5, 3.5]),
        ("1,2\n1.5,2\n3.5,4\n", TextLayout(header=0), "[0]", [1, 1.5, 3.5]),
    ],
)
def test_what_is_stated_decides(tmp_path, text, layout, name, expected):
    path = tmp_path / "x.csv"
    path.write_text(text)
    np.testing.assert_array_equal(read_columns(path, layout).column(name), expected)


@pytest.mark.parametrize(
    ("table", "word"),
    [
        ({"separator": "|"}, "separator = '|'"),
        ({"decimal": ";"}, "decimal = ';'"),
        ({"header": -1}, "header = -1"),
        ({"head": 1}, "unknown key 'head'"),
        ([], "must be a table"),
    ],
)
def test_a_format_that_does_not_fit_is_refused(table, word):
    with pytest.raises(ValueError) as error:
        layout_table(table)
    assert word in str(error.value)


@pytest.mark.parametrize("last", ["3", "x"])  # read at once, and cell by cell
def test_a_column_of_decimal_points_among_decimal_commas_is_read(tmp_path, last):
    path = tmp_path / "x.csv"
    lines = "".join(f"{0.998 + 0.069 * i:.3f};{i},5;0,5;{last if i == 9 else i}\n" for i in range(10))
    path.write_text("t;y;z;c\n" + lines)
    np.testing.assert_allclose(read_columns(path).column("t"), 0.998 + 0.069 * np.arange(10))
    np.testing.assert_array_equal(read_columns(path).column("y"), np.arange(10) + 0.5)


def test_only_what_is_asked_for_is_read_and_names_as_they_stand(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text('\ufeff"F [N]",probe.left,note\r\n1,2,ok\r\n3,4e-3,bad\r\n\r\n', encoding="utf-8")
    np.testing.assert_array_equal(read_columns(path).column("F [N]"), [1, 3])
    np.testing.assert_array_equal(read_columns(path).column("probe.left"), [2, 4e-3])


def test_blocks_join(tmp_path, monkeypatch):
    monkeypatch.setattr(text_files, "_BLOCK", 4)
    path = tmp_path / "x.csv"
    path.write_text("F,y\n" + "".join(f"{i},{'x' if i == 9 else i}\n" for i in range(11)))
    np.testing.assert_array_equal(read_columns(path).column("F"), np.arange(11))
    with pytest.raises(ValueError, match=r"'x' in line 11 \(sample 9\)"):
        read_columns(path).column("y")


def test_a_line_that_a_stopped_program_did_not_finish_is_left_out_and_said(tmp_path):
    path = tmp_path / "serial.csv"
    path.write_text("t,y\n" + rows(",") + "0.0")
    file = read_columns(path)
    np.testing.assert_array_equal(file.column("t"), T)
    assert any("last line is cut off ('0.0')" in note for note in file.notes)
    path.write_text("t,y\n" + rows(",").replace("\n", "\n0.0\n", 1))
    with pytest.raises(ValueError, match="has 1 values"):
        read_columns(path).column("t")


def test_times_of_day_are_seconds_also_past_midnight(tmp_path):
    clocks = ("23:59:59.250", "23:59:59.750", "00:00:00.250", "00:00:00.750")
    for name, before in (("plain.csv", ""), ("dated.csv", "2024-03-01 ")):
        (tmp_path / name).write_text("time,y\n" + "".join(f"{before}{c},{j}.5\n" for j, c in enumerate(clocks)))
        file = read_columns(tmp_path / name)
        np.testing.assert_allclose(np.diff(file.column("time")), 0.5, atol=1e-9)
        np.testing.assert_array_equal(file.column("y"), [0.5, 1.5, 2.5, 3.5])
        assert any("times of day" in note for note in file.notes)


@pytest.mark.parametrize(
    ("clocks", "first"),
    [
        (("1:22:01.5 PM", "1:22:02.5 PM", "1:22:03.5 PM"), 13 * 3600 + 22 * 60 + 1.5),
        (("05/01/2024 11:59:58 AM", "05/01/2024 11:59:59 AM", "05/01/2024 12:00:00 PM"), 12 * 3600 - 2.0),
        (("12:59:59 a.m.", "1:00:00 a.m.", "1:00:01 a.m."), 3599.0),
        (("11:59:59pm", "12:00:00am", "12:00:01am"), 24 * 3600 - 1.0),
    ],
)
def test_times_of_twelve_hours_are_times_of_day(tmp_path, clocks, first):
    (tmp_path / "x.csv").write_text("time,y\n" + "".join(f"{c},{j}.5\n" for j, c in enumerate(clocks)))
    np.testing.assert_allclose(read_columns(tmp_path / "x.csv").column("time"), first + np.arange(3.0))


def test_milliseconds_behind_a_comma_belong_to_the_time_of_day_before_them(tmp_path):
    stamps = [f"2024-05-01 {'23:59:59' if ms < 1000 else '00:00:00'},{ms % 1000:03d}" for ms in range(0, 2000, 250)]
    for head in ("", "stamp,ms,gap\n"):
        (tmp_path / "x.csv").write_text(head + "".join(f"{stamp},0.{i}5\n" for i, stamp in enumerate(stamps)))
        time = read_columns(tmp_path / "x.csv").column("stamp" if head else "[0]")
        np.testing.assert_allclose(time, 24 * 3600 - 1 + 0.25 * np.arange(8), atol=1e-9)
    counted = "".join(f"13:22:0{i},{i},0.5\n" for i in range(8))  # a count beside a time is none of its parts
    (tmp_path / "x.csv").write_text("stamp,k,gap\n" + counted)
    np.testing.assert_allclose(np.diff(read_columns(tmp_path / "x.csv").column("stamp")), 1.0)


@pytest.mark.parametrize("stated", [TextLayout(), TextLayout(",", ",")])
def test_decimal_commas_in_quotes_may_stand_between_commas(tmp_path, stated):
    (tmp_path / "x.csv").write_text('t [s],y [mm],n\n"0,00010","0,027",1\n"0,00020","-1,5e-3",2\n"0,00030","1",3\n')
    columns = read_columns(tmp_path / "x.csv", stated)
    np.testing.assert_array_equal(columns.column("t [s]"), [1e-4, 2e-4, 3e-4])
    np.testing.assert_array_equal(columns.column("y [mm]"), [0.027, -1.5e-3, 1.0])
    np.testing.assert_array_equal(columns.column("n"), [1, 2, 3])


@pytest.mark.parametrize(
    ("line", "seconds"),
    [
        ("Abtastzeit: 1 ms", 1e-3),
        ("# sample rate: 2 kHz", 5e-4),
        ("Ts = 0.5ms", 5e-4),
        ("dt;2e-4;s", 2e-4),
        ("Sample Interval;250;us", 2.5e-4),
        ("fs;1000", 1e-3),
        ("sampling rate: 0.5 ms", 5e-4),
        ("Abtastzeit: 3 Takte", None),
        ("Fréquence d'échantillonnage : 500 Hz", 2e-3),
        ("Sample rate;2 kS/s", 5e-4),
        ("magnetic ball, dt = 4 ms, gap = 8 mm", 4e-3),
    ],
)
def test_a_number_above_the_table_has_the_unit_behind_it(tmp_path, line, seconds):
    (tmp_path / "x.csv").write_text(f"Pruefstand 4\n{line}\n\nPosition;Strom\n" + rows(";"))
    stated = stated_step(read_columns(tmp_path / "x.csv").numbers)
    assert (stated and stated[0]) == (seconds and pytest.approx(seconds))


@pytest.mark.parametrize("separator", ["\t", ",", " "])
def test_numbers_with_their_names_beside_them_are_a_table(tmp_path, separator):
    told = [separator.join([f"us:{i * 1000}", f"gap:{8 + 0.001 * i:.3f}", f"cur:{-0.5 * i:.2f}"]) for i in range(20)]
    (tmp_path / "x.log").write_text("=~=~= log 2026.11.03 14:55:33 =~=~=\nready\n" + "\n".join([*told, "us:200"]))
    columns = read_columns(tmp_path / "x.log")
    assert columns.names == ("us", "gap", "cur")
    np.testing.assert_allclose(columns.column("gap"), 8 + 0.001 * np.arange(20))
    np.testing.assert_allclose(columns.column("cur"), -0.5 * np.arange(20))
    assert any("name beside it" in note for note in columns.notes) and any("cut off" in note for note in columns.notes)


def test_what_stands_above_a_table_of_blanks_is_read_as_sentences(tmp_path):
    (tmp_path / "x.dat").write_text("# magnetic ball, dt = 1 ms\n#  gap/mm  i/A\n" + rows("  "))
    assert stated_step(read_columns(tmp_path / "x.dat").numbers)[0] == 1e-3


def test_a_monitor_that_stamps_its_lines_gives_a_time(tmp_path):
    lines = [f"14:59:5{i // 2}.{i % 2 * 5}00 -> gap={8 + 0.01 * i:.3f}, cur={i:d}\n" for i in range(18)]
    (tmp_path / "x.txt").write_text("".join(lines))
    columns = read_columns(tmp_path / "x.txt")
    assert columns.names == ("time", "gap", "cur")
    np.testing.assert_allclose(np.diff(columns.column("time")), 0.5)
    np.testing.assert_allclose(columns.column("gap"), 8 + 0.01 * np.arange(18))


def test_times_of_day_are_no_names(tmp_path):
    (tmp_path / "x.csv").write_text("t,y\n" + "".join(f"13:22:0{i}.5,{i}\n" for i in range(9)))
    assert read_columns(tmp_path / "x.csv").names == ("t", "y")


@pytest.mark.parametrize(
    ("units", "headers"),
    [
        ("s;mm;A;1/min", ("t [s]", "y [mm]", "i [A]", "n [1/min]")),
        ("s;mm;A;U/min", ("t [s]", "y [mm]", "i [A]", "n [U/min]")),
        ("s;mm;A;bar", ("t [s]", "y [mm]", "i [A]", "n [bar]")),
        ("s;mm;A;l/min", ("t [s]", "y [mm]", "i [A]", "n [l/min]")),
        ("s;counts;A;V", ("t [s]", "y [counts]", "i [A]", "n [V]")),
        ("ms;mm/s2;kA;µm", ("t [ms]", "y [mm/s2]", "i [kA]", "n [µm]")),
    ],
)
def test_a_row_of_units_may_hold_one_that_is_not_known(tmp_path, units, headers):
    lines = "".join(f"0,{i:03d};{i},5;1,5;{i}\n" for i in range(20))
    (tmp_path / "x.csv").write_text(f"t;y;i;n\n{units}\n{lines}")
    columns = read_columns(tmp_path / "x.csv")
    assert columns.names == ("t", "y", "i", "n") and tuple(columns.headers.values()) == headers


@pytest.mark.parametrize("names", ["s;m;pos;cur", "t;gap;i;ref", "s;v;a;n", "s;mm;mm;Kommentarzeile"])
def test_names_that_are_like_units_are_names(tmp_path, names):
    lines = "".join(f"0,{i:03d};{i},5;1,5;{i}\n" for i in range(20))
    (tmp_path / "x.csv").write_text(f"Lager;vorn;links;oben\n{names}\n{lines}")
    split = names.split(";")
    expected = tuple(name if split.count(name) == 1 else f"[{j}]" for j, name in enumerate(split))
    assert read_columns(tmp_path / "x.csv").names == expected
