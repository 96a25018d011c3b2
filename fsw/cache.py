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
import sys
import sysconfig
import types
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fsw.files import atomic
from fsw.math.compiled import OPTIONS, Compiled

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


def source_digest(functions: Iterable[Any], files: Iterable[str] = ()) -> Any:
    """Digest of all code and constants that functions reach, of more files, of the versions and the processor."""
    import llvmlite.binding as llvm

    key, all_files = hashlib.sha256(), set(files)
    for function in functions:
        reached, constants = reachable(function)
        all_files |= {f.__code__.co_filename for f in reached}
        for text in sorted(constants):
            key.update(text.encode())
        for f in reached:  # a function made in a notebook or by exec has no file: its code stands for it
            key.update(f.__code__.co_code)
            key.update(repr([c for c in f.__code__.co_consts if not isinstance(c, types.CodeType)]).encode())
    for file in sorted(all_files):
        path = Path(file)
        key.update(path.read_bytes() if path.is_file() else file.encode())
    versions = [importlib.metadata.version(p) for p in ("numba", "llvmlite", "numpy")]
    machine = [platform.machine(), sys.version, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()]
    key.update(json.dumps([versions, machine, OPTIONS]).encode())
    return key


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
        parts = ("native.py", "intrinsics.py", "cache.py", "math/linking.py")
        own = [str(Path(__file__).parent / name) for name in parts]
        key = source_digest(self.reach.values(), own)
        layouts = [str(d.descr) + str(d.itemsize) for d in self.dtypes]
        key.update(json.dumps([self.source, layouts]).encode())
        return key.hexdigest()[:24]

    @property
    def path(self) -> Path:
        """Where the machine code is kept, whether it is there or not."""
        return cache_folder() / f"{self.name.rpartition('.')[2]}-{self.key}.o"

    def build(self) -> tuple[int, bool]:
        """Address of the compiled function, and whether it was found on disk."""
        if self.path.is_file():
            try:
                return _load(self.path.read_bytes()), True
            except Exception as error:  # whatever a damaged entry raises, the remedy is the same
                text = f"compile cache: entry of {self.name} is damaged ({error}); compiling again"
                warnings.warn(text, CacheWarning, stacklevel=4)
        progress(f"compiling {self.name} (once; kept in {cache_folder()})")
        data = self._compile()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with atomic(self.path) as temporary:
                temporary.write_bytes(data)
        except OSError as error:
            text = f"compile cache: cannot write {cache_folder()} ({error}); the next start compiles again"
            warnings.warn(text, CacheWarning, stacklevel=4)
        return _load(data), False

    def _compile(self) -> bytes:
        """A line of JSON (checksum, symbol, external symbols) and the object code."""
        from numba import from_dtype, int32, int64, njit
        from numba.core.errors import NumbaExperimentalFeatureWarning

        from fsw import intrinsics, native
        from fsw.math.linking import Translator

        names: dict[str, Any] = {"__name__": f"fsw_entry_{self.key}", "peek": native.peek, "move": native.move}
        names["row_at"] = intrinsics.row_at
        names |= {n: f if isinstance(f, Compiled) else Compiled(f) for n, f in self.reach.items()}
        names |= {f"R{i}": from_dtype(d) for i, d in enumerate(self.dtypes)}
        exec(compile(self.source, f"<wrapper of {self.name}>", "exec"), names)
        with warnings.catch_warnings():
            # numba takes a row that begins like another one for a kind of it, which is right: the offsets are the same
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            bare = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": Translator}
            made: Any = njit(int32(int64, int64), **bare, **OPTIONS)(names["entry"])
        (result,) = made.overloads.values()
        symbol = f"fsw_{self.key}"
        text = _C_WRAPPER.format(symbol=symbol, function=result.fndesc.llvm_func_name)
        code, externals = result.library.machine_code(text, symbol, _machine())
        head = {"sha256": hashlib.sha256(code).hexdigest(), "symbol": symbol, "externals": externals}
        return json.dumps(head).encode() + b"\n" + code


_C_WRAPPER = """
declare i32 @"{function}"(ptr, ptr, i64, i64)
define i32 @{symbol}(i64 %a, i64 %b) {{
  %result = alloca i32
  %exception = alloca ptr
  store i32 0, ptr %result
  %status = call i32 @"{function}"(ptr %result, ptr %exception, i64 %a, i64 %b)
  %returned = load i32, ptr %result
  %code = or i32 %status, %returned
  ret i32 %code
}}
"""
"""Calls a function by numba's convention, result and exception by pointer; if it raises, the result is not 0."""


def _machine() -> Any:
    """The processor at hand, as a target of the compiler."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=3, jit=True)


@functools.cache
def _engine() -> Any:
    """What holds machine code in memory, as long as the process lives."""
    import llvmlite.binding as llvm

    machine = _machine()
    module = llvm.parse_assembly("")
    module.triple = machine.triple
    return llvm.create_mcjit_compiler(module, machine)


def _load(data: bytes) -> int:
    """Address of the function in what `Unit._compile` returned."""
    import llvmlite.binding as llvm

    head, _, code = data.partition(b"\n")
    told = json.loads(head)
    if hashlib.sha256(code).hexdigest() != told["sha256"]:
        raise ValueError("its checksum is wrong")
    missing = [name for name in told["externals"] if not llvm.address_of_symbol(name)]
    if missing:  # such as memory for arrays: the compiler brings it
        context = importlib.import_module("numba.core.registry").cpu_target.target_context
        importlib.import_module("numba.core.runtime").rtsys.initialize(context)
        missing = [name for name in missing if not llvm.address_of_symbol(name)]
    if missing:
        raise ValueError(f"no such function here: {', '.join(missing)}")
    _engine().add_object_file(llvm.ObjectFileRef.from_data(code))
    _engine().finalize_object()
    return _engine().get_function_address(told["symbol"])
