"""Options of `maglev runup`: speeds, and gains of the rotor's controllers."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from math import isfinite

import numpy as np

from maglev_env.loop.gains import Gains
from maglev_env.rotor.parts import Rejection
from maglev_env.rotor.rotor import Rotor

MOST_SPEEDS = 2000


def parse_speeds(text: str) -> np.ndarray:
    """Speeds (n,) in rpm from the text lo:hi:step, both ends included, or from one value; the last step may be shorter.

    Raises:
        ValueError: The text has another form, or gives too many speeds.
    """
    try:
        values = [float(part) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(map(isfinite, values)):
        raise ValueError(f"--speeds {text!r}: write lo:hi:step in rpm, e.g. 0:14000:500, or one speed")
    if len(values) == 1:
        return np.array(values)
    low, high, step = values
    if not (step > 0 and high >= low):
        raise ValueError(f"--speeds {text!r}: the step must be above 0 and lo at most hi")
    count = (high - low) / step * (1 + 1e-12) + 1
    if count >= MOST_SPEEDS + 1:
        raise ValueError(f"--speeds {text!r}: {count:.4g} speeds; take a larger step, {MOST_SPEEDS} at most")
    steps = low + step * np.arange(int(count))
    return steps if high - steps[-1] <= 1e-9 * step else np.append(steps, high)


def with_rejection(rotor: Rotor, rate: float | None) -> Rotor:
    """The rotor with a force rejection of another rate (1/s), which acts from its own least speed; None: unchanged."""
    return rotor if rate is None else replace(rotor, rejection=replace(rotor.rejection or Rejection(), rate=rate))


def with_chosen_gains(rotor: Rotor, gains: Mapping[str, float | None], single: Sequence[str]) -> Rotor:
    """The rotor with other gains.

    Args:
        rotor: with two controllers.
        gains: replaced in both controllers; None: unchanged.
        single: controller.gain=value, replaced afterwards.

    Raises:
        ValueError: The rotor has no such controller or gain, or the value is not a number.
    """
    both = {name: value for name, value in gains.items() if value is not None}
    chosen = {name: replace(old, **both) for name, old in rotor.gains.items()}
    known = [f.name for f in fields(Gains)]
    for text in single:
        where, equals, value = text.partition("=")
        controller, dot, name = where.partition(".")
        if not (equals and dot) or controller not in chosen or name not in known:
            raise ValueError(
                f"--gains {text!r}: write controller.gain=value with a controller of {', '.join(chosen)} and a gain of "
                f"{', '.join(known)}"
            )
        try:
            chosen[controller] = replace(chosen[controller], **{name: float(value)})
        except ValueError as error:
            raise ValueError(f"--gains {text!r}: {error}") from None
    return replace(rotor, gains=chosen)


def check_reach(rotor: Rotor, speeds: np.ndarray) -> None:
    """Raise ValueError if the rotor's motor cannot keep one of the speeds (rpm)."""
    if rotor.motor is None:
        return
    try:
        rotor.motor.current(float(abs(speeds).max()) * np.pi / 30)
    except ValueError as error:
        raise ValueError(
            f"{error}; lower --speeds, or give [motor] of the rotor's TOML more torque or less drag"
        ) from None
