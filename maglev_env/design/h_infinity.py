"""Mixed-sensitivity H-infinity control of one axis, by the routine SB10AD of SLICOT (the optional package slycot).

The sampled plant is mapped by s = (2 / dt) (z - 1) / (z + 1), which keeps all suprema over frequency exactly, to
continuous time, for which the routine is made; the controller is mapped back. With y the reading, e its error, f the
force and u the command, it makes least the largest singular value over all frequencies of the four responses from
(force f, e) to (W y, V u):

    W y = W S (e + force P_f f),   V u = V C S (e + force P_f f)
    W = (s + w_b) / (s + w_b / STIFF),   V = command (1 + s / w_u) / (1 + s / (ROLL w_u))

so that |S|, |C S|, the compliance and the response to a force of the command are bounded together.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from maglev_env.linear.open_loop import OpenLoop

STIFF = 100.0  # gain of W at rest
ROLL = 30.0  # by which V rises
SLACK = 1.02  # of the least norm: the controller that attains it has a pole without bound
UNIT = 0.05  # control step in the unit of time in which the continuous system is written, for the sake of rounding
START = 1e6  # of the norms that are tried
Matrices = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class HInfinityWeights:
    """What a mixed-sensitivity controller weighs.

    Args:
        force: N/m, by which a force counts beside an error of the reading.
        command: m/A, by which the command counts beside the motion.
        stiff_below: Hz, below which the motion counts more.
        quiet_above: Hz, above which the command counts more.
    """

    force: float
    command: float
    stiff_below: float
    quiet_above: float


def h_infinity(plant: OpenLoop, weights: HInfinityWeights) -> tuple[Matrices, float]:
    """The mixed-sensitivity controller of one axis, and the norm of its loop: SLACK times the least that is found.

    Args:
        plant: Of one axis.
        weights: The weights.

    Returns:
        A (n, n), B (n, 1), C (1, n) and D (1, 1) from the negative reading (m) to the command (A); and the norm.

    Raises:
        ModuleNotFoundError: slycot is not installed.
        ValueError: There is no such controller that rounding leaves.
    """
    from slycot import sb10ad
    from slycot.exceptions import SlycotError

    a, b, c, d = generalised_plant(plant, weights)
    if not all(np.isfinite(m).all() for m in (a, b, c, d)):
        raise ValueError("no H-infinity controller: the plant has numbers beyond all bounds")
    n, inputs, outputs = len(a), b.shape[1], len(c)
    try:
        least = sb10ad(n, inputs, outputs, 1, 1, START, a, b, c, d, job=1, gtol=1e-4)[0]
        norm, *k = sb10ad(n, inputs, outputs, 1, 1, SLACK * least, a, b, c, d, job=4)[:5]
    except SlycotError as error:
        raise ValueError(f"no H-infinity controller: {error}") from None
    return to_sampled(tuple(k), UNIT), float(norm)


def generalised_plant(plant: OpenLoop, weights: HInfinityWeights) -> Matrices:
    """A (n, n), B (n, 3), C (3, n) and D (3, 3) in continuous time from force, error and command to W y, V u and -y."""
    b = np.hstack([weights.force * plant.force, np.zeros_like(plant.force), plant.command])
    a, b, c, d = to_continuous((plant.a, b, plant.reading, np.array([[0.0, 1.0, 0.0]])), UNIT)
    (scaled, _), n = scipy.linalg.matrix_balance(a, permute=False, separate=True)[1], len(a)
    a, b, c = a * scaled / scaled[:, None], b / scaled[:, None], c * scaled
    low, high = (2 * np.pi * one * plant.dt / UNIT for one in (weights.stiff_below, weights.quiet_above))
    # W = 1 + (low - low / STIFF) / (s + low / STIFF); V = command (ROLL - high ROLL (ROLL - 1) / (s + ROLL high)).
    whole_a = np.zeros((n + 2, n + 2))
    whole_a[:n, :n], whole_a[n, :n] = a, c
    whole_a[n, n], whole_a[n + 1, n + 1] = -low / STIFF, -ROLL * high
    whole_b = np.vstack([b, d, [[0.0, 0.0, ROLL * high]]])
    pad = np.zeros((1, 2))
    rows_c = [np.hstack([c, [[low - low / STIFF, 0.0]]]), np.zeros((1, n + 2)), np.hstack([-c, pad])]
    rows_c[1][0, -1] = -weights.command * (ROLL - 1)
    rows_d = [d, np.array([[0.0, 0.0, weights.command * ROLL]]), -d]
    return whole_a, whole_b, np.vstack(rows_c), np.vstack(rows_d)


def to_continuous(system: Matrices, dt: float) -> Matrices:
    """A sampled system at s = (2 / dt) (z - 1) / (z + 1); dt in the unit of time of s."""
    a, b, c, d = system
    back = np.linalg.inv(a + np.eye(len(a)))
    root = 2 / np.sqrt(dt)
    return 2 / dt * back @ (a - np.eye(len(a))), root * back @ b, root * c @ back, d - c @ back @ b


def to_sampled(system: Matrices, dt: float) -> Matrices:
    """The inverse of `to_continuous`."""
    a, b, c, d = system
    back = np.linalg.inv(2 / dt * np.eye(len(a)) - a)
    root = 2 / np.sqrt(dt)
    return back @ (2 / dt * np.eye(len(a)) + a), root * back @ b, root * c @ back, d + c @ back @ b
