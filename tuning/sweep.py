"""Gain sweeps: every gain set through the same identification experiment, stored in chunks and resumable."""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from hashlib import sha256
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.evaluation.devices import require_device
from maglev_env.evaluation.evaluation import Evaluation
from maglev_env.experiment import Experiment, protocol_experiment
from maglev_env.loop.effect import Effects
from maglev_env.loop.gains import NO_CONTROLLER, Controllers, digital, gain_values, of_axis, with_gains
from maglev_env.recordings.result_folder import claim, is_empty, load_arrays, locked, save_arrays
from maglev_env.rig.rig import Rig
from maglev_lanes.code_version import code_version
from maglev_lanes.price import check_experiments
from tuning.axis import Axis
from tuning.sweep_file import read_sweep, write_sweep

if TYPE_CHECKING:
    import xarray as xr

    from maglev_lanes.schedule import Workers

CHUNK = 256
TOGETHER = 32  # chunks whose experiments a GPU simulates at a time
POINTS = {"kp": 16, "ki": 4, "kd": 16}  # of the default grid
SPEC = "sweep.json"


@dataclass(frozen=True)
class Sweep:
    """A sweep.

    Attributes:
        rig: The rig.
        axes: Axes by name of a gain of the rig's controller; other gains stay at the preset.
        log: Logarithmic spacing.
        sobol: Number of Sobol points; 0 for the full grid.
        effects: Effects of the simulated rig.
        seed: Seed of all noise.
        sensor: What reads the displacement.
        device: Where the experiments are simulated, one of DEVICES.
    """

    rig: Rig
    axes: Mapping[str, Axis]
    log: bool = False
    sobol: int = 0
    effects: Effects = field(default_factory=dict)
    seed: int = 0
    sensor: str = "probe"
    device: str = "cpu"

    def __post_init__(self) -> None:
        if not self.rig.controlled or self.rig.protocol is None:
            raise ValueError(
                f"rig {self.rig.name} has no controlled magnet or no [protocol]: there is nothing to sweep"
            )
        p = self.rig.protocol
        period = max((self.rig.control_rate / e.fundamental for e in p.excitations if e.periodic), default=0.0)
        check_experiments(self.count, period * (p.periods + p.transient_periods), "sweep")
        if not self.axes:
            raise ValueError("sweep: give at least one gain as lo:hi:n")
        known = _known(self.rig)
        for name, axis in self.axes.items():
            if name not in known:
                raise ValueError(
                    f"sweep: {name!r} is not one of the gains of the rig's controller"
                    + (f": {', '.join(known)}" if known else ", which is given by numerator and denominator")
                )
            if not (np.isfinite(axis.low) and np.isfinite(axis.high) and axis.low <= axis.high and axis.points >= 1):
                raise ValueError(f"sweep: {name} = {axis.low}:{axis.high}:{axis.points} must be lo <= hi and n >= 1")
            if self.log and axis.low <= 0:
                raise ValueError(f"sweep: {name} from {axis.low}: a logarithmic axis starts above 0; use --linear")
        for end in ("low", "high"):  # refuses, before any work, what no controller can have
            extreme = with_gains(self.rig.gains, **{name: getattr(axis, end) for name, axis in self.axes.items()})
            digital(of_axis(extreme, 0), 1 / self.rig.control_rate)

    @property
    def count(self) -> int:
        """Number of gain sets."""
        return self.sobol or prod(axis.points for axis in self.axes.values())


def _known(rig: Rig) -> list[str]:
    """Names of the gains of a rig's controller."""
    return list(gain_values(of_axis(rig.gains or NO_CONTROLLER, 0)))


def default_axes(rig: Rig) -> dict[str, Axis]:
    """The rig's bounds of kp, ki and kd as axes of 16 x 4 x 16 points."""
    if lacking := [name for name in POINTS if name not in _known(rig)]:
        raise ValueError(
            f"rig {rig.name}: its controller has no {', '.join(lacking)}: the default sweep varies those of a PID; "
            "give the gains to sweep as lo:hi:n"
        )
    missing = [name for name in POINTS if name not in rig.bounds]
    if missing:
        raise ValueError(f"rig {rig.name}: [bounds] lacks {', '.join(missing)}; give --kp, --ki, --kd as lo:hi:n")
    return {name: Axis(*rig.bounds[name], points) for name, points in POINTS.items()}


