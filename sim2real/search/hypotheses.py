"""Hypotheses: which effects may explain a gap, which of their parameters are fitted, and where a fit starts."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from math import exp, inf, log

import numpy as np

from maglev_env.loop.card import SMALL_ROTOR, Parameter, Scales
from maglev_env.loop.effect import EFFECTS, NO_EFFECTS, Effects, effect_value, meaningful
from maglev_env.loop.free.places import NAMES as FREE
from maglev_env.rig.rig import Rig
from sim2real.compared.point import TOLERANCE_EFFECTS, Point
from sim2real.search.shapes import Shape, shapes_of

# Effects that are found by their frequencies and not fitted on spectral lines.
TONES = tuple(name for name, card in EFFECTS.items() if card.not_fitted and name not in FREE)
CALIBRATION, NONE, UNKNOWN = "calibration", "none", "unknown"


@dataclass(frozen=True)
class Coordinate:
    """How a fit moves one parameter: on a logarithmic scale (scale None), or in units of `scale` from a centre, within
    bounds."""

    effect: str
    parameter: str
    scale: float | None
    low: float
    high: float
    centre: float = 0.0

    def value(self, u: float) -> float:
        free = exp(min(u, 700.0)) if self.scale is None else u * self.scale + self.centre
        return float(min(max(free, self.low), self.high))

    def at(self, value: float) -> float:
        return log(value) if self.scale is None else (value - self.centre) / self.scale

    def to_bounds(self, u: float) -> float:
        return self.at(self.value(u))

    def at_bound(self, u: float) -> bool:
        """Whether a fit ended at an end of the range that it searches: its value is then no estimate."""
        return self.to_end(u) < AT_BOUND

    def to_end(self, u: float) -> float:
        """Distance to the nearer end of the range, in coordinates."""
        ends = [end for end in (self.low, self.high) if self.scale is not None or end > 0]
        return min((abs(self.to_bounds(u) - self.at(end)) for end in ends), default=inf)

    @property
    def signed(self) -> bool:
        """Whether its sign may change during a fit."""
        return self.scale is not None and self.low < 0

    def reach(self, u: float) -> float:
        """Largest change in a single step of a fit."""
        if self.scale is not None:
            return 3.0 + 1.5 * abs(u)
        return 0.15 if self.parameter == "frequency" else 0.7


AT_BOUND = 1e-6  # distance, in coordinates, from an end of the range within which a value stands there
FITTED = tuple(name for name in EFFECTS if name not in TONES and name not in FREE)


@lru_cache
def coordinates_of(name: str, scales: Scales = SMALL_ROTOR) -> tuple[Coordinate, ...]:
    """Coordinates of an effect on a rig of these scales; none of a tone."""
    if name not in FITTED:
        return ()
    own = ((key, p.on(scales)) for key, p in EFFECTS[name].plain.items() if p.is_meant_on(scales))
    # A zero that is off by more than the bias current would leave a magnet without any.
    ends = ((key, p, _least(p, scales), scales.bias if p.within_bias else inf) for key, p in own)
    return tuple(
        Coordinate(name, key, p.scale, max(low, -end), min(p.high, p.sought, end)) for key, p, low, end in ends
    )


def _least(p: Parameter, scales: Scales) -> float:
    """Lower end of what a fit seeks, where no bias bounds it."""
    return max(p.low, p.of_motion * scales.motion) if p.of_motion else p.low


# Real lags are not pure first-order. Up to MOST_FORM of a fitted lag (prior standard deviation FORM_SHARE) may be
# modelled as dead time, unless a delay of its own is fitted.
FORM, FORM_SHARE, MOST_FORM = "form of amplifier_lag", 0.2, 0.5
# A stated tolerance is also a prior of the effect that changes the same parameter. The effect stands for a parameter
# that is wrong beyond its tolerance, so its prior is wider: its standard deviation is WIDER tolerances. A change of
# more than EXCLUDED of these begins to contradict what the rig states. Its cost grows by STEEP times the square of what
# exceeds them, because of two effects that explain as much, at 15.3 and 14.1 tolerances, neither is much less probable.
# Beyond IMPOSSIBLE it grows no further (see `Hypothesis.beyond_stated`), and that is no explanation in a pair, in which
# nearly everything would seem to explain.
WIDER, EXCLUDED, IMPOSSIBLE, STEEP = 5.0, 3.0, 4.0, 30.0
STRAINED = 3.0  # tolerances from which a stated parameter that moved counts as it is, whatever the form of an effect is
NEARLY = 0.999  # share of that change at which a fit that may not go farther stands at the end
# A lag of another time constant than stated is still one pole, but these effects add a second one. So beside such an
# effect the stated time constant may itself be another, by WIDER tolerances.
REPLACED = {"amplifier_lag": "amplifier_time_constant", "sensor_lag": "sensor_time_constant"}
# Where no tolerance of it is stated, this much. Who says nothing of a time constant does not hold it for exact; what is
# known of it is its order of size.
USUAL = 0.1
RESONANCES = tuple(name for name, card in EFFECTS.items() if card.resonance)
NO_RESONANCE = 0.3  # damping ratio; supports and mounts of metal, rubber or print have 0.2 at most


@dataclass(frozen=True)
class Hypothesis:
    """What is assumed to cause the gap.

    Attributes:
        effects: Names of the effects; none for calibration alone.
        tolerances: Relative standard deviations of the nominal parameters that may move.
        dithered: Whether sensor noise smooths the effects.
        scales: What the sizes of effects are in proportion to.
        shaped: Effects whose form may differ from the plain formula.
        usual: Relative standard deviations of time constants of which no tolerance is stated: they move only beside the
            effect that stands for them.
        held: Effects whose coordinates stay at a value.
        given: Effect -> values of coordinates of its form that are known.
        own: Effects that the nominal rig has of its own. One that is fitted stands in its place; its change of a
            nominal parameter begins at the own value, which is where a stated tolerance is centred.
        seen: Effects that recordings show apart from any simulation, each with the range of its size.
        derived: Those of the tolerances that the rig does not state, but follow from others.
    """

    effects: tuple[str, ...]
    tolerances: Mapping[str, float]
    dithered: bool = False
    scales: Scales = SMALL_ROTOR
    shaped: tuple[str, ...] = ()
    usual: Mapping[str, float] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    given: Mapping[str, Mapping[str, float]] = field(default_factory=dict, kw_only=True)
    own: Effects = field(default_factory=dict, kw_only=True)
    seen: Mapping[str, tuple[float, float]] = field(default_factory=dict, kw_only=True)
    derived: frozenset[str] = field(default=frozenset(), kw_only=True)

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        own = (self._centred(c) for name in self.effects for c in coordinates_of(name, self.scales))
        held = self.held
        return tuple(
            replace(c, low=held[c.effect], high=held[c.effect]) if c.effect in held else self._possible(c) for c in own
        )

    def _centred(self, c: Coordinate) -> Coordinate:
        """A change of a nominal parameter about the one that the rig has of its own."""
        if c.effect not in self.own or EFFECTS[c.effect].nominal is None:
            return c
        return replace(c, centre=effect_value(self.own, c.effect, c.parameter))

    def _possible(self, c: Coordinate) -> Coordinate:
        """A coordinate within what is seen of it, and within what the rig states where it is one of several effects.

        One effect alone may show that a tolerance is wrong. Beside it any other one would seem to explain as much.
        """
        low, high = self.seen.get(c.effect, (-inf, inf))
        c = replace(c, low=max(c.low, low), high=min(c.high, high))
        sd = self._prior_sd(c) if len(self.effects) > 1 else None
        most = inf if sd is None else IMPOSSIBLE * sd
        return replace(c, low=max(c.low, c.centre - most), high=min(c.high, c.centre + most))

    @cached_property
    def shapes(self) -> Mapping[str, Shape]:
        """Coordinates of the forms that are free, by name."""
        all_forms = (s for name in self.effects if name in self.shaped for s in shapes_of(name, self.scales))
        free = (s for s in all_forms if s.key not in self.given.get(s.effect, {}))
        return {s.name: s for s in free if not set(self.effects).intersection(s.parameter.apart_from)}

    def instead(self, *effects: str) -> "Hypothesis":
        """Other effects on the same rig; the form stays free of those that stay."""
        kept = tuple(name for name in self.shaped if name in effects)
        return replace(self, effects=effects, dithered=False, shaped=kept, held={}, given={})

    @property
    def calibrated(self) -> tuple[str, ...]:
        """Nominal parameters within tolerance, except those that an effect frees entirely; then forms of effects."""
        freed = {t for t, name in TOLERANCE_EFFECTS.items() if name in self.effects}
        formed = "amplifier_lag" in self.effects and "delay" not in self.effects
        own = (name for name in self.tolerances if name not in freed)
        beside = (name for name in self.usual if name in self._replaced and name not in self.tolerances)
        return (*own, *beside, *([FORM] if formed else []), *self.shapes)

    def sigma(self, name: str) -> float:
        """Relative change that one unit of a calibrated coordinate stands for; 1 for a form's coordinate."""
        if name in self.shapes:
            return 1.0
        return FORM_SHARE if name == FORM else {**self.usual, **self.tolerances}[name]

    @property
    def size(self) -> int:
        return len(self.coordinates) + len(self.calibrated)

    @property
    def prior(self) -> np.ndarray:
        """Prior precision of each coordinate (size,): 1 for calibrated parameters, less for a time constant that an
        effect replaces; 0 for parameters of effects, except changes of a nominal parameter whose tolerance is stated.
        """
        own = [(c.scale or 0.0) / sd if (sd := self._prior_sd(c)) else 0.0 for c in self.coordinates]
        rest = [1 / WIDER if name in self._replaced else 1.0 for name in self.calibrated]
        return np.square([*own, *rest])

    @property
    def _replaced(self) -> frozenset[str]:
        """Stated time constants that an effect stands for, too."""
        return frozenset(REPLACED[name] for name in self.effects if name in REPLACED)

    def _prior_sd(self, c: Coordinate) -> float | None:
        """Prior standard deviation of a change of a nominal parameter, which is about what the rig's own effect makes
        of it; None where nothing is stated."""
        nominal = EFFECTS[c.effect].nominal
        return WIDER * self.tolerances[nominal] * (1 + c.centre) if nominal in self.tolerances else None

    def contradicted(self, u: np.ndarray) -> tuple[str, ...]:
        """Effects whose change at coordinates u contradicts the stated tolerance of their parameter."""
        return tuple(name for name, size in self._off_stated(u) if size > NEARLY * IMPOSSIBLE)

    def contradiction(self, u: np.ndarray) -> float:
        """Cost of what exceeds EXCLUDED at coordinates u, up to IMPOSSIBLE; 0 where nothing contradicts a stated
        tolerance."""
        sizes = (min(size, IMPOSSIBLE) for _, size in self._off_stated(u))
        return STEEP * sum(max(size - EXCLUDED, 0.0) ** 2 for size in sizes)

    def beyond_stated(self, u: np.ndarray) -> float:
        """What a contradiction adds to the cost, less what the prior has there for what exceeds IMPOSSIBLE: a number
        that is simply wrong, of another rotor or in another unit, is no less probable the farther it is off."""
        over = (max(size**2 - IMPOSSIBLE**2, 0.0) for _, size in self._off_stated(u))
        return self.contradiction(u) - sum(over)

    def _off_stated(self, u: np.ndarray) -> list[tuple[str, float]]:
        """Effects that change a parameter whose tolerance is stated, and by how many prior standard deviations."""
        at = ((c, float(v), self._prior_sd(c)) for c, v in zip(self.coordinates, u, strict=False))
        return [(c.effect, abs(c.value(v) - c.centre) / sd) for c, v, sd in at if sd]

    def strained(self, u: np.ndarray) -> dict[str, float]:
        """Stated parameters that moved by more than STRAINED tolerances, each with the cost of that.

        What follows from other tolerances is none: iron that saturates leaves less of the bias than its current says.
        """
        first, stated = len(self.coordinates), self.tolerances.keys() - self.derived
        moved = zip(self.calibrated, (self.prior * np.square(u))[first:], strict=True)
        return {name: float(cost) for name, cost in moved if name in stated and cost > STRAINED**2}

    def point(self, u: np.ndarray) -> Point:
        """The point at coordinates u (size,): effects first, then changes in units of their tolerance."""
        effects: dict[str, dict[str, float]] = {}
        for c, value in zip(self.coordinates, u, strict=False):
            effects.setdefault(c.effect, dict(self.given.get(c.effect, {})))[c.parameter] = c.value(float(value))
        rest = u[len(self.coordinates) :]
        changes = {n: float(v) * self.sigma(n) for n, v in zip(self.calibrated, rest, strict=True)}
        for name, shape in self.shapes.items():
            if (value := shape.value(changes.pop(name))) != shape.parameter.default:
                effects.setdefault(shape.effect, {})[shape.key] = value
        if share := changes.pop(FORM, 0.0):
            whole = effects["amplifier_lag"]["time_constant"]
            dead = effect_value(self.own, "delay") + share * whole
            effects["amplifier_lag"]["time_constant"], effects["delay"] = (1 - share) * whole, {"time": dead}
        return Point(effects, changes, self.dithered)

    def bounded(self, u: np.ndarray) -> np.ndarray:
        """Coordinates moved to within their bounds.

        A calibrated parameter may neither fall by more than 90 % nor contradict its tolerance.
        """
        bounded = np.array(u, float)
        for i, c in enumerate(self.coordinates):
            bounded[i] = c.to_bounds(float(bounded[i]))
        for i, name in enumerate(self.calibrated, len(self.coordinates)):
            if name in self.shapes:
                bounded[i] = self.shapes[name].bounded(bounded[i])
                continue
            sigma = self.sigma(name)
            most = WIDER * EXCLUDED * sigma
            low, high = (0.0, MOST_FORM) if name == FORM else (max(-0.9, -most), min(9.0, most))
            bounded[i] = min(max(bounded[i], low / sigma), high / sigma)
        return bounded


