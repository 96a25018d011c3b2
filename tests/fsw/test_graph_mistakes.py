"""Every kind of wiring mistake: found before time zero, named, with what to do, and nothing else reported beside it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import Annotated, Any

import numpy as np
import pytest

from fsw import (
    F64,
    In,
    KernelModule,
    Message,
    Module,
    ObjectMessage,
    Out,
    Shape,
    Simulation,
    Task,
    ms,
    s,
    zeros,
)
from fsw.graph import Graph, GraphError
from fsw.ports import collect_wiring_errors


class StateMsg(Message):
    """Truth."""

    r_m: Annotated[F64, Shape(3), "m", "position"] = zeros(3)


class PictureMsg(ObjectMessage):
    """An image."""

    image: Annotated[Any, "-", "pixels"]


class FixMsg(Message):
    """A position fix."""

    x_m: Annotated[float, "m", "place"] = 0.0


class EstimateMsg(Message):
    """An estimate."""

    x_m: Annotated[float, "m", "place"] = 0.0


class TorqueMsg(Message):
    """A command."""

    torque: Annotated[float, "N*m", "about z"] = 0.0


class Stepping:
    """Counts steps: none may happen before the report."""

    def step(self, t_ns: int) -> None:
        pytest.fail(f"{self} was stepped although the graph has a fault")


class Plant(Stepping, Module):
    in_torque = In(TorqueMsg)
    out_state = Out(StateMsg)


class Camera(Stepping, Module):
    in_state = In(StateMsg)
    out_picture = Out(PictureMsg)


class Finder(Stepping, Module):
    in_picture = In(PictureMsg)
    out_fix = Out(FixMsg)


class Estimator(Stepping, Module):
    in_fix = In(FixMsg)
    in_state = In(StateMsg, optional=True)
    out_estimate = Out(EstimateMsg)


class Control(Stepping, Module):
    in_estimate = In(EstimateMsg)
    out_torque = Out(TorqueMsg)


class Logger(Stepping, Module):
    in_state = In(StateMsg)


class Gyro(KernelModule):
    in_state = In(StateMsg)
    out_fix = Out(FixMsg)

    @staticmethod
    def kernel(t_ns: int, params: Any, state: Any, in_state: Any, out_fix: Any) -> None:
        raise AssertionError


class Mixer(Stepping, Module):
    in_fix = In(FixMsg)
    in_torque = In(TorqueMsg)
    out_fix = Out(FixMsg)


class NoStep(Module):
    in_state = In(StateMsg)


class NoInit(Stepping, Module):
    def __init__(self, name: str) -> None:
        self.label = name


class LatePort(Stepping, Module):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.in_state = In(StateMsg)


class Fresh(Stepping, Module):
    in_state = In(StateMsg, max_age=ms(50))


class Negative(Stepping, Module):
    in_state = In(StateMsg, max_age=-1)


class Seconds(Stepping, Module):
    in_state = In(StateMsg, max_age=0.5)  # pyright: ignore[reportArgumentType]


class Stop(Stepping, Module):
    in_state = In(StateMsg, max_age=s(9), on_stale="stop")  # pyright: ignore[reportArgumentType]


class Rig:
    """A correct closed loop of five modules in three tasks, for one mistake to be made in."""

    def __init__(self) -> None:
        self.plant, self.camera = Plant("plant"), Camera("camera")
        self.finder, self.estimator, self.control = Finder("finder"), Estimator("estimator"), Control("control")
        self.plant.out_state.connect(self.camera.in_state)
        self.camera.out_picture.connect(self.finder.in_picture)
        self.finder.out_fix.connect(self.estimator.in_fix)
        self.estimator.out_estimate.connect(self.control.in_estimate)
        self.control.out_torque.connect(self.plant.in_torque, delayed=True)
        self.truth = Task("truth", ms(100), [self.plant, self.camera])
        self.nav = Task("nav", s(1), [self.finder, self.estimator])
        self.steering = Task("control", ms(500), [self.control])
        self.tasks: list[Any] = [self.truth, self.nav, self.steering]

    def reads(self, module: Any, task: Task | None = None, at: int = 99, **how: Any) -> Any:
        """Insert a module that reads the plant's state into a task."""
        self.lists(module, task, at)
        self.plant.out_state.connect(module.in_state, **how)
        return module

    def lists(self, module: Any, task: Task | None = None, at: int = 99) -> Any:
        """Insert a module into a task."""
        (task or self.nav).modules.insert(at, module)
        return module

    def task(self, *args: Any, at: int = 99, **how: Any) -> Task:
        """Insert a task."""
        self.tasks.insert(at, Task(*args, **how))
        return self.tasks[at if at < 99 else -1]

    def second_plant(self) -> Plant:
        """A further plant at the head of the first task, wired."""
        plant = self.lists(Plant("plant_2"), self.truth, 0)
        self.control.out_torque.connect(plant.in_torque, delayed=True)
        return plant

    def mixers(self, *wires: tuple[int, int], **how: Any) -> None:
        """Three modules mix_0 to mix_2 in a task, wired (from, to) among themselves and to a source each."""
        mixers = [self.lists(Mixer(f"mix_{i}")) for i in range(1 + max(max(w) for w in wires))]
        for mixer in mixers:
            self.control.out_torque.connect(mixer.in_torque, delayed=True)
        for writer, reader in wires:
            mixers[writer].out_fix.connect(mixers[reader].in_fix, **how)

    def namesake(self, unit: str, shape: int) -> None:
        """A reader of another class of the name StateMsg."""
        fields = {"r_m": Annotated[F64, Shape(shape), unit, "position"]}
        meta: Any = type(Message)
        other = meta("StateMsg", (Message,), {"__annotations__": fields, "__module__": __name__})
        members = {"in_state": In(other), "step": Stepping.step, "__module__": __name__}
        self.reads(type("Reader", (Module,), members)("reader"))


