"""Kernels to machine code: one C function per module class, and one for the executive."""

from __future__ import annotations

import ctypes
import dis
import functools
import importlib
import operator
import os
import subprocess
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fsw import loop
from fsw.cache import Unit, reachable
from fsw.ports import Out
from messages.base import dtype_of

if TYPE_CHECKING:
    from fsw.module import KernelModule

_C_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int64, ctypes.c_int64)


class Entry:
    """A compiled C function ``int32 f(int64, int64)``; 0 means that all went well.

    Attributes:
        function: to call from Python. address: of it. from_cache: it was found on disk.
        saved: indices of the rows that it saves before it writes them; none if it cannot raise.
    """

    def __init__(self, address: int, from_cache: bool, saved: tuple[int, ...]) -> None:
        self.address, self.from_cache, self.saved = address, from_cache, saved
        self.function = _C_FUNCTION(address)

    def pointers(self, rows: list[NDArray[Any]]) -> NDArray[np.int64]:
        """What the function takes as its second argument: the addresses of the rows and of the space behind them."""
        n = len(rows)
        table = np.zeros(n + 1 + sum(rows[i].nbytes for i in self.saved) // 8, np.int64)
        table[: n + 1] = [*(r.ctypes.data for r in rows), table.ctypes.data + 8 * (n + 1)]
        return table

    def undo(self, pointers: NDArray[np.int64], rows: list[NDArray[Any]]) -> None:
        """Put back what the rows held before a call that failed."""
        space = pointers[len(rows) + 1 :].view(np.uint8)
        for i in self.saved:
            rows[i].view(np.uint8)[:], space = space[: rows[i].nbytes], space[rows[i].nbytes :]


def can_raise(function: Any) -> bool:
    """Whether the compiled code of a function contains a raise or an assert."""
    raises = dis.opmap["RAISE_VARARGS"]
    return any(raises in f.__code__.co_code[::2] for f in reachable(function)[0])


@functools.cache
def _saved_rows(cls: type[KernelModule]) -> tuple[int, ...]:
    """Indices of the rows that a kernel may write, if it can raise."""
    written = (1, *(i + 2 for i, n in enumerate(cls.kernel_ports) if isinstance(cls.ports[n], Out)))
    return written if can_raise(cls.kernel) else ()


@functools.cache
def _unit(cls: type[KernelModule]) -> Unit:
    dtypes = tuple(dtype_of(k) for k in (cls.Params, cls.State, *(cls.ports[n].kind for n in cls.kernel_ports)))
    saved, count = _saved_rows(cls), len(dtypes)
    lines = [f"a{i} = peek(rows + {8 * i})" for i in range(count)]
    lines += [f"space = peek(rows + {8 * count})"] if saved else []
    lines += [f"move(space, a{i}, {dtypes[i].itemsize}); space += {dtypes[i].itemsize}" for i in saved]
    arguments = ", ".join(f"row_at(a{i}, R{i})" for i in range(count))
    lines += [f"kernel(t_ns, {arguments})", "return 0"]
    source = "\n    ".join(["def entry(t_ns, rows):", *lines])
    return Unit(f"{cls.__module__}.{cls.__qualname__}", source, {"kernel": cls.kernel}, dtypes)


@functools.cache
def entry_of(cls: type[KernelModule]) -> Entry:
    """The compiled kernel of a module class, from memory, the cache or the compiler."""
    return Entry(*_unit(cls).build(), _saved_rows(cls))


@functools.cache
def loop_entry() -> Entry:
    """The compiled executive, `fsw.loop.run`."""
    source = "def entry(control, unused):\n    return run(control, unused)"
    return Entry(*Unit("fsw.loop.run", source, {"run": loop.run}).build(), ())


def compile_all(classes: Iterable[type[KernelModule]]) -> None:
    """Compile what the cache lacks, half of it in a second process if that pays."""
    missing = [c for c in classes if not _unit(c).path.is_file()]
    apart = [c for c in missing if c.__module__ != "__main__" and "<locals>" not in c.__qualname__][1::2]
    if len(apart) < 2 or (os.cpu_count() or 1) < 2:
        return
    command = [
        sys.executable,
        "-W",
        "ignore",
        "-m",
        "fsw.compiler",
        *(f"{c.__module__}:{c.__qualname__}" for c in apart),
    ]
    paths = os.pathsep.join(p or "." for p in sys.path)
    with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, stdin=subprocess.DEVNULL) as second:
        for cls in missing:
            if cls not in apart:
                entry_of(cls)
        loop_entry()
        second.wait()  # what it could not compile, this process will


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        module, _, name = argument.partition(":")
        entry_of(operator.attrgetter(name)(importlib.import_module(module)))
