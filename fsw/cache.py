"""The compile cache: machine code on disk, under the digest of everything it depends on."""

from __future__ import annotations

import dis
import functools
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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fsw.math.compiled import OPTIONS, compiled

_LIBRARIES = tuple(sysconfig.get_paths()[k] for k in ("stdlib", "platstdlib", "purelib", "platlib"))
progress: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True)  # noqa: E731, T201
"""Gets one line for every kernel that is compiled, not for those found in the cache."""


class CacheWarning(UserWarning):
    """The compile cache could not be used; everything works, but compiles again next time."""


def cache_folder() -> Path:
    """Where compiled kernels are kept: ``FSW_CACHE_DIR``, or the user's cache folder."""
    if folder := os.environ.get("FSW_CACHE_DIR"):
        return Path(folder)
    base = os.environ.get("LOCALAPPDATA") if os.name == "nt" else os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "opnav-fsw"


@functools.cache
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


@functools.cache
def _globals_used(function: types.FunctionType) -> list[tuple[str, Any]]:
    """Names of other modules' and own globals in a function, resolved through attributes (``module.constant``)."""
    found: list[tuple[str, Any]] = []
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
                found.append((str(step.argval), owner))
    return found


def can_raise(function: Any) -> bool:
    """Whether the compiled code of a function contains a raise or an assert."""
    codes = [f.__code__ for f in reachable(function)[0]]
    return any(step.opname == "RAISE_VARARGS" for c in codes for step in dis.get_instructions(c))


class Unit(msgspec.Struct, frozen=True, dict=True):
    """A C function ``int32 entry(int64, int64)`` to be compiled.

    Attributes:
        name: for people. source: Python text that defines ``entry``.
        reach: functions that the source calls, by name. dtypes: rows that it uses as R0, R1, ...
    """

    name: str
    source: str
    reach: dict[str, Any]
    dtypes: tuple[np.dtype[Any], ...] = ()

    @functools.cached_property
    def key(self) -> str:
        """Digest of the source, every file and constant in reach, the row layouts, the versions and the processor."""
        import llvmlite.binding as llvm

        key = hashlib.sha256()
        files: set[str] = {str(Path(__file__).with_name("native.py"))}
        for function in self.reach.values():
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
        layouts = [str(d.descr) + str(d.itemsize) for d in self.dtypes]
        key.update(json.dumps([self.source, layouts, versions, machine, OPTIONS]).encode())
        return key.hexdigest()[:24]

    @property
    def folder(self) -> Path:
        """Where the machine code is kept, whether it is there or not."""
        return cache_folder() / f"{self.name.rpartition('.')[2]}-{self.key}"

    def build(self) -> tuple[Any, bool]:
        """The compiled function (a numba ``cfunc``), and whether it was found on disk."""
        folder = self.folder
        if folder.is_dir():
            if _intact(folder):
                try:
                    return self._compile(folder, save=True), True
                except Exception as error:  # whatever an unreadable entry raises, the remedy is the same
                    reason = repr(error)
            else:
                reason = "its checksum is wrong"
            text = f"compile cache: entry of {self.name} is damaged ({reason}); compiling again"
            warnings.warn(text, CacheWarning, stacklevel=4)
            shutil.rmtree(folder, ignore_errors=True)
        progress(f"compiling {self.name} (once; kept in {cache_folder()})")
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix="new-", ignore_cleanup_errors=True) as temporary:
                place = Path(temporary) / "entry"
                place.mkdir()
                made = self._compile(place, save=True)
                sums = {str(f.relative_to(place)): _sum(f) for f in sorted(place.rglob("*")) if f.is_file()}
                (place / "manifest.json").write_text(json.dumps({"name": self.name, "files": sums}))
                if not folder.exists():  # else another process was faster, and its entry is as good
                    place.replace(folder)
        except OSError as error:
            text = (
                f"compile cache: cannot write {cache_folder()} ({error}); kernels are compiled again at the next start"
            )
            warnings.warn(text, CacheWarning, stacklevel=4)
            made = self._compile(folder, save=False)
        return made, False

    def _compile(self, folder: Path, *, save: bool) -> Any:
        """Compile the source as a file in ``folder``, or load it if numba finds its object code there."""
        from numba import cfunc, from_dtype, int32, int64
        from numba.core.errors import NumbaExperimentalFeatureWarning

        from fsw import native

        config: Any = importlib.import_module("numba.core.config")
        file = folder / "entry.py"
        module = types.ModuleType(f"fsw_entry_{self.key}")
        module.__file__ = str(file)
        names: dict[str, Any] = vars(module)
        names |= {n: getattr(native, n) for n in ("peek", "move", "row_at", "table_at")}
        names |= {n: f if hasattr(f, "py_func") else compiled(f) for n, f in self.reach.items()}
        names |= {f"R{i}": from_dtype(d) for i, d in enumerate(self.dtypes)}
        if save and not file.exists():
            file.write_text(self.source)
        exec(compile(self.source, str(file), "exec"), names)
        sys.modules[module.__name__] = module  # numba looks the module of cached code up by name
        elsewhere, config.CACHE_DIR = config.CACHE_DIR, ""  # keep the object code beside the wrapper
        try:
            with warnings.catch_warnings():
                # a row whose fields begin like another row's may be passed as that one: same offsets, so it is safe
                warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
                return cfunc(int32(int64, int64), cache=save, **OPTIONS)(names["entry"])
        finally:
            config.CACHE_DIR = elsewhere


def _sum(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def _intact(folder: Path) -> bool:
    try:
        files: dict[str, str] = json.loads((folder / "manifest.json").read_text())["files"]
        return all(_sum(folder / name) == value for name, value in files.items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return False