def without_camera(r: Any) -> None:
    r.truth.modules.remove(r.camera)
    r.plant.out_state.readers.clear()
    r.finder.in_picture.disconnect()


def rewired(writer: str, reader: str) -> Callable[[Any], None]:
    """Connect ports, given as paths in the rig, after the reader's source was removed."""

    def make(r: Any) -> None:
        get = attrgetter(reader)
        get(r).disconnect()
        attrgetter(writer)(r).connect(get(r))

    return make


def assigned(path: str, value: str | None) -> Callable[[Any], None]:
    """Set an attribute in the rig to what another path gives."""
    owner, _, name = path.rpartition(".")
    return lambda r: setattr(attrgetter(owner)(r), name, value and attrgetter(value)(r))


def fed_back_from_the_wrong_end(r: Any) -> None:
    r.plant.in_torque.delayed, r.camera.in_state.delayed = False, True


def phased_loop(r: Any) -> None:
    r.plant.in_torque.delayed, r.steering.phase = False, ms(30)


def borrowed_output(r: Any) -> None:
    spare = Control("spare")
    r.plant.in_torque.disconnect()
    r.control.out_torque = spare.out_torque
    spare.out_torque.connect(r.plant.in_torque, delayed=True)


def copied(r: Any) -> None:
    second = copy.copy(r.reads(Logger("logger")))
    second.name = "logger_2"
    r.lists(second)


def ran_elsewhere(r: Any) -> None:
    for module in [m for t in r.tasks for m in t.modules]:
        module.attach(Simulation([]))


TASK, CONNECT, NAME = (
    'Task("nav", period=s(1), modules=[...])',
    "writer.out_x.connect(reader.in_x)",
    "Give each its own name",
)
TO_CAMERA, TO_PLANT = (
    "plant.out_state.connect(camera.in_state)",
    "control.out_torque.connect(plant.in_torque, delayed=True)",
)
BACK_0, BACK_1 = (
    "mix_1.out_fix.connect(mix_0.in_fix, delayed=True)",
    "mix_2.out_fix.connect(mix_1.in_fix, delayed=True)",
)

