"""Draw where the time of a gain set goes, of two source trees: parts of the pipeline side by side.

Usage: python tests/tools/profile_picture.py OLD NEW --out docs/pipeline.png [--sets N]

Each tree evaluates gain sets of the full and of the quick protocol of the default rig, on one thread, in a process of
its own, twice: first to compile, then under cProfile. What Python's and other packages' functions take counts for the
file of the tree that calls them. Files belong to a part by their place (PARTS).
"""

import argparse
import cProfile
import json
import pstats
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from time import process_time

from bench_ratio import _environment, _tree

# Part of the pipeline -> how paths of its files begin, in the order of the pipeline.
PARTS = {
    "kernel": ("maglev_env/kernel", "maglev_env/loop", "maglev_lanes/noise", "maglev_lanes/compiled"),
    "transform, statistics over periods": ("maglev_lanes/line_spectra", "maglev_lanes/period", "estimation/lines"),
    "margins": ("estimation/stability_margins", "estimation/margin", "estimation/gain_margin", "estimation/loop"),
    "stiffness and damping": ("estimation",),
    "rest: lanes, poles, score": ("",),
}
COLOURS = ("#31688e", "#35b779", "#fde725", "#b5651d", "#9e9e9e")


def profiled(tree: str, protocol: str, sets: int) -> dict[str, float]:
    """Milliseconds of a gain set for each of PARTS."""
    from bench_ratio import _gain_sets, _quick

    from maglev_env import load_rig, protocol_experiment

    one = protocol_experiment(load_rig("hmb_free"))
    work, _ = _gain_sets(_quick(one) if protocol == "quick" else one, sets)
    work()
    profile = cProfile.Profile(process_time)
    profile.runcall(work)
    rows = pstats.Stats(profile).stats
    own = {f: str(Path(f[0]).resolve().relative_to(tree)) for f in rows if f[0].startswith(tree)}
    found: dict[str, float] = defaultdict(float)

    def give(function: tuple, seconds: float, depth: int) -> None:
        """Count seconds for a function of the tree, or share them among those that call it."""
        if function in own or depth == 0 or not (callers := rows[function][4]):
            path = own.get(function, "")
            found[next(part for part, begins in PARTS.items() if path.startswith(begins))] += seconds
            return
        whole = sum(c[2] for c in callers.values()) or 1.0
        for caller, c in callers.items():
            give(caller, seconds * c[2] / whole, depth - 1)

    for function, (_, _, seconds, _, _) in rows.items():
        give(function, seconds, 12)
    return {part: 1e3 * found[part] / sets for part in PARTS}


def drawn(found: dict[str, dict[str, dict[str, float]]], out: Path) -> None:
    """The picture; found: protocol -> tree -> part -> ms."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    mpl.rcParams["font.size"] = 9
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    for axes, (protocol, trees) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        for row, parts in enumerate(trees.values()):
            left = 0.0
            for (part, ms), colour in zip(parts.items(), COLOURS, strict=True):
                axes.barh(row, ms, left=left, color=colour, label=part if row == 0 else None)
                left += ms
            axes.text(left, row, f" {left:.2f} ms", va="center")
        axes.set(
            yticks=range(len(trees)), yticklabels=list(trees), title=f"{protocol} protocol", xlabel="ms a gain set"
        )
        axes.invert_yaxis()
        axes.margins(x=0.18)
        axes.spines[["top", "right"]].set_visible(False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(out, dpi=130)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sets", type=int, default=256)
    args = parser.parse_args()
    cache = Path(tempfile.gettempdir()) / "maglev-profiles"
    found: dict[str, dict[str, dict[str, float]]] = {}
    for protocol in ("full", "quick"):
        for name, path in (("before", args.old), ("after", args.new)):
            tree = _tree(path, cache)
            call = (
                f"import json; import profile_picture as p; print(json.dumps(p.profiled({str(tree)!r}, {protocol!r}, "
            )
            call += f"{args.sets})))"
            environment = _environment(tree, cache, cache / "numba")
            environment["PYTHONPATH"] += f":{Path(__file__).parent}"
            done = subprocess.run(
                [sys.executable, "-P", "-c", call], env=environment, stdout=subprocess.PIPE, check=True
            )
            found.setdefault(protocol, {})[name] = json.loads(done.stdout.splitlines()[-1])
            print(protocol, name, found[protocol][name], flush=True)
    drawn(found, args.out)


if __name__ == "__main__":
    main()
