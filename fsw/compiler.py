"""Kernels to machine code: one C function per module class, kept on disk under the digest of all it depends on."""

from __future__ import annotations

import ctypes
import dis
import hashlib
import importlib
import importlib.metadata
import json
import os
import platform
import shutil
import sys
import sysconfig
import tempfile
import types
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fsw import loop
from fsw.math.compiled import OPTIONS, compiled
from fsw.ports import Out
from messages.base import dtype_of

if TYPE_CHECKING:
    from fsw.module import KernelModule

_C_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int64, ctypes.c_int64)
_LIBRARIES = tuple(sysconfig.get_paths()[k] for k in ("stdlib", "platstdlib", "purelib", "platlib"))
progress: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True)  # noqa: E731
"""Gets one line for every kernel that is compiled, not for those found in the cache."""


class CacheWarning(UserWarning):
    """The compile cache could not be used; everything works, but compiles again next time."""


class Entry:
    """A compiled C function ``int32 f(int64, int64)``; 0 means that all went well.

    Attributes:
        function: to call from Python. address: of it. from_cache: it was found on disk.
        saved: indices of the rows that it saves before it writes them; none if it cannot raise.
    """

    def __init__(self, cfunc: Any, from_cache: bool, saved: tuple[int, ...]) -> None:
        self._keep = cfunc
        self.address: int = cfunc.address
        self.function = _C_FUNCTION(self.address)
        self.from_cache, self.saved = from_cache, saved

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


def cache_folder() -> Path:
    """Where compiled kernels are kept: ``FSW_CACHE_DIR``, or the user's cache folder."""
    if folder := os.environ.get("FSW_CACHE_DIR"):
        return Path(folder)
    base = os.environ.get("LOCALAPPDATA") if os.name == "nt" else os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "opnav-fsw"


_entries: dict[Any, Entry] = {}


def entry_of(cls: type[KernelModule]) -> Entry:
    """The compiled kernel of a module class, from memory, the cache or the compiler."""
    if cls not in _entries:
        kinds = [cls.Params, cls.State, *(cls.ports[n].kind for n in cls.kernel_ports)]
        dtypes = [dtype_of(k) for k in kinds]
        saved: tuple[int, ...] = ()
        lines = ["def entry(t_ns, rows):"]
        lines += [f"    a{i} = peek(rows + {8 * i})" for i in range(len(dtypes))]
        if can_raise(cls.kernel):
            saved = (1, *(i + 2 for i, n in enumerate(cls.kernel_ports) if isinstance(cls.ports[n], Out)))
            lines.append(f"    space = peek(rows + {8 * len(dtypes)})")
            lines += [f"    move(space, a{i}, {dtypes[i].itemsize}); space += {dtypes[i].itemsize}" for i in saved]
        arguments = ", ".join(f"row_at(a{i}, R{i})" for i in range(len(dtypes)))
        lines += [
            "    try:",
            f"        kernel(t_ns, {arguments})",
            "    except Exception:",
            "        return 1",
            "    return 0",
        ]
        made, from_cache = _build(
            f"{cls.__module__}.{cls.__qualname__}", "\n".join(lines), {"kernel": cls.kernel}, dtypes
        )
        _entries[cls] = Entry(made, from_cache, saved)
    return _entries[cls]


def loop_entry() -> Entry:
    """The compiled executive: takes the address of the control block, and 0."""
    if loop not in _entries:
        tables = "\n".join(
            f"    t{i} = table_at(peek(c + {48 + 8 * i}), peek(c + {8 + 8 * i}), {w})"
            for i, w in enumerate((*loop.WIDTHS, 1))
        )
        source = f"def entry(c, unused):\n{tables}\n    cursor = t4[:, 0]\n"
        source += "    return run(peek(c), t0, t1, t2, t3, cursor, peek(c + 88), peek(c + 96))"
        _entries[loop] = Entry(*_build("fsw.loop.run", source, {"run": loop.run}, []), ())
    return _entries[loop]


def reachable(function: Any) -> tuple[list[types.FunctionType], list[str]]:
    """Every function that compiled code of ``function`` contains, and the values of the constants they use.

    Functions of installed libraries are left out: their versions stand for them.
    """
    functions: dict[int, types.FunctionType] = {}
    constants: list[str] = []
    todo: list[Any] = [function]
    while todo:
        item = todo.pop()
        item = getattr(item, "py_func", item)
        if not isinstance(item, types.FunctionType) or id(item) in functions or _is_library(item.__code__.co_filename):
            continue
        functions[id(item)] = item
        for name, value in _globals_used(item):
            if isinstance(getattr(value, "py_func", value), types.FunctionType):
                todo.append(value)
            elif isinstance(value, np.ndarray):
                constants.append(f"{name}={value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}")
            elif not isinstance(value, types.ModuleType):
                constants.append(f"{name}={value!r}" if isinstance(value, (int, float, str, tuple)) else name)
    return list(functions.values()), constants


def _is_library(filename: str) -> bool:
    return (filename.startswith(_LIBRARIES) and "site-packages" in filename) or filename.startswith(_LIBRARIES[:2])


