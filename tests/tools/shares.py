"""A share of counted cases in words."""

from estimation.normal import NORMAL_95


def wilson(k: int, n: int) -> str:
    """k of n, with Wilson's 95 % interval."""
    if not n:
        return "0 of 0"
    z2 = NORMAL_95**2
    middle, half = k + z2 / 2, NORMAL_95 * (k * (n - k) / n + z2 / 4) ** 0.5
    low, high = (100 * (middle + sign * half) / (n + z2) for sign in (-1, 1))
    return f"{k} of {n} ({low:.0f} to {high:.0f} %)"
