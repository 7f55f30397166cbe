"""Prove that two source trees compute the same: run the same small jobs in both, compare every file they write.

Usage: python tests/tools/same_results.py OLD NEW [--out FOLDER] [--only NAME ...] [--tolerance 0] [--no-pages]

Each job is one `maglev` command in a process of its own, forked from one that has loaded only third-party libraries
(so it needs POSIX). Nothing is written into the trees: bytecode and compiled kernels go to --cache. JSON, npz, netCDF
and text are compared exactly, nan equal to nan; what says who made a result, when and how fast is left out. Of pages
and of what a command prints, times and code versions are masked. Exit status 1 when anything differs by more than
--tolerance, or a job fails.
"""

import argparse
import contextlib
import json
import os
import re
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from math import inf
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import scipy.io

COMMANDS = {"maglev_workbench/cli.py": "maglev_workbench.cli", "tuning/cli.py": "tuning.cli"}  # the newer tree's first
PACKAGES = (
    "benchmarks", "estimation", "maglev_env", "maglev_lanes", "maglev_workbench", "selfsense", "sim2real", "tuning",
)  # fmt: skip
LIBRARIES = ("scipy.signal", "scipy.optimize", "numba", "xarray", "h5netcdf", "plotly.graph_objects", "typer", "rich")
# Keys of JSON objects, attributes and arrays that say who made a result, when or how fast, and not what it is. The
# identity of a sweep is a hash of its settings, which are compared, and of the code version.
IGNORED = {
    "version", "identity", "date", "seconds", "experiments_per_second", "tuner_seconds", "clock", "own", "__header__",
}  # fmt: skip
TIMED = {"compare"}  # jobs whose pages and printed tables tell times without a unit
SKIPPED = {"lock", "lock.json", "journal.jsonl"}  # files that hold times and process ids; what they lead to is compared
MASKS = (  # of text: code versions and what is made of them, clock times, and seconds and rates of runs
    (re.compile(r"Identity</th><td>[0-9a-f]{64}"), "IDENTITY"),
    (re.compile(r"\d+\.\d+\.\d+\+[0-9a-f]{12}"), "VERSION"),
    (re.compile(r"\d+:\d\d:\d\d"), "CLOCK"),
    (re.compile(r"\b[\d.,]+ (m?s|experiments/s)(?=[,;.]|\s|$)"), "TIME"),
)
LINEAR = "[gains]\nnumerator = [60000.0, -52000.0]\ndenominator = [1.0, 0.0]\n\n"  # A/m: 8000 and 2.6 A s/m at 20 kHz
CROSS = "\n[cross]\nstiffness_xy = 100.0\nstiffness_yx = -100.0\ndamping_xy = 0.1\ngain_xy = 0.2\nsensor_xy = 0.01\n"

# Name of a job -> arguments of `maglev`. A job runs in a folder of its own; those beside it are what came before it.
JOBS = {
    "sweep": "sweep --kp 6000:12000:3 --kd 3:8:3 --threads 1 --out sweep --json sweep.json",
    "sweep-effects": "sweep --kp 6000:12000:2 --kd 3:8:2 --effect eddy_current=1400 --effect friction=0.05 --threads 1"
    " --out sweep --json sweep.json",
    "sweep-sobol": "sweep --rig hmb_free --sobol 5 --seed 3 --threads 1 --out sweep --json sweep.json",
    "sweep-xy": "sweep --rig hmb_radial --kp 6000:12000:2 --kd 4:8:2 --threads 1 --out sweep --json sweep.json",
    "sweep-coupled": "sweep --rig ../cross.toml --kp 8000 --kd 5:6:2 --threads 1 --out sweep --json sweep.json",
    "sweep-sensed": "sweep --kp 8000 --kd 4:8:2 --sensor self_sensing --threads 1 --out sweep --json sweep.json",
    "simulate": "simulate --protocol diagnosis --effect delay=75e-6 --effect saturation=1.2"
    " --effect support_resonance=180 --out campaign --json simulate.json",
    "simulate-delay": "simulate --periods 3 --effect delay=75e-6 --seed 1 --out campaign --json simulate.json",
    "simulate-radial": "simulate --rig hmb_radial --periods 2 --effect cross_coupling=0.05 --out campaign",
    "simulate-axial": "simulate --rig hmb_axial --out campaign",
    "simulate-pedestal": "simulate --rig pedestal --out campaign",
    "simulate-eframe": "simulate --rig eframe --out campaign",
    "simulate-linear": "simulate --rig ../linear.toml --periods 3 --out campaign",
    "simulate-sensed": "simulate --sensor self_sensing --periods 2 --format mat --out campaign",
    "estimate": "estimate ../simulate-delay/campaign --json estimate.json --out estimate.html",
    "estimate-xy": "estimate ../simulate-radial/campaign --json estimate.json --out estimate.html",
    "check": "check ../simulate/campaign --json check.json --out check.html",
    "diagnose": "diagnose ../simulate-delay/campaign --json diagnose.json --out diagnosis",
    "levitate": "selfsense levitate --points 2 --threads 1 --json levitate.json",
    "coil-record": "selfsense record --seconds 0.02 --out coil --json record.json",
    "coil-estimate": "selfsense estimate ../coil-record/coil --json estimate.json",
    "runup": "runup --speeds 0:6000:2000 --threads 1 --out runup --json runup.json",
    "tune": "tune --method tpe --budget 5 --protocol quick --threads 1 --out study --json tune.json",
    "compare": "compare rule sobol cma-es learned model --rigs 2 --budgets 2,4 --protocol quick --out comparison"
    " --json compare.json",
    "reproduce": "reproduce sphs pedestal --out page --json reproduce.json",
}


