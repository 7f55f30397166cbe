"""What gains reach on a rig, with intervals, and why they are not to be kept."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from maglev_env.loop.gains import PidGains
from tuning.campaign.carried import DRAWS, Carried
from tuning.campaign.gain_set import GainSet
from tuning.campaign.model import (
    RIGS,
    SEEN,
    Model,
    event_error,
    event_times,
    figure,
    large,
    linear,
    missed_by,
    scored,
    terms_of,
)  # fmt: skip
from tuning.study.recommendation import DISPLACEMENT_SHARE, GAIN_MARGIN, PEAK_SENSITIVITY, PHASE_MARGIN
from tuning.study.study import experiments

FEW = 8  # draws of the responses by which a search judges how sure margins are
SURE = 2.2  # of their standard deviations from the best estimate, for 95 % with so few
LEVEL = (2.5, 97.5)  # percentiles of a 95 % interval
NORMAL = scipy.stats.norm.ppf((np.arange(FEW) + 0.5) / FEW)  # FEW errors that are spread as normal ones are
RESERVE = 0.05  # share by which a margin's bound misses its limit where a search halves the score


@dataclass(frozen=True)
class Value:
    """An estimate with its 95 % interval, SI."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """What gains reach.

    Attributes:
        gains: The gains.
        score: Under the task's goal.
        expected: Its mean over all draws.
        spread: Its standard deviation over them.
        values: Quantities by name: the score, those of `match`, those of the goal.
        reason: Why these gains are not to be kept, or None.
        held: Whether the rotor levitates in all simulations.
        met: Share of the draws in which every requirement of the goal is met; None for `match`.
        missed: The requirements that the best estimate misses.
        unsure: Those that it meets, but the interval does not.
        simulated: Those that only simulation shows, at currents far beyond the recorded ones.
        response: |S| over frequency: (frequency, best, low, high), each (s,).
    """

    gains: PidGains
    score: Value
    expected: float
    spread: float
    values: Mapping[str, Value]
    reason: str | None
    held: bool
    met: float | None = None
    missed: tuple[str, ...] = ()
    unsure: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    response: tuple[np.ndarray, ...] = ()

    @property
    def peak(self) -> Value:
        return self.values["peak_sensitivity"]


def predict(model: Model, gains: PidGains, responses: Carried | None = None, seen: GainSet | None = None) -> Prediction:
    """What gains reach, by all recordings.

    Args:
        model: The rig.
        gains: The gains.
        responses: Instead of those of all recordings.
        seen: A recording at these gains, which shows some large signals itself.
    """
    point = model.point(gains)
    apart = 0.0 if seen else model.apart(gains)
    lanes = experiments(model.task, model.episodes, np.tile(point, (RIGS, 1)), [0] * RIGS)
    # Gains that were recorded have levitated, even where the model says that they would not.
    held = seen is not None or (not lanes.touchdown.any() and bool((figure(lanes, "pole_radius") < 1).all()))
    values = linear(model, responses or model.responses, gains, apart, DRAWS)
    turn = np.arange(DRAWS) % RIGS  # the rig on which the large signals of a draw are simulated
    values |= large(model, lanes, turn, seen, times=event_times(model, gains, turn))
    by, terms = missed_by(model, values), terms_of(model, values)
    scores = scored(model, terms)
    quantities = {"score": scores, **values}
    ends = {name: _interval(v) for name, v in quantities.items()}
    # Near its largest value a score falls with every error, while the truth may be better than the estimate in all
    # terms: the upper end is that of the terms' own upper ends.
    best = scored(model, {name: np.nanpercentile(term, LEVEL[1]) for name, term in terms.items()})
    ends["score"] = replace(ends["score"], high=max(float(best), ends["score"].high))
    s = np.abs((responses or model.responses).sensitivity(gains, apart))
    shape = (model.responses.injected, s[0], *np.percentile(s, LEVEL, axis=0))
    met, missed, unsure = None, (), ()
    if by:
        met = float(np.mean(np.all([v <= 0 for v in by.values()], axis=0)))
        missed = tuple(n for n, v in by.items() if v[0] > 0)
        unsure = tuple(n for n, v in by.items() if v[0] <= 0 and np.mean(v > 0) > 1 - LEVEL[1] / 100)
    expected, spread = float(scores.mean()), float(scores.std())
    reason = _reason(ends, held)
    return Prediction(
        gains, ends["score"], expected, spread, ends, reason, held, met, missed, unsure, response=shape
    )  # fmt: skip


def search_scores(model: Model, points: np.ndarray, limit: float, draws: int = FEW) -> np.ndarray:
    """Scores (n,) of points (n, k) over a few draws, lower where margins are not surely kept.

    Args:
        model: The rig.
        points: The points.
        limit: Largest peak sensitivity.
        draws: Up to FEW; of 1, the best estimate counts as if it were sure.
    """
    n = len(points)
    lanes = experiments(model.task, [model.episodes[0]] * n, points, [0] * n)
    simulated = large(model, lanes, np.arange(n), None, alone=True)
    # The same errors for every point: a search that knew none would stop right at the limits of large signals.
    rng = np.random.default_rng(173205)
    spread = NORMAL if draws > 1 else np.zeros(1)
    factors = {k: np.exp(SEEN.get(k, event_error(k)) * rng.permutation(spread)) for k in simulated}
    factors["displacement"] = factors["peak_displacement"]
    found = np.zeros(n)
    for i, point in enumerate(points):
        if lanes.touchdown[i] or not lanes.info[i].get("pole_radius", 1.0) < 1:
            continue
        gains = model.gains(point)
        values = linear(model, model.responses, gains, model.apart(gains), draws)
        sure = {
            "peak": _surely(values["peak_sensitivity"], 1.0) / limit,
            "phase": PHASE_MARGIN / _surely(values["phase_margin"], -1.0),
            "gain": GAIN_MARGIN / _surely(values["gain_margin_high"], -1.0),
        }
        drawn = values | {k: v[i] * factors[k] for k, v in simulated.items()}
        misses_by = sum(float(np.log(max(1.0, v))) for v in sure.values())
        found[i] = scored(model, terms_of(model, drawn)).mean() / (1 + misses_by / RESERVE)
    return found


def _surely(values: np.ndarray, side: float) -> float:
    """The end of the interval that a few draws, of which the first is the best estimate, stand for; above or below."""
    if np.isnan(values[0]):  # no crossing within the lines
        return np.inf
    if values.size == 1:
        return float(values[0])
    apart = np.log(values[1:] / values[0])
    return float(values[0] * np.exp(side * SURE * np.sqrt(np.nanmean(apart**2))))


def _interval(values: np.ndarray) -> Value:
    known = values[~np.isnan(values)]
    if not known.size:
        return Value(np.nan, np.nan, np.nan)
    low, high = np.percentile(known, LEVEL, method="closest_observation")
    return Value(float(values[0]), min(float(low), float(values[0])), max(float(high), float(values[0])))


def _reason(ends: Mapping[str, Value], held: bool) -> str | None:
    """Why gains are not to be kept, in words with figures."""
    if not held:
        return "the rotor does not levitate on every rig that the recordings allow"
    if not ends["peak_sensitivity"].high <= PEAK_SENSITIVITY:
        high = ends["peak_sensitivity"].high
        return f"peak sensitivity up to {high:.3g}, beyond zone B of ISO 14839-3 ({PEAK_SENSITIVITY:g})"
    if ends["displacement"].high > DISPLACEMENT_SHARE:
        return f"displacement up to {ends['displacement'].high:.0%} of the clearance under the excitation"
    for name, least, unit in (("phase_margin", PHASE_MARGIN, " degrees"), ("gain_margin_high", GAIN_MARGIN, "")):
        if ends[name].low < least:
            return f"{name.replace('_', ' ')} down to {ends[name].low:.3g}{unit}, below {least:g}{unit}"
    return None
