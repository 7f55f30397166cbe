"""One record in the layouts of further programs and instruments, none written by this project's own writers.

LVM: National Instruments, "Specification for the LabVIEW Measurement File"; ControlDesk: dSPACE, "MAT-File Export";
TwinCAT: heads of files exported by TwinCAT 3 Scope; the others after files of the instruments.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.io import savemat

Record = Mapping[str, np.ndarray]  # channel -> (samples,) in SI, with "time"
FIVE = ("displacement", "command", "current", "force", "injection")
STEP = "5.000000E-5"  # s


def _row(cells: Iterable[object], separator: str, end: str = "\n") -> str:
    return separator.join(map(str, cells)) + end


def _rows(columns: Sequence[np.ndarray], form: str, separator: str, end: str = "\n") -> str:
    return "".join(_row((form % v for v in row), separator, end) for row in zip(*columns, strict=True))


def _scaled(r: Record) -> list[np.ndarray]:
    """The five channels, the displacement in mm."""
    return [r[name] * (1e3 if name == "displacement" else 1.0) for name in FIVE]


def lvm_packets(path: Path, r: Record) -> Path:
    """LabVIEW: packets with a heading each, a time for every channel, decimal commas."""
    text = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t,\nMulti_Headings\tYes\nX_Columns\tMulti\n"
    text += "Time_Pref\tRelative\n***End_of_Header***\t\n\t\n"
    names = ("Position", "Sollstrom", "Iststrom", "Kraft", "Anregung")
    for begin in range(0, r["time"].size, 4000):
        part = slice(begin, begin + 4000)
        time = r["time"][part]
        for key, values in (
            ("Channels", ["5"]), ("Samples", [time.size] * 5), ("Date", ["2024/05/17"] * 5),
            ("Y_Unit_Label", ["mm", "A", "A", "N", "A"]), ("X_Dimension", ["Time"] * 5),
            ("X0", [f"{time[0]:.6f}"] * 5), ("Delta_X", [STEP] * 5),
        ):  # fmt: skip
            text += key + "\t" + _row(values, "\t\t", "\t\n").replace(".", ",")
        text += "***End_of_Header***" + 10 * "\t" + "\n" + "".join(f"X_Value\t{name}\t" for name in names) + "Comment\n"
        pairs = [c for values in _scaled(r) for c in (time, values[part])]
        text += _rows(pairs, "%.8f", "\t", "\t\n").replace(".", ",") + "\n"
    (path / "packets.lvm").write_text(text)
    return path / "packets.lvm"


def lvm_without_time(path: Path, r: Record) -> Path:
    """LabVIEW without a column of time: the first one is empty, and the heading states the step."""
    text = "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t5\t\t\t\t\t\n"
    for key, value in (("Samples", r["time"].size), ("Date", "2024/05/17"), ("X0", "0.000000E+0"), ("Delta_X", STEP)):
        text += _row([key, *[value] * 5], "\t", "\t\n")
    text += "Y_Unit_Label\tmm\tAmps\tAmps\tNewtons\tAmps\t\n***End_of_Header***\t\t\t\t\t\t\n"
    text += "X_Value\tPosition\tCommand\tCurrent\tForce\tInjection\tComment\n"
    rows = "".join(_row(["", *(f"{v:.8f}" for v in row)], "\t", "\t\n") for row in zip(*_scaled(r), strict=True))
    (path / "without_time.lvm").write_text(text + rows)
    return path / "without_time.lvm"


def controldesk(path: Path, r: Record) -> Path:
    """dSPACE ControlDesk: two rasters of unequal length, names as paths of blocks, units in some names."""
    x, y = (np.zeros((1, n), dtype=[(key, "O") for key in ("Name", "Type", "Data", "Unit", "Raster")]) for n in (2, 6))
    for place, every, raster in ((0, 1, "HostService"), (1, 50, "Periodic Task 2")):
        x[0, place] = (raster, "Data", r["time"][None, ::every], "s", raster)
    names = ("y_gap [um]", "i_ref", "i_meas", "F_ext", "i_inj")
    for j, (name, channel) in enumerate(zip(names, FIVE, strict=True)):
        values = r[channel] * (1e6 if j == 0 else 1.0)
        y[0, j] = (f'"Model Root"/"Controller"/"{name}"', "Data", values[None], "", "HostService")
    y[0, 5] = ("Temperature", "Data", np.full((1, r["time"][::50].size), 24.5), "degC", "Periodic Task 2")
    savemat(path / "rec_001.mat", {"rec_001": {"X": x, "Y": y, "Capture": {"Length": 5.0, "SamplingPeriod": 5e-5}}})
    return path / "rec_001.mat"


def structure_with_time(path: Path, r: Record) -> Path:
    """Simulink's Scope, structure with time: several signals a block, named in one label."""
    signals = np.zeros((1, 3), dtype=[(key, "O") for key in ("values", "dimensions", "label", "title")])
    columns = _scaled(r)
    signals[0, 0] = (columns[0][:, None], 1, "Position [mm]", "")
    signals[0, 1] = (np.column_stack(columns[1:3]), 2, "i_ref, i_meas", "")
    signals[0, 2] = (np.column_stack(columns[3:]), 2, "force, injection", "")
    savemat(
        path / "ScopeData.mat", {"ScopeData": {"time": r["time"][:, None], "signals": signals, "blockName": "b/Scope"}}
    )
    return path / "ScopeData.mat"


def to_workspace(path: Path, r: Record) -> Path:
    """Simulink's To Workspace, structures with time: one for each signal, each with its own time."""
    blocks: dict[str, object] = {"tout": r["time"][:, None]}
    for name, values in zip(("pos_mm", "i_soll", "i_ist", "F_mess", "i_anregung"), _scaled(r), strict=True):
        signals = {"values": values[:, None], "dimensions": 1.0, "label": ""}
        blocks[name] = {"time": r["time"][:, None], "signals": signals, "blockName": f"lager/{name}"}
    savemat(path / "workspace.mat", blocks)
    return path / "workspace.mat"