@dataclass
class Difference:
    """What differs of a job: largest relative difference of numbers (inf where anything else differs), and where."""

    largest: float = 0.0
    places: list[str] = field(default_factory=list)
    compared: int = 0  # values

    def add(self, where: str, what: str, relative: float = inf) -> None:
        self.largest = max(self.largest, relative)
        self.places.append(f"{where}: {what}")


def main() -> None:
    args = _arguments()
    if args.serve:
        _serve(args.old)
        return
    names = [name for name in JOBS if not args.only or name in _needed(args.only)]
    trees = {"old": args.old.resolve(), "new": args.new.resolve()}
    with contextlib.ExitStack() as stack:
        out = args.out or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="same-results-")))
        for side, tree in trees.items():
            if (out / side).exists():
                sys.exit(f"{out / side} exists; choose another --out or delete it")
            print(f"{side}: {tree} ({_module(tree)})")
        runs = {side: _run(tree, out.resolve() / side, args.cache, trees["old"], names) for side, tree in trees.items()}
        print(f"\n{'job':<20}{'old s':>8}{'new s':>8}{'files':>7}{'values':>10}  result")
        worst = 0.0
        for name in names:
            codes = [runs[side][name]["code"] for side in trees]
            found, files = _compare_folders(out / "old" / name, out / "new" / name, args.pages and name not in TIMED)
            for side in trees:
                if runs[side][name]["stray"]:
                    found.add(side, f"loaded from outside the tree: {', '.join(runs[side][name]['stray'])}")
            if any(codes):
                found.add("exit status", f"{codes[0]} and {codes[1]}")
            worst = max(worst, found.largest)
            seconds = "".join(f"{runs[side][name]['seconds']:8.1f}" for side in trees)
            print(f"{name:<20}{seconds}{files:7}{found.compared:10}  {_verdict(found)}")
            for place in found.places[: args.places]:
                print(f"    {place}")
            if len(found.places) > args.places:
                print(f"    and {len(found.places) - args.places} more")
            if any(codes):
                side = "old" if codes[0] else "new"
                print((out / side / name / "printed.txt").read_text(errors="replace")[-1500:])
        for side in trees:
            print(f"{side}: {sum(run['seconds'] for run in runs[side].values()):.0f} s in all")
    same = worst <= args.tolerance
    print("all results are the same" if same else f"results differ (largest relative difference {worst:.3g})")
    sys.exit(0 if same else 1)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, help="source tree of the reference")
    parser.add_argument("new", type=Path, help="source tree to prove equal")
    parser.add_argument("--out", type=Path, help="keep what the jobs write in this folder (default: deleted)")
    parser.add_argument("--only", nargs="+", choices=JOBS, metavar="NAME", help=f"of {', '.join(JOBS)}")
    parser.add_argument("--tolerance", type=float, default=0.0, help="largest relative difference allowed (default 0)")
    parser.add_argument("--no-pages", dest="pages", action="store_false", help="leave out HTML and what is printed")
    parser.add_argument("--places", type=int, default=6, help="differences listed per job (default 6)")
    cache = Path(tempfile.gettempdir()) / f"maglev-same-results-{os.getuid()}"
    parser.add_argument("--cache", type=Path, default=cache, help="bytecode and kernels (default: %(default)s)")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