CASES: dict[
    str, tuple[Callable[[Any], Any], list[tuple[str, str, str]]]
] = {  # mistake; kind, where, part of the advice
    "input forgotten": (lambda r: r.camera.in_state.disconnect(), [("unconnected", "camera.in_state", TO_CAMERA)]),
    "input of a kernel forgotten": (
        lambda r: r.lists(Gyro("gyro")),
        [("unconnected", "gyro.in_state", "plant.out_state.connect(gyro.in_state)")],
    ),
    "no output fits": (without_camera, [("unconnected", "finder.in_picture", "<output of PictureMsg>")]),
    "three inputs forgotten": (
        lambda r: [p.disconnect() for p in (r.plant.in_torque, r.camera.in_state, r.estimator.in_fix)],
        [
            ("unconnected", "plant.in_torque", TO_PLANT),
            ("unconnected", "camera.in_state", TO_CAMERA),
            ("unconnected", "estimator.in_fix", "finder.out_fix"),
        ],
    ),
    "second source": (
        lambda r: r.second_plant().out_state.connect(r.camera.in_state),
        [("two sources", "camera.in_state", "Remove one connection")],
    ),
    "connected twice": (
        lambda r: r.plant.out_state.connect(r.camera.in_state),
        [("two sources", "camera.in_state", "Remove one connection")],
    ),
    "source overwritten": (
        lambda r: setattr(r.camera.in_state, "source", r.second_plant().out_state),
        [("two sources", "camera.in_state", "disconnect")],
    ),
    "wrong type": (
        rewired("plant.out_state", "control.in_estimate"),
        [("type", "control.in_estimate", "right type")],
    ),
    "wrong type with equal fields": (
        rewired("finder.out_fix", "control.in_estimate"),
        [("type", "control.in_estimate", "right type")],
    ),
    "object message to a kernel": (
        lambda r: r.camera.out_picture.connect(r.lists(Gyro("gyro")).in_state),
        [("type", "gyro.in_state", "right type")],
    ),
    "source set to a wrong type": (
        assigned("control.in_estimate.source", "plant.out_state"),
        [("type", "control.in_estimate", CONNECT), ("two sources", "control.in_estimate", "disconnect")],
    ),
    "source set to a module": (
        assigned("camera.in_state.source", "plant"),
        [("type", "camera.in_state", CONNECT), ("two sources", "camera.in_state", "disconnect")],
    ),
    "same name, other shape": (lambda r: r.namesake("m", 4), [("shape", "reader.in_state", "Import one class")]),
    "same name, other unit": (lambda r: r.namesake("km", 3), [("shape", "reader.in_state", "Import one class")]),
    "same fields, other place": (lambda r: r.namesake("m", 3), [("shape", "reader.in_state", "Import one class")]),
    "loop without delay": (
        lambda r: setattr(r.plant.in_torque, "delayed", False),
        [("cycle", "plant.in_torque", TO_PLANT)],
    ),
    "loop in one task": (lambda r: r.mixers((0, 1), (1, 0)), [("cycle", "mix_0.in_fix", BACK_0)]),
    "loop with two edges back": (
        lambda r: r.mixers((0, 2), (2, 1), (1, 0)),
        [("cycle", "mix_0.in_fix", BACK_0), ("cycle", "mix_1.in_fix", BACK_1)],
    ),
    "loop of tasks that never meet": (phased_loop, [("cycle", "plant.in_torque", TO_PLANT)]),
    "reader before writer": (
        lambda r: r.truth.modules.reverse(),
        [("order", "camera.in_state", "put 'plant' before 'camera'")],
    ),
    "reader in an earlier task": (
        lambda r: r.reads(Logger("logger"), r.task("log", s(10), [], at=0)),
        [("order", "logger.in_state", "put 'plant' before 'logger'")],
    ),
    "kernel before its source": (
        lambda r: r.reads(Gyro("gyro"), r.truth, 0),
        [("order", "gyro.in_state", "delayed=True")],
    ),
    "delay that is none": (
        lambda r: setattr(r.camera.in_state, "delayed", True),
        [("delay", "camera.in_state", "Leave out delayed=True")],
    ),
    "delay that is none, between tasks": (
        lambda r: setattr(r.control.in_estimate, "delayed", True),
        [("delay", "control.in_estimate", "Leave out delayed=True")],
    ),
    "delay on the wrong edge": (
        fed_back_from_the_wrong_end,
        [("order", "plant.in_torque", TO_PLANT), ("delay", "camera.in_state", "Leave out delayed=True")],
    ),
    "reads its own output": (lambda r: r.mixers((0, 0)), [("self", "mix_0.in_fix", "state")]),
    "reads its own output, delayed": (lambda r: r.mixers((0, 0), delayed=True), [("self", "mix_0.in_fix", "state")]),
    "two modules of one name": (lambda r: r.reads(Camera("camera"), r.truth), [("name", "camera", NAME)]),
    "one name in two tasks": (lambda r: r.reads(Logger("plant")), [("name", "plant", NAME)]),
    "two tasks of one name": (lambda r: setattr(r.truth, "name", "nav"), [("name", "nav", NAME)]),
    "module twice in a task": (lambda r: r.lists(r.camera, r.truth), [("twice", "camera", "List it once")]),
    "module in two tasks": (lambda r: r.lists(r.plant), [("twice", "plant", "List it once")]),
    "task listed twice": (
        lambda r: r.tasks.append(r.steering),
        [("twice", "control", "List it once"), ("name", "control", "list it once")],
    ),
    "source in no task": (
        lambda r: r.truth.modules.remove(r.plant),
        [("no task", "camera.in_state", "Add 'plant' to a task"), ("no task", "control.out_torque", "Add 'plant'")],
    ),
    "reader in no task": (
        lambda r: r.plant.out_state.connect(Logger("logger").in_state),
        [("no task", "plant.out_state", "Add 'logger' to a task")],
    ),
    "source of an optional input in no task": (
        lambda r: Plant("spare").out_state.connect(r.estimator.in_state),
        [("no task", "estimator.in_state", "Add 'spare' to a task")],
    ),
    "task without modules": (lambda r: r.task("log", s(1), []), [("empty", "log", "Add modules or remove the task")]),
    "no tasks": (lambda r: r.tasks.clear(), [("empty", "simulation", "tasks with modules")]),
    "only an empty task": (
        lambda r: [r.tasks.clear(), r.task("log", s(1), [])],
        [("empty", "log", "Add modules"), ("empty", "simulation", "tasks with modules")],
    ),
    "max_age below what a delay gives": (
        lambda r: r.reads(Fresh("fresh"), r.truth, 0, delayed=True),
        [("age", "fresh.in_state", "Accept 0.1 s or run 'plant' more often")],
    ),
    "max_age below what the rates give": (
        lambda r: r.reads(Fresh("fresh"), r.task("fast", ms(10), [])),
        [("age", "fresh.in_state", "Accept 0.09 s or run 'plant' more often")],
    ),
    "max_age below what the phases give": (
        lambda r: r.reads(Fresh("fresh"), r.task("late", ms(100), [], phase=ms(70))),
        [("age", "fresh.in_state", "Accept 0.07 s or run 'plant' more often")],
    ),
    "max_age negative": (lambda r: r.reads(Negative("old")), [("age", "old.in_state", "max_age=ms(500)")]),
    "max_age in seconds": (lambda r: r.reads(Seconds("old")), [("age", "old.in_state", "max_age=ms(500)")]),
    "unknown on_stale": (lambda r: r.reads(Stop("old")), [("age", "old.in_state", '"error" or "warn"')]),
    "class for a module": (lambda r: r.lists(Logger), [("module", "nav[2]", "Logger('logger')")]),
    "kernel class for a module": (lambda r: r.lists(Gyro), [("module", "nav[2]", "Gyro('gyro')")]),
    "other class for a module": (lambda r: r.lists(dict), [("module", "nav[2]", "only modules")]),
    "text for a module": (lambda r: r.lists("logger"), [("module", "nav[2]", "only modules")]),
    "port for a module": (lambda r: r.lists(r.plant.out_state), [("module", "nav[2]", "only modules")]),
    "None for a module": (lambda r: r.lists(None), [("module", "nav[2]", "only modules")]),
    "module for a task": (lambda r: r.tasks.append(r.plant), [("task", "task 3", TASK)]),
    "list for a task": (lambda r: r.tasks.insert(0, []), [("task", "task 0", TASK)]),
    "__init__ without super": (
        lambda r: r.lists(NoInit("lost")),
        [("module", "nav[2]", "super().__init__(name, params)")],
    ),
    "no step": (lambda r: r.reads(NoStep("lazy")), [("module", "lazy", "Write step(self, t_ns)")]),
    "port made on the instance": (
        lambda r: r.lists(LatePort("late")),
        [("port", "late.in_state", "Declare it in the body of LatePort")],
    ),
    "output assigned to an input": (
        assigned("camera.in_state", "plant.out_state"),
        [("port", "camera.in_state", CONNECT)],
    ),
    "input set to None": (assigned("estimator.in_state", None), [("port", "estimator.in_state", CONNECT)]),
    "output of another module": (
        borrowed_output,
        [("port", "control.out_torque", CONNECT), ("no task", "plant.in_torque", "Add 'spare'")],
    ),
    "module copied": (copied, [("port", "logger_2.in_state", "copy no modules")]),
    "all modules ran elsewhere": (
        ran_elsewhere,
        [("simulation", m, "new modules") for m in ("plant", "camera", "finder", "estimator", "control")],
    ),
    "one module ran elsewhere": (
        lambda r: r.reads(Logger("logger")).attach(Simulation([])),
        [("simulation", "logger", "new modules")],
    ),
}

