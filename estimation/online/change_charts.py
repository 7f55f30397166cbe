"""Two-sided CUSUM charts of standard normal innovations, with a threshold from the wanted rate of false alarms."""

import numpy as np
import scipy
from numpy.typing import ArrayLike

OVERSHOOT = 1.166  # mean excess over the threshold at both ends, which Siegmund's approximation adds to the threshold


class ChangeCharts:
    """Page's CUSUM charts, upward and downward, of several coefficients; all return to zero after an alarm.

    Args:
        coefficients: Number of coefficients.
        false_alarm_blocks: As in `cusum_threshold`, counting the alarms of all charts together.
        allowance: As in `cusum_threshold`.
    """

    def __init__(self, coefficients: int, false_alarm_blocks: float, allowance: float = 0.5) -> None:
        self.threshold = cusum_threshold(false_alarm_blocks, allowance, 2 * coefficients)
        self._allowance = allowance
        self._sums = np.zeros((2, coefficients))
        self._since = np.full((2, coefficients), np.nan)

    def update(self, time: float, innovation: ArrayLike) -> tuple[np.ndarray, float]:
        """Advance all charts by one block.

        Args:
            time: Time of the block, s.
            innovation: Standard normal innovations (coefficients,).

        Returns:
            alarm: One flag per coefficient, (coefficients,).
            onset: Time of the first block of the rise that caused the alarm, taken from the highest chart; nan without
                an alarm.
        """
        innovation = np.asarray(innovation, dtype=float)
        raised = np.maximum(self._sums + np.stack([innovation, -innovation]) - self._allowance, 0.0)
        self._since[(self._sums == 0) & (raised > 0)] = time
        self._sums = raised
        alarm = np.any(raised > self.threshold, axis=0)
        if not alarm.any():
            return alarm, np.nan
        self._sums = np.zeros_like(raised)
        return alarm, float(self._since.flat[raised.argmax()])


def cusum_threshold(false_alarm_blocks: float, allowance: float = 0.5, charts: int = 1) -> float:
    """Threshold at which `charts` one-sided CUSUM charts of standard normal values give the wanted false-alarm rate.

    By Siegmund (1985, Sequential Analysis, ch. 2) the mean run length of a chart is
    (exp(2 a b) - 2 a b - 1) / (2 a^2) values, with the allowance a and b = threshold + 1.166.

    Args:
        false_alarm_blocks: Mean number of blocks between false alarms of any chart.
        allowance: Amount subtracted from every value, standard deviations.
        charts: Number of one-sided charts.

    Raises:
        ValueError: The rate is too high for any threshold above zero, or a value does not fit.
    """
    if not (np.isfinite(allowance) and allowance > 0):
        raise ValueError(f"CUSUM: allowance = {allowance} must be a positive number of standard deviations")
    if charts < 1:
        raise ValueError(f"CUSUM: charts = {charts} must be at least 1")
    least = _run_length(0.0, allowance) / charts
    if not (np.isfinite(false_alarm_blocks) and false_alarm_blocks > least):
        raise ValueError(
            f"CUSUM: one false alarm in {false_alarm_blocks:g} blocks is not possible with {charts} charts of "
            f"allowance {allowance:g}; ask for one in more than {least:.3g}"
        )
    target = charts * false_alarm_blocks
    highest = np.log(2 * allowance**2 * target + 2) / allowance  # the run length there is far above the target
    root = scipy.optimize.brentq(lambda h: np.log(_run_length(h, allowance) / target), 0.0, highest)
    return float(root)  # pyright: ignore[reportArgumentType]  # scipy's types count full_output=True in


def _run_length(threshold: float, allowance: float) -> float:
    x = 2 * allowance * (threshold + OVERSHOOT)
    return (np.expm1(x) - x) / (2 * allowance**2)
