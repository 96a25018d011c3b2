"""The base of every message, parameter and state: a record of fixed-shape fields with units.

One declaration gives the immutable Python object, the row of the arena (a structured dtype), the JSON schema, the
dictionary, the tables of the specs and the axis labels of plots.
"""

from __future__ import annotations

import functools
import typing
from collections.abc import Callable
from typing import Annotated, Any, cast, dataclass_transform

import msgspec
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "F64",
    "I64",
    "Bound",
    "Mat3",
    "Mat6",
    "Message",
    "NanOk",
    "ObjectMessage",
    "Record",
    "Shape",
    "Stream",
    "Vec2",
    "Vec3",
    "Vec4",
    "eye",
    "ones",
    "unknown",
    "unseeded",
    "zeros",
]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
U64 = NDArray[np.uint64]


class Shape:
    """Dimensions of an array field, ``Annotated[F64, Shape(3), unit, description]``."""

    def __init__(self, *dims: int) -> None:
        self.dims = dims


class Bound:
    """Limits of a field: every element is greater than ``gt``, at least ``ge``, less than ``lt``, at most ``le``."""

    def __init__(
        self, *, gt: float | None = None, ge: float | None = None, lt: float | None = None, le: float | None = None
    ) -> None:
        self.limits = tuple((s, x) for s, x in ((">", gt), (">=", ge), ("<", lt), ("<=", le)) if x is not None)

    def broken_by(self, value: Any) -> str | None:
        """The limit that a number or array breaks, such as ``"> 0"``, or None."""
        test = {">": np.greater, ">=": np.greater_equal, "<": np.less, "<=": np.less_equal}
        return next((f"{sign} {limit:g}" for sign, limit in self.limits if not np.all(test[sign](value, limit))), None)


class NanOk:
    """Marks a float field in which NaN is a legitimate value (an unknown one)."""


Vec2 = Annotated[F64, Shape(2)]
Vec3 = Annotated[F64, Shape(3)]
Vec4 = Annotated[F64, Shape(4)]
Mat3 = Annotated[F64, Shape(3, 3)]
Mat6 = Annotated[F64, Shape(6, 6)]
Stream = Annotated[U64, Shape(4), "-", "random stream, seeded from run seed, module and field name"]


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array


def zeros(*dims: int) -> F64:
    """Read-only zeros of the given shape: the default of an array field."""
    return _frozen(np.zeros(dims))


def ones(*dims: int) -> F64:
    """Read-only ones of the given shape: the default of an array field of factors."""
    return _frozen(np.ones(dims))


def unknown(*dims: int) -> F64:
    """Read-only NaN of the given shape: the default of an array field that a writer may leave out."""
    return _frozen(np.full(dims, np.nan))


def eye(n: int) -> F64:
    """Read-only n x n identity: the default of a matrix field."""
    return _frozen(np.eye(n))


unseeded: U64 = _frozen(np.zeros(4, np.uint64))
"""Default of a `Stream` field; the simulation seeds it."""


class Field(msgspec.Struct, frozen=True):
    """What a declaration says of one field; ``kind`` is "float", "int", "bool", "stream" or "object"."""

    name: str
    kind: str
    shape: tuple[int, ...]
    unit: str
    description: str
    bound: Bound | None
    nan_ok: bool
    default: Any

    @property
    def code(self) -> str:
        """numpy type code of one element."""
        return {"float": "<f8", "int": "<i8", "bool": "?", "stream": "<u8"}[self.kind]

    @property
    def expected(self) -> str:
        """For error messages: ``float array of shape (3,) [m]``."""
        word = f"{self.kind} array of shape {self.shape}" if self.shape else self.kind
        return f"{word} [{self.unit}]"


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False)
class RecordMeta(msgspec.StructMeta):
    """Makes every record frozen and keyword-only, and says so to type checkers."""

    def __new__(mcls, name: str, bases: Any, ns: Any, **options: Any) -> Any:
        """Create the class with the options that all records share."""
        fixed: Any = {"frozen": True, "kw_only": True, "eq": False, "gc": False, **options}
        return super().__new__(mcls, name, bases, ns, **fixed)


