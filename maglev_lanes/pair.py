"""Numbers of both axes of a lane, so that one formula serves a rig of one axis and one of two.

With one axis a formula runs on plain numbers. With two it runs on pairs: sums, differences and products of pairs are
taken axis by axis. A piece of one lane and axis is lifted to pairs by `Lifts`.
"""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import NamedTuple

from maglev_lanes.pieces import INLINED, piece


class Pair(NamedTuple):
    """A number of each axis. It is not a plain tuple, because the sum of tuples is their concatenation.

    The operators here serve pieces that run as plain Python; the compiler has its own, see `teach_pairs`.
    """

    x: float
    y: float

    def __add__(self, other):
        return Pair(self.x + other.x, self.y + other.y)

    def __sub__(self, other):
        return Pair(self.x - other.x, self.y - other.y)

    def __mul__(self, number):
        return Pair(self.x * number, self.y * number)

    __rmul__ = __mul__


def of_x(a):
    """The number of the first axis; a plain number belongs to both axes."""
    return a.x if isinstance(a, Pair) else a


def of_y(a):
    """The number of the second axis."""
    return a.y if isinstance(a, Pair) else a


@cache
def teach_pairs() -> None:
    """Register the operators on pairs with the compiler."""
    from numba.core import types
    from numba.extending import overload

    from maglev_lanes.piece_compiler import PieceCompiler

    overload_pairs(overload, types, INLINED | {"pipeline_class": PieceCompiler})


def overload_pairs(overload: Callable, types: ModuleType, options: Mapping[str, object]) -> None:
    """Register the operators on pairs by the `overload` and the `types` of a compiler, which inlines by the options."""
    inlined = {"jit_options": dict(options)}

    def is_pair(a) -> bool:
        return isinstance(a, types.BaseNamedTuple) and a.instance_class is Pair

    @overload(of_x, **inlined)
    def _(a):
        return (lambda a: a.x) if is_pair(a) else (lambda a: a)

    @overload(of_y, **inlined)
    def _(a):
        return (lambda a: a.y) if is_pair(a) else (lambda a: a)

    @overload(operator.add, **inlined)
    def _(a, b):
        if is_pair(a) and is_pair(b):
            return lambda a, b: Pair(a.x + b.x, a.y + b.y)

    @overload(operator.sub, **inlined)
    def _(a, b):
        if is_pair(a) and is_pair(b):
            return lambda a, b: Pair(a.x - b.x, a.y - b.y)

    @overload(operator.mul, **inlined)
    def _(a, b):
        if is_pair(b) and not is_pair(a):
            return lambda a, b: Pair(a * b.x, a * b.y)
        if is_pair(a) and not is_pair(b):
            return lambda a, b: Pair(a.x * b, a.y * b)


@dataclass(frozen=True)
class Lifts:
    """Lifts pieces f(x, k, a, b, ...) of one axis, which take the block, the lane's index and numbers.

    Args:
        axes: 1 or 2; with 1 a piece is not changed.
        size: offset between the two axes of a lane.
    """

    axes: int
    size: int

    def each(self, f: Callable, numbers: int) -> Callable:
        """The piece for both axes, each with its own numbers."""
        if self.axes == 1:
            return f
        n = self.size
        return piece(
            (
                lambda x, k: Pair(f(x, k), f(x, k + n)),
                lambda x, k, a: Pair(f(x, k, of_x(a)), f(x, k + n, of_y(a))),
                lambda x, k, a, b: Pair(f(x, k, of_x(a), of_x(b)), f(x, k + n, of_y(a), of_y(b))),
                lambda x, k, a, b, c: Pair(
                    f(x, k, of_x(a), of_x(b), of_x(c)),
                    f(x, k + n, of_y(a), of_y(b), of_y(c)),
                ),
                lambda x, k, a, b, c, d: Pair(
                    f(x, k, of_x(a), of_x(b), of_x(c), of_x(d)),
                    f(x, k + n, of_y(a), of_y(b), of_y(c), of_y(d)),
                ),
                lambda x, k, a, b, c, d, e: Pair(
                    f(x, k, of_x(a), of_x(b), of_x(c), of_x(d), of_x(e)),
                    f(x, k + n, of_y(a), of_y(b), of_y(c), of_y(d), of_y(e)),
                ),
                lambda x, k, a, b, c, d, e, g: Pair(
                    f(x, k, of_x(a), of_x(b), of_x(c), of_x(d), of_x(e), of_x(g)),
                    f(x, k + n, of_y(a), of_y(b), of_y(c), of_y(d), of_y(e), of_y(g)),
                ),
            )[numbers]
        )

    def crossed(self, f: Callable, numbers: int) -> Callable:
        """The piece for both axes, each with the numbers of the other one."""
        n = self.size
        return piece(
            (
                None,
                lambda x, k, a: Pair(f(x, k, of_y(a)), f(x, k + n, of_x(a))),
                lambda x, k, a, b: Pair(f(x, k, of_y(a), of_y(b)), f(x, k + n, of_x(a), of_x(b))),
            )[numbers]
        )

    def across(self, f: Callable) -> Callable:
        """A piece f(x, k, source) for both axes, where each takes its numbers from the lane of the other one."""
        n = self.size
        return piece(lambda x, k: Pair(f(x, k, k + n), f(x, k + n, k)))

    def both(self) -> Callable:
        """A piece that combines the numbers of both axes into a pair."""
        if self.axes == 1:
            return piece(lambda a, b: a)
        return piece(lambda a, b: Pair(a, b))

    def distance_sq(self) -> Callable:
        """A piece: squared distance from the centre."""
        if self.axes == 1:
            return piece(lambda a: a * a)
        return piece(lambda a: a.x * a.x + a.y * a.y)
