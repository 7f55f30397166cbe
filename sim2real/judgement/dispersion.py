"""How much more than noise the best explanation leaves: where it lacks something, and where recordings disagree.

Differences of cost count as evidence because noise alone would hardly make them. What a model lacks makes such
differences, too: it is a systematic error that every hypothesis takes up in another way, and that changes with the
excitation. Two chi-squares of the best explanation show its size: what of each recording's residual goes with the
recording's excitation, and what the recordings would save if each had parameters of its own (the heterogeneity of which
R. T. Birge's ratio is the root, Phys. Rev. 40, 1932).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import stats

from estimation.lines.line_windows import KEPT, POOLED
from maglev_env.loop.effect import effect_value
from sim2real.compared.problem import Part, Problem
from sim2real.judgement.lost_commands import LOST, louder_along, scatters
from sim2real.recorded.open_record import OpenRecord
from sim2real.search.fit import Fit

NOISE_INFLATION = 1.5  # of the residuals' chi-square, whose noise is told by the same recording
UNLIKELY = 1e-4  # probability under noise alone below which a chi-square is more than noise


@dataclass(frozen=True)
class ChiSquare:
    """A chi-square and its degrees of freedom.

    Attributes:
        value: The sum of squares, in units of the noise.
        freedom: Its expectation under noise alone.
        inflation: Factor on its scatter, because the noise is estimated too.
    """

    value: float
    freedom: float
    inflation: float = 1.0

    def beyond(self, allowed: float) -> float:
        """What exceeds an allowed cost and what noise alone is likely to make, at least 0."""
        if self.freedom < 1:
            return 0.0
        return max(self.value - allowed - self.freedom - self.inflation * _scatter(self.freedom), 0.0)

    def ratio(self, allowed: float) -> float:
        """Reduced chi-square of what exceeds an allowed cost; 1 where noise alone may make it."""
        return (self.value - allowed) / self.freedom if self.beyond(allowed) else 1.0


@lru_cache
def _scatter(freedom: float) -> float:
    """By how much a chi-square exceeds its expectation with a probability UNLIKELY."""
    return float(stats.chi2.isf(UNLIKELY, freedom)) - freedom


@dataclass(frozen=True)
class Dispersion:
    """What the best explanation leaves beyond noise.

    Attributes:
        fit: Of residuals that go with the excitation.
        recordings: Of the recordings about their common parameters.
    """

    fit: ChiSquare
    recordings: ChiSquare

    def ratio(self, allowed: float = 0.0) -> float:
        """The larger of both reduced chi-squares, at least 1; allowed: cost that another form may leave."""
        return max(self.fit.ratio(allowed), self.recordings.ratio(allowed))

    def beyond(self, allowed: float = 0.0) -> float:
        """The larger of what exceeds both, which something that the explanation lacks would save."""
        return max(self.fit.beyond(allowed), self.recordings.beyond(allowed))

    def in_words(self, allowed: float = 0.0) -> str:
        """The larger of the two excesses, in words: of the fit over its noise, or of the scatter among recordings."""
        if self.recordings.ratio(allowed) >= self.fit.ratio(allowed):
            return "the recordings disagree about the best explanation"
        return "the best explanation leaves much that goes with the excitation"


NOISE_ALONE = Dispersion(ChiSquare(0.0, 0.0), ChiSquare(0.0, 0.0))


def dispersion_of(problem: Problem, fit: Fit) -> Dispersion:
    """The dispersion about a fit that has its Jacobian."""
    lost = effect_value(fit.hypothesis.point(fit.u).effects, LOST)
    parts = [_left(part, fit.residual[part.place], lost) for part in problem.parts]
    freedom = sum(p.freedom for p in parts)
    scatter = sum(p.freedom * p.inflation**2 for p in parts) / max(freedom, 1.0)
    whole = ChiSquare(sum(p.value for p in parts), freedom, float(np.sqrt(scatter)))
    return Dispersion(whole, _among_recordings(problem, fit))


def _left(part: Part, residual: np.ndarray, lost: float = 0.0) -> ChiSquare:
    """What goes with the excitation: of a record without a period its directions in every window, because the noise is
    told from the others (along an instrument, that is all); else all lines, whose noise is told by the periods.

    The fewer directions tell the noise, the larger the ratio of both powers is on average, and the more it scatters: it
    is F-distributed. Lost commands (with a probability `lost`) scatter more along the excitation than elsewhere.
    """
    record = part.record
    if not isinstance(record, OpenRecord) or record.instrument is not None:
        return ChiSquare(float(np.sum(abs(residual) ** 2)), 2.0 * residual.size, NOISE_INFLATION)
    whole = np.zeros(part.measured.shape, complex)
    whole[..., part.used] = residual.reshape(*part.measured.shape[:2], -1)
    windows = part.used.reshape(-1, KEPT).all(axis=1)
    inside, rank = record.windows.along(whole.reshape(*whole.shape[:2], -1, KEPT), record.drives)
    power, rank = np.sum(abs(inside[..., windows, :]) ** 2, axis=(0, 3)), rank[windows]
    if lost > 0 and scatters(record):
        power = power / louder_along(part, record, lost)[:, windows]
    telling = np.maximum(KEPT - rank, 1.0)
    mean = POOLED * telling / (POOLED * telling - 1)
    more = np.sum(rank * (1 + rank / telling)) / max(rank.sum(), 1)
    freedom = 2.0 * float(rank.sum()) * whole.shape[0] * whole.shape[1]
    return ChiSquare(float(np.sum(power / mean)), freedom, max(NOISE_INFLATION, float(np.sqrt(more))))


def _among_recordings(problem: Problem, fit: Fit) -> ChiSquare:
    """What the recordings, and the means of a mass at rest, save with their own parameters, to second order.

    At the common optimum their scores s sum to zero. Each alone would move by H^-1 s and save s^T H^-1 s, with H its
    own part of the Hessian. Parameters at their bounds stay there.
    """
    h = fit.hypothesis
    coordinates = zip(h.coordinates, fit.u, strict=False)
    free = np.array([not c.at_bound(float(u)) for c, u in coordinates] + [True] * len(h.calibrated), bool)
    places = [part.place for part in problem.parts]
    places.append(slice(places[-1].stop, fit.residual.size))  # the means
    prior, saved, told = np.diag(fit.prior[free]), 0.0, 0.0
    for place in places:
        j, r = fit.jacobian[free, place], fit.residual[place]
        own, score = (j @ j.conj().T).real, (j @ r.conj()).real
        both = np.linalg.pinv(own + prior, rcond=1e-9, hermitian=True)
        saved += float(score @ both @ score)
        told += float(np.trace(both @ own))
    together = np.linalg.pinv(fit.normal[np.ix_(free, free)], rcond=1e-9, hermitian=True)
    return ChiSquare(saved, max(told - float(np.trace(together @ (fit.normal[np.ix_(free, free)] - prior))), 0.0))
