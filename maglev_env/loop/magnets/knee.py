"""A knee of any sharpness: x / (1 + |x|^n)^(1 / n), for kernels; n = 2 is a root, large n a hard limit.

With a creep c, x / (1 + |x|^n)^((1 - c) / n): far beyond the knee it still grows, as x^c.
"""

from maglev_env.loop.magnets.powers import exponential, logarithm
from maglev_lanes.elementary import root
from maglev_lanes.pieces import piece


@piece
def kept_share(size, sharpness):
    """(1 + size^n)^(-1 / n) for size >= 0 and sharpness n = 1 .. 100."""
    return exponential(-_bent(size, sharpness) / sharpness)


@piece
def creeping_share(size, sharpness, fall):
    """(1 + size^n)^(-fall) for size >= 0, sharpness n = 1 .. 100 and fall (1 - creep) / n."""
    return exponential(-_bent(size, sharpness) * fall)


@piece
def _bent(size, sharpness):
    """ln(1 + size^n)."""
    # Four times the logarithm of the fourth root: accurate over many decades.
    power = sharpness * (4.0 * logarithm(root(root(max(min(size, 1e6), 1e-12)))))
    # ln(1 + e^z) as max(z, 0) + ln(1 + e^-|z|), whose arguments stay where both approximations are accurate.
    return max(power, 0.0) + logarithm(1.0 + exponential(-abs(power)))
