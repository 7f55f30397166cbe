"""A plant with fewer states, where many of them hardly show, as the branches of eddy currents."""

from dataclasses import replace

import numpy as np
import scipy

from maglev_env.linear.open_loop import OpenLoop, balanced

STABLE = 1 - 1e-9  # radius of a pole up to which a state can be left out


def reduced(plant: OpenLoop, small: float) -> OpenLoop:
    """The plant of one axis with its stable states truncated in balanced coordinates, by their share in the reading.

    The coil's current is not kept. The largest error of a response is twice the sum of the singular values left out.

    Args:
        plant: Of one axis.
        small: Of the largest Hankel singular value of the stable states: what is left out.
    """
    own = balanced(plant)
    triangle, basis, count = scipy.linalg.schur(own.a, sort=lambda x, y=0.0: abs(complex(x, y)) < STABLE)
    n = len(own.a)
    stable, rest = slice(0, count), slice(count, n)
    across = scipy.linalg.solve_sylvester(triangle[stable, stable], -triangle[rest, rest], -triangle[stable, rest])
    apart, back = np.eye(n), np.eye(n)
    apart[stable, rest], back[stable, rest] = across, -across
    sizes = np.linalg.norm(own.command), np.linalg.norm(own.force)
    inputs = back @ basis.T @ np.hstack([own.command / sizes[0], own.force / sizes[1]])
    reading = own.reading @ basis @ apart
    a, b, c = triangle[stable, stable], inputs[stable], reading[:, stable]
    reached, seen = (
        _root(scipy.linalg.solve_discrete_lyapunov(*pair)) for pair in ((a, b @ b.T), (a.T, c.T @ c))
    )  # fmt: skip
    left, sizes_of, right = np.linalg.svd(seen.T @ reached)
    kept = int((sizes_of > small * sizes_of[0]).sum())
    scale = 1 / np.sqrt(sizes_of[:kept])
    into, out = reached @ right[:kept].T * scale, (left[:, :kept] * scale).T @ seen.T
    b = np.vstack([out @ b, inputs[rest]])
    return replace(
        plant,
        a=scipy.linalg.block_diag(out @ a @ into, triangle[rest, rest]),
        command=b[:, :1] * sizes[0],
        force=b[:, 1:] * sizes[1],
        reading=np.hstack([c @ into, reading[:, rest]]),
        current=np.full((1, kept + n - count), np.nan),
    )


def _root(gramian: np.ndarray) -> np.ndarray:
    """A factor L (n, n) of a positive semidefinite matrix L L'."""
    values, vectors = np.linalg.eigh((gramian + gramian.T) / 2)
    return vectors * np.sqrt(np.maximum(values, 0.0))
