"""Typed ports: declarations on a module class, connections between module instances."""

from __future__ import annotations

import contextlib
from collections.abc import Generator
from typing import TYPE_CHECKING, Any, Generic, Literal, Never, NoReturn, TypeAlias, TypeVar, cast, overload

import numpy as np
from numpy.typing import NDArray

from messages.base import Message, ObjectMessage, Record, dtype_of, fields_of

if TYPE_CHECKING:
    from fsw.module import Module
    from fsw.recorder import Recording

M = TypeVar("M", bound="Message | ObjectMessage")


class WiringError(Exception):
    """A connection that cannot be right. The message names both ports and says what to do."""


Collected: TypeAlias = tuple[str, "InPort[Any] | OutPort[Any]", WiringError]
"""Kind of fault, port, error."""
_collected: list[Collected] | None = None


@contextlib.contextmanager
def collect_wiring_errors() -> Generator[list[Collected]]:
    """Let `OutPort.connect` note its errors in the list yielded, as (kind, input, error), instead of raising them.

    `fsw check` builds a scenario in it, so that one report shows all faults.
    """
    global _collected
    _collected = found = []
    try:
        yield found
    finally:
        _collected = None


def blank_row(kind: type[Record]) -> NDArray[Any]:
    """One never-written row: header zero, floats NaN, so that nobody takes it for data."""
    row = np.zeros(1, dtype_of(kind))
    if issubclass(kind, Message):
        for field in fields_of(kind):
            if field.kind == "float":
                row[field.name] = np.nan
    return row


