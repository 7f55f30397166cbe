"""Measure the speed of two source trees in one run, in turn, so that a drift of the machine meets both alike.

Usage: python tests/tools/bench_ratio.py OLD NEW [--json FILE] [--only CASE ...] [--cold [N]]

One process per tree compiles and warms up; then both are asked for one short round at a time, in changing order. What
is timed is processor time (--wall: the clock), of one thread. They use public names alone (`from maglev_env import
...`), which both trees have. best: the shortest round; ratio: old time over new, above 1 the new tree is faster, of the
best rounds and as the median of the paired rounds with the half width of its 95 % interval. --cold: also what a first
sweep experiment costs with no compiled kernel on disk, and how many it compiles. Nothing is written into the trees.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import numpy as np

LANES = 64  # experiments together: whole blocks of any kernel
RECORDS = 16
PER_STEP, RATE = "ns per step and lane", "1/s"
Work = tuple[Callable[[], object], float]  # what a round runs, and how many units that is
# Cases by name, and in what their speed is told.
CASES = dict.fromkeys(
    (
        "quiet", "noise", "amplifier lag", "delay", "eddy current, friction", "x-y", "x-y noise", "x-y coupled",
        "x-y cross coupling effect", "self-sensing", "records",
    ), PER_STEP,
) | dict.fromkeys(("gain sets", "quick gain sets", "x-y gain sets", "rotor evaluations"), RATE)  # fmt: skip
COUPLING = {"stiffness_xy": 100.0, "stiffness_yx": -100.0, "damping_xy": 0.1, "gain_xy": 0.2, "sensor_xy": 0.01}


def cases() -> dict[str, Callable[[int], Work]]:
    """What prepares each of CASES, in some size; 1 is the smallest."""
    from maglev_env import effect, load_rig, protocol_experiment

    noisy, planar = protocol_experiment(load_rig("hmb_free")), protocol_experiment(load_rig("hmb_radial"))
    quiet = replace(noisy, rig=_quiet(noisy.rig))
    xy = replace(planar, rig=_quiet(planar.rig))
    coupled = replace(xy, rig=replace(xy.rig, cross=type(xy.rig.cross)(**COUPLING)))
    several = effect("eddy_current", 1400.0) | effect("friction", 0.05)
    kernels = {
        "quiet": quiet,
        "noise": noisy,
        "amplifier lag": replace(quiet, effects=effect("amplifier_lag", 1e-4)),
        "delay": replace(quiet, effects=effect("delay", 75e-6)),
        "eddy current, friction": replace(quiet, effects=several),
        "x-y": xy,
        "x-y noise": planar,
        "x-y coupled": coupled,
        "x-y cross coupling effect": replace(xy, effects=effect("cross_coupling", 0.05)),
        "self-sensing": replace(quiet, sensor="self_sensing"),
    }
    found = {name: partial(_kernel, e) for name, e in kernels.items()}
    return found | {
        "records": partial(_records, noisy),
        "gain sets": lambda size: _gain_sets(noisy, 16 * size),
        "quick gain sets": lambda size: _gain_sets(_quick(noisy), 64 * size),
        "x-y gain sets": lambda size: _gain_sets(planar, 4 * size),
        "rotor evaluations": _rotors,
    }


def _quick(e: Any) -> Any:
    from maglev_env import protocol_experiment
    from maglev_env.task.protocol import env_protocol

    return protocol_experiment(replace(e.rig, protocol=env_protocol(e.rig, "quick")))


def _quiet(rig: Any) -> Any:
    return replace(rig, noise=type(rig.noise)())


def _kernel(e: Any, size: int) -> Work:
    """Mostly the kernel: of a transient, which is simulated and dropped, nothing else is computed."""
    from maglev_env import simulate_statistics

    lanes = [replace(e, seed=i, periods=2, transient_periods=size) for i in range(LANES)]
    return lambda: simulate_statistics(lanes, threads=1), (size + 2) * e.samples_per_period * LANES


def _records(e: Any, size: int) -> Work:
    from maglev_env import simulate_records

    lanes = [replace(e, seed=i, periods=size, transient_periods=0) for i in range(RECORDS)]
    return lambda: simulate_records(lanes, threads=1), size * e.samples_per_period * RECORDS


def _gain_sets(e: Any, count: int) -> Work:
    """Simulated, estimated and scored."""
    from maglev_env import evaluate

    kp = np.geomspace(0.8, 1.25, count) * e.gains.kp
    sets = [replace(e, seed=i, gains=replace(e.gains, kp=float(k))) for i, k in enumerate(kp)]
    return lambda: evaluate(sets, threads=1), count


def _rotors(size: int) -> Work:
    """Run up over eight speeds, identified at standstill and the top one, and scored."""
    from maglev_env import evaluate_rotors, load_rotor

    rotors = [load_rotor("pump")] * size
    return lambda: evaluate_rotors(rotors, np.linspace(0, 14_000, 8), threads=1), size


def serve() -> None:
    """Answer lines of JSON: {"prepare": case, "size": n} with the seconds of a round and its units; anything else with
    the seconds of another round of the same."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever else is printed is no answer
    clock = {"cpu": process_time, "wall": perf_counter}[os.environ["BENCH_CLOCK"]]
    known, work, amount = cases(), None, 0.0
    for line in sys.stdin:
        asked = json.loads(line)
        if "prepare" in asked:
            work, amount = known[asked["prepare"]](asked["size"])
            work()  # compiles, and fills the caches
        started = clock()
        work()
        print(json.dumps({"seconds": clock() - started, "amount": amount}), file=answers, flush=True)


