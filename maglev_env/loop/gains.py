"""Controllers of an axis: PID gains as the nominal rig's digital controller uses them, a linear filter, or a form."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import lru_cache
from math import exp
from typing import Any, Literal

import numpy as np
import scipy

from maglev_env.fields import is_number
from maglev_env.loop.axes import AXES
from maglev_env.loop.controller_forms import FORMS, Form, Pid
from maglev_env.loop.gain_card import KD, KP, LEAK, TIME_CONSTANT, GainCard, cards, gain, stated_gains
from maglev_env.loop.linear_controller import LinearController


@dataclass(frozen=True)
class Gains:
    """Gains of command = kp e + kd (e - d) / td + ki x, where d and x are e after low-pass filters (D eq 3.27).

    Args:
        kp: A/m.
        ki: A/m, since the filter of x has unit gain at rest: an integrator of ki / ti, A/(m s), that leaks.
        kd: A s/m.
        td: time constant of the filter of d, s.
        ti: time constant of the filter of x, s.

    Raises:
        ValueError: A gain is not a finite number, or a time constant is not positive.
    """

    kp: float = gain(KP)
    ki: float = gain(LEAK)
    kd: float = gain(KD)
    td: float = gain(TIME_CONSTANT, 1e-4)
    ti: float = gain(TIME_CONSTANT, 0.0318)

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:  # not `asdict`, which copies: a sweep makes many
            if not is_number(value := getattr(self, name)):
                raise ValueError(f"gains: {name} = {value!r} is not a finite number")
        for name in ("td", "ti"):
            if getattr(self, name) <= 0:
                raise ValueError(f"gains: {name} = {getattr(self, name)} s must be positive")


Controller = Gains | LinearController | Form
PidGains = Gains | Pid  # controllers that are a PID and nothing else
Digital = Gains | LinearController
INPUTS = ("reference", "reading", "current")
_CARDS = tuple(cards(of) for of in (Gains, *FORMS.values()))
# Every gain that some controller has, by name; what several have, as the first of them.
GAIN_CARDS: Mapping[str, GainCard] = {name: card for own in reversed(_CARDS) for name, card in own.items()}


def card_of(name: str, beside: Iterable[str]) -> GainCard:
    """The card of a gain beside others, all of the controller's: ki is another quantity where there is no ti.

    The name of a controller may stand behind a gain's, as in kp_A.
    """
    own, *others = (n if n in GAIN_CARDS else n.split("_")[0] for n in (name, *beside))
    return next((known[own] for known in _CARDS if {own, *others} <= known.keys()), GAIN_CARDS[own])


def unit_of_gain(name: str, beside: Iterable[str]) -> str:
    """The SI unit of a gain, see `card_of`."""
    return card_of(name, beside).unit


# One controller for every axis, or one for each of x and y.
Controllers = Controller | tuple[Controller, Controller]
NO_CONTROLLER = Gains(0.0, 0.0, 0.0)


def of_axis(controllers: Controllers, axis: int) -> Controller:
    """The controller of one axis (0: x or the only one, 1: y)."""
    return controllers[axis] if isinstance(controllers, tuple) else controllers


def digital(controller: Controller, dt: float) -> Digital:
    """The controller as the recursion that runs every dt (s)."""
    return controller if isinstance(controller, Digital) else _filter(controller, dt)


@lru_cache(maxsize=256)
def _filter(form: Form, dt: float) -> LinearController:
    """The filter of a form. Every lane of a batch asks for it several times, mostly for the same one."""
    return form.filter(dt)


def gain_values(controller: Controller) -> dict[str, float]:
    """Its gains by name, those of a part behind the part's name: kp, kd, notch_frequency; none of a linear filter."""
    return {name: value for name, value, _ in stated_gains(controller)}


def with_gains(controllers: Controllers, **changes: float) -> Controllers:
    """The controllers with some gains (see `gain_values`) or other fields replaced in every axis.

    Raises:
        ValueError: A controller has no gain of that name.
    """
    if isinstance(controllers, tuple):
        x, y = (_with_gains(one, **changes) for one in controllers)
        return x, y
    return _with_gains(controllers, **changes)


def _with_gains(controller: Controller, **changes: float) -> Controller:
    if isinstance(controller, Gains) and changes.keys() <= controller.__dataclass_fields__.keys():
        return replace(controller, **changes)  # which has no parts; a sweep asks for many
    known = () if isinstance(controller, LinearController) else (f.name for f in fields(controller))
    known = {*known, *gain_values(controller)}
    if missing := [name for name in changes if name not in known]:
        kind = f'of the form "{form_of(controller)}"' if known else "given by numerator and denominator"
        raise ValueError(f"{', '.join(missing)}: the rig's controller is {kind}, which has no such gain")
    return _replaced(controller, changes)


def _replaced(part: Any, changes: Mapping[str, float]) -> Any:
    """A controller or a part of it with other values of fields, and of fields of its own parts."""
    new: dict[str, Any] = {}
    for f in fields(part):
        ahead = f"{f.name}_"
        inner = {name.removeprefix(ahead): value for name, value in changes.items() if name.startswith(ahead)}
        if f.name in changes:
            new[f.name] = changes[f.name]
        elif inner and is_dataclass(own := getattr(part, f.name)):
            new[f.name] = _replaced(own, inner)
    return replace(part, **new)


def form_of(controller: Controller) -> str | None:
    """The controller's form in a file; None for plain gains."""
    return next((name for name, cls in FORMS.items() if type(controller) is cls), None)


