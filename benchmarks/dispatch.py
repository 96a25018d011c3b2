"""What it costs to call one more module that does next to nothing, compiled and in Python."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Annotated

from benchmarks.timing import Figure, Line, figure, interleaved, slopes, timed
from fsw import In, KernelModule, Message, Module, Out, Row, Simulation, Task, Vec3, ms, publish

COMPILED_BAR_NS = 14.0
PYTHON_BAR_NS = 1500.0


class VectorMsg(Message):
    """A vector: the payload that Basilisk's module templates pass on."""

    vector: Annotated[Vec3, "-", "three numbers"]


class Nothing(KernelModule):
    """Does nothing, compiled."""

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row) -> None:
        """Return at once."""


class Relay(KernelModule):
    """Reads one message and writes one, compiled."""

    in_vector = In(VectorMsg, optional=True)
    out_vector = Out(VectorMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_vector: Row, out_vector: Row) -> None:
        """Pass the vector on, its first component greater by one."""
        out_vector.vector[0] = in_vector.vector[0] + 1.0
        out_vector.vector[1] = in_vector.vector[1]
        out_vector.vector[2] = in_vector.vector[2]
        publish(out_vector, t_ns)


class PythonNothing(Module):
    """Does nothing, in Python."""

    def step(self, t_ns: int) -> None:
        """Return at once."""


class PythonSource(Module):
    """Writes a message at each step, in Python."""

    out_vector = Out(VectorMsg)

    def step(self, t_ns: int) -> None:
        """Write zeros."""
        self.out_vector.write(VectorMsg(vector=_ZEROS.vector), t_ns)


class PythonRelay(Module):
    """Takes one message and writes it, in Python: what every module of that kind does beside its own work."""

    in_vector = In(VectorMsg, optional=True)
    out_vector = Out(VectorMsg)

    def step(self, t_ns: int) -> None:
        """Take and pass on."""
        message = self.in_vector.take()
        if message is not None:
            self.out_vector.write(message, t_ns)


class PythonMaker(Module):
    """Takes one message and writes a new one, validated, in Python."""

    in_vector = In(VectorMsg, optional=True)
    out_vector = Out(VectorMsg)

    def step(self, t_ns: int) -> None:
        """Take, make a message and write it."""
        message = self.in_vector.take()
        if message is not None:
            self.out_vector.write(VectorMsg(vector=message.vector), t_ns)


_ZEROS = VectorMsg(vector=[0.0, 0.0, 0.0])  # pyright: ignore[reportArgumentType]


def chain(kind: type[Module], count: int) -> Simulation:
    """A simulation of ``count`` modules of a kind, each reading the one before it, the first a source."""
    modules = [kind(f"m{i}") for i in range(count)]
    first: list[Module] = []
    if "in_vector" in kind.ports:
        source = PythonSource("source")
        first = [source]
        source.out_vector.connect(vars(modules[0])["in_vector"])
        for a, b in itertools.pairwise(modules):
            vars(a)["out_vector"].connect(vars(b)["in_vector"])
    return Simulation([Task("t", period=ms(100), modules=[*first, *modules])])


def ours(kind: type[Module], count: int, ticks: int) -> Callable[[], float]:
    """A case: nanoseconds for each tick of a chain."""
    sim = chain(kind, count)
    sim.run_for(ms(100) * 10)
    return lambda: timed(lambda n: sim.run_for(ms(100) * n), ticks)


def measure(repeats: int = 7, scale: float = 1.0, *, basilisk: bool = True) -> list[Line]:
    """Measure all kinds.

    Args:
        repeats: how often. scale: of the number of ticks, below 1 for a trial. basilisk: measure that side too.
    """
    kinds: dict[str, tuple[type[Module], str, int, int]] = {
        "compiled module, empty": (Nothing, "extForceTorque", 1000, 2000),
        "compiled module, reads and writes": (Relay, "rateMsgConverter", 1000, 1000),
        "Python module, empty": (PythonNothing, "python", 200, 500),
        "Python module, takes and passes on": (PythonRelay, "", 200, 200),
        "Python module, takes and makes a new message": (PythonMaker, "python_relay", 200, 200),
    }
    cases: dict[str, Callable[[], float]] = {}
    for name, (kind, there, count, ticks) in kinds.items():
        turns = max(int(ticks * scale), 2)
        cases |= {f"{name}/many": ours(kind, count, turns), f"{name}/one": ours(kind, 1, turns * 10)}
        if basilisk and there:
            from benchmarks.basilisk import trivial

            n = 20 if there.startswith("python") else 200
            cases |= {
                f"{name}/their many": trivial(there, n, turns),
                f"{name}/their one": trivial(there, 1, turns * 10),
            }
    samples = interleaved(cases, repeats)

    def summary(name: str, side: str, count: int) -> Figure | None:
        many = samples.get(f"{name}/{side}many")
        return figure(slopes(many, samples[f"{name}/{side}one"], count - 1)) if many else None

    lines: list[Line] = []
    for name, (kind, there, count, _) in kinds.items():
        own, other = summary(name, "", count), summary(name, "their ", 20 if there.startswith("python") else 200)
        assert own is not None
        bar = COMPILED_BAR_NS if kind in (Nothing, Relay) else PYTHON_BAR_NS
        lines.append(Line(name, "ns", own, other, f"at most {bar:g} ns", own.least, bar))
    return lines
