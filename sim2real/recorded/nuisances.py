"""What is not known of the measurement, marginalised: scales, delays and timing of channels within their tolerance.

One standard deviation of a nuisance changes the whitened residual by a column c. With the columns C of all nuisances,
the residual has the covariance 1 + C C^T. A fixed linear map takes that to 1 again; it acts on data and predictions
alike, so that a fit loses just the direction in which nothing is known. A nuisance of a channel is shared by all
recordings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

AT_ONCE = 4096  # numbers of each row that are mapped together, so that what is taken out stays in the cache


@dataclass(frozen=True)
class Nuisances:
    """The nuisances of stacked whitened data.

    Args:
        names: of the nuisances, (r,).
        columns: (r, K) complex, change of the whitened residual for one standard deviation of each.
    """

    names: tuple[str, ...]
    columns: np.ndarray

    @cached_property
    def _decomposed(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The singular value decomposition of the columns as real numbers: (r, q), (q,) and (q, 2 K)."""
        return np.linalg.svd(_parts(self.columns), full_matrices=False)

    @cached_property
    def _directions(self) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal directions (q, 2 K) of real and imaginary parts in turn, and the share (q,) that is taken out
        along each."""
        _, s, directions = self._decomposed
        known = s > 1e-9
        return directions[known], 1 - 1 / np.sqrt(1 + s[known] ** 2)

    def without(self, whitened: np.ndarray) -> np.ndarray:
        """Data or predictions (..., K) after the map."""
        return self.clear(np.array(whitened, complex)) if self.names else whitened

    def clear(self, whitened: np.ndarray) -> np.ndarray:
        """Map complex data or predictions (..., K), contiguous, in place: of long records they fill much memory."""
        if self.names:
            directions, share = self._directions
            parts = _parts(whitened)
            known = parts @ directions.T * share
            for at in range(0, parts.shape[-1], AT_ONCE):
                parts[..., at : at + AT_ONCE] -= known @ directions[:, at : at + AT_ONCE]
        return whitened

    def amounts(self, cleared: np.ndarray) -> dict[str, float]:
        """The most probable amount of each nuisance, in standard deviations, in a residual (K,) after the map."""
        if not self.names:
            return {}
        u, s, directions = self._decomposed
        found = u @ (s / np.sqrt(1 + s**2) * (directions @ _parts(cleared)))
        return dict(zip(self.names, map(float, found), strict=True))

    @cached_property
    def spread(self) -> dict[str, float]:
        """Standard error of the amount of each nuisance, in standard deviations of what is stated of it: 1 at most."""
        u, s, _ = self._decomposed
        told = 1 - (u**2) @ (s**2 / (1 + s**2))
        return dict(zip(self.names, map(float, np.sqrt(np.maximum(told, 0.0))), strict=True))

    def within(self, place: slice) -> "Nuisances":
        """The nuisances of a part of the data."""
        return Nuisances(self.names, self.columns[:, place])


def _parts(values: np.ndarray) -> np.ndarray:
    """Real and imaginary parts (..., 2 K) in turn of complex values (..., K)."""
    return np.ascontiguousarray(values, complex).view(float)


def stacked(found: Sequence[dict[str, np.ndarray]], sizes: Sequence[int]) -> Nuisances:
    """Nuisances of stacked data from the columns (size,) of every part, by name."""
    names = tuple(dict.fromkeys(name for own in found for name in own))
    rows = [
        np.concatenate([own.get(name, np.zeros(n, complex)) for own, n in zip(found, sizes, strict=True)])
        for name in names
    ]
    return Nuisances(names, np.array(rows).reshape(len(names), sum(sizes)))
