"""The one decorator of compiled code, and the switch that turns compilation off."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

COMPILE = os.environ.get("FSW_COMPILE", "1") != "0"
"""False when the environment says ``FSW_COMPILE=0``: every kernel then runs as plain Python."""

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
"""numba options of all compiled code: IEEE division, no fastmath, no contraction."""


class Compiled(Generic[P, R]):
    """A pure function that compiled code calls directly, and that Python compiles when it first calls it.

    Attributes:
        py_func: the function as written.
    """

    def __init__(self, function: Callable[P, R], into_callers: bool = False) -> None:
        functools.update_wrapper(self, function)
        self.py_func, self._into_callers = function, into_callers

    def _jit(self, **more: Any) -> Any:
        import numba

        return cast(Any, numba).njit(self.py_func, **OPTIONS, **more)

    @functools.cached_property
    def _dispatcher(self) -> Any:
        """For compiled callers, which may then be optimised together with it; Python could not call it."""
        from fsw.math.linking import Translator

        bare = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": self._into_callers}
        return self._jit(**bare, pipeline_class=Translator)

    @functools.cached_property
    def _entry(self) -> Any:
        """For callers in Python; its machine code is kept on disk."""
        from fsw.math.function_cache import keep_on_disk

        return keep_on_disk(self._jit())

    @property
    def _numba_type_(self) -> Any:
        """What numba asks of an object that it meets in compiled code."""
        import numba

        return cast(Any, numba).typeof(self._dispatcher)

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> R:
        """Call the compiled function."""
        return self._entry(*args, **kwargs)


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a pure function of numbers, arrays and rows as one that kernels may call.

    The function must be in the subset that numba compiles and must mean the same in plain Python, because
    ``FSW_COMPILE=0`` and error reports run it uncompiled. The compiler is loaded when there is something to compile.

    Args:
        function: pure function; it may write into arrays that its name or docstring declares as outputs.

    Returns:
        A `Compiled`, or ``function`` itself when compilation is off.
    """
    return Compiled(function) if COMPILE else function


def inlined(function: Callable[P, R]) -> Callable[P, R]:
    """As `compiled`, for a function of an innermost loop whose call would cost as much as it does itself.

    The compiler puts it into every caller; elsewhere it decides by size, which counts branches that are rarely taken.
    """
    return Compiled(function, into_callers=True) if COMPILE else function


def plain(function: Callable[P, R]) -> Callable[P, R]:
    """A compiled function, and all it calls, as plain Python: for the few calls of a set-up, faster than compiling.

    Args:
        function: what `compiled` returned, or a function that calls such; it does not call itself.

    Returns:
        A function that does the same.
    """
    return _plain(function)


@functools.cache
def _plain(function: Any) -> Any:
    source: Any = getattr(function, "py_func", function)
    scope = dict(source.__globals__)
    for name in source.__code__.co_names:
        if hasattr(scope.get(name), "py_func"):
            scope[name] = _plain(scope[name])
    return FunctionType(source.__code__, scope, source.__name__, source.__defaults__, source.__closure__)
