"""One record of a simulated rig in the layouts of other programs, none written by this project's own writers."""

from collections.abc import Callable, Mapping
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat

Record = Mapping[str, np.ndarray]  # channel -> (samples,) in SI, with "time"


def matrix(path: Path, r: Record) -> Path:
    """MATLAB v5: one matrix and a cell of names."""
    names = np.array(["t", "y_mm", "i_soll_A", "i_A", "F_N", "stoerung_A"], dtype=object)
    columns = [r["time"], r["displacement"] * 1e3, r["command"], r["current"], r["force"], r["injection"]]
    savemat(path / "matrix.mat", {"data": np.column_stack(columns), "names": names})
    return path / "matrix.mat"


def struct(path: Path, r: Record) -> Path:
    """MATLAB v5: a struct of named vectors and the sample rate as a number."""
    rows = {"pos_um": r["displacement"] * 1e6, "icmd": r["command"], "imeas": r["current"], "kraft": r["force"]}
    savemat(path / "struct.mat", {"rec": {**rows, "dither": r["injection"], "fs": 20000.0}})
    return path / "struct.mat"


def dspace(path: Path, r: Record) -> Path:
    """dSPACE ControlDesk: X and Y structs, names as model paths."""
    named = {
        "position": r["displacement"], "command": r["command"], "current": r["current"], "force": r["force"],
        "injection": r["injection"],
    }  # fmt: skip
    y = np.zeros((1, len(named)), dtype=[("Name", "O"), ("Unit", "O"), ("Data", "O")])
    units = {"position": "m", "force": "N"}
    for j, (name, values) in enumerate(named.items()):
        y[0, j] = (f"Model Root/Bearing/{name}/Out1", units.get(name, "A"), values[None].astype(np.float32))
    x = {"Name": "", "Data": r["time"][None]}
    savemat(path / "dspace.mat", {"mb10": {"X": x, "Y": y, "Capture": {"SamplingPeriod": 5e-5}}})
    return path / "dspace.mat"


def hdf5_mat(path: Path, r: Record) -> Path:
    """MATLAB 7.3: row vectors stored transposed in HDF5 behind a MATLAB header."""
    file = path / "run73.mat"
    names = {"zeit": "time", "weg": "displacement", "strom": "current", "sollstrom": "command", "kraft": "force"}
    with h5py.File(file, "w", userblock_size=512) as f:
        for name, channel in {**names, "anregung": "injection"}.items():
            f.create_dataset(name, data=r[channel][:, None]).attrs["MATLAB_class"] = np.bytes_("double")
    with file.open("r+b") as f:
        f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    return file


def npz(path: Path, r: Record) -> Path:
    """numpy, letters for names."""
    np.savez(path / "run.npz", t=r["time"], x=r["displacement"], i_ref=r["command"], i=r["current"], F=r["force"],
             exc=r["injection"])  # fmt: skip
    return path / "run.npz"


def groups(path: Path, r: Record) -> Path:
    """HDF5 with groups and the rate as a number."""
    with h5py.File(path / "run.h5", "w") as f:
        f["acquisition/sample_rate"] = 20000.0
        f["acquisition/sensors/displacement"] = r["displacement"]
        f["acquisition/sensors/force"] = r["force"]
        f["acquisition/coil/current"] = r["current"]
        f["acquisition/coil/setpoint"] = r["command"]
        f["acquisition/coil/injection"] = r["injection"]
    return path / "run.h5"


def _table(r: Record, names: Mapping[str, tuple[str, float]], separator: str, comma: bool = False) -> str:
    rows = np.column_stack([r[channel] / unit for channel, unit in names.values()])
    text = separator.join(names) + "\n" + "".join(separator.join(f"{v:.9g}" for v in row) + "\n" for row in rows)
    return text.replace(".", ",") if comma else text


def csv_units(path: Path, r: Record) -> Path:
    """CSV with units in the header."""
    names = {
        "Time [s]": ("time", 1.0), "Gap sensor [um]": ("displacement", 1e-6), "Current command [A]": ("command", 1.0),
        "Coil current [A]": ("current", 1.0), "Shaker force [N]": ("force", 1.0), "Dither [mA]": ("injection", 1e-3),
    }  # fmt: skip
    (path / "units.csv").write_text(_table(r, names, ","))
    return path / "units.csv"


def semicolon(path: Path, r: Record) -> Path:
    """CSV of a German spreadsheet: semicolons, decimal commas."""
    names = {
        "Zeit [s]": ("time", 1.0), "Weg [mm]": ("displacement", 1e-3), "Sollstrom [A]": ("command", 1.0),
        "Iststrom [A]": ("current", 1.0), "Kraft [N]": ("force", 1.0), "Stoerung [A]": ("injection", 1.0),
    }  # fmt: skip
    (path / "deutsch.csv").write_text(_table(r, names, ";", comma=True))
    return path / "deutsch.csv"


def headerless(path: Path, r: Record) -> Path:
    """Columns between blanks without names: time, displacement, command, current."""
    np.savetxt(path / "log.txt", np.column_stack([r[n] for n in ("time", "displacement", "command", "current")]))
    return path / "log.txt"


def labview(path: Path, r: Record) -> Path:
    """LabVIEW .lvm: a preamble, a comment column, tabs."""
    preamble = (
        "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
        "X_Columns\tOne\nTime_Pref\tRelative\nDate\t2024/05/17\n***End_of_Header***\t\n\t\nChannels\t5\t\t\t\t\t\n"
        "Samples\t25000\t25000\t25000\t25000\t25000\t\n***End_of_Header***\t\t\t\t\t\t\n"
    )
    names = ("X_Value", "Position (mm)", "Command (A)", "Current (A)", "Force (N)", "Injection (A)")
    sources = ("time", "displacement", "command", "current", "force", "injection")
    scaled = [r[n] * (1e3 if n == "displacement" else 1.0) for n in sources]
    rows = "".join("\t".join(f"{v:.6f}" if j else f"{v:.8f}" for j, v in enumerate(row)) + "\t\n"
                   for row in zip(*scaled, strict=True))  # fmt: skip
    (path / "run.lvm").write_text(preamble + "\t".join(names) + "\tComment\n" + rows)
    return path / "run.lvm"


def umlauts(path: Path, r: Record) -> Path:
    """Latin-1 with umlauts and a micro sign."""
    names = {
        "Zeit in s": ("time", 1.0), "Position in µm": ("displacement", 1e-6), "Stellgröße in A": ("command", 1.0),
        "Strom in A": ("current", 1.0), "Kraft in N": ("force", 1.0), "Störgröße Anregung in mA": ("injection", 1e-3),
    }  # fmt: skip
    (path / "umlaute.csv").write_bytes(_table(r, names, ";").encode("latin-1"))
    return path / "umlaute.csv"


def timeless(path: Path, r: Record) -> Path:
    """CSV in mm and mA without a time column."""
    names = {
        "y (mm)": ("displacement", 1e-3), "i_ref (mA)": ("command", 1e-3), "i (mA)": ("current", 1e-3),
        "F (N)": ("force", 1.0), "inj (mA)": ("injection", 1e-3),
    }  # fmt: skip
    (path / "timeless.csv").write_text(_table(r, names, ","))
    return path / "timeless.csv"


LAYOUTS: tuple[Callable[[Path, Record], Path], ...] = (
    matrix, struct, dspace, hdf5_mat, npz, groups, csv_units, semicolon, headerless, labview, umlauts, timeless,
)  # fmt: skip
