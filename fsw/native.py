"""The operations on raw addresses, the only place that leaves the type system; `fsw.intrinsics` compiles them."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from messages.base import I64


def peek(address: int) -> int:
    """The 64-bit integer at an address."""
    return ctypes.c_int64.from_address(int(address)).value


def move(target: int, source: int, size: int) -> None:
    """Copy ``size`` bytes between addresses that do not overlap."""
    ctypes.memmove(int(target), int(source), int(size))


def call(function: int, a: int, b: int) -> int:
    """Call the C function ``int32 f(int64, int64)`` at an address."""
    return ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int64, ctypes.c_int64)(function)(a, b)


def table_at(address: int, rows: int, columns: int) -> I64:
    """The matrix of 64-bit integers at an address, (rows, columns)."""
    if not rows:
        return np.zeros((0, columns), np.int64)
    memory: Any = (ctypes.c_int64 * (int(rows) * columns)).from_address(int(address))
    return np.frombuffer(memory, np.int64).reshape(-1, columns)