def first_experiment() -> None:
    """Print the processor seconds, with those of other processes, of importing and of the first and the second sweep
    experiment; and the seconds by the clock until the first is there."""

    def used() -> float:
        return sum(os.times()[:4])

    times, begun = [used()], perf_counter()
    from maglev_env import evaluate, load_rig, protocol_experiment

    experiment = protocol_experiment(load_rig("hmb_free"))
    times.append(used())
    evaluate([experiment], threads=1)
    clock = perf_counter() - begun
    times.append(used())
    evaluate([experiment], threads=1)
    times.append(used())
    spent = dict(zip(("import", "first", "second"), np.diff(times).tolist(), strict=True))
    print(json.dumps({**spent, "clock": clock}))


def _environment(tree: Path, cache: Path, kernels: Path, wall: bool = False) -> dict[str, str]:
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    caches = {"PYTHONPYCACHEPREFIX": str(cache / "bytecode"), "NUMBA_CACHE_DIR": str(kernels)}
    own = {"PYTHONPATH": str(tree), "BENCH_CLOCK": "wall" if wall else "cpu"}
    return {n: v for n, v in os.environ.items() if n != "PYTHONDONTWRITEBYTECODE"} | threads | caches | own


def _command(what: str) -> list[str]:
    return [sys.executable, "-P", __file__, ".", ".", what]


