"""Modes of a scenario: named sets of tasks, and transitions between them on conditions of messages.

A `Modes` module runs first. It looks at the newest messages, and when the condition of a transition is fulfilled it
enables the tasks of the new mode and disables those of the others, in the same instant. Tasks that no mode names run
always. Where tasks of different modes write for one reader, `newest` gives the reader what was written last.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import msgspec

from fsw import In, InPort, Module, Out, OutPort, Task
from messages.base import Message, ObjectMessage
from messages.modes import ModeMsg

M = TypeVar("M", bound="Message | ObjectMessage")


class Transition(msgspec.Struct, frozen=True):
    """A way from one mode to another; make it with `transition`.

    Attributes:
        sources: names of modes it leads out of; empty for all. target: name of the mode it leads to. port: whose newest
            message is looked at. condition: on that message. hold_ns: how long it has to be fulfilled without a break.
    """

    sources: tuple[str, ...]
    target: str
    port: OutPort[Any]
    condition: Callable[[Any], bool]
    hold_ns: int = 0


def transition(
    source: str | Sequence[str], target: str, port: OutPort[M], condition: Callable[[M], bool], hold_ns: int = 0
) -> Transition:
    """A way from a mode, from several, or from any (``"*"``), to ``target``.

    Args:
        source: name, names or ``"*"``. target: name. port: its newest message is looked at; none yet fulfils nothing.
        condition: on that message. hold_ns: time for which it has to be fulfilled without a break, ns.
    """
    sources = (source,) if isinstance(source, str) else tuple(source)
    return Transition(() if sources == ("*",) else sources, target, port, condition, hold_ns)


class Modes(Module):
    """Keeps a scenario in one of its modes. Put it into a task of its own before all others.

    Attributes:
        mode: name of the mode.
    """

    shared = ("modes", "names", "transitions", "start")
    out_mode = Out(ModeMsg)

    def __init__(
        self, name: str, modes: Mapping[str, Sequence[Task]], transitions: Sequence[Transition], start: str
    ) -> None:
        """Make the module.

        Args:
            name: unique name. modes: the tasks that run in each mode, by its name. transitions: looked at in this
                order; the first that leads out of the mode and is fulfilled is taken, at most one in a step.
            start: name of the first mode.

        Raises:
            ValueError: if a transition or ``start`` names a mode that there is not, or leads to where it comes from.
        """
        super().__init__(name)
        self.modes, self.names = {n: list(tasks) for n, tasks in modes.items()}, list(modes)
        self.transitions, self.start = list(transitions), start
        self.mode = ""
        self._since_ns = [-1] * len(self.transitions)
        for known, where in [(start, "start"), *((n, f"transition {i}") for i, n in self._named())]:
            if known not in self.modes:
                raise ValueError(f"Modes {name!r}: {where}: there is no mode {known!r}; there are {self.names}")
        for i, t in enumerate(self.transitions):
            if t.target in t.sources:
                raise ValueError(f"Modes {name!r}: transition {i} leads from {t.target!r} to itself; remove it")

    def _named(self) -> list[tuple[int, str]]:
        return [(i, n) for i, t in enumerate(self.transitions) for n in (*t.sources, t.target)]

    def step(self, t_ns: int) -> None:
        """Begin, or take a transition if one is fulfilled."""
        if not self.mode:
            self._require_order()
            self._enter(self.start, -1, t_ns)
        for i, way in enumerate(self.transitions):
            leads_out = self.mode != way.target and (not way.sources or self.mode in way.sources)
            message = way.port.latest() if leads_out else None
            if message is None or not way.condition(message):
                self._since_ns[i] = -1
                continue
            if self._since_ns[i] < 0:
                self._since_ns[i] = t_ns
            if t_ns - self._since_ns[i] >= way.hold_ns:
                self._enter(way.target, i, t_ns)
                return

    def _enter(self, mode: str, number: int, t_ns: int) -> None:
        assert self._simulation is not None
        previous = self.names.index(self.mode) if self.mode else -1
        self.mode = mode
        self._since_ns = [-1] * len(self.transitions)
        on = self.modes[mode]
        for task in {id(t): t for tasks in self.modes.values() for t in tasks}.values():
            self._simulation.enable(task, any(task is t for t in on))
        index = self.names.index(mode)
        self.out_mode.write(ModeMsg(mode=index, previous=previous, transition=number, entered_ns=t_ns), t_ns)

    def _require_order(self) -> None:
        """Check that no task of a mode runs before this module, which could not hold it back."""
        if self._simulation is None:
            raise ValueError(f"Modes {self.name!r} switches tasks of a simulation; run it in one")
        tasks = self._simulation.tasks
        home = next(i for i, t in enumerate(tasks) if any(m is self for m in t.modules))
        for mode, named in self.modes.items():
            for task in named:
                place = next((i for i, t in enumerate(tasks) if t is task), None)
                if place is None:
                    raise ValueError(f"Modes {self.name!r}: {task} of mode {mode!r} is not in the simulation; add it")
                if place <= home:
                    text = f"{task} of mode {mode!r} does not run after it"
                    raise ValueError(f"Modes {self.name!r}: {text}; list the task of the modes first")


def _step(self: Any, t_ns: int) -> None:
    """Pass on what is new; of several new ones, the last in the order of the inputs."""
    for port in self.inputs:
        source = port.source
        if source is not None and source.seq != port.taken:
            port.taken = source.seq
            self.out_message.write(source.latest(), source.t_ns)


@functools.cache
def _merger(kind: type[Message] | type[ObjectMessage], number: int) -> type[Module]:
    inputs = {f"in_{i}": In(kind, optional=True) for i in range(number)}
    text = f"Gives on the newest of {number} {kind.__name__}."
    parts = {"__doc__": text, "__module__": __name__, **inputs, "out_message": Out(kind), "step": _step}
    return type(f"Newest{kind.__name__}", (Module,), parts)


def newest(name: str, reader: InPort[M], *sources: OutPort[M], delayed: bool = False) -> Module:
    """A module that gives ``reader`` what was written last by any of ``sources``; put it into a task before the reader.

    Args:
        name: unique name. reader: not connected yet. *sources: one at least. delayed: they run after the module.

    Raises:
        ValueError: if there are no sources. WiringError: if the reader has a source, or the message classes differ.
    """
    if not sources:
        raise ValueError(f"newest {name!r} for {reader}: no sources were given")
    module = _merger(reader.kind, len(sources))(name)
    for port, source in zip(module.inputs, sources, strict=True):
        source.connect(port, delayed=delayed)
    module.outputs[0].connect(reader)
    return module
