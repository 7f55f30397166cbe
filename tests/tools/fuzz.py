"""Does every call of `maglev` end in an answer or in a sentence? Draw hostile calls and watch each of them.

    python tests/tools/fuzz.py [COUNT] [--seed 0] [--jobs 1] [--limit 90] [--out fuzz.json] [--only N]

Each call runs in a fresh folder of small files, spoiled by `fuzz_inputs.py`, in a process forked from this one (one in
fifty is the real command started anew). It must end with exit code 0, 2 or 130, without a traceback that --verbose did
not ask for, without a silence of more than 60 s, and with less than 4 GiB of memory. What works for longer than
--limit seconds is ended, which is no fault. CI runs 300; nightly, 20,000 is the size. --only N repeats call N of the
seed and shows what it printed. Exit status 0: nothing was found.
"""

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
from fuzz_inputs import case, prepare

CODES = (0, 2, 130)
SILENCE = 60.0  # s
MEMORY = 4 * 1024**3  # bytes
STARTED = 50  # every so many calls the command is started anew


@dataclass(frozen=True)
class Call:
    """One call: what was typed, how it ended and what was wrong with that, if anything."""

    number: int
    words: list[str]
    code: int
    seconds: float
    memory: int
    wrong: str
    said: str


def watched(number: int, words: list[str], folder: Path, anew: bool, limit: float) -> Call:
    """Run a call in a folder and judge how it ended."""
    printed = folder.with_suffix(".out")
    started = time.monotonic()
    pid = os.fork()
    if pid == 0:
        _child(words, folder, printed, anew)
    heard, size, silence = started, 0, 0.0
    while True:
        ended, status, usage = os.wait4(pid, os.WNOHANG)
        now = time.monotonic()
        if printed.exists() and printed.stat().st_size != size:
            heard, size = now, printed.stat().st_size
        silence = max(silence, now - heard)
        if ended:
            break
        if now - started > limit:
            os.killpg(pid, signal.SIGKILL)
            _, status, usage = os.wait4(pid, 0)
            break
        time.sleep(0.01)
    seconds, code = time.monotonic() - started, os.waitstatus_to_exitcode(status)
    said = printed.read_text(errors="replace") if printed.exists() else ""
    printed.unlink(missing_ok=True)
    long = seconds > limit
    asked = code in CODES and not {"-v", "--verbose"}.isdisjoint(words)  # it shows where bad input was found
    wrong = (
        "traceback" if "Traceback (most recent call last)" in said and not asked
        else "silent" if silence > SILENCE
        else "memory" if usage.ru_maxrss * 1024 > MEMORY
        else f"exit code {code}" if not long and code not in CODES
        else ""
    )  # fmt: skip
    return Call(number, words, code, seconds, usage.ru_maxrss * 1024, wrong, said[-3000:])


def _child(words: list[str], folder: Path, printed: Path, anew: bool) -> None:
    """Become the call; never returns."""
    code = 1
    try:
        os.setpgid(0, 0)
        os.chdir(folder)
        out = os.open(printed, os.O_CREAT | os.O_WRONLY | os.O_APPEND)
        nothing = os.open(os.devnull, os.O_RDONLY)
        for old, new in ((nothing, 0), (out, 1), (out, 2)):
            os.dup2(old, new)
        os.environ["COLUMNS"] = "200"
        if anew:
            os.execv(sys.executable, [sys.executable, "-m", "maglev_workbench.cli", *words])
        sys.argv = ["maglev", *words]
        from maglev_workbench.cli import app

        app(words)
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def call(number: int, seed: int, sound: Path, limit: float) -> Call:
    """Draw and run one call."""
    folder = sound.parent / f"call-{number}"
    shutil.copytree(sound, folder, symlinks=True, copy_function=_copy)
    words = case(np.random.default_rng((seed, number)), folder)
    found = watched(number, words, folder, number % STARTED == STARTED - 1, limit)
    shutil.rmtree(folder, ignore_errors=True)
    return found


def _copy(source: str, target: str) -> None:
    """Files as they are; a pipe, which a copy would wait for, is made anew."""
    if Path(source).is_fifo():
        os.mkfifo(target)
    else:
        shutil.copy(source, target)


def fuzz(count: int, seed: int, limit: float, share: tuple[int, int] = (0, 1), show: int = 0) -> list[Call]:
    """Run the calls of one of several processes: (its number, how many there are)."""
    calls = []
    with tempfile.TemporaryDirectory(prefix="fuzz-", ignore_cleanup_errors=True) as scratch:
        sound = Path(scratch, "sound")
        sound.mkdir()
        prepare(sound)
        for number in range(share[0], count, share[1]):
            calls.append(call(number, seed, sound, limit))
            if calls[-1].wrong:
                print(f"call {number}: {calls[-1].wrong}: maglev {' '.join(calls[-1].words)}", flush=True)
            if show and len(calls) % show == 0:
                print(f"{len(calls)} calls, {sum(bool(c.wrong) for c in calls)} wrong", flush=True)
    return calls


def preload() -> None:
    """Import what commands import when they are called: each call is a copy of this process and need not again."""
    for package in ("maglev_workbench", "tuning", "sim2real"):
        for module in walk_packages(import_module(package).__path__, f"{package}."):
            if not module.name.endswith("__main__"):
                import_module(module.name)
    for name in ("special", "linalg", "optimize", "signal", "stats", "ndimage", "interpolate", "integrate"):
        import_module(f"scipy.{name}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("count", nargs="?", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=90.0)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--only", type=int)
    asked = parser.parse_args()
    preload()
    if asked.only is not None:
        with tempfile.TemporaryDirectory(prefix="fuzz-", ignore_cleanup_errors=True) as scratch:
            sound = Path(scratch, "sound")
            sound.mkdir()
            prepare(sound)
            found = call(asked.only, asked.seed, sound, asked.limit)
        print(f"maglev {' '.join(found.words)}\n{found.said}")
        print(f"{found.code}, {found.seconds:.1f} s, {found.wrong or 'fine'}")
        return int(bool(found.wrong))
    shares = []
    with tempfile.TemporaryDirectory() as scratch:
        for job in range(asked.jobs):
            told = Path(scratch, f"{job}.json")
            if (pid := os.fork()) == 0:
                calls = fuzz(asked.count, asked.seed, asked.limit, (job, asked.jobs), 500)
                told.write_text(json.dumps([asdict(c) for c in calls]))
                os._exit(0)
            shares.append((pid, told))
        for pid, _ in shares:
            os.waitpid(pid, 0)
        calls = sorted((Call(**c) for _, told in shares for c in json.loads(told.read_text())), key=lambda c: c.number)
    wrong = [c for c in calls if c.wrong]
    print(f"{len(calls)} calls of seed {asked.seed}: exit codes {dict(Counter(c.code for c in calls))}")
    print(f"longest {max(c.seconds for c in calls):.1f} s, largest {max(c.memory for c in calls) / 2**30:.2f} GiB")
    print(f"{len(wrong)} wrong {dict(Counter(c.wrong for c in wrong))}")
    if asked.out:
        asked.out.write_text(json.dumps([asdict(c) for c in wrong], indent=1))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
