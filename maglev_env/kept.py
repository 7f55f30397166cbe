"""Results that are kept by the value of what they are made of."""

import pickle
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import ParamSpec, TypeVar

P, Result = ParamSpec("P"), TypeVar("Result")


def by_value(size: int) -> Callable[[Callable[P, Result]], Callable[P, Result]]:
    """Keep the last `size` results of a function of rigs and the like, which hold tables and so have no hash.

    Every chunk of a sweep has the same rig, but in another process a copy of it for each. Two of equal value whose
    bytes differ, as where names in them are the same object in one alone, are worked out twice; nothing else differs.
    Whoever is given a result must not change it.
    """

    def around(function: Callable[P, Result]) -> Callable[P, Result]:
        @lru_cache(maxsize=size)
        def made(arguments: bytes) -> Result:
            positional, named = pickle.loads(arguments)
            return function(*positional, **named)

        @wraps(function)
        def kept(*args: P.args, **kwargs: P.kwargs) -> Result:
            return made(pickle.dumps((args, kwargs)))

        return kept

    return around
