"""The operations of `fsw.native` for the compiler, and two more for compiled wrappers. Importing this loads numba."""

# pyright: basic, reportCallIssue=false
# ruff: noqa: PLW0108
# numba knows no types of its own making, and wants functions written in Python where a name would do

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic, overload

from fsw import native

_I64 = ir.IntType(64)


@intrinsic
def _peek(typing: Any, address: Any) -> Any:
    """The 64-bit integer at an address."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(builder.inttoptr(args[0], _I64.as_pointer()))

    return types.int64(types.int64), build


@intrinsic
def _move(typing: Any, target: Any, source: Any, size: Any) -> Any:
    """Copy ``size`` bytes between addresses that do not overlap."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        to, start = builder.inttoptr(args[0], byte), builder.inttoptr(args[1], byte)
        cgutils.raw_memcpy(builder, to, start, args[2], 1)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), build


@intrinsic
def _call(typing: Any, function: Any, a: Any, b: Any) -> Any:
    """Call the C function ``int32 f(int64, int64)`` at an address."""

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(32), [_I64, _I64])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])

    return types.int32(types.int64, types.int64, types.int64), build


@intrinsic
def _table_at(typing: Any, address: Any, rows: Any, columns: Any) -> Any:
    """The C-contiguous int64 matrix at an address; ``columns`` is a constant."""
    kind = types.Array(types.int64, 2, "C")

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = context.make_array(kind)(context, builder)
        stride = builder.mul(args[2], ir.Constant(_I64, 8))
        context.populate_array(
            array,
            data=builder.inttoptr(args[0], _I64.as_pointer()),
            shape=cgutils.pack_array(builder, [args[1], args[2]]),
            strides=cgutils.pack_array(builder, [stride, ir.Constant(_I64, 8)]),
            itemsize=ir.Constant(_I64, 8),
            meminfo=None,
        )
        return array._getvalue()

    return kind(types.int64, types.int64, types.int64), build


@intrinsic
def row_at(typing: Any, address: Any, kind: Any) -> Any:
    """The row of a structured type at an address."""
    record = kind.dtype if hasattr(kind, "dtype") else kind.instance_type

    def build(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(record))

    return record(types.int64, kind), build


overload(native.peek)(lambda address: lambda address: _peek(address))
overload(native.move)(lambda target, source, size: lambda target, source, size: _move(target, source, size))
overload(native.call)(lambda function, a, b: lambda function, a, b: _call(function, a, b))
overload(native.table_at)(
    lambda address, rows, columns: lambda address, rows, columns: _table_at(address, rows, columns)
)