class Record(msgspec.Struct, metaclass=RecordMeta):
    """Fixed-shape fields: an immutable object in Python, a row in the arena. Base of parameters and states.

    Raises:
        ValueError: at construction, if a field has the wrong type or shape, is NaN or infinite, or breaks its bound.
    """

    def __post_init__(self) -> None:
        """Check and freeze every field."""
        _validators[self.__class__](self)


class Message(Record):
    """A record that travels through ports. Its header (time written, count) belongs to the port, not to the payload."""


class ObjectMessage(Record):
    """A message passed by reference, for images and other large things; its arrays become read-only.

    Fields may be of any type; only Python modules can read it. The writer gives its arrays away.
    """

    def __post_init__(self) -> None:
        """Make arrays read-only."""
        for field in fields_of(type(self)):
            value: Any = getattr(self, field.name)
            if type(value) is np.ndarray:
                msgspec.structs.force_setattr(self, field.name, _frozen(np.asarray(value).view()))


def _field(owner: type[Record], name: str, hint: Any, default: Any) -> Field:
    notes: list[Any] = list(getattr(hint, "__metadata__", ()))
    base = hint.__origin__ if notes else hint
    texts = [n for n in notes if isinstance(n, str)]
    if len(texts) != 2:
        raise TypeError(
            f"{owner.__qualname__}.{name}: expected Annotated[type, unit, description], found {len(texts)} texts; "
            f'write for example Annotated[Vec3, "m", "position of B relative to N"] ("-" for no unit)'
        )
    shape = next((n.dims for n in notes if isinstance(n, Shape)), ())
    kind = {float: "float", int: "int", bool: "bool", F64: "float", I64: "int", U64: "stream"}.get(base, "object")
    is_array = base in (F64, I64, U64)
    if kind == "object" and not issubclass(owner, ObjectMessage):
        raise TypeError(
            f"{owner.__qualname__}.{name}: a row holds float, int, bool and arrays of them, not {base!r}; "
            f"use an ObjectMessage for other things"
        )
    if is_array != bool(shape) and not issubclass(owner, ObjectMessage):
        raise TypeError(f"{owner.__qualname__}.{name}: an array field needs a Shape(...), a scalar none")
    bound = next((n for n in notes if isinstance(n, Bound)), None)
    nan_ok = any(n is NanOk or isinstance(n, NanOk) for n in notes)
    return Field(name, kind, shape, texts[0], texts[1], bound, nan_ok, default)


@functools.cache
def fields_of(kind: type[Record]) -> tuple[Field, ...]:
    """The declared fields of a record class, in order.

    Raises:
        TypeError: if a declaration lacks its unit or description, or its type does not fit a row.
    """
    hints = typing.get_type_hints(kind, include_extras=True)
    defaults = {f.name: f.default for f in msgspec.structs.fields(kind) if f.default is not msgspec.NODEFAULT}
    return tuple(_field(kind, n, hints[n], defaults.get(n, msgspec.NODEFAULT)) for n in kind.__struct_fields__)


@functools.cache
def dtype_of(kind: type[Record]) -> np.dtype[Any]:
    """Aligned structured dtype of a record's row; a message's row begins with the header ``t_ns``, ``seq``."""
    head: list[Any] = [("t_ns", "<i8"), ("seq", "<i8")] if issubclass(kind, (Message, ObjectMessage)) else []
    body: list[Any] = [] if issubclass(kind, ObjectMessage) else [(f.name, f.code, f.shape) for f in fields_of(kind)]
    return np.dtype(head + body or [("unused", "<i8")], align=True)


def _refuse(owner: Record, field: Field, found: str) -> typing.NoReturn:
    where = type(owner).__qualname__
    raise ValueError(f"{where}.{field.name}: expected {field.expected} ({field.description}), got {found}")


def _check_array(owner: Record, field: Field, value: Any) -> NDArray[Any]:
    """A frozen copy with the declared type and shape, every element checked."""
    try:
        raw = np.asarray(value)
        wanted = np.dtype(field.code)
        if raw.dtype.kind not in "fiub" or (wanted.kind in "iu" and raw.dtype.kind == "f"):
            raise TypeError
        array = np.array(raw, wanted, order="C")
    except (TypeError, ValueError):
        _refuse(owner, field, f"{type(value).__name__} {str(value)[:60]}")
    if array.shape != field.shape:
        _refuse(owner, field, f"shape {array.shape}")
    _check_limits(owner, field, array)
    return _frozen(array)


