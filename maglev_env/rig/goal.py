"""A goal of tuning: requirements with one-sided limits, and what to make best; read from text of one grammar."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import inf
from typing import Literal, get_args

from maglev_env.fields import is_number
from maglev_env.rig.goal_units import KINDS, in_si

EventKind = Literal["impulse", "step", "lift_off"]
MATCH = "match"  # the goal that compares stiffness and damping with those of the target
ENGINEER = "engineer"  # requirements derived from the rig, see `design.goals`
NAMED = (MATCH, ENGINEER)


@dataclass(frozen=True)
class Quantity:
    """One thing that a goal can require of a gain set.

    Args:
        unit: SI, and degrees; "" for a ratio.
        most: whether a requirement is an upper limit, otherwise a lower one.
        words: for tables and figures.
        shown: factor from the SI unit, and the unit it leads to.
        condition: word and unit of the condition under which it is measured; None: there is none. A band is optional.
        event: the event of the large-signal test that shows it, "any" if each one does; None: the identification
            experiment shows it.
        kind: of a current: "rms" or "peak".
        gain: of a ratio: whether it is one of gains, which dB can state.
    """

    unit: str
    most: bool
    words: str
    shown: tuple[float, str] = (1.0, "")
    condition: tuple[Literal["in", "after", "from"], str] | None = None
    event: EventKind | Literal["hover", "any"] | None = None
    kind: Literal["", "rms", "peak"] = ""
    gain: bool = True


QUANTITIES: Mapping[str, Quantity] = {
    "peak_sensitivity": Quantity("", True, "peak |S|"),
    "phase_margin": Quantity("deg", False, "phase margin", (1.0, "°")),
    "gain_margin": Quantity("", False, "gain margin"),
    "disk_margin": Quantity("", False, "disk margin", gain=False),
    "compliance": Quantity("m/N", True, "worst compliance", (1e6, "µm/N"), ("in", "Hz")),
    "stiffness": Quantity("N/m", False, "stiffness", (1e-3, "kN/m")),
    "damping": Quantity("N s/m", False, "damping", (1.0, "N s/m")),
    "displacement": Quantity("", True, "displacement over clearance"),
    "current_rms": Quantity("A", True, "current under excitation", (1.0, "A rms"), kind="rms"),
    "noise_current": Quantity("A", True, "noise current", (1e3, "mA rms"), event="hover", kind="rms"),
    "impulse_displacement": Quantity("m", True, "peak after an impulse", (1e6, "µm"), ("after", "N s"), "impulse"),
    "recovery_time": Quantity("s", True, "recovery from a step load", (1e3, "ms"), ("after", "N"), "step"),
    "lift_off_time": Quantity("s", True, "lift-off", (1e3, "ms"), ("from", "m"), "lift_off"),
    "current_peak": Quantity("A", True, "peak current", (1.0, "A"), event="any", kind="peak"),
}
MOST_RIGS = 256
MOST_TEXT = 10_000  # characters of a goal
EVENTS: tuple[EventKind, ...] = get_args(EventKind)


def _digits(value: float) -> str:
    """A number with as many digits as it needs to be read as the same one."""
    short = f"{value:g}"
    return short if float(short) == value else repr(float(value))


@dataclass(frozen=True)
class Requirement:
    """A limit of one quantity.

    Args:
        name: of QUANTITIES.
        limit: in the quantity's unit; of what is made best only a scale, at which its term is one half.
        at: the condition: a band (low, high) in Hz, None for all excited lines; a size in N s or N; a distance in m.

    Raises:
        ValueError: The name is unknown, the limit is not a positive number, or the condition does not fit.
    """

    name: str
    limit: float
    at: float | tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if self.name not in QUANTITIES:
            raise ValueError(f"goal: no quantity {self.name!r}; use {', '.join(QUANTITIES)}")
        if not (is_number(self.limit) and self.limit > 0):
            raise ValueError(f"goal: {self.name}: the limit {self.limit!r} must be a number above 0")
        condition, at = self.quantity.condition, self.at
        if condition is None:
            if at is not None:
                raise ValueError(f"goal: {self.name} takes no condition; leave {at!r} out")
        elif condition[0] == "in":
            if at is not None and not (
                isinstance(at, tuple) and len(at) == 2 and all(map(is_number, at)) and 0 < at[0] < at[1]
            ):
                raise ValueError(f"goal: {self.name}: the band {at!r} must be two increasing frequencies in Hz")
        elif not (isinstance(at, float | int) and is_number(at) and at > 0):
            raise ValueError(
                f"goal: {self.name} needs its condition: '{self.name} <= {self.limit:g} {condition[0]} SIZE', in "
                f"{condition[1]}"
            )

    @property
    def quantity(self) -> Quantity:
        return QUANTITIES[self.name]

    @property
    def size(self) -> float:
        """Size of the event that shows the quantity, in N s, N or m."""
        if not isinstance(self.at, float | int):
            raise ValueError(f"goal: {self.name} has no event")
        return self.at

    @property
    def band(self) -> tuple[float, float]:
        """Frequencies among which the worst is sought, Hz; all without a condition."""
        return self.at if isinstance(self.at, tuple) else (0.0, inf)

    @property
    def text(self) -> str:
        """As a statement of a goal."""
        return f"{self.name} {'<=' if self.quantity.most else '>='} {_digits(self.limit)}{self._condition}"

    @property
    def _condition(self) -> str:
        if self.at is None or self.quantity.condition is None:
            return ""
        size = "..".join(map(_digits, self.at if isinstance(self.at, tuple) else (self.at,)))
        return f" {self.quantity.condition[0]} {size}"


@dataclass(frozen=True)
class Goal:
    """Requirements, and one quantity to make as good as possible once they are met.

    Args:
        requirements: each quantity at most once.
        best: what is made best, with its scale; None: a gain set that meets everything is good enough.
        rigs: number of rigs, drawn within the data-sheet tolerances, on the worst of which everything counts; 0: the
            rig alone.

    Raises:
        ValueError: A quantity is named twice, there is nothing to require, current_peak has no event, or there are too
            many rigs.
    """

    requirements: tuple[Requirement, ...]
    best: Requirement | None = None
    rigs: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.rigs <= MOST_RIGS:
            raise ValueError(f"goal: worst of {self.rigs} rigs; draw up to {MOST_RIGS}")
        names = [r.name for r in self.requirements]
        if twice := {name for name in names if names.count(name) > 1}:
            raise ValueError(f"goal: {', '.join(sorted(twice))} is limited twice; state each quantity once")
        for one in self.requirements:
            if self.best and self.best.name == one.name and self.best.at not in (None, one.at):
                limited, best = (r._condition.strip() for r in (one, self.best))
                raise ValueError(
                    f"goal: {one.name} is measured {limited or 'everywhere'}, where it is limited, and made best "
                    f"{best}; state one of the two for both"
                )
        if not self.measured:
            raise ValueError("goal: state at least one requirement, such as 'peak_sensitivity <= 3'")
        if "current_peak" in {r.name for r in self.measured} and not self.events:
            raise ValueError(
                "goal: current_peak is that of the large-signal test; require an event of it too: "
                "impulse_displacement, recovery_time or lift_off_time"
            )

    @property
    def measured(self) -> tuple[Requirement, ...]:
        """Everything that is measured: the requirements, and what is made best."""
        own = {r.name for r in self.requirements}
        return self.requirements + ((self.best,) if self.best and self.best.name not in own else ())

    @property
    def events(self) -> dict[EventKind, Requirement]:
        """The events of the large-signal test, each with the requirement that states its size."""
        found = {r.quantity.event: r for r in self.measured}
        return {kind: found[kind] for kind in EVENTS if kind in found}

    @property
    def text(self) -> str:
        """Text that `parse_goal` reads as this goal."""
        statements = [r.text for r in self.requirements]
        if self.best and self.best in self.requirements:
            statements.append(f"best {self.best.name}")
        elif self.best:
            statements.append(f"best {self.best.name} near {_digits(self.best.limit)}{self.best._condition}")
        if self.rigs:
            statements.append(f"worst of {self.rigs} rigs")
        return ", ".join(statements)


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_UNIT = r"(?:\s*(?P<{}>[a-zA-Zµμ°%][a-zA-Zµμ°%/*· ]{{0,19}}?))?"
_CONDITION = (
    rf"(?:\s+(?P<word>in|after|from)\s+(?P<low>{_NUMBER})(?:\s*\.\.\s*(?P<high>{_NUMBER}))?{_UNIT.format('of')})?"
)
_LIMIT = re.compile(rf"(?P<name>\w+)\s*(?P<sense><=|>=)\s*(?P<limit>{_NUMBER}){_UNIT.format('unit')}{_CONDITION}")
_WORST = re.compile(r"worst\s+of\s+(\d{1,6})\s+rigs")
_BEST = re.compile(rf"best\s+(?P<name>\w+)(?:\s+near\s+(?P<limit>{_NUMBER}){_UNIT.format('unit')}{_CONDITION})?")


def parse_goal(text: str) -> Goal:
    """The goal of a text such as `peak_sensitivity <= 3, compliance <= 25e-6 in 10..250, best noise_current near 0.05`.

    Statements are separated by commas, semicolons or lines; # begins a comment. `best` takes its scale and condition
    from the requirement of the same quantity, or states them. `worst of 16 rigs` judges on rigs within tolerance.
    Numbers are SI or have a unit (`gain_margin >= 6 dB`, `recovery_time <= 30 ms after 0.8 N`).

    Raises:
        ValueError: A statement is not understood; the message quotes it and says what would be.
    """
    if len(text) > MOST_TEXT:
        raise ValueError(f"goal: {len(text)} characters; a goal has up to {MOST_TEXT}")
    requirements, best, rigs = [], None, 0
    for line in text.splitlines():
        for statement in filter(None, map(str.strip, re.split("[,;]", line.partition("#")[0]))):
            if limited := _LIMIT.fullmatch(statement):
                one = _requirement(limited, statement)
                if (limited["sense"] == "<=") != one.quantity.most:
                    wanted = "<=" if one.quantity.most else ">="
                    raise ValueError(
                        f"goal: {statement!r}: a requirement of {one.name} is a limit of the form {wanted}"
                    )
                requirements.append(one)
            elif (wished := _BEST.fullmatch(statement)) and best is None:
                best = wished, statement
            elif (drawn := _WORST.fullmatch(statement)) and not rigs:
                rigs = int(drawn[1])
            else:
                raise ValueError(
                    f"goal: {statement!r:.80} is not understood; write NAME <= NUMBER or NAME >= NUMBER, and each once "
                    f"'best NAME', 'best NAME near SCALE' and 'worst of N rigs'; names are {', '.join(QUANTITIES)}"
                )
    return Goal(tuple(requirements), best and _wish(*best, {r.name: r for r in requirements}), rigs)


def check_goal(text: str) -> None:
    """Raise ValueError unless the text is the name of a goal or one that `parse_goal` reads."""
    if not isinstance(text, str):
        raise ValueError(f"goal = {text!r:.40} must be a text: {', '.join(NAMED)}, or requirements")
    if text.strip() not in NAMED:
        parse_goal(text)


def _requirement(found: re.Match[str], statement: str, at: float | tuple[float, float] | None = None) -> Requirement:
    """The requirement of a statement, at the condition `at` unless it states one."""
    quantity = QUANTITIES.get(found["name"])
    if quantity is None:
        return Requirement(found["name"], float(found["limit"]))  # which says what there is
    condition = quantity.condition
    if found["word"] and condition and condition[0] != found["word"]:
        raise ValueError(f"goal: {statement!r}: the condition of {found['name']} is '{condition[0]}', not "
                         f"{found['word']!r}")  # fmt: skip
    try:
        limit = _limit(found, quantity)
        if found["word"]:
            ends = [float(found[one]) for one in ("low", "high") if found[one] is not None]
            ends = [in_si(one, found["of"], condition[1]) if condition else one for one in ends]
            at = (ends[0], ends[1]) if len(ends) == 2 else ends[0]
    except ValueError as error:
        raise ValueError(f"goal: {statement!r}: the unit {error}") from None
    return Requirement(found["name"], limit, at)


def _limit(found: re.Match[str], quantity: Quantity) -> float:
    """The limit of a statement, SI."""
    name, unit = found["name"], found["unit"]
    if unit == "dB" and not quantity.gain:
        raise ValueError(
            f"{unit!r} is not a unit of {name}, which is no gain: where gains may change by a factor k either way, it "
            "is 2 (k - 1) / (k + 1) at least, 0.34 of 3 dB; write the number"
        )
    try:
        return in_si(float(found["limit"]), unit, quantity.unit, quantity.kind)
    except ValueError as error:
        if quantity.kind and unit and unit.split()[-1] in KINDS:
            article = "an" if quantity.kind == "rms" else "a"
            raise ValueError(f"{error}: {name} is {article} {quantity.kind} value") from None
        raise


def _wish(found: re.Match[str], statement: str, limited: Mapping[str, Requirement]) -> Requirement:
    if found["limit"] is not None:
        same = limited.get(found["name"])
        return _requirement(found, statement, same and same.at)
    if found["name"] not in limited:
        raise ValueError(
            f"goal: {statement!r}: {found['name']} has no limit that could serve as its scale; write 'best "
            f"{found['name']} near SCALE', a value at which its term is one half"
        )
    return limited[found["name"]]
