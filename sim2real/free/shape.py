"""The shape of a fitted curve: which simple form describes it, of what size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

SIMPLE = 0.6  # share of a curve's chi-square beyond a straight line that a simple form must describe
BROKEN = 0.05  # of the largest value: by how much a smooth curve may differ from a broken line
LEAST = 9.0  # chi-square beyond a straight line below which a curve is straight
PLACES = 19  # of a knee that are tried, between zero and the range
SAME, KNEE = 1.2, 2.5  # a form with a knee must leave so many times less of the chi-square than one without, and KNEE
CONFIDENT = 3.84  # of chi-square with one degree of freedom

# f(x, k) over inputs in units of the range, with its knee at k. Each is beside a straight line of free slope.
_Form = Callable[[np.ndarray, float], np.ndarray]
KNEELESS: Mapping[str, _Form] = {
    "one-sided": lambda x, k: abs(x),
    "bent": lambda x, k: x**2,
    "cubic": lambda x, k: x**3,
    "quadratic": lambda x, k: x * abs(x),
    "step": lambda x, k: np.sign(x),
}
KNEED: Mapping[str, _Form] = {
    "band": lambda x, k: np.clip(x, -k, k),
    "kink above": lambda x, k: np.maximum(x - k, 0.0),
    "kink below": lambda x, k: np.minimum(x + k, 0.0),
}


@dataclass(frozen=True)
class Form:
    """A simple form of a curve.

    Attributes:
        name: A key of KNEELESS or KNEED; "straight" where a line is enough, "free" where no simple form is.
        slope: Of the straight line beside it, in units of the curve's values over its range.
        size: Of the form, in the unit of the curve's values, at the range or, of a band, within it.
        se: Standard error of the size.
        knee: Where it bends, in the unit of the input; None without a knee.
        knee_ends: 95 % interval of the knee.
    """

    name: str
    slope: float
    size: float
    se: float
    knee: float | None = None
    knee_ends: tuple[float, float] | None = None


def form_of(at: np.ndarray, value: np.ndarray, covariance: np.ndarray, slope_sd: float = np.inf) -> Form:
    """The simplest form that describes a curve.

    Args:
        at: Inputs (n,), without zero, where the curve is zero.
        value: The curve (n,).
        covariance: Of its values (n, n).
        slope_sd: Prior standard deviation of the slope of the straight line beside a form, as of a gain that is known.
    """
    reach = float(abs(at).max())
    x = at / reach
    # A floor on the errors, because a broken line is not a smooth curve.
    whole = covariance + np.diag(np.full(at.size, (BROKEN * abs(value).max()) ** 2 + 1e-300))
    root = np.linalg.cholesky(whole)

    def fitted(*columns: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        a, b = np.linalg.solve(root, np.stack(columns, axis=1)), np.linalg.solve(root, value)
        prior = np.zeros((1, len(columns)))
        prior[0, 0] = 1 / (slope_sd * reach)
        a, b = np.concatenate([a, prior]), np.append(b, 0.0)
        theta, *_ = np.linalg.lstsq(a, b, rcond=None)
        return float(np.sum((b - a @ theta) ** 2)), theta, np.linalg.pinv(a.T @ a)

    straight, theta, spread = fitted(x)
    if straight < LEAST + at.size - 1:
        return Form("straight", float(theta[0]), float(theta[0]), float(np.sqrt(spread[0, 0])))
    found: list[tuple[float, Form]] = []
    for name, form in KNEELESS.items():
        chi2, theta, spread = fitted(x, form(x, 0.0))
        found.append((chi2, Form(name, float(theta[0]), float(theta[1]), float(np.sqrt(spread[1, 1])))))
    knees = np.linspace(float(abs(x).min()), 1.0, PLACES + 2)[1:-1]
    for name, form in KNEED.items():
        tried = [fitted(x, form(x, k)) for k in knees]
        chi2 = np.array([t[0] for t in tried])
        best = int(np.argmin(chi2))
        near = knees[chi2 <= chi2[best] + CONFIDENT * max(chi2[best] / max(at.size - 3, 1), 1.0)]
        _, theta, spread = tried[best]
        most = form(x, knees[best])
        size = float(most[np.argmax(abs(most))])  # where it does most, with its sign
        apart = 0.5 * (knees[1] - knees[0])
        ends = (float((near[0] - apart) * reach), float((near[-1] + apart) * reach))
        own = Form(name, float(theta[0]), float(theta[1]) * size, float(np.sqrt(spread[1, 1])) * abs(size),
                   float(knees[best]) * reach, ends)  # fmt: skip
        found.append((SAME * chi2[best] + KNEE, own))
    least, best_form = min(found, key=lambda item: item[0])
    if least > (1 - SIMPLE) * straight:
        return Form("free", float(theta[0]), float(value[np.argmax(abs(value))]), 0.0)
    return best_form
