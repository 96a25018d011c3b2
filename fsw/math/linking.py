"""How compiled functions inside a kernel are put together: translated each for itself, optimised once, as a whole.

The compiler's own way is to make machine code of every function, which nobody calls if all callers are compiled, and to
optimise it again in each of its callers. Here a function ends as text of the compiler's inner language (LLVM); whoever
is called from outside links all that it reaches, and that alone becomes machine code. Importing this loads numba.
"""

# pyright: basic
# the compiler has no types of its own

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba._dynfunc import make_function
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class Part(JITCodeLibrary):
    """One function, neither linked nor made machine code."""

    def finalize(self) -> None:
        """Nothing more can be added; what it calls stays apart."""
        self._raise_if_finalized()
        self._finalized = True
        self._finalize_dynamic_globals()
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)

    def reached(self) -> list[Any]:
        """Every library that this one calls, directly or not, each once."""
        found: dict[Any, None] = {self: None}
        todo: list[Any] = [self]
        while todo:
            library = todo.pop()
            if isinstance(library, Part):
                todo += [x for x in library._linking_libraries if x not in found]
                found |= dict.fromkeys(library._linking_libraries)
        return list(found)[1:]

    def whole(self, linkage: str, more: str = "", symbol: str = "") -> Any:
        """A module of this function, all that it calls and ``more`` text; all but ``symbol`` get the linkage."""
        self._ensure_finalized()
        module = self._final_module.clone()
        module.link_in(llvm.parse_assembly(more))
        reached = self.reached()
        for library in reached:
            if isinstance(library, Part):
                module.link_in(library._final_module, preserve=True)
        for library in reached:  # these come last: of them, only what is called by then is taken
            if not isinstance(library, Part):
                module.link_in(library._get_module_for_linking(), preserve=True)
        for function in module.functions:
            if not function.is_declaration and function.name != symbol:
                function.linkage = linkage
        return module

    def _get_module_for_linking(self) -> Any:
        """What a caller needs that is compiled the usual way."""
        return self.whole("linkonce_odr")

    def machine_code(self, more: str, symbol: str, machine: Any) -> tuple[bytes, list[str]]:
        """Object code of ``symbol`` in ``more`` text and all that it calls; names that it wants from outside."""
        self._final_module = module = self.whole("internal", more, symbol)
        self._optimize_final_module()
        # Counts of references that cancel out show only after all is merged; without them a start loads no numba
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=False, slp_vectorize=False, cost="cheap")
        passes.run(module, builder)
        declared = [x.name for group in (module.functions, module.global_variables) for x in group if x.is_declaration]
        return machine.emit_object(module), [name for name in declared if not name.startswith("llvm.")]


@register_pass(mutates_CFG=True, analysis_only=False)
class _Translation(NativeLowering):
    """The usual last pass, less the making of machine code."""

    _name = "translation"

    def run_pass(self, state: Any) -> bool:
        """Translate the function."""
        state.library = Part(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        made = state.cr
        name, module = made.fndesc.qualname.rpartition(".")[2], made.fndesc.lookup_module()
        # callers know it by an object of its own; what this would run, if anybody called it, does not exist
        known = make_function(module, name, "", 0, made.env, (state.library,))
        state.targetctx.insert_user_function(known, made.fndesc, [state.library])
        state.reload_init.extend(state.library._reload_init)
        state.cr = made._replace(cfunc=known)
        return True


class Translator(Compiler):
    """For ``njit(pipeline_class=Translator)``: functions that compiled code alone calls."""

    def define_pipelines(self) -> Any:
        """The usual passes with another last one."""
        (manager,) = super().define_pipelines()
        manager.passes = [(_Translation if p is NativeLowering else p, text) for p, text in manager.passes]
        manager.finalize()
        return [manager]
