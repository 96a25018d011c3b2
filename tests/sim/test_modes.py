"""Modes: which tasks run when, what conditions lead where, snapshots, mistakes; tasks that are enabled by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from fsw import (
    In,
    KernelModule,
    Message,
    Module,
    ModuleError,
    Out,
    Record,
    Row,
    Simulation,
    Task,
    WiringError,
    hz,
    ms,
    publish,
    s,
)
from sim.modes import Modes, newest, transition


class CountMsg(Message):
    """A number that grows."""

    k: Annotated[int, "-", "steps of the writer"]


class Counter(KernelModule):
    """Counts its steps."""

    class Params(Record):
        """Where to begin."""

        first: Annotated[int, "-", "first number"] = 1

    class State(Record):
        """The count."""

        k: Annotated[int, "-", "steps"] = 0

    out_count = Out(CountMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_count: Row) -> None:
        """Count."""
        out_count.k = params.first + state.k
        state.k += 1
        publish(out_count, t_ns)


class Case:
    """A clock that always runs, and two tasks in modes."""

    def __init__(self, hold_ns: int = 0) -> None:
        self.clock, self.a, self.b = Counter("clock"), Counter("a"), Counter("b")
        self.tasks = [Task("A", s(1), [self.a]), Task("B", s(1), [self.b])]
        k = self.clock.out_count
        ways = [
            transition("first", "second", k, lambda m: m.k in (4, 5, 6, 7), hold_ns),
            transition(["second"], "both", k, lambda m: m.k == 9),
            transition("*", "none", k, lambda m: m.k == 12),
        ]
        sets = {"first": self.tasks[:1], "second": self.tasks[1:], "both": self.tasks, "none": []}
        self.modes = Modes("modes", sets, ways, "first")
        self.log = self.modes.out_mode.record()
        self.records = [m.out_count.record() for m in (self.a, self.b)]
        always = [Task("modes", s(1), [self.modes]), Task("clock", s(1), [self.clock])]
        self.sim = Simulation([*always, *self.tasks])

    def ran(self) -> list[list[int]]:
        """Seconds at which A and B ran."""
        return [(r.t_ns // s(1)).tolist() for r in self.records]


EXPECTED = [[0, 1, 2, 3, 9, 10, 11], [4, 5, 6, 7, 8, 9, 10, 11]]
"""The clock shows k at k - 1 s, and the modes see it one second later."""


def test_tasks_run_in_their_modes() -> None:
    case = Case()
    case.sim.run_until(s(20))
    assert case.ran() == EXPECTED
    assert case.log["mode"].tolist() == [0, 1, 2, 3]
    assert case.log["previous"].tolist() == [-1, 0, 1, 2]
    assert case.log["transition"].tolist() == [-1, 0, 1, 2]
    assert (case.log["entered_ns"] // s(1)).tolist() == [0, 4, 9, 12]
    assert case.modes.mode == "none"
    assert case.clock.state.k == 21, "a task of no mode always runs"


def test_a_condition_that_has_to_hold() -> None:
    """k from 4 to 7 is seen at 4 to 7 s: three seconds are enough, four are not."""
    case = Case(hold_ns=s(3))
    case.sim.run_until(s(8))
    assert (case.log["entered_ns"] // s(1)).tolist() == [0, 7]
    case = Case(hold_ns=s(4))
    case.sim.run_until(s(8))
    assert case.modes.mode == "first"


def test_snapshot_restore_and_reset() -> None:
    case = Case()
    case.sim.run_until(s(6))
    kept = case.sim.snapshot()
    case.sim.run_until(s(15))
    case.sim.restore(kept)
    assert case.modes.mode == "second"
    case.sim.run_until(s(20))
    assert case.ran() == EXPECTED
    other = Case()
    other.sim.restore(kept)
    other.sim.run_until(s(20))
    assert other.ran()[1] == [7, 8, 9, 10, 11]
    case.sim.reset()
    case.sim.run_until(s(20))
    assert case.ran() == EXPECTED


def test_in_pieces_and_with_new_wires() -> None:
    """Tables that are built again keep what is enabled."""
    case = Case()
    for k in range(21):
        case.sim.run_until(s(k))
        case.clock.out_count.record()
    assert case.ran() == EXPECTED


def test_enabled_by_hand_on_the_grid() -> None:
    """A task at a third of a second keeps its grid over the time in which it is off."""
    counter = Counter("counter")
    task = Task("thirds", hz(3), [counter])
    record = counter.out_count.record()
    sim = Simulation([task, Task("other", ms(100), [Counter("other")])])
    sim.run_until(s(1))
    sim.enable(task, on=False)
    sim.run_until(s(2.5))
    sim.enable(task, on=True)
    sim.run_until(s(3))
    thirds = [k * s(1) // 3 for k in (0, 1, 2, 3, 8, 9)]
    assert record.t_ns.tolist() == thirds
    with pytest.raises(ValueError, match="not in list"):
        sim.enable(Task("stranger", s(1), []), on=True)


class Reader(Module):
    """Keeps the numbers that it takes."""

    in_count = In(CountMsg)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.taken: list[int] = []

    def step(self, t_ns: int) -> None:
        message = self.in_count.take()
        if message is not None:
            self.taken.append(message.k)


def test_newest_of_several_writers() -> None:
    """One reader gets the numbers of whichever task runs."""
    a, b, clock, reader = Counter("a"), Counter("b", Counter.Params(first=100)), Counter("clock"), Reader("reader")
    tasks = [Task("A", s(1), [a]), Task("B", s(1), [b])]
    way = transition("one", "two", clock.out_count, lambda m: m.k == 3)
    modes = Modes("modes", {"one": tasks[:1], "two": tasks[1:]}, [way], "one")
    merge = newest("merge", reader.in_count, a.out_count, b.out_count)
    first, last = Task("modes", s(1), [modes, clock]), Task("reader", s(1), [merge, reader])
    Simulation([first, *tasks, last]).run_until(s(5))
    assert reader.taken == [1, 2, 3, 100, 101, 102]
    with pytest.raises(WiringError, match="already reads"):
        newest("again", reader.in_count, a.out_count)
    with pytest.raises(ValueError, match="no sources"):
        newest("none", Reader("lonely").in_count)


def test_wrong_modes() -> None:
    a, task = Counter("a"), Task("A", s(1), [Counter("b")])
    port = a.out_count
    with pytest.raises(ValueError, match="start: there is no mode 'x'"):
        Modes("modes", {"one": []}, [], "x")
    with pytest.raises(ValueError, match="transition 0: there is no mode 'two'"):
        Modes("modes", {"one": []}, [transition("one", "two", port, lambda m: True)], "one")
    with pytest.raises(ValueError, match="leads from 'one' to itself"):
        Modes("modes", {"one": []}, [transition("one", "one", port, lambda m: True)], "one")
    with pytest.raises(ValueError, match="run it in one"):
        Modes("modes", {"one": [task]}, [], "one").step(0)
    missing = Modes("modes", {"one": [Task("C", s(1), [Counter("c")])]}, [], "one")
    with pytest.raises(ModuleError, match="is not in the simulation"):
        Simulation([Task("modes", s(1), [missing]), task]).run_until(0)
    late = Task("B", s(1), [Counter("d")])
    after = Modes("modes", {"one": [late]}, [], "one")
    with pytest.raises(ModuleError, match="list the task of the modes first"):
        Simulation([late, Task("modes", s(1), [after])]).run_until(0)


def test_the_example_of_the_guide_runs() -> None:
    """It ends in the mode that points, at the rate of the orbit."""
    text = (Path(__file__).parents[2] / "docs" / "modes.md").read_text()
    names: dict[str, Any] = {}
    exec(text.split("```python\n")[1].split("```")[0], names)
    assert names["modes"].mode == "point"
    assert names["changes"]["mode"].tolist()[:2] == [0, 1]
    rate = float(np.linalg.norm(names["case"].spacecraft.out_state.latest().omega_BN_B))
    assert abs(rate - 1.07e-3) < 2e-5
