"""Kernels for an NVIDIA GPU, made by numba-cuda from the same pieces as those for a processor.

On a GPU every lane has a thread of its own. Blocks have the layout of `maglev_lanes.layout`, so that neighbouring
threads read neighbouring numbers. NUMBA_ENABLE_CUDASIM=1 in the environment, before numba is imported, runs everything
as plain Python, for tests.
"""

from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from threading import current_thread
from types import SimpleNamespace
from warnings import filterwarnings

import numpy as np

from maglev_lanes.compiled import sign
from maglev_lanes.elementary import nearest, root
from maglev_lanes.pair import overload_pairs
from maglev_lanes.pieces import piece, pieces

# Of a group that shares a processor of the GPU: few, so that few lanes are spread over all of its processors.
THREADS = 32
INSTALL = 'pip install "maglev-workbench[cuda]"'
_INLINED = {"forceinline": True}
_taught: set[int] = set()  # pieces that the compiler for GPUs knows, by identity


def simulated() -> bool:
    """Whether numba simulates the GPU, without a compiler."""
    from numba.core import config

    return bool(config.ENABLE_CUDASIM)


def require_gpu() -> str:
    """The name of the GPU.

    Raises:
        ValueError: There is no GPU, or what drives it is not installed; the text says what to do.
    """
    if simulated():
        return "simulated"
    if find_spec("numba_cuda") is None:
        raise ValueError(f"--device cuda needs numba-cuda, which is not installed: {INSTALL}, or use --device cpu")
    from numba import cuda

    if not cuda.is_available():
        try:
            cuda.current_context()
            why = "its compiler libraries (NVVM) are missing"
        except Exception as error:  # of the driver, and each version has its own classes
            why = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(
            f"--device cuda: no usable CUDA GPU: {why}. A GPU of NVIDIA, its driver and {INSTALL} are needed; "
            "nvidia-smi shows what there is. Or use --device cpu"
        )
    _require_fitting_numpy()
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def _require_fitting_numpy() -> None:
    """Raise ValueError where numba-cuda, which has no upper bound of numpy, takes something from it that is gone."""
    try:
        import_module("numba.cuda.cudaimpl")  # otherwise imported with the first kernel
    except (AttributeError, ImportError) as error:
        raise ValueError(
            f"--device cuda: numba-cuda {version('numba-cuda')} does not work with numpy {np.__version__} ({error}): "
            f"{INSTALL} brings versions that fit. Or use --device cpu"
        ) from error


def free_memory() -> int:
    """Bytes that are free on the GPU."""
    if simulated():
        return 1 << 30
    from numba import cuda

    context = cuda.current_context()
    context.deallocations.clear()  # what is no longer used is freed late
    return int(context.get_memory_info().free)


def of_lane(function: Callable) -> Callable:
    """A function of a factory with a variable `sources`, as for `compiled`, marked as part of kernels for a GPU."""
    sign(function)
    return piece(function)


def gpu_kernel(function: Callable) -> Callable[..., None]:
    """The kernel of a function of arrays and numbers, compiled at its first call.

    It is called with the arguments of the function, of which the last is the number of threads that are needed; a few
    more may run.
    """
    from numba import cuda

    if simulated():
        kernel = cuda.jit(function)
    else:
        _teach()
        # Not optimised at link time, which would come after rows had been given memory instead of registers.
        kernel = cuda.jit(function, lto=False)
    return lambda *arguments: kernel[-(-arguments[-1] // THREADS), THREADS](*arguments)


def thread_number() -> Callable[[], int]:
    """A function that gives the number of the thread in which it runs."""
    if simulated():
        # Of the simulator's threads. Its own function is found only by kernels whose module has imported numba.cuda.
        def here() -> int:
            thread = current_thread()
            return thread.blockIdx.x * THREADS + thread.threadIdx.x

        return here
    from numba import cuda

    grid = cuda.grid
    return piece(lambda: grid(1))


def own_rows(size: int) -> Callable:
    """A function that gives a thread `size` doubles of its own, not set to anything.

    Those at indices that the compiler knows end up in registers. The compiler's own array for a thread is set to zero
    first, which keeps a large one in memory.
    """
    if simulated():
        return lambda: np.empty(size)
    from llvmlite import ir
    from numba.cuda import types
    from numba.cuda.extending import intrinsic

    @intrinsic
    def rows(typing_context):
        def made(context, builder, signature, arguments):
            with builder.goto_entry_block():
                whole = builder.alloca(ir.ArrayType(ir.DoubleType(), size))
            return builder.bitcast(whole, ir.PointerType(ir.DoubleType()))

        return types.CPointer(types.float64)(), made

    return rows


def for_each(one: Callable, numbers: Sequence[int]) -> Callable:
    """A piece f(a, b, c) that calls one(a, b, c, number, index) for every number, without a loop at run time."""

    def part(first: int, last: int) -> Callable:
        if last - first == 1:
            number = int(numbers[first])
            return piece(lambda a, b, c: one(a, b, c, number, first))
        middle = (first + last) // 2
        low, high = part(first, middle), part(middle, last)

        @piece
        def both(a, b, c):
            low(a, b, c)
            high(a, b, c)

        return both

    return part(0, len(numbers))


def _teach() -> None:
    """Register all pieces that were marked up to now with the compiler for GPUs."""
    compiler = _compiler()
    for function in pieces():
        if id(function) not in _taught:
            _taught.add(id(function))
            compiler.register_jitable(**_INLINED)(function)


@cache
def _compiler() -> SimpleNamespace:
    """The compiler's functions that take pieces, once it knows what pieces take for granted."""
    filterwarnings("ignore", message=".*Grid size .* under-utilization")  # few lanes are no mistake
    from numba.cuda import libdevice, types
    from numba.cuda.extending import overload, register_jitable

    overload_pairs(overload, types, _INLINED)

    @overload(nearest, jit_options=_INLINED)
    def _(a):
        return lambda a: libdevice.rint(a)

    @overload(root, jit_options=_INLINED)
    def _(a):
        return lambda a: libdevice.sqrt(a)

    _taught.update((id(nearest), id(root)))
    return SimpleNamespace(register_jitable=register_jitable)
