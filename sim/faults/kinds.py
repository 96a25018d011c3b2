"""The kinds of fault, when they act, and the checks of what they are given."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from fsw import OutPort
from messages.base import Field, Message, ObjectMessage, fields_of

M = TypeVar("M", bound="Message | ObjectMessage")
Place = int | tuple[int, ...] | None

WHOLE = ("drop", "delay", "freeze", "duplicate")
"""Kinds that leave the contents alone; object messages take these only."""


class Fault(msgspec.Struct, frozen=True):
    """One fault. Make it with `drop`, `delay`, `freeze`, `duplicate`, `bias`, `scale`, `noise`, `nan`, `bit_flip`.

    Attributes:
        kind: name of the function that makes it. field, place: what it changes; ``place`` is an index, None for all.
        value: number or array that belongs to the kind. probability: that it acts on a message. start_ns, stop_ns: it
            acts from the first up to, not at, the second; -1 for ever. condition: a port, and what its newest message
            has to fulfil.
    """

    kind: str
    field: str = ""
    place: Place = None
    value: Any = 0.0
    probability: float = 1.0
    start_ns: int = 0
    stop_ns: int = -1
    condition: tuple[OutPort[Any], Callable[[Any], bool]] | None = None

    def between(self, start_ns: int, stop_ns: int = -1) -> Fault:
        """The same fault from ``start_ns`` up to, not at, ``stop_ns`` (-1 for ever), simulation time in ns.

        Raises:
            ValueError: if the times are no ints or the end is before the start.
        """
        if type(start_ns) is not int or type(stop_ns) is not int:
            raise ValueError(f"{self.kind}: times are ints in ns, got {start_ns!r}, {stop_ns!r}; write s(10)")
        if 0 <= stop_ns <= start_ns:
            raise ValueError(f"{self.kind}: expected an end after the start ({start_ns} ns), got {stop_ns} ns")
        return msgspec.structs.replace(self, start_ns=start_ns, stop_ns=stop_ns)

    def when(self, port: OutPort[M], condition: Callable[[M], bool]) -> Fault:
        """The same fault, only while the newest message of ``port`` fulfils ``condition``."""
        return msgspec.structs.replace(self, condition=(port, condition))

    def active(self, t_ns: int) -> bool:
        """Whether it acts now."""
        if t_ns < self.start_ns or 0 <= self.stop_ns <= t_ns:
            return False
        if self.condition is None:
            return True
        port, condition = self.condition
        message = port.latest()
        return message is not None and bool(condition(message))

    def require(self, kind: type[Message] | type[ObjectMessage], where: str) -> None:
        """Check that it can act on messages of class ``kind``; ``where`` names the connection.

        Raises:
            ValueError: if the field is unknown or of another kind, the index lies outside, or the value does not fit.
        """
        if self.kind in WHOLE:
            return
        if issubclass(kind, ObjectMessage):
            text = f"{self.kind} changes fields, and {kind.__name__} is an object message"
            raise ValueError(f"{where}: {text}; it takes {', '.join(WHOLE)}")
        known = {f.name: f for f in fields_of(kind)}
        if self.field not in known:
            text = f"{kind.__name__} has no field {self.field!r}; it has {', '.join(known)}"
            raise ValueError(f"{where}: {self.kind}: {text}")
        field = known[self.field]
        if field.kind != "float" and self.kind != "bit_flip":
            text = f"{self.field} is {field.kind}, not float; bit_flip can change it"
            raise ValueError(f"{where}: {self.kind}: {text}")
        try:
            part = np.zeros(field.shape)[... if self.place is None else self.place]
            np.broadcast_to(self.value, np.shape(part))
        except (IndexError, ValueError) as error:
            text = f"{self.field} has the shape {field.shape}; index {self.place} and value {self.value} do not fit"
            raise ValueError(f"{where}: {self.kind}: {text} ({error})") from None
        self._require_bit(field, where)

    def _require_bit(self, field: Field, where: str) -> None:
        most = 1 if field.kind == "bool" else 64
        if self.kind == "bit_flip" and not -1 <= self.value < most:
            raise ValueError(f"{where}: bit_flip: expected a bit from 0 to {most - 1}, or -1 for any, got {self.value}")


def _chance(kind: str, probability: float) -> float:
    if not 0.0 <= probability <= 1.0:
        raise ValueError(f"{kind}: expected a probability from 0 to 1, got {probability}")
    return float(probability)


def _finite(kind: str, value: ArrayLike) -> Any:
    array = np.array(value, np.float64)
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{kind}: expected finite numbers, got {value}; use nan for NaN")
    array.setflags(write=False)
    return array


def drop(probability: float = 1.0) -> Fault:
    """Messages are lost, each with a probability."""
    return Fault("drop", probability=_chance("drop", probability))


def delay(delay_ns: int) -> Fault:
    """Messages arrive later by ``delay_ns`` (ns), in their order, at the reader's first step from then on.

    When the fault is over, those still on the way are overtaken and lost.
    """
    if type(delay_ns) is not int or delay_ns <= 0:
        raise ValueError(f"delay: expected an int in ns above 0, got {delay_ns!r}; write ms(250)")
    return Fault("delay", value=delay_ns)


def freeze() -> Fault:
    """Messages arrive in time, but all with the contents of the last one before: a source that is stuck."""
    return Fault("freeze")


def duplicate(probability: float = 1.0) -> Fault:
    """Messages arrive once more at the reader's next step, each with a probability."""
    return Fault("duplicate", probability=_chance("duplicate", probability))


def bias(field: str, value: ArrayLike, place: Place = None) -> Fault:
    """``value`` (a number, or one for each element) is added to a field."""
    return Fault("bias", field, place, _finite("bias", value))


def scale(field: str, factor: ArrayLike, place: Place = None) -> Fault:
    """A field is multiplied by ``factor`` (a number, or one for each element)."""
    return Fault("scale", field, place, _finite("scale", factor))


def noise(field: str, sigma: ArrayLike, place: Place = None) -> Fault:
    """White normal noise with the standard deviation ``sigma`` (a number, or one for each element) is added."""
    value = _finite("noise", sigma)
    if np.any(value < 0.0):
        raise ValueError(f"noise: expected a standard deviation >= 0, got {sigma}")
    return Fault("noise", field, place, value)


def nan(field: str, place: Place = None, probability: float = 1.0) -> Fault:
    """A field becomes NaN in messages that are hit, each with a probability."""
    return Fault("nan", field, place, math.nan, _chance("nan", probability))


def bit_flip(field: str, bit: int = -1, place: Place = None, probability: float = 1.0) -> Fault:
    """One bit of one element of a field is turned over in messages that are hit, each with a probability.

    Args:
        field: of floats, ints or bools. bit: 0 is the least significant of 64, 63 the sign; -1: any, by chance. place:
            index of the element; None: any, by chance. probability: that a message is hit.
    """
    if type(bit) is not int:
        raise ValueError(f"bit_flip: expected an int from -1 to 63 as bit, got {bit!r}")
    return Fault("bit_flip", field, place, bit, _chance("bit_flip", probability))