def _check_limits(owner: Record, field: Field, value: Any) -> None:
    if field.kind == "float" and not np.all(np.isfinite(value)):
        if not field.nan_ok or np.any(np.isinf(value)):
            _refuse(owner, field, "NaN" if np.any(np.isnan(value)) else "infinity")
    elif field.bound is not None and (limit := field.bound.broken_by(value)) is not None:
        _refuse(owner, field, f"{value}, which is not {limit}")


def _check_scalar(owner: Record, field: Field, given: Any) -> Any:
    value = cast(Any, given.item() if isinstance(given, np.generic) else given)
    accepted = {"float": (float, int), "int": (int,), "bool": (bool,)}[field.kind]
    if not isinstance(value, accepted) or (isinstance(value, bool) and field.kind != "bool"):
        _refuse(owner, field, f"{type(value).__name__} {str(value)[:60]}")
    if field.kind == "int" and not -(2**63) <= value < 2**63:
        _refuse(owner, field, f"{value}, which does not fit 64 bits")
    _check_limits(owner, field, value)
    return {"float": float, "int": int, "bool": bool}[field.kind](value)


class _Validators(dict[type[Record], Callable[[Record], None]]):
    """The check of each class, written out when it is first needed: the good case costs half a microsecond."""

    def __missing__(self, kind: type[Record]) -> Callable[[Record], None]:
        """Write and compile the check of one class."""
        names: dict[str, Any] = {
            "put": msgspec.structs.force_setattr,
            "ndarray": np.ndarray,
            "array": _check_array,
            "scalar": _check_scalar,
        }
        lines = ["def validate(record):", "    pass"]
        for i, field in enumerate(fields_of(kind)):
            names |= {f"f{i}": field, f"s{i}": field.shape, f"d{i}": np.dtype(field.code)}
            lines += [f"    v = record.{field.name}", *(f"    {line}" for line in _check_lines(i, field))]
        exec("\n".join(lines), names)
        self[kind] = names["validate"]
        return self[kind]


def _check_lines(i: int, field: Field) -> list[str]:
    """Statements that check and freeze ``v``, the value of field number ``i``; they try the common case first."""
    slow = f"put(record, '{field.name}', {'array' if field.shape else 'scalar'}(record, f{i}, v))"
    if field.bound is not None or field.kind not in ("float", "bool") or (field.shape and field.kind == "bool"):
        return [slow]
    if not field.shape:
        good = "type(v) is bool" if field.kind == "bool" else "type(v) is float and v - v == 0.0"
        return [f"if not ({good}): {slow}"]
    if (
        len(field.shape) == 1 and field.shape[0] <= 16
    ):  # unpacking a few numbers checks the length, and beats numpy's sum
        items = [f"a{k}" for k in range(field.shape[0])]
        read = f"{', '.join(items)}, = v.tolist(); x = {' + '.join(items)}"
    else:
        read = f"x = v.sum() if v.shape == s{i} else None"
    return [
        "try:",
        f"    {read}",
        f"    good = x - x == 0.0 and v.dtype is d{i} and type(v) is ndarray",
        "except Exception:",
        "    good = False",
        f"if not good: {slow}",
        "elif v.base is not None or v.flags.writeable:",
        f"    v = v.copy(); v.setflags(False); put(record, '{field.name}', v)",
    ]


_validators = _Validators()


def json_schema(kind: type[Record]) -> dict[str, Any]:
    """JSON schema of a record class, with unit and description of each field."""
    scalar = {"float": "number", "int": "integer", "bool": "boolean", "stream": "integer", "object": "object"}
    properties: dict[str, Any] = {}
    for f in fields_of(kind):
        item: dict[str, Any] = {"type": scalar[f.kind]}
        for n in reversed(f.shape):
            item = {"type": "array", "items": item, "minItems": n, "maxItems": n}
        properties[f.name] = {**item, "unit": f.unit, "description": f.description}
    required = [f.name for f in fields_of(kind) if f.default is msgspec.NODEFAULT]
    text = (kind.__doc__ or "").strip().split("\n")[0]
    return {
        "title": kind.__name__,
        "description": text,
        "type": "object",
        "properties": properties,
        "required": required,
    }
