"""Kinds of reference controllers, each designed from the linear model by a few weights."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from maglev_env.design.h_infinity import HInfinityWeights, h_infinity
from maglev_env.design.lqg import LqgWeights, lqg
from maglev_env.design.state_space_filter import state_space_filter
from maglev_env.experiment import Experiment
from maglev_env.linear.loop import loop_response
from maglev_env.linear.open_loop import OpenLoop, open_loop
from maglev_env.linear.reduced import reduced
from maglev_env.loop.linear_controller import LinearController

LOWEST, TOP, POINTS = 1e-4, 0.45, 400  # shares of the control rate between which the preset's loop is looked at
LEFT_OUT = (1e-4, 1e-3, 1e-2)  # shares of a plant's states that are left out, one after the other, where rounding asks
SLOW, FAST = 0.05, 3.0  # of the crossover of the preset's loop: corners of the weights where a search begins


@dataclass(frozen=True)
class Scales:
    """What the loop of the rig's own gains reaches, from which weights are counted.

    Attributes:
        compliance: Largest response of the reading to a force, m/N.
        effort: Largest response of the command to an error of the reading, A/m.
        crossover: Highest frequency at which the loop's gain is 1, Hz.
    """

    compliance: float
    effort: float
    crossover: float


@dataclass(frozen=True)
class Kind:
    """A kind of reference.

    Args:
        words: What it is, for a reader.
        names: Of its weights, each counted in decades from what the scales say.
        wide: Decades in which each weight is sought, to either side.
        design: Its controller (A, B, C, D) for a plant, scales and weights.
        needs: A package that only an extra installs.
    """

    words: str
    names: tuple[str, ...]
    wide: tuple[float, ...]
    design: Callable[[OpenLoop, Scales, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, float]]
    needs: str | None = None


def _lqg(plant: OpenLoop, scales: Scales, decades: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    force, command, drift, corner = 10.0**decades
    weights = LqgWeights(force / scales.compliance, command / scales.effort**2, drift, corner * SLOW * scales.crossover)
    return lqg(plant, weights)


def _h_infinity(
    plant: OpenLoop, scales: Scales, decades: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    force, command, slow, fast = 10.0**decades
    weights = HInfinityWeights(
        force / scales.compliance, command / scales.effort, slow * SLOW * scales.crossover,
        fast * FAST * scales.crossover,
    )  # fmt: skip
    (a, b, c, d), _ = h_infinity(plant, weights)
    return a, b[:, 0], c[0], float(d[0, 0])


KINDS: Mapping[str, Kind] = {
    "lqg": Kind("LQG", ("force", "command", "drift", "corner"), (1.5, 3.0, 1.0, 1.0), _lqg),
    "h-infinity": Kind(
        "H-infinity", ("force", "command", "stiff below", "quiet above"), (1.5, 1.5, 1.0, 1.0),
        _h_infinity, "slycot",
    ),
}  # fmt: skip


def kind_of(name: str) -> Kind:
    """The kind of a name, whose package is installed.

    Raises:
        ValueError: There is no such kind.
        ModuleNotFoundError: A package that it needs is not installed.
    """
    if name not in KINDS:
        raise ValueError(f"reference {name!r} is unknown; use one of {', '.join(KINDS)}")
    needs = KINDS[name].needs
    if needs and find_spec(needs) is None:
        raise ModuleNotFoundError(f"No module named {needs!r}", name=needs)
    return KINDS[name]


def scales_of(experiment: Experiment) -> Scales:
    """The scales of one axis.

    Args:
        experiment: Of one axis, with gains that hold.
    """
    rate = experiment.rig.control_rate
    frequency = np.geomspace(LOWEST, TOP, POINTS) * rate
    loop = loop_response(experiment, frequency)
    above = np.flatnonzero(np.abs(loop.loop_gain) > 1)
    return Scales(
        float(np.abs(loop.receptance).max()),
        float(np.abs(loop.controller * loop.sensitivity).max()),
        float(frequency[above[-1]] if above.size else experiment.rig.target.band[1]),
    )


def designed(kind: Kind, experiment: Experiment, scales: Scales, decades: np.ndarray) -> LinearController:
    """The controller of one axis at weights (k,).

    Raises:
        ValueError: There is none that rounding leaves.
        ModuleNotFoundError: The package that it needs is not installed.
    """
    whole = open_loop(experiment)
    try:
        return state_space_filter(*kind.design(whole, scales, decades), whole.dt)
    except ValueError as error:
        # A filter has no digits for states that hardly show: by a model without them it is designed nearly as well.
        for small in LEFT_OUT:
            with suppress(ValueError):
                return state_space_filter(*kind.design(reduced(whole, small), scales, decades), whole.dt)
        raise error
