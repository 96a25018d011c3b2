"""The graph of modules: every wiring fault in one report before time zero, and the latency of every connection."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from fsw.module import Module
from fsw.ports import In, InPort, Out, OutPort, WiringError
from fsw.time import text

if TYPE_CHECKING:
    from fsw.simulation import Simulation, Task


class Fault(msgspec.Struct, frozen=True):
    """One thing that is wrong with ``where``, a "module.port", module or task, and what to do about it."""

    kind: str
    where: str
    message: str
    advice: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.where} {self.message}. {self.advice}."


class GraphError(Exception):
    """A graph that cannot run; ``faults`` has all that is wrong with it, and the text names each."""

    def __init__(self, faults: list[Fault]) -> None:
        self.faults = faults
        super().__init__("\n  ".join([f"nothing was run, faults in the graph: {len(faults)}", *map(str, faults)]))


class Edge(msgspec.Struct, frozen=True):
    """A connection of two ports ("module.port").

    ``period_ns`` and ``places`` (in `Graph.modules`) are those of writer and reader; ``meet``, ``age_ns``, ``unseen`` are
    what `latency` returns.
    """

    source: str
    reader: str
    type: str
    period_ns: tuple[int, int]
    places: tuple[int, int]
    delayed: bool
    meet: bool
    age_ns: tuple[int, int]
    unseen: int

    @property
    def label(self) -> str:
        """Type, rates and latency, for people."""
        age = " to ".join(dict.fromkeys(map(text, self.age_ns)))
        unseen = f", none at first {self.unseen}" if self.unseen else ""
        return f"{self.type}, {text(self.period_ns[0])} to {text(self.period_ns[1])}, age {age}{unseen}"


def latency(writer: Task, reader: Task, reader_first: bool) -> tuple[bool, tuple[int, int], int]:
    """How old what a module of one task writes at each of its steps is when a module of another reads it.

    The ages are the difference of the phases plus all multiples of the greatest common divisor of the periods, from 0 to
    below the writer's period; with ``reader_first``, when the reader runs first at an instant at which both are due, an
    age of 0 is one period of the writer instead.

    Returns:
        Whether there are such instants; least and greatest age, ns; how many steps of the reader see no message yet.
    """
    step = math.gcd(writer.period, reader.period)
    offset = (reader.phase - writer.phase) % step
    least = step if reader_first and offset == 0 else offset
    late = writer.phase - reader.phase + reader_first
    return offset == 0, (least, least + writer.period - step), max(0, -(-late // reader.period))


class Graph:
    """The graph as it is wired now.

    Args:
        tasks: of a simulation, in order. simulation: modules may have run in this one only.
        collected: what `fsw.ports.collect_wiring_errors` noted while the graph was built.

    Attributes:
        modules: those that could run, in order. tasks: the task of each. edges: their connections.
    """

    def __init__(
        self,
        tasks: Sequence[Task],
        collected: Sequence[tuple[str, InPort[Any], WiringError]] = (),
        simulation: Simulation | None = None,
    ) -> None:
        self.modules: list[Module] = []
        self.tasks: list[Task] = []
        self.edges: list[Edge] = []
        self._faults: list[Fault] = []
        self._untimed: set[str] = set()
        for kind, port, error in collected:
            self._fault(kind, port, f"cannot be connected: {error}")
        for number, task in enumerate(tasks):
            self._add_task(task, f"task {number}")
        if not self.modules:
            self._fault("empty", "simulation", "has nothing to run. Pass it tasks with modules")
        for what, named in (("task", dict.fromkeys(tasks)), ("module", self.modules)):
            for name, count in Counter(getattr(x, "name", None) for x in named).items():
                if count > 1 and name is not None:
                    self._fault("name", name, f"is the name of {count} {what}s. Give each its own")
        homes = [vars(m)["_simulation"] for m in self.modules]
        known = (None, simulation or next(filter(None, homes), None))
        for module in [m for m, home in zip(self.modules, homes, strict=True) if home not in known]:
            self._fault("simulation", module.name, "has run in another simulation. Make new modules for each")
        self._places = {id(m): i for i, m in enumerate(self.modules)}
        noted = [id(port) for _, port, _ in collected]
        for port in [p for m in self.modules for p in self._sound_ports(m)]:
            if isinstance(port, InPort):
                self._check_input(port, id(port) in noted)
            else:
                self._check_readers(port)
        self._check_order()

    def _fault(self, kind: str, where: object, sentences: str) -> None:
        message, _, advice = sentences.rpartition(". ")
        self._faults.append(Fault(kind, str(where), message, advice))

    def _add_task(self, task: Any, where: str) -> None:
        from fsw.simulation import Task

        if not isinstance(task, Task):
            return self._fault("task", where, f'is {task!r}. Write Task("nav", period=s(1), modules=[...])')
        for what, value, least in (("period", task.period, 1), ("phase", task.phase, 0)):
            if type(value) is not int or not least <= value < 2**62:
                advice = "Write for example s(0.5) or ms(500)"
                self._fault("time", f"{task.name}.{what}", f"is {value!r}, not an int in ns, at least {least}. {advice}")
                self._untimed.add(task.name)
        if not task.modules:
            self._fault("empty", task.name, "is a task without modules. Add modules or remove the task")
        for position, module in enumerate(task.modules):
            self._add_module(task, module, f"{task.name}[{position}]")
        return None

    def _add_module(self, task: Task, module: Any, where: str) -> None:
        kind = module if isinstance(module, type) else type(module)
        if not issubclass(kind, Module):
            self._fault("module", where, f"is {module!r}, not a module. Put only modules into a task")
        elif module is kind:
            self._fault("module", where, f"is the class {kind.__name__}. Write {kind.__name__}({kind.__name__.lower()!r})")
        elif "_simulation" not in vars(module):
            advice = "Call super().__init__(name, params) first in its __init__"
            self._fault("module", where, f"is a {kind.__name__} without name and ports. {advice}")
        elif any(module is known for known in self.modules):
            self._fault("twice", module.name, f"is in a task already and again as {where}. List it once, or make two")
        else:
            self.modules.append(module)
            self.tasks.append(task)
            if kind.step is Module.step:
                self._fault("module", module.name, f"has no step. Write step(self, t_ns) in {kind.__name__}")
            for name in [n for n, value in vars(module).items() if isinstance(value, (In, Out))]:
                advice = f"Declare it in the body of {kind.__name__}"
                self._fault("port", f"{module.name}.{name}", f"is declared on the instance. {advice}")

    def _sound_ports(self, module: Module) -> list[InPort[Any] | OutPort[Any]]:
        """The ports that are as the class declares them; a fault for each other."""
        sound: list[InPort[Any] | OutPort[Any]] = []
        for name, declared in module.ports.items():
            port: Any = vars(module)[name]
            if not isinstance(port, (InPort, OutPort)) or port.owner is not module or port.name != name:
                advice = "Connect with writer.out_x.connect(reader.in_x); assign no ports, copy no modules"
                self._fault("port", f"{module.name}.{name}", f"was replaced by {port!r}. {advice}")
            elif declared.name != name:
                self._fault("port", port, f"shares its declaration with {declared.name}. Declare each by itself")
            else:
                sound.append(port)
        return sound

    def _check_input(self, port: InPort[Any], noted: bool) -> None:
        source: Any = port.source
        wanted = port.kind.__name__
        if port.max_age is not None and (type(port.max_age) is not int or port.max_age < 0):
            self._fault("time", port, f"has max_age {port.max_age!r}, not an int in ns. Write for example max_age=ms(500)")
        if port.on_stale not in ("error", "warn"):
            self._fault("time", port, f'has on_stale {port.on_stale!r}. Write "error" or "warn"')
        if source is None:
            if not port.optional and not noted:
                fitting = [o for m in self.modules for o in m.outputs if o.kind is port.kind and o.owner is not port.owner]
                example = fitting[0] if fitting else f"<output of {wanted}>"
                self._fault("unconnected", port, f"({wanted}) is not connected. Write {example}.connect({port})")
        elif not isinstance(source, OutPort) or source.kind is not port.kind:
            advice = "Connect with writer.out_x.connect(reader.in_x), and do not set source"
            self._fault("type", port, f"expects {wanted}, but its source was set to {source!r}. {advice}")
        elif id(source.owner) not in self._places:
            self._fault("no task", port, f"reads {source}, which is in no task. Add {source.owner.name!r} to a task")
        else:
            self._add_edge(source, port)

    def _check_readers(self, out: OutPort[Any]) -> None:
        for reader in out.readers:
            if reader.source is not out:
                self._fault("two sources", reader, f"is connected to {out} and to {reader.source}. Use disconnect first")
            elif id(reader.owner) not in self._places:
                self._fault("no task", out, f"is read by {reader}, which is in no task. Add {reader.owner.name!r} to a task")

    def _add_edge(self, source: OutPort[Any], port: InPort[Any]) -> None:
        places = self._places[id(source.owner)], self._places[id(port.owner)]
        writer, reader = (self.tasks[p] for p in places)
        timed = self._untimed.isdisjoint((writer.name, reader.name))
        meet, age, unseen = latency(writer, reader, places[1] <= places[0]) if timed else (True, (0, 0), 0)
        names, periods = (str(source), str(port), port.kind.__name__), (writer.period, reader.period)
        self.edges.append(Edge(*names, periods, places, port.delayed, meet, age, unseen))
        if type(port.max_age) is int and 0 <= port.max_age < age[1]:
            advice = f"Accept {text(age[1])} or run {source.owner.name!r} more often"
            self._fault("stale", port, f"accepts {text(port.max_age)}, but {source} gets {text(age[1])} old. {advice}")

    def _check_order(self) -> None:
        undeclared: dict[int, list[int]] = {}
        for edge in self.edges:
            if not edge.delayed:
                undeclared.setdefault(edge.places[0], []).append(edge.places[1])
        for edge in self.edges:
            writer, reader = edge.places
            first, second = self.modules[writer].name, self.modules[reader].name
            advice = f"Declare {edge.source}.connect({edge.reader}, delayed=True)"
            if writer == reader:
                self._fault("self", edge.reader, f"reads its own module's {edge.source}. Keep the value in the state")
            elif edge.delayed and edge.meet and writer < reader:
                advice = f"Leave out delayed=True or put {second!r} before {first!r}"
                self._fault("delay", edge.reader, f"is declared delayed, but {first!r} runs before it. {advice}")
            elif not edge.delayed and reader < writer:
                cycle = _path(undeclared, reader, writer)
                if cycle:
                    names = " -> ".join(self.modules[p].name for p in [writer, *cycle])
                    self._fault("cycle", edge.reader, f"closes {names} without a declared delay. {advice}")
                elif edge.meet:
                    told = f"runs before {first!r}, which writes it: the value is at least {text(edge.age_ns[0])} old"
                    self._fault("order", edge.reader, f"{told}. {advice} or put {first!r} before {second!r}")

    def faults(self) -> list[Fault]:
        """All that is wrong; empty if the graph can run."""
        return list(self._faults)

    def require_sound(self) -> None:
        """Raise `GraphError` with all faults, if there are any."""
        if self._faults:
            raise GraphError(self.faults())

    def report(self, format: Literal["text", "json"] = "text") -> str:  # noqa: A002
        """Tasks, connections with type, rates and latency, and faults."""
        tasks = {
            t.name: (t.period, t.phase, [m.name for m, of in zip(self.modules, self.tasks, strict=True) if of is t])
            for t in dict.fromkeys(self.tasks)
        }
        if format == "json":
            keys = ("name", "period_ns", "phase_ns", "modules")
            found = {"tasks": [dict(zip(keys, (n, *t), strict=True)) for n, t in tasks.items()]}
            return msgspec.json.encode({**found, "edges": self.edges, "faults": self._faults}).decode()
        lines = [f"{name}, every {text(t[0])} from {text(t[1])}: {', '.join(t[2])}" for name, t in tasks.items()]
        lines += [f"{e.source} -> {e.reader}: {e.label}{', delayed' if e.delayed else ''}" for e in self.edges]
        return "\n".join([*lines, f"{len(self._faults)} faults", *map(str, self._faults)])

    def picture(self, format: Literal["mermaid", "dot", "svg"] = "svg") -> str:  # noqa: A002
        """The graph drawn: a lane for each task, its modules in order, connections with type, rates and latency."""
        from fsw import picture

        return {"mermaid": picture.mermaid, "dot": picture.dot, "svg": picture.svg}[format](self)


def _path(following: dict[int, list[int]], start: int, end: int) -> list[int]:
    """Places from ``start`` to ``end`` by the fewest connections, or nothing if there is no way."""
    came, waiting = {start: start}, deque([start])
    while waiting and end not in came:
        at = waiting.popleft()
        for place in following.get(at, ()):
            if place not in came:
                came[place] = at
                waiting.append(place)
    path = [end] if end in came else []
    while path and path[0] != start:
        path.insert(0, came[path[0]])
    return path