def field_views(kind: type[Record], row: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    """A writable view of each field of a one-row array."""
    return [(f.name, row[f.name].reshape(f.shape)) for f in fields_of(kind)]


class OutPort(Generic[M]):
    """An output of one module instance. Only its owner writes it.

    Attributes:
        owner: the module. name: of the port. kind: message class. row: one-row array in the arena. head: its t_ns, seq.
        readers: connected inputs. recordings: attached recordings.
    """

    __slots__ = ("_last", "_last_seq", "_views", "head", "kind", "name", "owner", "readers", "recordings", "row")

    def __init__(self, owner: Module, name: str, kind: type[M]) -> None:
        self.owner, self.name, self.kind = owner, name, kind
        self.readers: list[InPort[M]] = []
        self.recordings: list[Recording[M]] = []
        self._last: M | None = None
        self.bind(blank_row(kind))

    def bind(self, row: NDArray[Any]) -> None:
        """Use another one-row array, such as a row of a simulation's arena."""
        self.row = row
        self.head = memoryview(cast(Any, row.view(np.uint8))).cast("q")
        self._views = [] if issubclass(self.kind, ObjectMessage) else field_views(self.kind, row)
        self._last_seq = -1 if issubclass(self.kind, Message) else self.seq

    def write(self, message: M, t_ns: int) -> None:
        """Publish a message, written at ``t_ns``.

        Raises:
            TypeError: if the message is not of the port's class.
        """
        if message.__class__ is not self.kind:
            raise TypeError(f"{self}: expected {self.kind.__name__}, got {type(message).__name__}")
        for name, view in self._views:
            view[...] = getattr(message, name)
        head = self.head
        head[0] = t_ns
        head[1] = self._last_seq = head[1] + 1
        self._last = message

    def latest(self) -> M | None:
        """The newest message, or None if never written.

        Raises:
            ValueError: if a compiled module wrote something that the message class refuses, such as NaN.
        """
        seq = self.head[1]
        if seq == 0:
            return None
        if seq != self._last_seq:
            values = {name: (v.copy() if v.ndim else v.item()) for name, v in self._views}
            try:
                self._last = self.kind(**values)
            except ValueError as error:
                raise ValueError(f"{self} holds a bad value: {error}") from None
            self._last_seq = seq
        return self._last

    @property
    def t_ns(self) -> int:
        """Time of the newest message in ns; meaningless while `seq` is 0."""
        return self.head[0]

    @property
    def seq(self) -> int:
        """How many messages have been written."""
        return self.head[1]

    def held(self) -> M | None:
        """The Python object behind an object message, for snapshots."""
        return self._last if issubclass(self.kind, ObjectMessage) else None

    def restore(self, held: M | None) -> None:
        """Forget cached objects after the row was changed from outside; ``held`` is what `held` returned."""
        self._last, self._last_seq = held, (-1 if held is None else self.seq)

    def connect(self, reader: InPort[M], *, delayed: bool = False) -> None:
        """Feed an input of another module from this output.

        Args:
            reader: the input. It may have one source only.
            delayed: declares that the reader runs before this port's owner and sees the previous value (feedback).

        Raises:
            WiringError: if the input has a source already, the message classes differ, or ``reader`` is no input.
        """
        if not isinstance(reader, InPort):  # pyright: ignore[reportUnnecessaryIsInstance]
            _complain("not an input", self, f"{self} can only be connected to an input port, not to {reader!r}")
        elif reader.kind is not self.kind:
            _complain(*_mismatch(self, reader))
        elif reader.source is not None:
            text = f"{reader} already reads {reader.source}; it cannot also read {self}. Remove one connection"
            _complain("two sources", reader, text)
        else:
            reader.source, reader.delayed = self, delayed
            self.readers.append(reader)
            self.owner.rewired()
            reader.owner.rewired()

    def record(self, *, every: int | None = None, on_change: bool = False) -> Recording[M]:
        """Record this port from now on: each write, or at most one in ``every`` ns, or only changed values."""
        from fsw.recorder import Recording

        recording = Recording(self, every=every, on_change=on_change)
        self.recordings.append(recording)
        self.owner.rewired()
        return recording

    def __repr__(self) -> str:
        return f"{self.owner.name}.{self.name}"


class InPort(Generic[M]):
    """An input of one module instance.

    Attributes:
        source: the output it reads, or None. delayed: the connection was declared to show the previous value.
        optional, max_age, on_stale: as declared by `In`.
    """

    __slots__ = ("delayed", "kind", "max_age", "name", "on_stale", "optional", "owner", "source", "taken")

    def __init__(self, owner: Module, name: str, declared: In[M]) -> None:
        self.owner, self.name, self.kind = owner, name, declared.kind
        self.optional, self.max_age, self.on_stale = declared.optional, declared.max_age, declared.on_stale
        self.source: OutPort[M] | None = None
        self.delayed = False
        self.taken = 0

    def latest(self) -> M | None:
        """The newest message, or None if never written or not connected."""
        source = self.source
        return None if source is None else source.latest()

    def take(self) -> M | None:
        """The newest message if it was not taken before, else None."""
        source = self.source
        if source is None or (seq := source.head[1]) == self.taken:
            return None
        self.taken = seq
        return source.latest()

    def connect(self, reader: Never) -> NoReturn:
        """Refused: connections are made from the output.

        Raises:
            WiringError: always.
        """
        raise WiringError(f"{self} is an input; connect from the output that feeds it: source.connect({self})")

    def disconnect(self) -> None:
        """Remove the connection, if there is one."""
        if self.source is not None:
            self.source.readers.remove(self)
            self.source.owner.rewired()
            self.source, self.delayed = None, False
            self.owner.rewired()

    @property
    def t_ns(self) -> int | None:
        """Time at which the newest message was written, in ns, or None if there is none."""
        return None if self.source is None or self.source.seq == 0 else self.source.t_ns

    def __repr__(self) -> str:
        return f"{self.owner.name}.{self.name}"


def _mismatch(out: OutPort[Any], reader: InPort[Any]) -> tuple[str, InPort[Any], str]:
    give, want = out.kind, reader.kind
    head = f"{out} gives {give.__name__}, but {reader} expects {want.__name__}"
    if give.__name__ != want.__name__:
        return "type", reader, f"{head}. Connect a port of the right type or convert the message in a module"
    differing = [
        f"{a.name} {a.expected} against {b.name} {b.expected}"
        for a, b in zip(fields_of(give), fields_of(want), strict=False)
        if (a.name, a.kind, a.shape, a.unit) != (b.name, b.kind, b.shape, b.unit)
    ]
    detail = "; ".join(differing) or "the two classes are declared in different places"
    return "shape", reader, f"{head} of another declaration: {detail}. Import one class on both sides"


def _complain(kind: str, port: InPort[Any] | OutPort[Any], text: str) -> None:
    error = WiringError(text)
    if _collected is None:
        raise error
    _collected.append((kind, port, error))


class _Declaration(Generic[M]):
    """A port on a module class; its name is that of the class attribute."""

    def __init__(self, kind: type[M]) -> None:
        self.kind, self.name = kind, ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class In(_Declaration[M]):
    """Declares an input on a module class.

    Args:
        kind: message class.
        optional: may stay unconnected, or its source may never write.
        max_age: greatest accepted age of the message when the module runs, in ns.
        on_stale: an older message stops the run ("error") or is counted and warned of ("warn").
    """

    def __init__(
        self,
        kind: type[M],
        *,
        optional: bool = False,
        max_age: int | None = None,
        on_stale: Literal["error", "warn"] = "error",
    ) -> None:
        super().__init__(kind)
        self.optional, self.max_age, self.on_stale = optional, max_age, on_stale

    @overload
    def __get__(self, instance: None, owner: type) -> In[M]: ...
    @overload
    def __get__(self, instance: Module, owner: type) -> InPort[M]: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else instance.__dict__[self.name]


class Out(_Declaration[M]):
    """Declares an output on a module class; ``kind`` is the message class."""

    @overload
    def __get__(self, instance: None, owner: type) -> Out[M]: ...
    @overload
    def __get__(self, instance: Module, owner: type) -> OutPort[M]: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else instance.__dict__[self.name]
