# SPDX-License-Identifier: Apache-2.0
"""Two forms of a numerical kernel, which take half of Numba's compilation time.

Numba prepares every function for calls from Python and from C, and optimizes it and generates its machine
code separately, although a function that another kernel calls is also copied into that kernel's module and
optimized there. Here a kernel has two forms, each compiled only when needed:

- *entry*: called from Python, compiled as Numba does.
- *inner*: called by other kernels. It has no wrappers and no machine code of its own. It is simplified and
  stored as LLVM code; the entry that contains it optimizes it.

Functions that were compiled with Numba's own decorator call the entry: without machine code they may crash.

Both forms are cached on disk, in different files. See `asyneio.jit` for the versions of Numba.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.core.types import IntegerLiteral
from numba.core.types.misc import unliteral

#: Start of the names of compiled functions.
_COMPILED = "_ZN"
#: Start of the names of the variables through which compiled code finds its Python environment.
_ENVIRONMENT = "_ZN08NumbaEnv"


class _Library(JITCodeLibrary):
    """Code of an entry."""

    _final_module: Any

    def _optimize_functions(self, ll_module: Any) -> None:
        """Simplify each function, as Numba does, but skip declarations: preparing the passes takes longer
        than running them."""
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Optimize, as Numba does, but with private copies of inner kernels: each is specialized for the
        calls in this entry, and removed where it is inlined."""
        for function in self._final_module.functions:
            copied = function.linkage == llvm.Linkage.linkonce_odr and not function.is_declaration
            if copied and function.name.startswith(_COMPILED):
                function.linkage = llvm.Linkage.internal
        super()._optimize_final_module()


class _InnerLibrary(_Library):
    """Code of an inner kernel, without machine code."""

    def _optimize_final_module(self) -> None:
        """Left to the entry."""

    def _finalize_final_module(self) -> None:
        """Generate machine code for nothing but the variables of the environment, which Numba sets."""
        self._verify_declare_only_symbols()
        code = self._final_module
        names = [v.name for v in code.global_variables if v.name.startswith(_ENVIRONMENT)]
        stub = str(self._codegen._create_empty_module(self.name))
        stub += "".join(f'\n@"{name}" = common global ptr null' for name in names)
        self._final_module = llvm.parse_assembly(stub)
        super()._finalize_final_module()
        self._final_module = code
        self._finalize_dynamic_globals()


class _EntryCompiler(Compiler):
    library_class: type[JITCodeLibrary] = _Library
    #: Number of kernels being compiled, one inside the other; Numba compiles in one thread at a time.
    depth = 0

    def _compile_core(self) -> Any:
        """Compile, and know that it is a kernel."""
        _EntryCompiler.depth += 1
        try:
            return super()._compile_core()
        finally:
            _EntryCompiler.depth -= 1

    def define_pipelines(self) -> Any:
        """Numba's passes, on our library."""
        state = self.state
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


class _InnerCompiler(_EntryCompiler):
    library_class = _InnerLibrary


class _InnerCacheImpl(CompileResultCacheImpl):
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        """Files separate from those of the entry."""
        return str(super().get_filename_base(f"{fullname}.inner", abiflags))


class _InnerCache(FunctionCache):
    _impl_class = _InnerCacheImpl


class _Inner(CPUDispatcher):
    """A kernel as other kernels call it."""

    def enable_caching(self) -> None:
        """Keep compiled kernels on disk."""
        self._cache = _InnerCache(self.py_func)


class Kernel(CPUDispatcher):
    """A kernel; calls from other kernels are passed on to its inner form."""

    #: Whether the inner form is compiled separately for each constant integer.
    literals = True

    def __init__(
        self,
        py_func: Callable[..., Any],
        locals: dict[str, Any] | None = None,
        targetoptions: dict[str, Any] | None = None,
        pipeline_class: type[Compiler] = _EntryCompiler,
    ) -> None:
        options = {**(targetoptions or {}), "no_cfunc_wrapper": True}
        super().__init__(py_func, locals, options, pipeline_class)
        self.inner = _Inner(py_func, locals, {**options, "no_cpython_wrapper": True}, _InnerCompiler)

    def enable_caching(self) -> None:
        """Keep compiled kernels on disk."""
        super().enable_caching()
        self.inner.enable_caching()

    @property
    def is_compiling(self) -> bool:
        """Whether a call from a compiled function is a recursive one."""
        return bool(self.inner.is_compiling if _EntryCompiler.depth else super().is_compiling)

    @property
    def nopython_signatures(self) -> Any:
        """Signatures for calls from compiled functions."""
        return self.inner.nopython_signatures if _EntryCompiler.depth else super().nopython_signatures

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Compile for a call from a kernel; other functions get the entry."""
        if not _EntryCompiler.depth:
            return super().get_call_template(args, kws)
        if not self.literals:
            args = tuple(unliteral(a) if isinstance(a, IntegerLiteral) else a for a in args)
        return self.inner.get_call_template(args, kws)

    def get_overload(self, sig: Any) -> Any:
        """The compiled form that a kernel calls, or another function."""
        return self.inner.get_overload(sig) if _EntryCompiler.depth else super().get_overload(sig)
