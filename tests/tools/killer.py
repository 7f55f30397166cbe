"""Does a command that is killed at any moment lose anything? Kill it, go on, and compare with a run left alone.

    python tests/tools/killer.py [KILLS] [--seed 0] [--only NAME ...] [--out killer.json]

Each job is a small sweep, study, training, comparison or sealed set. It is run once without disturbance, and then again
and again in new folders, where its process, or all of its processes, are ended by SIGKILL at a random moment; where the
disk is full (a small file system as root, else a limit of the size of files); or where a second process starts in the
same folder. The same command then goes on to its end. What it leaves must equal the undisturbed results bit for bit, or
it must be refused in a sentence, as a set that was killed while it was sealed. Exit status 0: that is so.
"""

import argparse
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_inputs import prepare

# What differs always: times, and the hash of a set's answers, which state theirs.
TIMES = ("seconds", "experiments_per_second", "tuner_seconds", "clock", "date", "own", "reused", "command")
TIMES += ("answers_sha256",)
TIMED_ROW = "mean time per campaign"  # of a sealed set's results
SKIPPED = ("lock", "lock.json")
HOW = ("process", "process", "group", "twice", "disk", "second")
JOBS: dict[str, str] = {
    "sweep": "sweep --rig ../rig.toml --kp 4000:12000:36 --kd 0.5:8:30 --threads 1 --out out",
    "sweep-workers": "sweep --rig ../rig.toml --kp 4000:12000:36 --kd 0.5:8:30 --scheduler local:2 --out out",
    **{
        f"tune-{method}": f"tune --protocol quick --method {method} --budget {budget} --threads 1 --out out"
        for method, budget in (
            ("grid", 8), ("sobol", 12), ("de", 12), ("cma-es", 12), ("tpe", 14), ("gp", 8), ("rule", 6), ("model", 5),
            ("learned", 8),
        )
    },
    "train": "train --protocol quick --rigs 6 --held-out 2 --out out",
    "compare": "compare sobol tpe --protocol quick --rigs 2 --budgets 2,4 --out out",
    "blind": "blind run --seed 7 --count 2 --processes 1 --out out",
}  # fmt: skip


@dataclass(frozen=True)
class Trial:
    """One disturbance: the job, what was done to it and after how many seconds, and what was wrong, if anything."""

    job: str
    how: str
    after: float
    refused: str
    wrong: str


def start(words: list[str], folder: Path, largest: int | None = None) -> subprocess.Popen:
    """The command in a folder, as the leader of its own process group."""

    def limit() -> None:
        if largest is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    return subprocess.Popen(
        [sys.executable, "-m", "maglev_workbench.cli", *words], cwd=folder, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, errors="replace", start_new_session=True, preexec_fn=limit,
    )  # fmt: skip


def finish(process: subprocess.Popen) -> tuple[int, str]:
    """Exit code and output."""
    said, _ = process.communicate(timeout=900)
    return process.returncode, said


def contents(folder: Path) -> dict[str, Any]:
    """What a job left, by file, without times."""
    found: dict[str, Any] = {}
    for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.name not in SKIPPED and p.suffix != ".html"):
        if path.name.startswith("."):
            continue  # unfinished files of a killed process
        name = str(path.relative_to(folder))
        if path.suffix == ".npz":
            with np.load(path, allow_pickle=False) as stored:
                parts = {key: stored[key] for key in stored.files if key not in TIMES}
            found[name] = {key: (v.shape, str(v.dtype), _plain(key, v)) for key, v in parts.items()}
        elif path.suffix == ".nc":
            import xarray as xr

            with xr.open_dataset(path, engine="h5netcdf") as d:
                found[name] = {str(k): d[k].values.tobytes() for k in d.variables}
        elif path.suffix == ".json":
            found[name] = _untimed(json.loads(path.read_text()))
        else:
            found[name] = path.read_bytes()
    return found


def _plain(key: str, values: np.ndarray) -> Any:
    """The bytes of an array; of a policy's head its JSON, which states times."""
    return _untimed(json.loads(values.tobytes())) if key == "head" else values.tobytes()


def _untimed(data: Any) -> Any:
    if isinstance(data, dict):
        if TIMED_ROW in data.values():
            return TIMED_ROW
        return {key: _untimed(value) for key, value in data.items() if key not in TIMES}
    return [_untimed(value) for value in data] if isinstance(data, list) else data


