"""Pieces of a kernel: plain functions of one lane that are compiled into the loop that calls them."""

from collections.abc import Callable
from typing import TypeVar

Function = TypeVar("Function", bound=Callable)

# How the compiler takes them: without what only a function that is called on its own needs, which costs time.
INLINED = {"forceinline": True, "no_cfunc_wrapper": True, "no_cpython_wrapper": True}
_waiting: list[Callable] = []  # pieces that the compiler does not know yet


def piece(function: Function) -> Function:
    """Mark a function as part of kernels. It stays a plain Python function.

    The compiler inlines it by force when the machine code is made. That compiles faster than inlining before types are
    known, and the result is as fast. The compiler itself is imported when the first kernel is made (see `register`),
    because importing it takes a second.
    """
    _waiting.append(function)
    return function


def register() -> None:
    """Register all pieces that were marked since the last call with the compiler."""
    from numba.extending import register_jitable

    while _waiting:
        register_jitable(**INLINED)(_waiting.pop())
