"""How the compiler takes pieces: up to intermediate code, of which the kernel that calls them makes machine code.

numba optimises every function and makes machine code of it, also of one that is only ever inlined. A kernel has about
a hundred pieces, and each would be optimised again within every piece that calls it; what is never called on its own
needs neither. This takes a sixth to a fourth off the time that a kernel takes to compile. Steps that look for what no
piece has (functions in functions, and expressions of whole arrays), counts of references and numba's slow comparison of
its options took another seventh.
"""

from functools import cache
from types import SimpleNamespace

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.targetconfig import TargetConfig
from numba.core.typed_passes import InlineOverloads, NativeLowering, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

NEEDLESS = (InlineClosureLikes, InlineOverloads, NopythonRewrites)


class PieceCode(JITCodeLibrary):
    """The intermediate code of a piece and of those that it calls."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """No address: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> SimpleNamespace:
        """Of what a function with machine code is given, nothing."""
        return SimpleNamespace(set_env=lambda name, environment: None)


@register_pass(mutates_CFG=True, analysis_only=False)
class PieceLowering(NativeLowering):
    """Makes the intermediate code of a piece."""

    _name = "piece_lowering"

    def run_pass(self, state) -> bool:
        """See numba's `CompilerPass`."""
        state.library = PieceCode(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().run_pass(state)


class PieceCompiler(CompilerBase):
    """numba's compiler of functions, but for the last step and those that are NEEDLESS."""

    def define_pipelines(self) -> list:
        """See numba's `CompilerBase`."""
        steps = DefaultPassBuilder.define_nopython_pipeline(self.state)
        steps.passes = [
            (PieceLowering if step is NativeLowering else step, why)
            for step, why in steps.passes
            if step not in NEEDLESS
        ]
        steps.finalize()
        return [steps]


@cache
def compare_options_quickly() -> None:
    """Make numba read all options of a function at once.

    At every call of a piece it compares them with those of other functions, and reads each of two dozen by a property.
    """

    def values(options: TargetConfig) -> dict[str, object]:
        return {**_defaults(type(options)), **options._values}

    TargetConfig.values = values


@cache
def _defaults(kind: type[TargetConfig]) -> dict[str, object]:
    return {name: option.default for name, option in kind.options.items()}