def disturb(words: list[str], folder: Path, how: str, after: float, rng: np.random.Generator) -> str:
    """Run a job and disturb it; returns what is wrong with how it took that."""
    if how == "disk":
        return _full_disk(words, folder, rng)
    first = start(words, folder)
    if how == "second":
        time.sleep(after)
        running = first.poll() is None
        code, said = finish(start(words, folder))
        held = "another process works there" in said
        mine = finish(first)
        if mine[0] != 0 and not (mine[0] == 2 and "another process works there" in mine[1]):
            return f"the first of two ended with {mine[0]}: {mine[1][-300:]}"
        return (
            "" if code == 0 or (code == 2 and (held or not running)) else f"the second ended with {code}: {said[-300:]}"
        )
    for pause in (after, float(rng.uniform(0, after))) if how == "twice" else (after,):
        if first.poll() is not None:
            first = start(words, folder)
        time.sleep(pause)
        if how == "group":
            os.killpg(first.pid, signal.SIGKILL)
        else:
            first.kill()
        first.communicate()
    return ""


def _full_disk(words: list[str], folder: Path, rng: np.random.Generator) -> str:
    """Run a job where files cannot grow, then give it room again."""
    size, mounted = int(rng.integers(4, 150)) * 1024, False
    if os.getuid() == 0:
        (folder / "out").mkdir()
        command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder / "out")]
        mounted = subprocess.run(command, capture_output=True).returncode == 0
    code, said = finish(start(words, folder, None if mounted else size))
    if mounted:
        subprocess.run(["mount", "-o", "remount,size=1g", str(folder / "out")], check=True)
    if code not in (0, 2) or "Traceback" in said:
        return f"a full disk ended it with {code}: {said[-600:]}"
    return "" if code == 0 or "maglev: " in said else f"a full disk is not named: {said[-300:]}"


def trial(job: str, how: str, scratch: Path, alone: dict[str, Any], lasted: float, rng: np.random.Generator) -> Trial:
    """Disturb a job in a new folder, let it go on, and compare."""
    folder, words = scratch / "trial", JOBS[job].split()
    folder.mkdir()
    after = float(rng.uniform(0.2, max(lasted, 0.4)))
    refused = ""
    try:
        wrong = disturb(words, folder, how, after, rng)
        if not wrong:
            code, said = finish(start(words, folder))
            if code == 2 and "maglev: " in said and "Traceback" not in said:
                refused = said[said.rindex("maglev: ") :].strip()
            elif code != 0:
                wrong = f"going on ended with {code}: {said[-600:]}"
            elif different := _different(contents(folder / "out"), alone):
                wrong = f"results differ: {different}"
    except subprocess.TimeoutExpired:
        wrong = "it hangs"
    subprocess.run(["umount", str(folder / "out")], capture_output=True)
    shutil.rmtree(folder, ignore_errors=True)
    return Trial(job, how, after, refused, wrong)


def _different(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    return [name for name in sorted({*one, *other}) if one.get(name) != other.get(name)]


def kill(kills: int, seed: int, names: list[str]) -> list[Trial]:
    """Disturb the jobs in turn."""
    rng, trials = np.random.default_rng(seed), []
    known: dict[str, tuple[dict[str, Any], float]] = {}
    with tempfile.TemporaryDirectory(prefix="killer-", ignore_cleanup_errors=True) as place:
        scratch = Path(place)
        prepare(scratch)
        for number in range(kills):
            job = names[number % len(names)]
            if job not in known:
                (scratch / "alone").mkdir()
                started = time.monotonic()
                code, said = finish(start(JOBS[job].split(), scratch / "alone"))
                if code != 0:
                    raise RuntimeError(f"{job} alone ended with {code}: {said[-2000:]}")
                known[job] = contents(scratch / "alone" / "out"), time.monotonic() - started
                shutil.rmtree(scratch / "alone")
            how = HOW[int(rng.integers(len(HOW)))]
            trials.append(trial(job, how, scratch, *known[job], rng))
            t = trials[-1]
            print(f"{number}: {job}, {how} after {t.after:.1f} s: {t.wrong or t.refused or 'equal'}", flush=True)
    return trials


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kills", nargs="?", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=JOBS, default=list(JOBS))
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    trials = kill(asked.kills, asked.seed, asked.only)
    wrong = [t for t in trials if t.wrong]
    refused = sum(bool(t.refused) for t in trials)
    equal = len(trials) - refused - len(wrong)
    print(f"{len(trials)} disturbances {dict(Counter(t.how for t in trials))}")
    print(f"{equal} equal, {refused} refused in a sentence, {len(wrong)} wrong")
    if asked.out:
        asked.out.write_text(json.dumps([asdict(t) for t in trials], indent=1))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
