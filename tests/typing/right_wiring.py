# pyright: strict
"""Wiring that is correct: the type checker has nothing to say."""

from __future__ import annotations

from typing import Annotated

from fsw import In, KernelModule, Message, Module, Out, Record, Row, Simulation, Task, Vec3, ms, publish, s, zeros


class StateMsg(Message):
    """A state."""

    r_m: Annotated[Vec3, "m", "position"] = zeros(3)
    count: Annotated[int, "-", "number"] = 0


class FixMsg(Message):
    """A fix."""

    x_m: Annotated[float, "m", "place"]


class Plant(KernelModule):
    """Truth."""

    class Params(Record):
        """Parameters."""

        gain: Annotated[float, "-", "gain"] = 1.0

    in_fix = In(FixMsg, optional=True, max_age=s(2), on_stale="warn")
    out_state = Out(StateMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_fix: Row, out_state: Row) -> None:
        """Publish."""
        out_state.count += 1
        publish(out_state, t_ns)


class Sensor(Module):
    """Reads and writes."""

    in_state = In(StateMsg)
    out_fix = Out(FixMsg)

    def step(self, t_ns: int) -> None:
        """Measure."""
        state = self.in_state.take()
        if state is not None:
            self.out_fix.write(FixMsg(x_m=float(state.r_m[0])), t_ns)


def build() -> float:
    """A closed loop, run and read."""
    plant, sensor = Plant("plant", Plant.Params(gain=2.0)), Sensor("sensor")
    plant.out_state.connect(sensor.in_state)
    sensor.out_fix.connect(plant.in_fix, delayed=True)
    fixes = sensor.out_fix.record(every=s(1))
    simulation = Simulation([Task("truth", period=ms(100), modules=[plant]), Task("nav", s(1), [sensor], phase=ms(50))])
    simulation.run_until(s(10), stop=(sensor.out_fix, lambda fix: fix.x_m > 3.0))
    simulation.graph().require_sound()
    newest = sensor.out_fix.latest()
    return (newest.x_m if newest else 0.0) + float(fixes["x_m"][-1])
