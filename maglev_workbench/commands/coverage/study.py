"""How often the intervals of an estimate hold what they are said to hold, over drawn experiments."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from estimation.normal import NORMAL_95
from estimation.stability_margins import margins
from maglev_env.evaluation.identification import Identification, identify
from maglev_env.experiment import Experiment
from maglev_env.kernel.simulate import simulate_records
from maglev_env.loop.magnets.kinds import force_law
from maglev_env.loop.magnets.law import linearise
from maglev_env.recordings.recording import simulated_recording
from maglev_env.recordings.spectra import RecordedSignals
from maglev_env.rig.rig import Noise
from maglev_workbench.commands.coverage.conditions import Condition

BANDS = (40.0, 90.0, 150.0)  # Hz: the bands nearest to these are counted
MARGINS = ("peak_sensitivity", "phase_margin", "delay_margin", "disk_margin", "gain_margin_low", "gain_margin_high")
COEFFICIENTS = ("stiffness", "damping")

Intervals = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True)
class Coverage:
    """How often the intervals of one quantity hold the truth.

    Attributes:
        quantity: its name; a band's has its middle in Hz.
        held: draws whose interval holds the truth.
        draws: draws that gave an interval.
        truth: in SI.
        half_width: median half width of the intervals, of the truth's size; None where half of them have no end.
    """

    quantity: str
    held: int
    draws: int
    truth: float
    half_width: float | None

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the coverage (Wilson)."""
        found = scipy.stats.binomtest(self.held, self.draws).proportion_ci(method="wilson")
        return float(found.low), float(found.high)


def coverage(
    condition: Condition, draws: int, seed: int, progress: Callable[[], object] | None = None
) -> tuple[Coverage, ...]:
    """Draw experiments, identify each as a user would, and count.

    The truth of stiffness, damping and margins is that of the best linear approximation: the mean over the same draws
    without noise. The truth of a record of the injection alone is the rig's own gain, stiffness and damping.

    Args:
        condition: what is drawn.
        draws: at least 2.
        seed: of the study.
        progress: called after each draw.
    """
    found, clean = [], []
    for draw in range(draws):
        e = condition.experiment(seed, draw)
        found.append(_identified(condition, e))
        clean.append(_identified(condition, replace(e, rig=replace(e.rig, noise=Noise()))))
        if progress:
            progress()
    truth = _truth(condition, clean)
    return tuple(_counted(name, value, [_intervals(one)[name] for one in found]) for name, value in truth.items())


def _identified(condition: Condition, e: Experiment) -> Identification:
    recording = simulated_recording(e, simulate_records([e], threads=1)[0])
    channels = {str(n): recording[n].values for n in recording.data_vars if str(n) not in condition.hidden}
    rate = e.rig.control_rate if "force" in condition.places else None
    signals = RecordedSignals(channels, e.rig.control_rate, e.excitations, rate, e.gains)
    return identify(signals, condition.nominal, condition.nominal.mass)


def _intervals(found: Identification) -> Intervals:
    """Interval by quantity."""
    given: dict[str, tuple[float | None, float | None]] = {}
    if found.actuator is not None:
        for name in ("gain", *COEFFICIENTS):
            value, half = getattr(found.actuator, name), NORMAL_95 * getattr(found.actuator, f"{name}_se")
            given[f"actuator {name}"] = value - half, value + half
    else:
        for name, band, at in _bands(found):
            given[f"{name} at {at:.0f} Hz"] = getattr(found.bands[band], f"{name}_ci")
    if found.stability is not None:
        given |= {name: found.stability.margins.intervals[name] for name in MARGINS}
    return given


def _bands(found: Identification) -> list[tuple[str, int, float]]:
    """Coefficient, index of the band and the frequency that it is nearest to."""
    middles = np.array([(b.f_lo + b.f_hi) / 2 for b in found.bands])
    return [(name, int(abs(middles - at).argmin()), at) for name in COEFFICIENTS for at in BANDS]


def _truth(condition: Condition, clean: Sequence[Identification]) -> dict[str, float]:
    """Truth by quantity, where there is one."""
    first, truth = clean[0], {}
    if first.actuator is not None:
        gain, stiffness = linearise(force_law(condition.nominal))
        truth = {"actuator gain": gain, "actuator stiffness": stiffness, "actuator damping": 0.0}
    else:
        for name, band, at in _bands(first):
            truth[f"{name} at {at:.0f} Hz"] = float(np.mean([getattr(one.bands[band], name) for one in clean]))
    if first.stability is not None:
        sensitivity = np.mean([one.stability.sensitivity for one in clean if one.stability], axis=0)
        exact = margins(first.stability.frequency, sensitivity, np.zeros(sensitivity.size), draws=0)
        known = {name: getattr(exact, name) for name in MARGINS}
        truth |= {name: float(value) for name, value in known.items() if value is not None}
    return truth


def _counted(name: str, truth: float, intervals: Sequence[tuple[float | None, float | None]]) -> Coverage:
    ends = np.array([(-np.inf if low is None else low, np.inf if high is None else high) for low, high in intervals])
    held = int(((ends[:, 0] <= truth) & (truth <= ends[:, 1])).sum())
    half = float(np.median(ends[:, 1] - ends[:, 0]) / 2)
    return Coverage(name, held, len(ends), truth, half / abs(truth) if truth and np.isfinite(half) else None)