PERIODS: list[Any] = [0, -1, 0.5, True, "1 s", None, 2**62, np.float64(1e9)]
PHASES: list[Any] = [-1, 0.25, False, None, 2**70]
for what, value in [*(("period", v) for v in PERIODS), *(("phase", v) for v in PHASES)]:
    change: Callable[[Any], Any] = partial(lambda w, v, r: setattr(r.nav, w, v), what, value)
    CASES[f"{what} {value!r}"] = change, [("time", f"nav.{what}", "s(0.5)")]


@pytest.mark.parametrize("name", CASES)
def test_mistake_is_found_before_time_zero_named_and_alone(name: str) -> None:
    make, expected = CASES[name]
    rig = Rig()
    assert Graph(rig.tasks).faults() == []
    with collect_wiring_errors() as collected:
        make(rig)
    simulation = Simulation(rig.tasks)
    faults = Graph(simulation.tasks, collected, simulation).faults()
    assert sorted((f.kind, f.where) for f in faults) == sorted(e[:2] for e in expected)
    for kind, where, advice in expected:
        fault = next(f for f in faults if (f.kind, f.where) == (kind, where))
        assert advice in fault.advice
        assert fault.message
    if not collected:
        with pytest.raises(GraphError) as raised:
            simulation.run_until(s(1))
        assert raised.value.faults == faults
        assert all(str(fault) in str(raised.value) for fault in faults)


def test_forty_kinds_and_more() -> None:
    assert len(CASES) >= 40


def test_all_faults_in_one_report() -> None:
    rig: Any = Rig()
    with collect_wiring_errors() as collected:
        for name in (
            "second source",
            "wrong type",
            "reader in no task",
            "delay on the wrong edge",
            "module in two tasks",
        ):
            CASES[name][0](rig)
    for name in (
        "class for a module",
        "two tasks of one name",
        "task without modules",
        "period -1",
        "port made on the instance",
    ):
        CASES[name][0](rig)
    with pytest.raises(GraphError) as raised:
        Graph(rig.tasks, collected).require_sound()
    kinds = {f.kind for f in raised.value.faults}
    assert kinds >= {
        "two sources",
        "type",
        "no task",
        "order",
        "delay",
        "twice",
        "module",
        "name",
        "empty",
        "time",
        "port",
    }
    assert str(raised.value).count("\n") == len(raised.value.faults)
    assert Graph(rig.tasks, collected).report("json")