def _needed(only: list[str]) -> set[str]:
    """The jobs named, and those whose results they read."""
    found = set(only)
    for name in reversed(JOBS):
        if name in found:
            found |= {part.split("/")[1] for part in JOBS[name].split() if part.startswith("../")} & set(JOBS)
    return found


def _module(tree: Path) -> str:
    """The module of a tree that is its command."""
    for path, module in COMMANDS.items():
        if (tree / path).is_file():
            return module
    sys.exit(f"{tree}: holds none of {', '.join(COMMANDS)}")


def _run(tree: Path, folder: Path, cache: Path, rigs: Path, names: list[str]) -> dict[str, dict[str, Any]]:
    """Run the jobs in a tree: exit code, seconds and modules from elsewhere, by job."""
    folder.mkdir(parents=True)
    _write_rigs(rigs / "maglev_env" / "rigs", folder)
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    cache = cache.resolve()
    caches = {"PYTHONPYCACHEPREFIX": str(cache / "bytecode"), "NUMBA_CACHE_DIR": str(cache / "numba")}
    environment = os.environ | threads | caches | {"PYTHONPATH": str(tree), "COLUMNS": "200", "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-P", __file__, "--serve", str(tree), str(tree)]
    found = {}
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        for name in names:
            (folder / name).mkdir()
            print(json.dumps([_module(tree), str(folder / name), JOBS[name].split()]), file=server.stdin, flush=True)
            answer = server.stdout.readline()
            if not answer:
                sys.exit(f"{tree}: the process that runs the jobs ended at {name}")
            found[name] = json.loads(answer)
            print(f"  {folder.name} {name}: {found[name]['seconds']:.1f} s", file=sys.stderr)
        server.stdin.close()
    return found


def _write_rigs(presets: Path, folder: Path) -> None:
    """Rigs beyond the presets: one with a linear controller, one with coupled axes. Made of the old tree's for both."""
    text = (presets / "hmb_free.toml").read_text(encoding="utf-8")
    linear = re.sub(r"\[gains\].*?(?=\[noise\])", LINEAR, text, flags=re.DOTALL)
    (folder / "linear.toml").write_text(linear, encoding="utf-8")
    text = (presets / "hmb_radial.toml").read_text(encoding="utf-8")
    (folder / "cross.toml").write_text(text.replace("\n[noise]", CROSS + "\n[noise]", 1), encoding="utf-8")


def _serve(tree: Path) -> None:
    """Fork a process for each job that a line on stdin asks for: [module, folder, arguments]; answer with a line."""
    for library in LIBRARIES:
        import_module(library)
    for line in sys.stdin:
        module, folder, arguments = json.loads(line)
        started, reading, writing = perf_counter(), *os.pipe()
        child = os.fork()
        if not child:
            os.close(reading)
            code = _job(module, Path(folder), arguments)
            os.write(writing, json.dumps(_strays(tree)).encode())
            os._exit(code)
        os.close(writing)
        with os.fdopen(reading) as answer:
            stray = json.loads(answer.read() or "[]")
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        print(json.dumps({"code": code, "seconds": perf_counter() - started, "stray": stray}), flush=True)


def _job(module: str, folder: Path, arguments: list[str]) -> int:
    """Run a command as `python -m` does; what it prints goes to a file."""
    os.chdir(folder)
    printed = os.open("printed.txt", os.O_WRONLY | os.O_CREAT)
    for stream in (1, 2):
        os.dup2(printed, stream)
    sys.argv = ["maglev", *arguments]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=False)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        sys.excepthook(*sys.exc_info())
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


def _strays(tree: Path) -> list[str]:
    """The project's modules that were loaded, but not from the tree."""
    loaded = {n: getattr(m, "__file__", None) for n, m in sys.modules.items() if n.split(".")[0] in PACKAGES}
    return sorted(n for n, file in loaded.items() if file and not Path(file).resolve().is_relative_to(tree.resolve()))


def _compare_folders(old: Path, new: Path, pages: bool) -> tuple[Difference, int]:
    """What differs between the files of a job, and how many files it wrote."""
    found = Difference()
    files = [{p.relative_to(root).as_posix(): p for p in root.rglob("*") if p.is_file()} for root in (old, new)]
    count = 0
    for name in sorted(files[0].keys() | files[1].keys()):
        if Path(name).name in SKIPPED or (not pages and (name.endswith(".html") or name == "printed.txt")):
            continue
        if any(name not in side for side in files):
            found.add(name, f"only in {'old' if name in files[0] else 'new'}")
            continue
        count += 1
        _compare_files(name, files[0][name], files[1][name], found)
    return found, count


