"""Compiled functions that Python calls, kept on disk: what a command or a Python module needs is compiled once.

Kernels of modules have a cache of their own (`fsw.cache`). Here numba's is used, with another key: numba looks at the
one file in which a function stands and returns stale code if what it calls has changed elsewhere.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import FunctionType
from typing import Any, cast

from numba.core import types
from numba.core.caching import CompileResultCacheImpl, FunctionCache

from fsw.cache import cache_folder, source_digest


class _Locator:
    """Says where a function's entries are, and by what they are valid."""

    def __init__(self, py_func: FunctionType) -> None:
        self.digest = source_digest([py_func]).hexdigest()[:24]

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> _Locator | None:
        """A locator, or None for a function that was not read from a file."""
        return cls(py_func) if Path(py_file).is_file() else None

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(cache_folder() / "functions")

    def get_source_stamp(self) -> str:
        """Digest of all code and constants that the function reaches."""
        return self.digest

    def get_disambiguator(self) -> str:
        """What tells the entries of two states of the code apart."""
        return self.digest


class _Entry(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 - numba's name and type

    def check_cachable(self, cres: Any) -> bool:
        """Whether the machine code holds no addresses of this process."""
        return not any(not x.can_cache for x in cres.lifted) and not cres.library.has_dynamic_globals


class _Cache(FunctionCache):
    _impl_class = _Entry

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None; whatever a damaged entry raises, it is compiled again."""
        if not _passes_functions(sig):
            with contextlib.suppress(Exception):
                return cast(Any, super()).load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code; a folder that cannot be written, or a damaged index, costs only time."""
        if not _passes_functions(sig):
            with contextlib.suppress(Exception):
                super().save_overload(sig, data)


def _passes_functions(sig: Any) -> bool:
    """Whether an argument is a compiled function: its type has no name that another process would know."""
    return any(isinstance(t, (types.Dispatcher, types.FunctionType)) for t in sig)


def keep_on_disk(dispatcher: Any) -> Any:
    """The dispatcher itself, which from now on looks on disk before it compiles."""
    with contextlib.suppress(RuntimeError):  # no file: a notebook, or text that was executed
        dispatcher._cache = _Cache(dispatcher.py_func)
    return dispatcher