def as_table(controllers: Controllers) -> dict:
    """The controllers as the [gains] table of a rig or campaign TOML."""
    if isinstance(controllers, tuple):
        return {axis: as_table(one) for axis, one in zip(AXES, controllers, strict=True)}
    if isinstance(controllers, Gains):
        return asdict(controllers)
    form = {} if isinstance(controllers, LinearController) else {"form": form_of(controllers)}
    return form | _stated(controllers)


def _stated(part: Any) -> dict[str, Any]:
    """The values of a controller or a part of it that are not the default ones."""
    values = {f.name: getattr(part, f.name) for f in fields(part) if getattr(part, f.name) != f.default}
    return {name: _stated(value) if is_dataclass(value) else value for name, value in values.items()}


def realised(controller: Controller, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """State-space matrices from reference, negative reading (m) and negative current (A) to the command (A).

    Its limit is left out.

    Returns:
        A (n, n), B (n, 3), C (n,) and D (3,), sampled every dt (s).
    """
    controller = digital(controller, dt)
    if isinstance(controller, Gains):
        a_d, a_i = exp(-dt / controller.td), exp(-dt / controller.ti)
        slope = controller.kd / controller.td
        direct = controller.kp + slope
        return (
            np.array([[a_d, 0.0], [0.0, a_i]]),
            np.array([[1 - a_d, 1 - a_d, 0.0], [1 - a_i, 1 - a_i, 0.0]]),
            np.array([-slope, controller.ki]),
            np.array([direct, direct, 0.0]),
        )
    n = controller.order
    b, a = controller.numerators, np.array(controller.denominator)
    matrix = np.eye(n, k=1)
    matrix[:, :1] -= a[1:, None]
    return matrix, (b[:, 1:] - a[1:] * b[:, :1]).T, np.eye(1, n)[0] if n else np.zeros(0), b[:, 0]


def states_of(controller: Controller, dt: float) -> int:
    """Number of states of `realised`."""
    own = digital(controller, dt)
    return 2 if isinstance(own, Gains) else own.order


def realised_together(controllers: Sequence[Controller], dt: float) -> tuple[np.ndarray, ...]:
    """`realised` of n controllers with the same number of states: A (n, s, s), B (n, s, 3), C (n, s) and D (n, 3)."""
    if not all(isinstance(own, Gains) for own in controllers):
        return tuple(map(np.array, zip(*(realised(own, dt) for own in controllers), strict=True)))
    kp, ki, kd, td, ti = np.array([(g.kp, g.ki, g.kd, g.td, g.ti) for g in controllers]).T
    decay = {t: exp(-dt / t) for t in {*td.tolist(), *ti.tolist()}}  # not numpy's, whose last bit may differ
    a_d, a_i = (np.array([decay[t] for t in own.tolist()]) for own in (td, ti))
    slope, none = kd / td, np.zeros(len(controllers))
    direct, by_d, by_i = kp + slope, 1 - a_d, 1 - a_i
    rows = ((a_d, none, none, a_i), (by_d, by_d, none, by_i, by_i, none), (-slope, ki), (direct, direct, none))
    a, b, c, d = (np.stack(own, axis=-1) for own in rows)
    return a.reshape(-1, 2, 2), b.reshape(-1, 2, 3), c, d


def state_space(controller: Controller, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """State-space matrices A (n, n), B (n,), C (n,) and D from the negative reading (m) to the command (A)."""
    a, b, c, d = realised(controller, dt)
    return a, b[:, 1], c, float(d[1])


def controller_response(
    controller: Controller, z: np.ndarray, dt: float, of: Literal["reference", "reading", "current"] = "reading"
) -> np.ndarray:
    """Response of the command to one input at points z (n,) of the unit circle.

    Args:
        controller: of an axis.
        z: (n,).
        dt: control step, s.
        of: "reference" (A/m), "reading" (its negative, A/m: that of the error too, if the error is all that acts) or
            "current" (its negative, A/A).
    """
    a, b, c, d = realised(controller, dt)
    b, d = b[:, INPUTS.index(of)], d[INPUTS.index(of)]
    return d + np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[:, None])[..., 0] @ c


def controller_output(
    controller: Controller,
    displacement: np.ndarray,
    dt: float,
    reference: np.ndarray | None = None,
    current: np.ndarray | None = None,
) -> np.ndarray:
    """What a controller at rest makes of its inputs, (samples,), by its own recursion, with its limit.

    Args:
        controller: of an axis.
        displacement: what the controller reads, m, (samples,).
        dt: control step, s.
        reference: m; None: 0.
        current: what the controller reads, A; needed if it reads the current.
    """
    own = digital(controller, dt)
    if isinstance(own, LinearController):
        return own.output((reference, -displacement, None if current is None else -current))
    a, b, c, d = state_space(own, dt)
    numerator, denominator = scipy.signal.ss2tf(a, b[:, None], c[None], np.array([[d]]))
    return np.asarray(
        scipy.signal.lfilter(
            numerator[0], denominator, -displacement if reference is None else reference - displacement
        )
    )


def reads_current(controllers: Controllers, dt: float) -> bool:
    """Whether a controller has the coil's current as an input."""
    if isinstance(controllers, Gains):
        return False
    return any(one.reads_current for one in linear_ones(controllers, dt))


def limited(controllers: Controllers, dt: float) -> bool:
    """Whether a controller's command has a limit."""
    return any(one.limit is not None for one in linear_ones(controllers, dt))


def linear_ones(controllers: Controllers, dt: float) -> list[LinearController]:
    """The controllers of all axes that are no PID gains, as the recursions that run every dt (s)."""
    found = (digital(one, dt) for one in (controllers if isinstance(controllers, tuple) else (controllers,)))
    return [one for one in found if isinstance(one, LinearController)]
