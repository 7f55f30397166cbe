"""Kernels that are compiled once and kept on disk under a key made from everything that they use.

The compiler's own disk cache only checks the file of the compiled function, and refers to functions of other files by
their names. A kernel therefore has a fingerprint of all code that it reaches, and is compiled again when any of it
changes.
"""

import gc
from collections.abc import Callable, Iterator
from functools import cache
from hashlib import sha256
from inspect import getclosurevars
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType

from maglev_lanes.layout import FAST
from maglev_lanes.pair import Pair, overload_pairs, teach_pairs
from maglev_lanes.pieces import EXACT, INLINED, register

OWN = ("maglev_lanes", "estimation", "selfsense", "maglev_env")  # packages whose code ends up in kernels


def compiled(kernel: Callable, fast: bool = True) -> Callable:
    """The compiled kernel, from the disk cache if the same code has been compiled before.

    Args:
        kernel: a function in a factory, which uses a variable `sources` of the factory, so that its value becomes part
            of the key of the disk cache. It is set here.
        fast: whether the compiler may assume FAST of the kernel's arithmetic.
    """
    import numba as nb

    teach_pairs()
    register()
    _interleave()
    _uncollected()
    sign(kernel)
    made = nb.njit(fastmath=FAST if fast else False, error_model="numpy", nogil=True)(kernel)
    made._cache = _kept()(made.py_func)
    return made


@cache
def _kept() -> type:
    """numba's disk cache of a function, which loads machine code without what the compiler needs to make some.

    numba would first declare to itself every function that it can compile: three times what it takes to load all
    kernels of a sweep. Where nothing is found, the compiler does so when it begins.
    """
    from numba.core.caching import FunctionCache
    from numba.core.runtime import rtsys

    class Kept(FunctionCache):
        def load_overload(self, sig: object, target_context: object) -> object:
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)

    return Kept


def sign(kernel: Callable) -> None:
    """Set the variable `sources` of a kernel's factory to the kernel's fingerprint."""
    at = kernel.__code__.co_freevars.index("sources")
    kernel.__closure__[at].cell_contents = fingerprint(kernel)


@cache
def _interleave() -> None:
    """Make the compiler take two vectors of every loop over lanes in turn.

    A step is a long chain of operations, of which each waits for the one before: the second vector fills the waiting.
    """
    from llvmlite import binding

    binding.set_option("maglev", "-force-vector-interleave=2")


@cache
def _uncollected() -> None:
    """Keep the garbage collector from running while the compiler does.

    The compiler makes millions of objects that stay until it is done, and of all objects of the process the collector
    would look at each again and again, which takes a sixth of the compiler's time.
    """
    from numba.core import event

    class Uncollected(event.Listener):
        """Counts compilations that contain one another; the compiler's lock lets one thread in at a time."""

        def __init__(self) -> None:
            self.depth, self.before = 0, False

        def on_start(self, event: event.Event) -> None:
            if self.depth == 0:
                self.before = gc.isenabled()
                gc.disable()
            self.depth += 1

        def on_end(self, event: event.Event) -> None:
            self.depth -= 1
            if self.depth == 0 and self.before:
                gc.enable()

    event.register("numba:compile", Uncollected())


def fingerprint(function: Callable) -> int:
    """A number that changes with the code of a function, of every own function that it reaches, and their constants,
    and with how pieces are compiled.

    Comments, docstrings, and functions of the same files that it does not use leave it unchanged.
    """
    found = sha256(_way_of_compiling())
    for part in _parts(function, set()):
        found.update(repr(part).encode())
    return int(found.hexdigest()[:15], 16)


@cache
def _way_of_compiling() -> bytes:
    return repr((sorted(FAST), INLINED, EXACT)).encode() + Path(__file__).with_name("piece_compiler.py").read_bytes()


def _parts(value: object, seen: set[int]) -> Iterator[object]:
    """The parts of a fingerprint by everything that a value refers to in compiled code."""
    function = getattr(value, "py_func", value)  # of one that is compiled on its own
    if isinstance(function, FunctionType):
        if not function.__module__.startswith(OWN):
            yield function.__module__, function.__qualname__
        elif id(function) not in seen:
            seen.add(id(function))
            yield from _code(function.__code__, function.__doc__)
            used = getclosurevars(function)
            for name, other in sorted((used.globals | used.nonlocals).items()):
                yield name
                if isinstance(other, ModuleType):
                    attributes = sorted(set(function.__code__.co_names) & vars(other).keys())
                    for attribute in attributes if other.__name__.startswith(OWN) else ():
                        yield from _parts(vars(other)[attribute], seen)
                elif name != "sources":
                    yield from _parts(other, seen)
    elif value is Pair:
        yield from _code(overload_pairs.__code__, overload_pairs.__doc__)
    elif isinstance(value, type | BuiltinFunctionType):
        yield value.__name__
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, set | frozenset):
        yield sorted(value)
    else:
        yield value


def _code(code: CodeType, doc: str | None) -> Iterator[object]:
    yield code.co_code, code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant, None)
        elif constant is None or constant != doc:
            yield constant