def points(sweep: Sweep) -> dict[str, np.ndarray]:
    """Values (n,) of the swept gains: the grid, last axis fastest, or the scrambled Sobol points of the seed."""
    names = [name for name in _known(sweep.rig) if name in sweep.axes]
    if sweep.sobol:
        from scipy.stats import qmc

        sampler = qmc.Sobol(len(names), rng=np.random.default_rng(sweep.seed))
        unit = sampler.random_base2(int(np.ceil(np.log2(sweep.sobol))))[: sweep.sobol]
        return {name: _along(sweep.axes[name], unit[:, j], sweep.log) for j, name in enumerate(names)}
    grids = [
        _along(
            sweep.axes[n],
            np.linspace(0, 1, sweep.axes[n].points) if sweep.axes[n].points > 1 else np.zeros(1),
            sweep.log,
        )
        for n in names
    ]
    return {name: c.ravel() for name, c in zip(names, np.meshgrid(*grids, indexing="ij"), strict=True)}


def gain_sets(sweep: Sweep) -> list[Controllers]:
    """The gain sets in order."""
    return _controllers(sweep, points(sweep))


def _controllers(sweep: Sweep, swept: Mapping[str, np.ndarray]) -> list[Controllers]:
    rows = zip(*(column.tolist() for column in swept.values()), strict=True)
    return [with_gains(sweep.rig.gains, **dict(zip(swept, row, strict=True))) for row in rows]


def run_sweep(
    sweep: Sweep,
    out: Path,
    threads: int | None = None,
    progress: Callable[[int, bool], None] | None = None,
    workers: "Workers | None" = None,
) -> "xr.Dataset":
    """Run or resume a sweep in a folder.

    Finished chunks are reused. An interrupted sweep, and one whose chunks workers made, equal an uninterrupted one bit
    for bit.

    Args:
        sweep: The sweep.
        out: Folder of the results.
        threads: Number of threads; None for all cores.
        progress: Called with (experiments, reused).
        workers: Where to run.

    Returns:
        Dataset with the dimensions experiment and band, and the gains as coordinates; of more than LARGE experiments it
        stays in its file until something is read.

    Raises:
        ValueError: `out` holds another sweep, or the device is not there, or workers are given with it.
        BlockingIOError: Another process works on it.
        OSError: `out` cannot be written.
    """
    with locked(out):
        return _run(sweep, out, threads, progress or (lambda n, reused: None), workers)


def _run(sweep, out, threads, advance, workers) -> "xr.Dataset":  # see run_sweep
    if sweep.device != "cpu" and workers is not None:
        raise ValueError(f"sweep: device {sweep.device} is of this machine: leave out the scheduler, or use cpu")
    if not (out / SPEC).exists() and not is_empty(out):
        raise ValueError(f"{out} is not empty and holds no sweep; choose another --out")
    swept, n = points(sweep), sweep.count
    claim(out / SPEC, description(sweep, n), "sweep")
    chunks = out / "chunks"
    chunks.mkdir(exist_ok=True)
    paths = {start: chunks / f"{start:07d}.npz" for start in range(0, n, CHUNK)}
    todo = []
    for start, path in paths.items():
        own = {name: column[start : start + CHUNK] for name, column in swept.items()}
        if not path.exists():
            todo.append(_Chunk(sweep, start, own))
            continue
        load_arrays(path)  # a damaged one is told before the work, not behind it
        advance(min(CHUNK, n - start), True)
    for chunk, columns in _made(todo, threads, lambda n: advance(n, False), workers):
        save_arrays(paths[chunk.start], columns)
    made_by = json.loads((out / SPEC).read_text())
    attributes = {k: v if isinstance(v, str) else json.dumps(v) for k, v in made_by.items()}
    gains = {name: np.full(n, value) for name, value in gain_values(of_axis(sweep.rig.gains, 0)).items()} | swept
    temporary = out / "sweep.part"
    try:
        write_sweep(temporary, map(load_arrays, paths.values()), gains, attributes)
        temporary.replace(out / "sweep.nc")
    finally:
        temporary.unlink(missing_ok=True)
    return read_sweep(out / "sweep.nc")


