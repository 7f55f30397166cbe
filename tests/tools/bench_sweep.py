"""Measure `maglev sweep` as a user runs it, start, files and page included, of two source trees in turn.

Usage: python tests/tools/bench_sweep.py OLD NEW [--rounds N] [--threads N ...] [--sets 1024 16384]

Each round starts the command once in every tree, in changing order, for the full and the quick protocol of the embedded
default rig. Told are seconds by the clock and processor seconds with those of all its threads and processes, the
shortest of the rounds, and the ratio old over new of the shortest ones and as the median of the paired rounds. Kernels
are compiled before. Nothing is written into the trees.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from time import perf_counter

import numpy as np
from bench_ratio import _environment, _tree

GRIDS = {1024: (16, 4, 16), 16384: (64, 4, 64)}  # points of kp, ki, kd: the default grid, and one of sixteen times that
_QUICK = """
from dataclasses import replace
from maglev_env import load_rig
from maglev_env.rig.rig_toml import rig_toml
from maglev_env.task.protocol import env_protocol
rig = load_rig("hmb_free")
print(rig_toml(replace(rig, name="quick", protocol=env_protocol(rig, "quick"))))
"""
_COMMAND = "from maglev_workbench.cli import app; app()"


def _axes(rig: str, tree: Path, environment: dict[str, str], grid: tuple[int, int, int]) -> list[str]:
    """The rig's bounds of the gains as options."""
    code = f"from maglev_env import load_rig; b = load_rig({rig!r}).bounds; print(*b['kp'], *b['ki'], *b['kd'])"
    done = subprocess.run([sys.executable, "-P", "-c", code], env=environment, stdout=subprocess.PIPE, text=True)
    ends = done.stdout.split()
    return [
        word
        for i, name in enumerate(("kp", "ki", "kd"))
        for word in (f"--{name}", f"{ends[2 * i]}:{ends[2 * i + 1]}:{grid[i]}")
    ] + ["--log"]


def _run(environment: dict[str, str], options: list[str]) -> tuple[float, float]:
    """Seconds by the clock and of processors that a sweep takes."""
    with tempfile.TemporaryDirectory(prefix="bench-sweep-") as folder:
        before, started = sum(os.times()[2:4]), perf_counter()
        command = [sys.executable, "-P", "-c", _COMMAND, "sweep", "--out", f"{folder}/out", *options]
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return perf_counter() - started, sum(os.times()[2:4]) - before


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, nargs="+", default=[2])
    parser.add_argument("--sets", type=int, nargs="+", choices=GRIDS, default=[1024])
    parser.add_argument("--protocols", nargs="+", choices=("full", "quick"), default=["full", "quick"])
    parser.add_argument(
        "--cache", type=Path, default=Path(tempfile.gettempdir()) / f"maglev-same-results-{os.getuid()}"
    )
    args = parser.parse_args()
    cache = args.cache.resolve()
    trees = [_tree(path, cache) for path in (args.old, args.new)]
    environments = [_environment(tree, cache, cache / "numba") for tree in trees]
    with tempfile.TemporaryDirectory() as folder:
        quick = Path(folder) / "quick.toml"
        command = [sys.executable, "-P", "-c", _QUICK]
        quick.write_text(subprocess.run(command, env=environments[1], stdout=subprocess.PIPE, text=True).stdout)
        print(f"old: {trees[0]}\nnew: {trees[1]}\nload average {os.getloadavg()[0]:.1f}\n")
        heads = "".join(f"{clock:>10}{'new':>8}{'best':>7}{'median':>7}" for clock in ("clock old", "cpu old"))
        print(f"{'':<30}{heads}")
        for protocol in args.protocols:
            rig = {"full": "hmb_free", "quick": str(quick)}[protocol]
            for sets in args.sets:
                axes = _axes(rig, trees[0], environments[0], GRIDS[sets])
                for threads in args.threads:
                    options = ["--rig", rig, *axes, "--threads", str(threads)]
                    _report(f"{protocol}, {sets} sets, {threads} threads", environments, options, args.rounds)


def _report(name: str, environments: list[dict[str, str]], options: list[str], rounds: int) -> None:
    for environment in environments:
        _run(environment, options)  # compiles
    times = np.empty((rounds, 2, 2))
    for i in range(rounds):
        for side in (0, 1) if i % 2 == 0 else (1, 0):
            times[i, side] = _run(environments[side], options)
    row = f"{name:<30}"
    for clock in (0, 1):
        old, new = times[:, 0, clock], times[:, 1, clock]
        row += f"{old.min():10.2f}{new.min():8.2f}{old.min() / new.min():7.2f}{median(old / new):7.2f}"
    print(row, flush=True)


if __name__ == "__main__":
    main()
