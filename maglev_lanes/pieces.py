"""Pieces of a kernel: plain functions of one lane that are compiled into the loop that calls them."""

from collections.abc import Callable
from typing import TypeVar, cast

Function = TypeVar("Function", bound=Callable)

# How the compiler takes them: without what only a function that is called on its own needs, which costs time, and
# without counting references to arrays, as they neither make nor keep any. None may stay a call: of functions of one
# name a process keeps the one that it compiled or loaded first, optimised for another kernel, and the last bits of
# results would depend on which kernels ran before.
INLINED = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True, "forceinline": True, "_nrt": False}
EXACT = INLINED | {"fastmath": False}
_made: dict[tuple, Callable] = {}  # every piece by what it computes, see `_content`
_waiting: list[tuple[Callable, tuple, dict]] = []  # pieces that were marked since the last kernel was made


def piece(function: Function) -> Function:
    """Mark a function as part of kernels. It stays a plain Python function.

    The compiler inlines it by force when the machine code is made. That compiles faster than inlining before types are
    known, and the result is as fast. The compiler itself is imported when the first kernel is made (see `register`),
    because importing it takes a second.

    Returns:
        The function, or one that was marked before and computes the same: factories make the pieces of every kernel
        anew, and the compiler would compile them anew.
    """
    return _marked(function, INLINED)


def exact(function: Function) -> Function:
    """Mark a function as part of kernels whose arithmetic is as it is written, in fast kernels, too."""
    return _marked(function, EXACT)


def _marked(function: Function, options: dict) -> Function:
    content = _content(function)
    _waiting.append((function, content, options))
    return cast(Function, _made.setdefault(content, function))


def pieces() -> list[Callable]:
    """All pieces that were marked up to now."""
    return list(_made.values())


def _content(function: Callable) -> tuple:
    """What a function computes: its code with the values of the variables of its factory."""
    cells = function.__closure__ or ()
    return function.__code__, id(function.__globals__), *(_value(cell.cell_contents) for cell in cells)


def _value(value: object) -> object:
    """A number by what it is, because 1, 1.0 and True are equal, but are not compiled alike; all else by its identity.

    What is compared by identity is kept alive by the piece that was made of it.
    """
    return repr(value) if isinstance(value, bool | int | float | str | None) else id(value)


def register() -> None:
    """Register all pieces that were marked since the last call with the compiler.

    Raises:
        RuntimeError: A variable that a piece uses was set again after the piece was marked.
    """
    from numba.extending import register_jitable

    from maglev_lanes.piece_compiler import PieceCompiler, compare_options_quickly

    compare_options_quickly()
    while _waiting:
        function, content, options = _waiting.pop()
        if _content(function) != content:
            raise RuntimeError(f"{function.__qualname__}: a variable that this piece uses changed after it was marked")
        if _made[content] is function:
            register_jitable(**options, pipeline_class=PieceCompiler)(function)
