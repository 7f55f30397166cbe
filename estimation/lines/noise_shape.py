"""How a noise variance goes with frequency, from shapes that physics allows and a measured spread."""

import numpy as np
import scipy

CLIPPED = 3.0  # multiple of the fitted shape at which a line's weight in the fit is clipped
PASSES = 12
_TINY = float(np.finfo(float).tiny)


def noise_shape(own: np.ndarray, shapes: np.ndarray) -> np.ndarray:
    """The sum (n,) of shapes, in proportions that are not negative, which fits variances best.

    Args:
        own: variances (n,), each measured with few degrees of freedom.
        shapes: (shapes, n), what each source of noise would cause.
    """
    scale = shape = np.full_like(own, max(float(np.median(own)), own.mean() * 1e-12 + _TINY))
    for _ in range(PASSES):  # weights from the fit itself, because a variance scatters in proportion to its size
        columns = shapes / scale
        norms = np.maximum(np.linalg.norm(columns, axis=1), _TINY)
        shares, _ = scipy.optimize.nnls(
            (columns / norms[:, None]).T, np.minimum(own / scale, CLIPPED)
        )  # clipped against tones
        shape = np.maximum(shapes.T @ (shares / norms), _TINY)
        scale = shape
    return shape