@contextmanager
def _server(tree: Path, cache: Path, wall: bool) -> Iterator[Callable[[dict[str, Any]], dict[str, float]]]:
    """What asks the tree's process for a round."""
    environment = _environment(tree, cache, cache / "numba", wall)
    with subprocess.Popen(
        _command("--serve"), env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:

        def ask(what: dict[str, Any]) -> dict[str, float]:
            print(json.dumps(what), file=child.stdin, flush=True)
            answer = child.stdout.readline()
            if not answer:
                sys.exit(f"{tree}: its process ended at {what}")
            return json.loads(answer)

        yield ask
        child.stdin.close()


Ask = Callable[[dict[str, Any]], dict[str, float]]


def measure(name: str, old: Ask, new: Ask, rounds: int, seconds: float) -> dict[str, float]:
    """Seconds per unit, best and median of the rounds, of both trees; and the ratios old over new."""
    size = 1
    found = old({"prepare": name, "size": size})
    while found["seconds"] < 0.7 * seconds and size < 256:
        size = min(max(size + 1, round(size * min(seconds / found["seconds"], 6))), 256)
        found = old({"prepare": name, "size": size})
    new({"prepare": name, "size": size})
    times = np.array([_pair(old, new, i % 2 == 1) for i in range(rounds)]) / found["amount"]
    ratios = times[:, 0] / times[:, 1]
    spread = 1.96 * 1.2533 * ratios.std(ddof=1) / rounds**0.5  # of the median of ratios that scatter normally
    result = {f"{side}_best": times[:, i].min() for i, side in enumerate(("old", "new"))}
    result |= {f"{side}_median": median(times[:, i]) for i, side in enumerate(("old", "new"))}
    best = result["old_best"] / result["new_best"]
    result |= {"ratio_best": best, "ratio_median": median(ratios), "half_width": spread, "rounds": rounds, "size": size}
    return {key: float(value) for key, value in result.items()}


def _pair(old: Ask, new: Ask, new_first: bool) -> tuple[float, float]:
    """Seconds of a round of each."""
    if new_first:
        later = new({})["seconds"]
        return old({})["seconds"], later
    return old({})["seconds"], new({})["seconds"]


def cold(tree: Path, cache: Path) -> dict[str, float]:
    """Seconds of the first experiments with an empty kernel cache, and how many files that leaves there."""
    with tempfile.TemporaryDirectory(prefix="bench-cold-") as folder:
        environment = _environment(tree, cache, Path(folder))
        done = subprocess.run(_command("--first"), env=environment, stdout=subprocess.PIPE, text=True, check=True)
        files = {kind: len(list(Path(folder).rglob(f"*.{kind}"))) for kind in ("nbi", "nbc")}
        return json.loads(done.stdout) | files


def _tree(path: Path, cache: Path) -> Path:
    """A tree whose package is the one that its processes import."""
    tree = path.resolve()
    command = [sys.executable, "-P", "-c", "import maglev_env; print(maglev_env.__file__)"]
    environment = _environment(tree, cache, cache / "numba")
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    if not Path(done.stdout.strip()).resolve().is_relative_to(tree):
        sys.exit(f"{tree}: holds no maglev_env; {done.stdout.strip()} would be measured instead")
    return tree


def _told(unit: str, seconds: float) -> str:
    return f"{seconds * 1e9:.2f} ns" if unit == PER_STEP else f"{1 / seconds:.2f} /s"


def main() -> None:
    args = _arguments()
    if args.serve:
        serve()
    elif args.first:
        first_experiment()
    else:
        _bench(args)


def _bench(args: argparse.Namespace) -> None:
    cache = args.cache.resolve()
    trees = [_tree(path, cache) for path in (args.old, args.new)]
    print(f"old: {trees[0]}\nnew: {trees[1]}\nload average {os.getloadavg()[0]:.1f}\n")
    result: dict[str, Any] = {"old": str(trees[0]), "new": str(trees[1]), "clock": "wall" if args.wall else "cpu"}
    result["cases"] = {}
    head = f"{'case':<27}{'old best':>12}{'median':>12}{'new best':>12}{'median':>12}{'ratio best':>12}{'median':>8}"
    print(f"{head}  95 %")
    with _server(trees[0], cache, args.wall) as old, _server(trees[1], cache, args.wall) as new:
        for name, unit in CASES.items():
            if args.only and name not in args.only:
                continue
            found = measure(name, old, new, args.rounds, args.seconds)
            result["cases"][name] = {"unit": unit, **found}
            figures = [found[f"{side}_{which}"] for side in ("old", "new") for which in ("best", "median")]
            columns = "".join(f"{_told(unit, figure):>12}" for figure in figures)
            ratios = f"{found['ratio_best']:12.3f}{found['ratio_median']:8.3f}  ± {found['half_width']:.3f}"
            print(f"{name:<27}{columns}{ratios}", flush=True)
    print(f"\nns: per control step and lane, of x-y both axes; /s: per second of one core; {args.rounds} rounds")
    if args.cold:
        result["cold"] = {side: [] for side in ("old", "new")}
        for _ in range(args.cold):
            for side, tree in zip(("old", "new"), trees, strict=True):
                result["cold"][side].append(cold(tree, cache))
        print("\nfirst sweep experiment with no compiled kernel on disk (best), processor seconds")
        for side, runs in result["cold"].items():
            best = {key: min(run[key] for run in runs) for key in runs[0]}
            print(
                f"{side}: import {best['import']:.2f}, first {best['first']:.2f}, second {best['second']:.2f} s, "
                f"by the clock {best['clock']:.2f} s until the first is there; "
                f"{best['nbi']} functions (.nbi), {best['nbc']} compiled versions (.nbc)"
            )
    if args.json:
        args.json.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path, help="source tree of the reference")
    parser.add_argument("new", type=Path, help="source tree measured against it")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
    parser.add_argument("--only", nargs="+", choices=CASES, metavar="CASE", help=f"of {'; '.join(CASES)}")
    parser.add_argument("--rounds", type=int, default=15, help="rounds of each tree and case (default 15)")
    parser.add_argument("--seconds", type=float, default=0.25, help="of a round, about (default 0.25)")
    parser.add_argument("--wall", action="store_true", help="time by the clock, for a machine with nothing else to do")
    parser.add_argument("--cold", type=int, nargs="?", const=1, default=0, metavar="N", help="cold starts, N of each")
    cache = Path(tempfile.gettempdir()) / f"maglev-same-results-{os.getuid()}"
    parser.add_argument("--cache", type=Path, default=cache, help="bytecode and kernels (default: %(default)s)")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--first", action="store_true", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    main()
