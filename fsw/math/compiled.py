"""The one decorator of compiled code, and the switch that turns compilation off."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from types import FunctionType
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")

COMPILE = os.environ.get("FSW_COMPILE", "1") != "0"
"""False when the environment says ``FSW_COMPILE=0``: every kernel then runs as plain Python."""

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
"""numba options of all compiled code: IEEE division, no fastmath, no contraction."""


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a pure function of numbers, arrays and rows when it is first called.

    The mark of everything a kernel may call. The function must be in the subset that numba compiles and must
    mean the same in plain Python, because ``FSW_COMPILE=0`` and error reports run it uncompiled.

    Args:
        function: pure function; it may write into arrays that its name or docstring declares as outputs.

    Returns:
        The compiled dispatcher (the plain function is its ``py_func``), or ``function`` itself when compilation is off.
    """
    if not COMPILE:
        return function
    import numba

    return cast(Any, numba).njit(function, no_cfunc_wrapper=True, **OPTIONS)


def plain(function: Callable[P, R]) -> Callable[P, R]:
    """A compiled function, and all it calls, as plain Python: for the few calls of a set-up, faster than compiling.

    Args:
        function: what `compiled` returned; it does not call itself.

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
    return FunctionType(source.__code__, scope, source.__name__, source.__defaults__)
