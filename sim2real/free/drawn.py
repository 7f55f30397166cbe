"""A fitted correction as curves with their errors: what is drawn, and what its words are made from."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from maglev_env.loop.free.element import LINE, PLAYS, RATIO, RELAXATIONS, SHARES, WIDTHS
from sim2real.compared.problem import Problem
from sim2real.free.kinds import CURVE, LINEAR, PLACES, Freed, Kind
from sim2real.free.shape import Form, form_of
from sim2real.search.fit import Fit

GAIN_SD = 0.1  # prior standard deviation of the relative error of a gain
FREQUENCIES, CYCLE = 41, 200  # points of a factor over frequency, and of a loop


@dataclass(frozen=True)
class Drawn:
    """One correction.

    Attributes:
        kind: Where and of what shape.
        range: Of its input, in its unit.
        at: Of a curve or a loop the input, of a factor the frequency in Hz, (n,).
        value: The correction there (n,), of a factor complex: what is added per unit of the input; beyond what the rig
            has of its own.
        se: Its standard error (n,), of a factor that of each real part.
        form: The simple form of a curve, or the straight line of one that has none; None without a curve.
    """

    kind: Kind
    range: float
    at: np.ndarray
    value: np.ndarray
    se: np.ndarray
    form: Form | None = None

    @property
    def relative(self) -> bool:
        """Whether it corrects its own input, so that shares of it mean something."""
        quantity, values = PLACES[self.kind.place]
        return quantity == values


def drawn(problem: Problem, fit: Fit) -> tuple[Drawn, ...]:
    """The corrections of a fit; errors are widened by the misfit that it leaves."""
    h = fit.hypothesis
    if not isinstance(h, Freed):
        return ()
    wider = max(float(np.mean(abs(fit.residual) ** 2) / 2), 1.0)
    covariance = fit.covariance() * wider
    excited = np.concatenate([p.record.frequency[p.record.excited] for p in problem.parts])
    band = np.geomspace(float(excited.min()), float(excited.max()), FREQUENCIES)
    return tuple(_drawn(h, kind, fit.u, covariance, band) for kind in h.added)


def _drawn(h: Freed, kind: Kind, u: np.ndarray, covariance: np.ndarray, band: np.ndarray) -> Drawn:
    own = h.place_of(kind)
    scale = np.array([c.scale or 1.0 for c in h.coordinates[own]])
    theta = u[own] * scale
    spread = covariance[own, own] * np.outer(scale, scale)
    constants = h.sizes.constants(kind.place)
    reach = constants["range"]
    if kind.shape == CURVE:
        at = reach * np.array([*(-s for s in SHARES[::-1]), *SHARES])
        quantity, values = PLACES[kind.place]
        form = form_of(at, theta, spread, GAIN_SD if quantity == values else np.inf)
        middle = len(LINE) // 2
        value, se = (np.insert(v, middle, 0.0) for v in (theta, np.sqrt(np.diag(spread))))
        return Drawn(kind, reach, np.insert(at, middle, 0.0), value, se, form)
    if kind.shape == LINEAR:
        times = constants["time"] * RATIO ** np.arange(len(RELAXATIONS))
        basis = np.column_stack([np.ones(band.size), 1 / (1 + 2j * np.pi * np.outer(band, times))])
        se = np.sqrt(np.maximum(np.einsum("fi,ij,fj->f", basis, spread, basis.conj()).real, 0.0) / 2)
        return Drawn(kind, reach, band, basis @ theta, se)
    at, basis = _cycle(reach)
    se = np.sqrt(np.maximum(np.einsum("fi,ij,fj->f", basis, spread, basis), 0.0))
    return Drawn(kind, reach, at, basis @ theta, se)


def _cycle(reach: float) -> tuple[np.ndarray, np.ndarray]:
    """A closed cycle over the range (CYCLE,), and the input and its plays along it, (CYCLE, 1 + plays)."""
    at = reach * np.cos(2 * np.pi * np.arange(CYCLE) / CYCLE)
    plays = np.empty((CYCLE, len(PLAYS)))
    states = at[0] - reach * np.array(WIDTHS)
    for _ in range(2):  # after one cycle it is closed
        for i, x in enumerate(at):
            states = np.clip(states, x - reach * np.array(WIDTHS), x + reach * np.array(WIDTHS))
            plays[i] = states
    return at, np.column_stack([at, plays])


def to_json(d: Drawn) -> Mapping[str, object]:
    """SI."""
    quantity, values = PLACES[d.kind.place]
    head = {"place": d.kind.place, "block": d.kind.block, "shape": d.kind.shape, "over": quantity, "of": values}
    if d.kind.shape == LINEAR:
        own = {"frequency": d.at, "real": d.value.real, "imag": d.value.imag, "se": d.se}
    else:
        own = {"at": d.at, "value": d.value, "se": d.se}
    if (f := d.form) is None:
        return head | own
    knee = {} if f.knee is None else {"knee": f.knee, "knee_ci": list(f.knee_ends or ())}
    return head | own | {"form": f.name, "size": f.size, "size_se": f.se} | knee