def description(sweep: Sweep, n: int) -> dict[str, object]:
    """What the results depend on, as JSON data; `identity` is a hash of all of it."""
    data: dict[str, object] = {
        "schema": "maglev-sweep-folder/1",
        "version": code_version(),
        "n": n,
        "log": sweep.log,
        "sobol": sweep.sobol,
        "seed": sweep.seed,
        "axes": {name: asdict(axis) for name, axis in sweep.axes.items()},
        "effects": {name: dict(values) for name, values in sweep.effects.items()},
        "sensor": sweep.sensor,
        "device": require_device(sweep.device, sweep.sensor),
        "rig": json.loads(json.dumps(asdict(sweep.rig))),
    }
    data["identity"] = sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()
    return data


@dataclass(frozen=True)
class _Chunk:
    """Neighbouring gain sets of a sweep, and the number of the first one, from which their noise is drawn."""

    sweep: Sweep
    start: int
    gains: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(next(iter(self.gains.values())))

    def experiments(self) -> list[Experiment]:
        """Of the gain sets, in order."""
        s = self.sweep
        return [
            protocol_experiment(s.rig, gains, s.effects, (s.seed, i), s.sensor)
            for i, gains in enumerate(_controllers(s, self.gains), self.start)
        ]

    def columns(self) -> dict[str, np.ndarray]:
        """All arrays of their evaluation, on one thread."""
        from maglev_env.evaluation.evaluate import evaluate  # takes long to import

        return _columns(evaluate(self.experiments(), 1))


def _made(
    chunks: Sequence[_Chunk], threads: int | None, progress: Callable[[int], None], workers: "Workers | None"
) -> Iterator[tuple[_Chunk, dict[str, np.ndarray]]]:
    """Chunks and their columns as they are finished."""
    if workers is None:
        # A chunk alone would keep two threads busy.
        on_cpu = bool(chunks) and chunks[0].sweep.device == "cpu"
        size = (threads or os.cpu_count() or 1) if on_cpu else TOGETHER
        for start in range(0, len(chunks), size):
            yield from _together(chunks[start : start + size], threads, progress)
        return
    for i, columns in workers.each(_Chunk.columns, chunks):
        yield chunks[i], columns
        progress(len(chunks[i]))  # after the caller has stored the chunk


def _together(
    chunks: Sequence[_Chunk], threads: int | None, progress: Callable[[int], None]
) -> Iterator[tuple[_Chunk, dict[str, np.ndarray]]]:
    """Chunks and their columns, evaluated together: a chunk is too little for many threads and for a GPU."""
    from maglev_env.evaluation.evaluate import evaluate

    experiments = [e for chunk in chunks for e in chunk.experiments()]
    whole = _columns(evaluate(experiments, threads, progress, device=chunks[0].sweep.device))
    bands, stop = whole.pop("bands"), 0
    for chunk in chunks:
        start, stop = stop, stop + len(chunk)
        own = slice(start, stop)
        yield chunk, {"bands": bands} | {name: column[own] for name, column in whole.items()}


def _along(axis: Axis, unit: np.ndarray, log: bool) -> np.ndarray:
    if log:
        return axis.low * (axis.high / axis.low) ** unit
    return axis.low + (axis.high - axis.low) * unit


_NAMES = {  # what stands before and behind the names of a field
    "terms": ("term_", ""), "required": ("required_", ""), "required_low": ("required_", "_low"),
    "required_high": ("required_", "_high"),
}  # fmt: skip


def _columns(e: Evaluation) -> dict[str, np.ndarray]:
    """Every array of an evaluation under one flat name."""
    columns: dict[str, np.ndarray] = {}
    for f in fields(Evaluation):
        value = getattr(e, f.name)
        named = value if isinstance(value, dict) else {f.name: value}
        head, tail = _NAMES.get(f.name, ("", ""))
        columns |= {head + name + tail: array for name, array in named.items()}
    return columns
