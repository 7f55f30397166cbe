"""One block of lines, and the measurement of stiffness and damping that it gives together with prior knowledge."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

ITERATIONS = 30
HALVINGS = 20
NEEDS = {
    "force": ("finite", np.isfinite),
    "displacement": ("finite", np.isfinite),
    "noise": ("positive, inf to leave a line out", lambda a: a > 0),
    "force_noise": ("finite and at least 0", lambda a: np.isfinite(a) & (a >= 0)),
}


@dataclass(frozen=True, eq=False)
class Block:
    """Lines of one block of whole excitation periods.

    Attributes:
        time: End of the block, s.
        force: Complex peak amplitudes (n,), N.
        displacement: Complex peak amplitudes (n,), m.
        noise: Noise variance E|n|^2 of the displacement lines (n,), m^2; inf leaves a line out.
        force_noise: Noise variance of the force lines (n,), N^2, as far as it is independent of the displacement's.
            By default the force is exact.
    """

    time: float
    force: ArrayLike
    displacement: ArrayLike
    noise: ArrayLike
    force_noise: ArrayLike = 0.0


def checked_block(block: Block, frequency: np.ndarray) -> Block:
    """The block as arrays with one value per line of frequency (n,).

    Raises:
        ValueError: The block does not fit the lines.
    """
    where, n = f"block at {block.time} s", frequency.size
    arrays = {name: np.asarray(getattr(block, name), dtype=complex) for name in ("force", "displacement")}
    arrays |= {name: np.asarray(getattr(block, name), dtype=float) for name in ("noise", "force_noise")}
    for name, a in arrays.items():
        if a.shape != (n,) and not (name.endswith("noise") and a.ndim == 0):
            raise ValueError(f"{where}: {name} has the shape {a.shape}; {n} lines are tracked, give ({n},)")
        need, good = NEEDS[name]
        arrays[name] = np.broadcast_to(a, n)
        bad = ~good(arrays[name])
        if bad.any():
            at = ", ".join(f"{f:g}" for f in frequency[bad])
            raise ValueError(f"{where}: {name} must be {need}; it is not at {at} Hz")
    if not np.any(np.isfinite(arrays["noise"]) & (arrays["force"] != 0)):
        raise ValueError(f"{where}: no line has both a force and a finite noise; nothing can be learnt from it")
    return Block(block.time, **arrays)


def measured_at_mode(
    block: Block, w: np.ndarray, mass: float, prior: np.ndarray, prior_variance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float]:
    """A checked block as one measurement of stiffness k and damping c.

    The model is linearised at the highest posterior density, which is searched from the prior. If the lines are
    explained badly there, the search also starts from least squares on the receptance (D eq 4.19): a stiffness that
    is far off or has the other sign has a minimum of its own.

    Args:
        block: As `checked_block` returns it.
        w: Angular frequencies (n,), rad/s.
        mass: Moving mass, kg.
        prior: Prior mean (2,) of k and c.
        prior_variance: Prior variance (2,).

    Returns:
        measured: Measurement (2,) of k and c.
        variance: Its variance (2,).
        misfit: Chi-square of the lines about the measurement.
    """
    known = (block, w, mass, prior, prior_variance)
    found, cost = _searched(*known, prior)
    if cost > 4 * np.count_nonzero(np.isfinite(block.noise)):  # twice its mean over 2 n degrees of freedom
        displacement, force, noise = map(np.asarray, (block.displacement, block.force, block.noise))
        squares = np.abs(displacement) ** 2 / noise
        lines = np.conj(displacement) * force / noise
        stiffness = (lines.real + mass * w**2 * squares).sum() / squares.sum()
        start = np.array([stiffness, (w * lines.imag).sum() / (w**2 * squares).sum()])
        other, other_cost = _searched(*known, start)
        if other_cost < cost:
            return other
    return found


def _searched(
    block: Block, w: np.ndarray, mass: float, prior: np.ndarray, prior_variance: np.ndarray, point: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray, float], float]:
    """`measured_at_mode` for the minimum that Gauss-Newton steps reach from a point, and the cost there.

    A step is halved for as long as it raises the cost.
    """
    measured, variance, misfit, cost = _linearised(block, w, mass, point)
    cost += np.sum((point - prior) ** 2 / prior_variance)
    for _ in range(ITERATIONS):
        step = prior + prior_variance / (prior_variance + variance) * (measured - prior) - point
        last = cost
        for _ in range(HALVINGS):
            trial = point + step
            measured, variance, misfit, cost = _linearised(block, w, mass, trial)
            cost += np.sum((trial - prior) ** 2 / prior_variance)
            if cost <= last:
                break
            step = step / 2
        point = trial
        if np.all(step**2 < 1e-6 * np.minimum(variance, prior_variance)):
            break
    return (measured, variance, float(misfit)), float(cost)


def _linearised(
    block: Block, w: np.ndarray, mass: float, point: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Gauss-Newton target (2,) from a point (2,), its variance (2,), and the chi-square about it and at the point."""
    z = point[0] - mass * w**2 + 1j * w * point[1]
    error = block.displacement - block.force / z
    total = block.noise + block.force_noise / np.abs(z) ** 2
    weight = 2 / total
    # The slope dY/dk uses the force estimated from both channels, whose error is uncorrelated with the residual. The
    # error of the measured force is correlated with it and would bias the stiffness by the force's noise share.
    slope = -(block.force + weight / 2 * block.force_noise / np.conj(z) * error) / z**2
    along = weight * np.conj(slope) * error
    information = np.array([np.sum(weight * np.abs(slope) ** 2), np.sum(weight * np.abs(w * slope) ** 2)])
    gradient = np.array([np.sum(along.real), np.sum(w * along.imag)])
    cost = np.sum(weight * np.abs(error) ** 2)
    return point + gradient / information, 1 / information, cost - np.sum(gradient**2 / information), cost
