"""Matrix exponentials of lanes, cached because many lanes, recordings and trial steps have the same matrices."""

from functools import lru_cache

import numpy as np
import scipy


def expm(matrices: np.ndarray) -> np.ndarray:
    """Exponentials of matrices (n, m, m); each distinct matrix is computed once and remembered."""
    matrices = np.ascontiguousarray(matrices, dtype=np.float64)
    size = matrices.shape[-1]
    return np.array([_one(m.tobytes(), size) for m in matrices])


@lru_cache(maxsize=20_000)  # of at most some 20 x 20 doubles each
def _one(raw: bytes, size: int) -> np.ndarray:
    return scipy.linalg.expm(np.frombuffer(raw).reshape(size, size))
