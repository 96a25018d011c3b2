# pyright: strict, reportUnnecessaryTypeIgnoreComment=true
"""Wiring that is wrong: each ignored line is one that the type checker must flag, with that rule."""

from __future__ import annotations

from typing import Annotated

from fsw import In, Message, Module, Out, Record, Simulation, Task, Vec3, ms, s, zeros
from fsw.graph import Graph


class StateMsg(Message):
    """A state."""

    r_m: Annotated[Vec3, "m", "position"] = zeros(3)
    count: Annotated[int, "-", "number"] = 0


class SameMsg(Message):
    """A message with the same fields."""

    r_m: Annotated[Vec3, "m", "position"] = zeros(3)
    count: Annotated[int, "-", "number"] = 0


class FixMsg(Message):
    """A fix."""

    x_m: Annotated[float, "m", "place"]


class Sensor(Module):
    """Reads and writes."""

    class Params(Record):
        """Parameters."""

        gain: Annotated[float, "-", "gain"] = 1.0

    in_state = In(StateMsg)
    out_fix = Out(FixMsg)

    def step(self, t_ns: int) -> None:
        """Measure."""
        state = self.in_state.take()
        self.out_fix.write(FixMsg(x_m=float(state.r_m[0])), t_ns)  # pyright: ignore[reportOptionalMemberAccess]
        self.out_fix.write(FixMsg(x_m=0.0))  # pyright: ignore[reportCallIssue]
        self.out_fix.write(StateMsg(), t_ns)  # pyright: ignore[reportArgumentType]
        self.in_state.write(StateMsg(), t_ns)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
        self.out_fix.latest().x_m  # pyright: ignore[reportOptionalMemberAccess]


class Source(Module):
    """Writes."""

    out_state = Out(StateMsg)
    out_same = Out(SameMsg)
    out_number = Out(int)  # pyright: ignore[reportArgumentType, reportUnknownVariableType]
    in_stop = In(StateMsg, on_stale="stop")  # pyright: ignore[reportArgumentType]
    in_late = In(StateMsg, max_age=0.5)  # pyright: ignore[reportArgumentType]

    def step(self, t_ns: float, extra: int) -> None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Take one argument too many."""


source, sensor, second = Source("source"), Sensor("sensor"), Sensor("second")

source.out_same.connect(sensor.in_state)  # pyright: ignore[reportArgumentType]
sensor.out_fix.connect(second.in_state)  # pyright: ignore[reportArgumentType]
source.out_state.connect(sensor)  # pyright: ignore[reportArgumentType]
source.out_state.connect(Sensor.in_state)  # pyright: ignore[reportArgumentType]
source.out_state.connect(source.out_state)  # pyright: ignore[reportArgumentType]
source.out_state.connect(None)  # pyright: ignore[reportArgumentType]
source.out_state.connect(sensor.in_state, True)  # pyright: ignore[reportCallIssue]
source.out_state.connect(sensor.in_state, delayed="yes")  # pyright: ignore[reportArgumentType]
source.out_state.connect()  # pyright: ignore[reportCallIssue]
source.out_stat.connect(sensor.in_state)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
source.out_state.connect(sensor.in_stat)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownArgumentType]
Source.out_state.connect(sensor.in_state)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
sensor.in_state = source.out_state  # pyright: ignore[reportAttributeAccessIssue]
sensor.in_state.source = sensor.out_fix  # pyright: ignore[reportAttributeAccessIssue]
source.out_state.record(every=0.5)  # pyright: ignore[reportArgumentType]
source.out_state.record(s(1))  # pyright: ignore[reportCallIssue]

FixMsg(1.0)  # pyright: ignore[reportCallIssue]
FixMsg()  # pyright: ignore[reportCallIssue]
FixMsg(x_m="one")  # pyright: ignore[reportArgumentType]
FixMsg(y_m=1.0)  # pyright: ignore[reportCallIssue]
FixMsg(x_m=1.0).x_m = 2.0  # pyright: ignore[reportAttributeAccessIssue]
StateMsg(r_m=[0.0, 0.0, 0.0])  # pyright: ignore[reportArgumentType]
StateMsg(count=0.5)  # pyright: ignore[reportArgumentType]

Sensor()  # pyright: ignore[reportCallIssue]
Sensor("sensor", 2.0)  # pyright: ignore[reportArgumentType]
Sensor.Params(gain="high")  # pyright: ignore[reportArgumentType]
Sensor.Params(gian=1.0)  # pyright: ignore[reportCallIssue]
Sensor.Params(gain=1.0).gain = 2.0  # pyright: ignore[reportAttributeAccessIssue]

Task("nav", 0.5, [sensor])  # pyright: ignore[reportArgumentType]
Task("nav", s(1), sensor.out_fix)  # pyright: ignore[reportArgumentType]
Task("nav", s(1), [Sensor])  # pyright: ignore[reportArgumentType]
Task("nav", s(1), [sensor.in_state])  # pyright: ignore[reportArgumentType]
Task("nav", s(1), [sensor], phase="late")  # pyright: ignore[reportArgumentType]
Task("nav", [sensor])  # pyright: ignore[reportCallIssue]
Simulation([sensor])  # pyright: ignore[reportArgumentType]
Simulation(Task("nav", s(1), [sensor]))  # pyright: ignore[reportArgumentType]
simulation = Simulation([Task("nav", ms(500), [source, sensor])])
simulation.run_until(10.0)  # pyright: ignore[reportArgumentType]
simulation.run_until(s(9), stop=(sensor.in_state, bool))  # pyright: ignore[reportArgumentType]
simulation.run_until(s(9), stop=(sensor.out_fix, Source.step))  # pyright: ignore[reportArgumentType]
Graph(simulation.tasks).picture("png")  # pyright: ignore[reportArgumentType]
Graph(simulation.tasks).report("yaml")  # pyright: ignore[reportArgumentType]
# last, because nothing runs after it
Sensor("other").in_state.connect(source.out_state)  # pyright: ignore[reportArgumentType]
