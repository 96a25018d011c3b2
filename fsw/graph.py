"""The graph of modules: every wiring fault in one report before time zero, and the latency of every connection."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from fsw.module import Module
from fsw.ports import Collected, In, InPort, Out, OutPort
from fsw.time import text

if TYPE_CHECKING:
    from fsw.simulation import Simulation, Task

_CONNECT = "Use writer.out_x.connect(reader.in_x); assign no ports, copy no modules"


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

    ``period_ns`` and ``places`` (indices in `Graph.modules`): of writer and reader; ``delayed``: declared so; ``meet``,
    ``age_ns`` and ``unseen``: what `latency` returns.
    """

    source: str
    reader: str
    type: str
    period_ns: tuple[int | Fraction, int | Fraction]
    places: tuple[int, int]
    delayed: bool
    meet: bool
    age_ns: tuple[int, int]
    unseen: int

    @property
    def backward(self) -> bool:
        """Feedback: the reader comes first in the order of modules, or is the writer."""
        return self.places[1] <= self.places[0]

    @property
    def label(self) -> str:
        """Type, rates and latency, for people."""
        rates, age = (" to ".join(dict.fromkeys(map(text, pair))) for pair in (self.period_ns, self.age_ns))
        steps = "step" if self.unseen == 1 else f"{self.unseen} steps"
        unseen = f", none in the first {steps}" if self.unseen else ""
        return f"{self.type}, {rates}, age {age}{unseen}"


def latency(writer: Task, reader: Task, reader_first: bool) -> tuple[bool, tuple[int, int], int]:
    """How old what a module of one task writes at each of its steps is when a module of another reads it.

    The ages are the difference of the phases plus all multiples of the greatest common divisor of the periods, from 0
    to below the writer's period; with ``reader_first``, when the reader runs first at an instant at which both are due,
    an age of 0 is one period of the writer instead.

    Returns:
        Whether there are such instants; least and greatest age, ns; how many steps of the reader see no message yet.
    """
    step = _common(Fraction(writer.period), Fraction(reader.period))
    offset = (reader.phase - writer.phase) % step
    least = step if reader_first and offset == 0 else offset
    late = writer.phase - reader.phase + reader_first
    ages = math.floor(least), math.ceil(least + writer.period - step)
    return offset == 0, ages, max(0, math.ceil(late / Fraction(reader.period)))


def _common(a: Fraction, b: Fraction) -> Fraction:
    """Greatest common divisor."""
    n = a.denominator * b.denominator
    return Fraction(math.gcd(int(a * n), int(b * n)), n)


