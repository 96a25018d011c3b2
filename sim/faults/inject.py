"""Puts a module between an output and an input, which does to the messages what faults say."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from fsw import In, InPort, Module, Out, OutPort, Simulation, WiringError
from messages.base import Message, ObjectMessage
from messages.faults import FaultActionMsg
from sim.faults.kinds import Fault

M = TypeVar("M", bound="Message | ObjectMessage")


class Item(NamedTuple):
    """A message on its way: a copy of its row or the object itself, when it was written, how many it stands for."""

    content: Any
    t_ns: int
    number: int


class Stage:
    """One fault at work: its random numbers, and the messages that it keeps."""

    def __init__(self, words: NDArray[np.uint64]) -> None:
        self.chance = np.random.Generator(np.random.PCG64(words.tolist()))
        self.waiting: list[tuple[int, Item]] = []
        self.last: Item | None = None

    def hit(self, fault: Fault) -> bool:
        """Whether the fault acts on the next message; a certain one draws no number."""
        return fault.probability >= 1.0 or bool(self.chance.random() < fault.probability)

    def through(self, fault: Fault, items: list[Item], t_ns: int) -> tuple[list[Item], bool]:
        """What becomes of the messages that arrive, and whether the fault did something."""
        active = fault.active(t_ns)
        if not (active or self.waiting or fault.kind == "freeze"):
            return items, False
        if fault.kind == "delay":
            return self.late(fault, items, t_ns, active)
        if fault.kind == "duplicate":
            return self.again(fault, items, active)
        out: list[Item] = []
        acted = False
        for item in items:
            if not active or (fault.kind == "freeze" and self.last is None) or not self.hit(fault):
                self.last = item if fault.kind == "freeze" else None
                out.append(item)
                continue
            acted = True
            if fault.kind == "freeze":
                out.append(cast(Item, self.last)._replace(t_ns=item.t_ns, number=item.number))
            elif fault.kind != "drop":
                out.append(item._replace(content=self.changed(fault, item.content.copy())))
        return out, acted

    def late(self, fault: Fault, items: list[Item], t_ns: int, active: bool) -> tuple[list[Item], bool]:
        """Keep messages until they are due."""
        if not active:
            acted = bool(self.waiting) and bool(items)
            due = [] if items else [item for when, item in self.waiting if when <= t_ns]
            self.waiting = [] if items else [(when, item) for when, item in self.waiting if when > t_ns]
            return [*due, *items], acted or bool(due)
        self.waiting += [(t_ns + fault.value, item) for item in items]
        due = [item for when, item in self.waiting if when <= t_ns]
        self.waiting = [(when, item) for when, item in self.waiting if when > t_ns]
        return due, bool(items) or bool(due)

    def again(self, fault: Fault, items: list[Item], active: bool) -> tuple[list[Item], bool]:
        """Let messages arrive, and those of the last step that are repeated before them."""
        repeated = [item for _, item in self.waiting]
        self.waiting = [(0, item) for item in items if active and self.hit(fault)]
        return [*repeated, *items], bool(repeated)

    def changed(self, fault: Fault, row: NDArray[Any]) -> NDArray[Any]:
        """The row with its field changed, in place."""
        values = row[fault.field][0:1] if row[fault.field].ndim == 1 else row[fault.field][0]
        place: Any = ... if fault.place is None or row[fault.field].ndim == 1 else fault.place
        if fault.kind == "bias":
            values[place] += fault.value
        elif fault.kind == "scale":
            values[place] *= fault.value
        elif fault.kind == "noise":
            values[place] += fault.value * self.chance.standard_normal(values[place].shape)
        elif fault.kind == "nan":
            values[place] = np.nan
        else:
            self.flip(fault, values, place)
        return row

    def flip(self, fault: Fault, values: NDArray[Any], place: Any) -> None:
        """Turn one bit over."""
        numbers = np.arange(values.size).reshape(values.shape)[place].reshape(-1)
        element = int(numbers[self.chance.integers(len(numbers))] if len(numbers) > 1 else numbers[0])
        flat = values.reshape(-1)
        if values.dtype.kind == "b":
            flat[element] = not flat[element]
            return
        bit = int(self.chance.integers(64)) if fault.value < 0 else int(fault.value)
        flat.view(np.uint64)[element] ^= np.uint64(1) << np.uint64(bit)


def _idle(self: Any, t_ns: int) -> bool:
    """Whether no fault can act now, none has to remember what passes, and none keeps a message."""
    return not self.acted and not any(
        (f.start_ns <= t_ns and not 0 <= f.stop_ns <= t_ns) or f.kind == "freeze" or stage.waiting
        for f, stage in zip(self.faults, self.stages, strict=True)
    )


def _step(self: Any, t_ns: int) -> None:
    """Take what the source has written since the last step, pass it through the faults, deliver."""
    source, out = self.in_message.source, self.out_message
    if source is not None and not self.objects and _idle(self, t_ns):
        if source.seq != self.seen:
            seq = out.seq + source.seq - self.seen
            out.row[:], self.seen = source.row, source.seq
            out.head[1] = seq
        return
    items: list[Item] = []
    if source is not None and source.seq != self.seen:
        content = source.latest() if self.objects else source.row.copy()
        items, self.seen = [Item(content, source.t_ns, source.seq - self.seen)], source.seq
    taken, acting = len(items), 0
    for i, fault in enumerate(self.faults):
        items, acted = self.stages[i].through(fault, items, t_ns)
        acting |= acted << i
    for item in items:
        if self.objects:
            out.write(item.content, item.t_ns)
        else:
            seq = out.seq + item.number
            out.row[:] = item.content
            out.head[0], out.head[1] = item.t_ns, seq
    if acting or self.acted:
        action = self.out_action
        action.row[0] = (t_ns, action.seq + 1, acting, taken, len(items), out.t_ns if out.seq else -1)
    self.acted = acting


def _seed(self: Any, stream: Callable[[str], NDArray[np.uint64]]) -> None:
    """Give each fault a stream of its own, which others before or behind it do not change."""
    names = [f"{f.kind} {f.field}" for f in self.faults]
    words = [stream(f"{name} {names[:i].count(name)}") for i, name in enumerate(names)]
    self.stages = [Stage(w) for w in words]


@functools.cache
def _class_for(kind: type[Message] | type[ObjectMessage]) -> type[Module]:
    """The module for connections of one message class."""
    parts = {
        "__doc__": f"Does to {kind.__name__} what faults say.",
        "__module__": __name__,
        "shared": ("faults",),
        "in_message": In(kind, optional=True),
        "out_message": Out(kind),
        "out_action": Out(FaultActionMsg),
        "step": _step,
        "seed": _seed,
    }
    return type(f"FaultsOn{kind.__name__}", (Module,), parts)


def inject(sim: Simulation, out: OutPort[M], reader: InPort[M], *faults: Fault) -> OutPort[FaultActionMsg]:
    """Put faults on the connection from ``out`` to ``reader``; other readers of ``out`` see nothing of them.

    A module takes the place of the wire. It runs right before the reader in the reader's task, so that the reader sees
    bit for bit what it would see without it, as long as no fault acts. Faults act one after the other, as listed.

    Args:
        sim: that will run the scenario; it has not run yet. out: output that feeds ``reader``. reader: input.
        *faults: one at least.

    Returns:
        What the faults do, step by step, to record or to read.

    Raises:
        WiringError: if ``out`` does not feed ``reader``, or the reader is in no task of ``sim``.
        ValueError: if there are no faults, one does not fit the message, or the simulation has run.
    """
    where = f"{out} to {reader}"
    if reader.source is not out:
        now = "is not connected" if reader.source is None else f"reads {reader.source}"
        raise WiringError(f"faults on {where}: {reader} {now}; connect first, give all faults in one call of inject")
    task = next((t for t in sim.tasks if any(m is reader.owner for m in t.modules)), None)
    if task is None:
        raise WiringError(f"faults on {where}: {reader.owner.name!r} is in no task of the simulation; add it first")
    if vars(reader.owner)["_simulation"] is not None:
        raise ValueError(f"faults on {where}: the simulation has run; inject before its first run")
    if not faults:
        raise ValueError(f"faults on {where}: none given; write for example inject(sim, out, reader, drop(0.1))")
    for fault in faults:
        fault.require(out.kind, where)
    module: Any = _class_for(out.kind)(f"faults_{reader.owner.name}_{reader.name}")
    module.faults, module.objects = faults, issubclass(out.kind, ObjectMessage)
    module.seen, module.acted = 0, 0
    _seed(module, lambda name: np.zeros(4, np.uint64))
    delayed = reader.delayed
    reader.disconnect()
    out.connect(module.in_message, delayed=delayed)
    module.out_message.connect(reader)
    task.modules.insert(next(i for i, m in enumerate(task.modules) if m is reader.owner), module)
    return module.out_action