def _compare_files(name: str, old: Path, new: Path, found: Difference) -> None:
    suffix = old.suffix
    if suffix == ".json":
        _compare(name, *(json.loads(p.read_text(encoding="utf-8")) for p in (old, new)), found)
    elif suffix == ".npz":
        _compare(name, *(dict(np.load(p)) for p in (old, new)), found)
    elif suffix == ".mat":
        _compare(name, *(scipy.io.loadmat(p) for p in (old, new)), found)
    elif suffix == ".nc":
        _compare(name, *(dict(_netcdf(p)) for p in (old, new)), found)
    elif suffix in (".html", ".toml", ".txt", ".md", ".csv"):
        found.compared += 1
        lines = [_masked(p.read_text(encoding="utf-8")).splitlines() for p in (old, new)]
        if lines[0] != lines[1]:
            pairs = list(zip(*lines, strict=False))
            at = next((i for i, (a, b) in enumerate(pairs) if a != b), len(pairs))
            texts = [side[at] if at < len(side) else "" for side in lines]
            apart = next((i for i, (a, b) in enumerate(zip(*texts, strict=False)) if a != b), 0)
            start = max(apart - 20, 0)
            found.add(name, f"line {at + 1}: {texts[0][start : start + 70]!r} and {texts[1][start : start + 70]!r}")
    else:
        found.compared += 1
        if old.read_bytes() != new.read_bytes():
            found.add(name, "bytes differ")


def _netcdf(path: Path) -> Iterator[tuple[str, Any]]:
    """Variables and attributes of a netCDF file."""
    import xarray as xr

    with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as data:
        for name, one in data.variables.items():
            yield str(name), {"dims": list(one.dims), "values": one.values, "attributes": dict(one.attrs)}
        yield "attributes", dict(data.attrs)


def _masked(text: str) -> str:
    for pattern, word in MASKS:
        text = pattern.sub(word, text)
    return text


def _compare(where: str, old: Any, new: Any, found: Difference) -> None:
    """Compare JSON data, arrays, and mappings of either."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in old.keys() | new.keys():
            if key in IGNORED:
                continue
            if key not in old or key not in new:
                found.add(f"{where}/{key}", f"only in {'old' if key in old else 'new'}")
            else:
                _compare(f"{where}/{key}", old[key], new[key], found)
    elif isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            found.add(where, f"{len(old)} and {len(new)} entries")
        for i, pair in enumerate(zip(old, new, strict=False)):
            _compare(f"{where}/{i}", *pair, found)
    elif isinstance(old, str) and isinstance(new, str):
        found.compared += 1
        if _masked(old) != _masked(new):
            found.add(where, f"{old[:60]!r} and {new[:60]!r}")
    elif type(old) is not type(new):
        found.add(where, f"{type(old).__name__} and {type(new).__name__}")
    else:
        _compare_arrays(where, np.asarray(old), np.asarray(new), found)


def _compare_arrays(where: str, old: np.ndarray, new: np.ndarray, found: Difference) -> None:
    found.compared += old.size
    if old.dtype != new.dtype or old.shape != new.shape:
        found.add(where, f"{old.dtype} {old.shape} and {new.dtype} {new.shape}")
    elif old.dtype.kind not in "fc":
        if not np.array_equal(old, new):
            found.add(where, f"{np.count_nonzero(old != new)} of {old.size} values differ")
    elif not np.array_equal(old, new, equal_nan=True):
        with np.errstate(all="ignore"):
            relative = np.abs(old - new) / np.maximum(np.abs(old), np.abs(new))
        relative = np.where((old == new) | (np.isnan(old) & np.isnan(new)), 0.0, relative)
        largest = float(np.nan_to_num(relative, nan=inf).max())
        found.add(where, f"{np.count_nonzero(relative)} of {old.size} values, relative {largest:.3g}", largest)


def _verdict(found: Difference) -> str:
    if not found.places:
        return "identical"
    size = "" if found.largest == inf else f", largest relative difference {found.largest:.3g}"
    return f"{len(found.places)} differ{size}"


if __name__ == "__main__":
    main()