class Graph:
    """The graph as it is wired now.

    Args:
        tasks: of a simulation, in order. simulation: modules may have run in this one only.
        collected: what was noted while the graph was built.

    Attributes:
        modules: those that could run, in order. tasks: the task of each. edges: their connections.
    """

    def __init__(
        self, tasks: Sequence[Task], collected: Sequence[Collected] = (), simulation: Simulation | None = None
    ) -> None:
        self.modules: list[Module] = []
        self.tasks: list[Task] = []
        self.edges: list[Edge] = []
        self._faults: list[Fault] = []
        self._noted = [id(port) for _, port, _ in collected]
        for kind, port, error in collected:
            self._fault(kind, port, f"cannot be connected: {error}")
        for number, task in enumerate(tasks):
            self._add_task(task, f"task {number}")
        if not self.modules:
            self._fault("empty", "simulation", "has nothing to run. Pass it tasks with modules")
        self._check_names_and_homes(tasks, simulation)
        self._places = {id(m): i for i, m in enumerate(self.modules)}
        self._ports = [port for module in self.modules for port in self._sound_ports(module)]
        for port in self._ports:
            if isinstance(port, InPort):
                self._check_input(port)
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
        for name, t_ns, least, kinds in (("period", task.period, 1, (int, Fraction)), ("phase", task.phase, 0, (int,))):
            if not _is_time(t_ns, least, kinds=kinds):
                advice = f"Write an int in ns, at least {least}, such as s(0.5)"
                self._fault("time", f"{task.name}.{name}", f"is {t_ns!r}. {advice}")
        if not task.modules:
            self._fault("empty", task.name, "is a task without modules. Add modules or remove the task")
        for position, module in enumerate(task.modules):
            self._add_module(task, module, f"{task.name}[{position}]")
        return None

    def _add_module(self, task: Task, module: Any, where: str) -> None:
        name = str(getattr(module, "__name__", type(module).__name__))
        if isinstance(module, type) and issubclass(module, Module):
            self._fault("module", where, f"is the class {name}. Write {name}({name.lower()!r})")
        elif not isinstance(module, Module):
            self._fault("module", where, f"is {module!r}, not a module. Put only modules into a task")
        elif "_simulation" not in vars(module):
            advice = "Let its __init__ call super().__init__(name, params)"
            self._fault("module", where, f"is a {name} without ports. {advice}")
        elif any(module is known for known in self.modules):
            self._fault("twice", module.name, f"is in a task already and again as {where}. List it once, or make two")
        else:
            self.modules.append(module)
            self.tasks.append(task)
            if type(module).step is Module.step:
                self._fault("module", module.name, f"has no step. Write step(self, t_ns) in {name}")
            for port in [n for n, value in vars(module).items() if isinstance(value, (In, Out))]:
                self._fault("port", f"{module.name}.{port}", f"is no port. Declare it in the body of {name}")

    def _check_names_and_homes(self, tasks: Sequence[Task], simulation: Simulation | None) -> None:
        for what, named in (("tasks", tasks), ("modules", self.modules)):
            for name, number in Counter(str(getattr(n, "name", id(n))) for n in named).items():
                if number > 1:
                    self._fault("name", name, f"is the name of {number} {what}. Give each its own name, list it once")
        homes: list[Simulation | None] = [vars(m)["_simulation"] for m in self.modules]
        home = simulation or next((known for known in homes if known), None)
        for module, known in zip(self.modules, homes, strict=True):
            if known not in (None, home):
                self._fault("simulation", module.name, "has run in another simulation. Make new modules for each")

    def _sound_ports(self, module: Module) -> list[InPort[Any] | OutPort[Any]]:
        """The ports that are as the class declares them; a fault for each other."""
        sound: list[Any] = []
        for name, declared in module.ports.items():
            port: Any = vars(module).get(name)
            made: Any = InPort if isinstance(declared, In) else OutPort
            if type(port) is made and port.owner is module and port.name == name:
                sound.append(port)
            else:
                self._fault("port", f"{module.name}.{name}", f"was replaced by {port!r}. {_CONNECT}")
        return sound

    def _check_input(self, port: InPort[Any]) -> None:
        source: Any = port.source
        wanted = port.kind.__name__
        if port.max_age is not None and not _is_time(port.max_age, 0):
            self._fault("age", port, f"has max_age {port.max_age!r}. Write an int in ns, such as max_age=ms(500)")
        if port.on_stale not in ("error", "warn"):
            self._fault("age", port, f'has on_stale {port.on_stale!r}. Write "error" or "warn"')
        if source is None and not port.optional and id(port) not in self._noted:
            fits = [
                o for o in self._ports if isinstance(o, OutPort) and o.kind is port.kind and o.owner is not port.owner
            ]
            late = bool(fits) and self._places[id(fits[0].owner)] > self._places[id(port.owner)]
            call = f"{fits[0] if fits else f'<output of {wanted}>'}.connect({port}{', delayed=True' * late})"
            self._fault("unconnected", port, f"({wanted}) is not connected. Write {call}")
        elif source is not None and (not isinstance(source, OutPort) or source.kind is not port.kind):
            self._fault("type", port, f"expects {wanted}, but its source was set to {source!r}. {_CONNECT}")
        elif source is not None and id(source.owner) not in self._places:
            self._fault("no task", port, f"reads {source}, which is in no task. Add {source.owner.name!r} to a task")
        elif source is not None:
            self._add_edge(source, port)

    def _check_readers(self, out: OutPort[Any]) -> None:
        for reader in out.readers:
            name = reader.owner.name
            if reader.source is not out:
                self._fault("two sources", reader, f"has {reader.source} and {out}. Use disconnect, then connect")
            elif id(reader.owner) not in self._places:
                self._fault("no task", out, f"is read by {reader}, which is in no task. Add {name!r} to a task")

    def _add_edge(self, source: Any, port: InPort[Any]) -> None:
        places = self._places[id(source.owner)], self._places[id(port.owner)]
        writer, reader = (self.tasks[p] for p in places)
        timed = all(_is_time(t.period, 1, kinds=(int, Fraction)) and _is_time(t.phase, 0) for t in (writer, reader))
        meet, age, unseen = latency(writer, reader, places[1] <= places[0]) if timed else (True, (0, 0), 0)
        names, periods = (str(source), str(port), port.kind.__name__), (writer.period, reader.period)
        self.edges.append(Edge(*names, periods if timed else (0, 0), places, port.delayed, meet, age, unseen))
        limit, worst = port.max_age, age[0] if port.on_stale == "warn" else age[1]  # some warnings may be wanted
        if limit is not None and _is_time(limit, 0) and limit < worst:
            advice = f"Accept {text(worst)} or run {source.owner.name!r} more often"
            self._fault("age", port, f"accepts {text(limit)}, but {source} gets {text(worst)} old. {advice}")

    def _check_order(self) -> None:
        undeclared: dict[int, list[int]] = {}
        for edge in [e for e in self.edges if not e.delayed]:
            undeclared.setdefault(edge.places[0], []).append(edge.places[1])
        for edge in self.edges:
            first, second = (self.modules[p].name for p in edge.places)
            delay = f"Write {edge.source}.connect({edge.reader}, delayed=True)"
            cycle = [] if edge.delayed or not edge.backward else _path(undeclared, edge.places[1], edge.places[0])
            if edge.places[0] == edge.places[1]:
                self._fault("self", edge.reader, f"reads its own module's {edge.source}. Keep the value in the state")
            elif cycle:
                names = " -> ".join([first, *(self.modules[p].name for p in cycle)])
                self._fault("cycle", edge.reader, f"closes {names} without a declared delay. {delay}")
            elif edge.meet and edge.backward and not edge.delayed:
                told = f"is read before {first!r} writes: the value is at least {text(edge.age_ns[0])} old"
                self._fault("order", edge.reader, f"{told}. {delay} or put {first!r} before {second!r}")
            elif edge.meet and edge.delayed and not edge.backward:
                advice = f"Leave out delayed=True or put {second!r} before {first!r}"
                self._fault("delay", edge.reader, f"is declared delayed, but {first!r} runs before it. {advice}")

    def faults(self) -> list[Fault]:
        """All that is wrong; empty if the graph can run."""
        return list(self._faults)

    def require_sound(self) -> None:
        """Raise `GraphError` with all faults, if there are any."""
        if self._faults:
            raise GraphError(self.faults())

    def report(self, format: Literal["text", "json"] = "text") -> str:  # noqa: A002
        """Tasks, connections with type, rates and latency, and faults."""
        from fsw.tools import picture

        return {"text": picture.text_report, "json": picture.json_report}[format](self)

    def picture(self, format: Literal["mermaid", "dot", "svg"] = "svg") -> str:  # noqa: A002
        """The graph drawn: a lane for each task, its modules in order, connections with type, rates and latency."""
        from fsw.tools import picture

        return {"mermaid": picture.mermaid, "dot": picture.dot, "svg": picture.svg}[format](self)


def _is_time(value: Any, least: int, *, kinds: tuple[type, ...] = (int,)) -> bool:
    return type(value) in kinds and least <= value < 2**62


def _path(following: dict[int, list[int]], start: int, end: int) -> list[int]:
    """Places from ``start`` to ``end`` by the fewest connections; empty if there is no way."""
    came, reached = {start: start}, [start]
    for at in reached:  # grows while it is walked
        for place in following.get(at, ()):
            if place not in came:
                came[place] = at
                reached.append(place)
        if end in came:
            break
    path = [end] if end in came else []
    while path and path[0] != start:
        path.insert(0, came[path[0]])
    return path
