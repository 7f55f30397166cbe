"""Pieces that compute the same are one piece, so that the compiler takes them once for all kernels."""

import numpy as np
import pytest
from numba.core.compiler import Flags

from maglev_lanes import pieces
from maglev_lanes.compiled import compiled
from maglev_lanes.piece_compiler import compare_options_quickly
from maglev_lanes.pieces import exact, piece, register


@pytest.fixture(autouse=True)
def no_others():
    """Nothing else waits to be registered, before and afterwards."""
    register()
    yield
    pieces._waiting.clear()


def raised(by):
    return piece(lambda a: a + by)


def doubled(f):
    return piece(lambda a: f(f(a)))


def test_a_factory_that_is_called_again_gives_the_same_piece():
    assert raised(1.0) is raised(1.0) and doubled(raised(1.0)) is doubled(raised(1.0))


def test_pieces_with_other_numbers_or_of_other_pieces_are_others():
    found = [raised(1.0), raised(2.0), raised(1), raised(True), raised(0.0), raised(-0.0)]
    found += [doubled(f) for f in found]
    assert len({id(f) for f in found}) == len(found)
    assert [f(1.0) for f in found[:2]] == [2.0, 3.0]
    assert doubled(raised(2.0))(1.0) == 5.0


def test_an_equal_function_of_another_place_is_another_piece():
    assert piece(lambda a: a) is not piece(lambda a: a)


def test_a_variable_that_changes_after_the_piece_was_marked_is_refused():
    by = 1.0
    piece(lambda a: a + by)
    by = 2.0
    with pytest.raises(RuntimeError, match="changed after it was marked"):
        register()


def test_the_compiler_takes_a_shared_piece_once_and_keeps_both_kernels_right():
    import numba

    def made(factor):
        twice = doubled(raised(3.0))
        register()
        return numba.njit(lambda a: factor * twice(a)), twice

    (first, shared), (second, again) = made(10.0), made(100.0)
    assert shared is again
    assert first(1.0) == 70.0 and second(1.0) == 700.0


@exact
def rest(a, b, c):
    return a * b - c


def rounded():
    sources = 0

    def kernel(a, b, c):
        if sources == 0:
            return 1.0
        return rest(a, b, c)

    return compiled(kernel)


def test_an_exact_piece_rounds_as_it_is_written_in_a_fast_kernel_too():
    # A multiplication that is fused with the subtraction leaves what the rounding took.
    draw = np.random.default_rng(0).uniform(1.0, 2.0, (100, 2))
    kernel = rounded()
    assert all(kernel(a, b, a * b) == 0.0 for a, b in draw)


@piece
def polynomial(z, a):
    for i in range(z.size):
        z[i] = (((a * z[i] + 1.0) * z[i] + a) * z[i] - 1.0) * rest(a, z[i], 2.0)


def test_no_piece_stays_a_function_of_its_own_whichever_the_compiler_would_keep():
    # Such a function is shared by all kernels of a process, as the first one that holds it optimised it.
    import numba

    register()

    @numba.njit
    def kernel(z):
        for a in range(5):
            polynomial(z, a)
            polynomial(z[::2], 2.0 * a)
        polynomial(z, 0.5)

    kernel(np.ones(8))
    (code,) = kernel.inspect_llvm().values()
    defined = [line for line in code.splitlines() if line.startswith("define ")]
    assert any("kernel" in line for line in defined)
    assert not [line for line in defined if "polynomial" in line or "rest" in line]


def test_the_compiler_makes_machine_code_of_the_kernel_alone_and_not_of_its_pieces():
    from numba.core.registry import cpu_target

    def kernel():
        sources = 0
        inner = doubled(raised(7.0))

        def run(a):
            if sources == 0:
                return 0.0
            return inner(a) + 0.5

        return compiled(run)

    assert kernel()(1.0) == 15.5
    names = cpu_target.target_context.codegen()._engine._defined_symbols
    own = [name for name in names if "11test_pieces" in name and "NumbaEnv" not in name]
    assert any("test_the_compiler_makes_machine_code" in name for name in own)
    assert not [name for name in own if "6raised" in name or "7doubled" in name]


def test_options_that_are_read_at_once_are_those_that_are_read_one_by_one():
    compare_options_quickly()
    plain, flags = Flags(), Flags()
    flags.forceinline, flags.nrt = True, True
    for one in (plain, flags):
        assert one.values() == {name: getattr(one, name) for name in one.options}
    assert plain != flags == flags.copy() and hash(flags) == hash(flags.copy())
