"""Gain sweeps: every gain set through the same identification experiment, stored in chunks and resumable."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from math import prod
from typing import TYPE_CHECKING

import numpy as np

from maglev_env.evaluation.devices import require_device
from maglev_env.loop.effect import Effects
from maglev_env.loop.gains import NO_CONTROLLER, Controllers, digital, gain_values, of_axis, with_gains
from maglev_env.rig.rig import Rig
from maglev_lanes.code_version import code_version
from maglev_lanes.price import check_experiments
from tuning.axis import Axis

if TYPE_CHECKING:
    pass

POINTS = {"kp": 16, "ki": 4, "kd": 16}  # of the default grid


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
    return controllers(sweep, points(sweep))


def controllers(sweep: Sweep, swept: Mapping[str, np.ndarray]) -> list[Controllers]:
    """The rig's controllers with the values (n,) of the swept gains."""
    rows = zip(*(column.tolist() for column in swept.values()), strict=True)
    return [with_gains(sweep.rig.gains, **dict(zip(swept, row, strict=True))) for row in rows]


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


def _along(axis: Axis, unit: np.ndarray, log: bool) -> np.ndarray:
    if log:
        return axis.low * (axis.high / axis.low) ** unit
    return axis.low + (axis.high - axis.low) * unit