def added_lag(effects: Effects, name: str, causes: Collection[str], own: Effects = NO_EFFECTS) -> float:
    """Time in s by which a lag among effects ("amplifier_lag" or "sensor_lag") makes its block later.

    It is the time constant, less what feedback around it takes away, and the part of it that is dead time; own: effects
    of the nominal rig. What a lead takes away counts: a current loop that hardly lags has its poles in spite of it.
    """
    values = effects.get(name, {})
    return (1 - values.get("feedback", 0.0)) * values.get("time_constant", 0.0) + dead_part(effects, name, causes, own)


def dead_part(effects: Effects, name: str, causes: Collection[str], own: Effects = NO_EFFECTS) -> float:
    """Seconds of an amplifier's lag that are simulated as a delay, which is then none of the causes; the nominal rig's
    own delay is not part of it."""
    if name != "amplifier_lag" or "delay" in causes or "delay" not in effects:
        return 0.0
    return effect_value(effects, "delay") - effect_value(own, "delay")


def usual_tolerances(rig: Rig) -> dict[str, float]:
    """Relative standard deviations of the rig's time constants of which it states no tolerance."""
    return {name: USUAL for name in REPLACED.values() if getattr(rig, name) and name not in rig.tolerance}


def single_effects(rig: Rig) -> tuple[str, ...]:
    """Effects that have a meaning on a rig and are fitted on lines, except changes of what is stated as exact."""
    exact = {TOLERANCE_EFFECTS.get(name) for name, sigma in rig.tolerance.items() if sigma == 0}
    return tuple(name for name in FITTED if meaningful(name, rig.capabilities) and name not in exact)