def _globals_used(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Names of other modules' and own globals in a function, resolved through attributes (``module.constant``)."""
    codes = [function.__code__]
    scope = dict(function.__globals__)
    scope.update(zip(function.__code__.co_freevars, (c.cell_contents for c in function.__closure__ or ()), strict=True))
    while codes:
        code = codes.pop()
        codes += [c for c in code.co_consts if isinstance(c, types.CodeType)]
        owner: Any = None
        for step in dis.get_instructions(code):
            if step.opname in ("LOAD_GLOBAL", "LOAD_DEREF", "LOAD_NAME"):
                owner = scope.get(str(step.argval))
            elif step.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(owner, types.ModuleType):
                owner = getattr(owner, str(step.argval), None)
            else:
                owner = None
            if owner is not None:
                yield str(step.argval), owner


def can_raise(function: Any) -> bool:
    """Whether the compiled code of a function contains a raise or an assert."""
    codes = [f.__code__ for f in reachable(function)[0]]
    return any(step.opname == "RAISE_VARARGS" for c in codes for step in dis.get_instructions(c))


def digest(source: str, reach: dict[str, Any], dtypes: list[np.dtype[Any]]) -> str:
    """Key of a cache entry: wrapper, every source file and constant in reach, row layouts, versions, processor."""
    import llvmlite.binding as llvm

    key = hashlib.sha256()
    files: set[str] = {str(Path(__file__).with_name("native.py"))}
    for function in reach.values():
        functions, constants = reachable(function)
        files |= {f.__code__.co_filename for f in functions}
        for text in sorted(constants):
            key.update(text.encode())
        for f in functions:  # a function made in a notebook or by exec has no file: its code stands for it
            key.update(f.__code__.co_code)
            key.update(repr([c for c in f.__code__.co_consts if not isinstance(c, types.CodeType)]).encode())
    for file in sorted(files):
        path = Path(file)
        key.update(path.read_bytes() if path.is_file() else file.encode())
    versions = [importlib.metadata.version(p) for p in ("numba", "llvmlite", "numpy")]
    machine = [platform.machine(), sys.version, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    key.update(
        json.dumps([source, [str(d.descr) + str(d.itemsize) for d in dtypes], versions, machine, OPTIONS]).encode()
    )
    return key.hexdigest()[:24]


def _build(name: str, source: str, reach: dict[str, Any], dtypes: list[np.dtype[Any]]) -> tuple[Any, bool]:
    """The compiled wrapper and whether it was found on disk."""
    key = digest(source, reach, dtypes)
    folder = cache_folder() / f"{name.rpartition('.')[2]}-{key}"
    if folder.is_dir():
        if _intact(folder):
            try:
                return _compile(folder, key, source, reach, dtypes, save=True), True
            except Exception as error:  # whatever an unreadable entry raises, the remedy is the same
                reason = repr(error)
        else:
            reason = "its checksum is wrong"
        warnings.warn(
            f"compile cache: entry of {name} is damaged ({reason}); compiling again", CacheWarning, stacklevel=4
        )
        shutil.rmtree(folder, ignore_errors=True)
    progress(f"compiling {name} (once; kept in {cache_folder()})")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix="new-", ignore_cleanup_errors=True) as temporary:
            place = Path(temporary) / "entry"
            place.mkdir()
            made = _compile(place, key, source, reach, dtypes, save=True)
            sums = {str(f.relative_to(place)): _sum(f) for f in sorted(place.rglob("*")) if f.is_file()}
            (place / "manifest.json").write_text(json.dumps({"name": name, "files": sums}))
            if not folder.exists():  # else another process was faster, and its entry is as good
                place.replace(folder)
    except OSError as error:
        text = f"compile cache: cannot write {cache_folder()} ({error}); kernels are compiled again at the next start"
        warnings.warn(text, CacheWarning, stacklevel=4)
        made = _compile(folder, key, source, reach, dtypes, save=False)
    return made, False


def _sum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _intact(folder: Path) -> bool:
    try:
        files: dict[str, str] = json.loads((folder / "manifest.json").read_text())["files"]
        return all(_sum(folder / name) == value for name, value in files.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False


def _compile(
    folder: Path, key: str, source: str, reach: dict[str, Any], dtypes: list[np.dtype[Any]], *, save: bool
) -> Any:
    """Compile the wrapper whose file lies in ``folder``, or load it if numba finds its object code there."""
    from numba import cfunc, from_dtype, int32, int64

    from fsw import native

    config: Any = importlib.import_module("numba.core.config")

    file = folder / "entry.py"
    module = types.ModuleType(f"fsw_entry_{key}")
    module.__file__ = str(file)
    names: dict[str, Any] = vars(module)
    names |= {n: getattr(native, n) for n in ("peek", "move", "row_at", "table_at")}
    names |= {n: f if hasattr(f, "py_func") else compiled(f) for n, f in reach.items()}
    names |= {f"R{i}": from_dtype(d) for i, d in enumerate(dtypes)}
    if save and not file.exists():
        file.write_text(source)
    exec(compile(source, str(file), "exec"), names)
    sys.modules[module.__name__] = module  # numba looks the module of cached code up by name
    elsewhere, config.CACHE_DIR = config.CACHE_DIR, ""  # keep the object code beside the wrapper
    try:
        return cfunc(int32(int64, int64), cache=save, **OPTIONS)(names["entry"])
    finally:
        config.CACHE_DIR = elsewhere
