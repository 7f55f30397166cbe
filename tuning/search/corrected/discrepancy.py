"""What measurements differ from a model by, as a Gaussian process over the box, which doubts contradicted readings."""

import numpy as np

# Standard deviations of a difference that varies over the box, and lengths of its variation, in the box's half widths.
# Which of them hold is judged by the differences so far.
VARYING, LENGTHS = (0.005, 0.02, 0.06, 0.2), (0.7, 1.8)
DOUBTED = 3.0  # standard deviations from what the others say, beyond which a reading is taken to have more noise
ROUNDS = 4


class Discrepancy:
    """The logarithm of measured over modelled values of one quantity, at any point of the box."""

    def __init__(self, points: np.ndarray, noise: np.ndarray, constant: float, least: float) -> None:
        """Set up for points (n, k) of experiments.

        Args:
            points: The points.
            noise: Standard deviations of the readings' logarithms, (n,).
            constant: That of what is the same everywhere.
            least: Least standard deviation of what varies.
        """
        self._points, self._noise, self._constant = points, noise, constant
        self._choices = [(max(v, least), length) for v in VARYING for length in LENGTHS if v >= least / 2]

    def learn(self, ratios: np.ndarray) -> None:
        """Judge what holds by the differences (n,) from the best model."""
        known = np.isfinite(ratios)
        self._known = known
        x, y, noise = self._points[known], ratios[known], self._noise[known]
        variance = noise**2
        best, self._chosen = -np.inf, self._choices[0]
        if y.size:
            for choice in self._choices:
                covariance = self._kernel(x, x, choice) + np.diag(variance)
                likelihood = -0.5 * (y @ np.linalg.solve(covariance, y) + np.linalg.slogdet(covariance)[1])
                # Without evidence the differences are taken to be of middle size.
                likelihood -= 0.5 * (np.log(choice[0] / 0.03) / 1.5) ** 2
                if likelihood > best:
                    best, self._chosen = likelihood, choice
            for _ in range(ROUNDS if y.size > 2 else 0):
                inverse = np.linalg.inv(self._kernel(x, x, self._chosen) + np.diag(variance))
                without = (inverse @ y) / np.diag(inverse)  # each reading less what all others say of it
                own = np.maximum(1 / np.diag(inverse) - variance, 0.0) + noise**2
                variance = noise**2 + np.maximum(0.0, (without / DOUBTED) ** 2 - own)
        self._inverse = np.linalg.inv(self._kernel(x, x, self._chosen) + np.diag(variance)) if y.size else None

    def at(self, points: np.ndarray, ratios: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Means (d, m) and standard deviation (m,) at points (m, k) for the differences (d, n) from d models."""
        own = np.full(len(points), self._constant**2 + self._chosen[0] ** 2)
        if self._inverse is None:
            return np.zeros((len(ratios), len(points))), np.sqrt(own)
        across = self._kernel(points, self._points[self._known], self._chosen)
        gain = across @ self._inverse
        spread = np.sqrt(np.maximum(own - (gain * across).sum(axis=1), 0.0))
        return ratios[:, self._known] @ gain.T, spread

    def _kernel(self, a: np.ndarray, b: np.ndarray, choice: tuple[float, float]) -> np.ndarray:
        size, length = choice
        square = ((a[:, None] - b[None]) ** 2).sum(axis=2)
        return self._constant**2 + size**2 * np.exp(-0.5 * square / length**2)
