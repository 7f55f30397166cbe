"""The kinds of free corrections: where in the loop, of what, and with which coefficients."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from maglev_env.kernel.replay import replayed
from maglev_env.loop.effect import EFFECTS, Effects, meaningful
from maglev_env.loop.free.element import LINE, PLAYS, RELAXATIONS
from maglev_env.loop.free.places import REMEMBERING
from sim2real.compared.point import Point, unseen_by
from sim2real.compared.problem import Part, Problem
from sim2real.search.hypotheses import Coordinate, Hypothesis

CURVE, LINEAR, PLAY = "curve", "linear", "play"
KEYS = {CURVE: LINE, LINEAR: ("direct", *RELAXATIONS), PLAY: ("direct", *PLAYS)}
# What each place corrects, and in what: quantity, and that of its values.
PLACES: Mapping[str, tuple[str, str]] = {
    "free_command": ("command", "command"),
    "free_current": ("current", "current"),
    "free_gain": ("displacement", "share"),
    "free_gain_velocity": ("velocity", "share"),
    "free_spring": ("displacement", "force"),
    "free_damper": ("velocity", "force"),
    "free_reading": ("displacement", "displacement"),
}
SETTLING = 0.2  # share of a replayed recording that is not looked at
MOST, BEYOND = 0.999, 1.02  # quantile of a quantity's size that is its range, and the factor on it
RELAXED = 3.0  # prior standard deviation of a relaxation's weight, in units of what it corrects; 1 of all others
BOUND = 4.0  # prior standard deviations that a coefficient may have
SUPPORTED = 0.95  # quantile of the excited frequencies that the fastest relaxation follows


@dataclass(frozen=True)
class Kind:
    """A kind of free correction.

    Attributes:
        place: The effect, a key of PLACES.
        shape: CURVE, LINEAR or PLAY.
    """

    place: str
    shape: str

    @property
    def block(self) -> str:
        return EFFECTS[self.place].block


@dataclass(frozen=True)
class Sizes:
    """How large the quantities of a campaign become.

    Attributes:
        of: Range of command, current (A), displacement (m), velocity (m/s), force (N) and share (1).
        time: Time constant of the fastest relaxation, s.
        own: Effects that the rig has of its own; a correction among them is where one of that place begins.
    """

    of: Mapping[str, float]
    time: float
    own: Effects = field(default_factory=dict)

    def coordinates(self, kind: Kind) -> tuple[Coordinate, ...]:
        """The coefficients of a kind in units of their prior standard deviations."""
        reach, values = self.constants(kind.place)["range"], PLACES[kind.place][1]
        parameters = EFFECTS[kind.place].parameters
        found = []
        for key in KEYS[kind.shape]:
            unit = self.of[values] / (1.0 if key in LINE else reach)
            scale = unit * (RELAXED if key in RELAXATIONS else 1.0)
            low, high = max(-BOUND * scale, parameters[key].low), min(BOUND * scale, parameters[key].high)
            found.append(Coordinate(kind.place, key, scale, low, high))
        return tuple(found)

    def constants(self, place: str) -> dict[str, float]:
        """The parameters of a place without any correction but the rig's own."""
        found = {key: p.default or 0.0 for key, p in EFFECTS[place].parameters.items()}
        if place in self.own:
            return found | dict(self.own[place])
        found["range"] = self.of[PLACES[place][0]]
        return found | ({"time": self.time} if place in REMEMBERING else {})


def sizes_of(problem: Problem, point: Point) -> Sizes | None:
    """The sizes at a point, from its simulation of every recording; None where the rotor touches down."""
    found = [own for part in problem.parts if (own := _sizes(part, point))]
    if len(found) < len(problem.parts):
        return None
    of = {name: max(own[name] for own in found) for name in found[0]}
    excited = [part.record.frequency[part.record.excited] for part in problem.parts]
    highest = float(np.quantile(np.concatenate(excited), SUPPORTED))
    # Below a control period, a relaxation is as good as no lag.
    rig = problem.parts[0].record.nominal
    return Sizes(of, max(0.5 / (2 * np.pi * highest), 0.5 / rig.control_rate), rig.effects)


def _sizes(part: Part, point: Point) -> dict[str, float] | None:
    e = part.record.experiment
    (series,) = replayed(part.predictor.lanes([point]), [part.record.drive])
    displacement, current, command = series[0][..., int(SETTLING * series.shape[-1]) :]
    if not np.isfinite(displacement).all():
        return None
    velocity = np.gradient(displacement, axis=-1) * e.rig.control_rate
    acceleration = np.gradient(velocity, axis=-1) * e.rig.control_rate
    every = {"command": command, "current": current, "displacement": displacement, "velocity": velocity}
    every["force"] = part.record.nominal.mass * acceleration
    found = {name: BEYOND * float(np.quantile(abs(values), MOST)) for name, values in every.items()}
    return found | {"share": 1.0}


def kinds(problem: Problem, sizes: Sizes) -> tuple[Kind, ...]:
    """The kinds that have a meaning on the rig, move, and are not before what drives every recording."""
    rig = problem.parts[0].record.nominal
    unseen = frozenset.intersection(*(unseen_by(part.record) for part in problem.parts))
    places = (p for p in PLACES if meaningful(p, rig.capabilities) and p not in unseen and sizes.of[PLACES[p][0]] > 0)
    return tuple(Kind(place, shape) for place in places for shape in KEYS if shape == CURVE or place in REMEMBERING)


@dataclass(frozen=True)
class Freed(Hypothesis):
    """A hypothesis with free corrections beside its effects; each coefficient has a wide prior about that of the rig's
    own correction, else about zero.

    Attributes:
        added: The corrections.
        sizes: Of the campaign.
    """

    added: tuple[Kind, ...] = ()
    sizes: Sizes = Sizes({}, 0.0)

    @cached_property
    def coordinates(self) -> tuple[Coordinate, ...]:
        return (*self.named, *(c for kind in self.added for c in self.sizes.coordinates(kind)))

    @cached_property
    def named(self) -> tuple[Coordinate, ...]:
        """The coordinates of the effects."""
        return Hypothesis(self.effects, self.tolerances, scales=self.scales, own=self.own).coordinates

    @property
    def prior(self) -> np.ndarray:
        own = super().prior
        own[len(self.named) : len(self.coordinates)] = 1.0
        return own

    def point(self, u: np.ndarray) -> Point:
        plain, first = super().point(u), len(self.named)
        freed = {kind.place: self.sizes.constants(kind.place) for kind in self.added}
        # Two kinds of one place may have a coefficient in common, as the part that acts at once.
        for c, v in zip(self.coordinates[first:], u[first:], strict=False):
            freed[c.effect][c.parameter] += c.value(float(v))
        return replace(plain, effects={**plain.effects, **freed})

    def place_of(self, kind: Kind) -> slice:
        """Where the coefficients of a correction stand among the coordinates."""
        at = len(self.named)
        for own in self.added:
            size = len(KEYS[own.shape])
            if own == kind:
                return slice(at, at + size)
            at += size
        raise ValueError(f"{kind} is not among the corrections")


def freed(base: Hypothesis, added: Sequence[Kind], sizes: Sizes) -> Freed:
    """A hypothesis with corrections added."""
    own = base.effects, base.tolerances, base.dithered, base.scales, base.shaped, base.usual
    return Freed(*own, tuple(added), sizes, own=base.own)
