"""One swept gain: what a sweep covers, and how it is written on the command line."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Axis:
    """One swept gain: lowest and highest value in SI, and the number of grid points."""

    low: float
    high: float
    points: int


def parse_axis(text: str) -> Axis:
    """Read `lo:hi:n` (or `value`, kept constant) as written on the command line."""
    parts = text.split(":")
    try:
        if len(parts) == 1:
            return Axis(float(text), float(text), 1)
        low, high, points = parts
        return Axis(float(low), float(high), int(points))
    except ValueError:
        raise ValueError(f"{text!r} is not lo:hi:n (two gains and a whole number of points)") from None


def parse_axes(texts: Sequence[str]) -> dict[str, Axis]:
    """Read axes by name, each as `name=lo:hi:n`.

    Raises:
        ValueError: A text has another form, or a name is given twice.
    """
    axes: dict[str, Axis] = {}
    for text in texts:
        name, sign, axis = text.partition("=")
        if not sign:
            raise ValueError(f"{text!r} is not name=lo:hi:n, such as notch_frequency=500:800:7")
        if name in axes:
            raise ValueError(f"{name} is given twice")
        axes[name] = parse_axis(axis)
    return axes