def file_scope(path: Path, r: Record) -> Path:
    """Simulink Real-Time's file scope: a matrix, a cell of block paths, the time last."""
    names = ["Controller/Position [mm]", "Controller/i_ref", "IO/i_meas", "IO/Force", "Controller/Injection", "Time"]
    data = {
        "version": 1.0,
        "data": np.column_stack([*_scaled(r), r["time"]]),
        "signames": np.array(names, dtype=object),
    }
    savemat(path / "file_scope.mat", {"matlab_data": data})
    return path / "file_scope.mat"


def twincat(path: Path, r: Record) -> Path:
    """TwinCAT Scope: a time in ms for every channel, keys above the times, no row of names above the numbers."""
    variables = [f"MAIN.fbLager.{name}" for name in ("fPosition", "fStromSoll", "fStromIst", "fKraft", "fAnregung")]
    text = (
        "Name;Scope Project\nFile;C:\\Scope\\Lager.tcscopex\nStarttime of export;133604106621234567;10:31:02.123\n\n\n"
    )
    for key, cells in (
        ("Name", variables), ("SymbolComment", [""] * 5), ("Data-Type", ["REAL64"] * 5),
        ("SampleTime[ms]", ["0,05"] * 5), ("IndexGroup", [16448] * 5), ("NetID", ["5.34.1.2.1.1"] * 5),
        ("Offset", [0] * 5), ("ScaleFactor", [1] * 5), ("Unit", ["mm (Length)", *["(None)"] * 4]),
        ("Unit ScaleFactor", [1] * 5),
    ):  # fmt: skip
        text += _row((f"{key};{cell}" for cell in cells), ";")
    pairs = [c for values in _scaled(r) for c in (r["time"] * 1e3, values)]
    (path / "twincat.csv").write_text(text + "\n" + _rows(pairs, "%.8f", ";").replace(".", ","), encoding="utf-8-sig")
    return path / "twincat.csv"


def to_file(path: Path, r: Record) -> Path:
    """Simulink's To File, array: a row for each signal, the time first, no names."""
    savemat(path / "to_file.mat", {"ans": np.stack([r["time"], *[r[name] for name in FIVE[:3]]])})
    return path / "to_file.mat"


def _volts(r: Record) -> list[np.ndarray]:
    """Probe at 10 V/mm, and two current clamps at 1 V/A."""
    return [r["displacement"] * 1e4, r["command"], r["current"]]


def tektronix(path: Path, r: Record) -> Path:
    """Tektronix MSO: a preamble with labels and units of the channels, time before the trigger."""
    text = f"Model,MSO46\n\nHorizontal Units,s,,,\nSample Interval,5e-05,,,\nRecord Length,{r['time'].size},,,\n"
    text += "Probe Attenuation,10,1,1,\nVertical Units,V,V,V,\nVertical Offset,0,0,0,\n,,,\nLabel,GAP,I_REF,I_COIL\n"
    columns = [r["time"] - 0.4, *_volts(r)]
    (path / "tek0001.csv").write_text(text + "TIME,CH1,CH2,CH3\n" + _rows(columns, "%.9g", ","))
    return path / "tek0001.csv"


def tektronix_beside(path: Path, r: Record) -> Path:
    """Tektronix TDS: the preamble stands beside the first samples, in columns of its own."""
    beside = [
        "Record Length,2.5e+04,",
        "Sample Interval,5e-05,",
        ",,",
        "Source,CH1,",
        "Vertical Units,V,",
        "Yzero,0.0,",
    ]
    rows = zip(r["time"], _volts(r)[0], strict=True)
    lines = [f"{beside[j] if j < len(beside) else ',,'},{t:018.12f},{y:12.6f},\n" for j, (t, y) in enumerate(rows)]
    (path / "F0000CH1.CSV").write_text("".join(lines))
    return path / "F0000CH1.CSV"


def rigol(path: Path, r: Record) -> Path:
    """Rigol DS: numbered samples; where they begin and their step stand behind the names, and a further comma there."""
    text = "X,CH1,CH2,CH3,Start,Increment,\nSequence,VOLT,VOLT,VOLT,-4.000000e-01,5.000000e-05,\n"
    numbers = np.arange(r["time"].size)
    (path / "rigol.csv").write_text(text + _rows([numbers, *_volts(r)], "%.9g", ",", ",,\n"))
    return path / "rigol.csv"


def keysight(path: Path, r: Record) -> Path:
    """Keysight: channels are numbers, units in words."""
    text = "x-axis,1,2,3\nsecond,Volt,Volt,Volt\n"
    (path / "scope_0.csv").write_text(text + _rows([r["time"], *_volts(r)], "%+.9E", ","))
    return path / "scope_0.csv"


def picoscope(path: Path, r: Record) -> Path:
    """PicoScope: units in a row of their own, a blank line below it."""
    text = "Time,Channel A,Channel B,Channel C\n(ms),(V),(A),(A)\n\n"
    (path / "pico.csv").write_text(text + _rows([r["time"] * 1e3 - 100, *_volts(r)], "%.8f", ","))
    return path / "pico.csv"


NAMED: tuple[Callable[[Path, Record], Path], ...] = (
    lvm_packets, lvm_without_time, controldesk, structure_with_time, to_workspace, file_scope, twincat,
)  # fmt: skip
UNNAMED: tuple[Callable[[Path, Record], Path], ...] = (to_file, tektronix, rigol, keysight, picoscope)
