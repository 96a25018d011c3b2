"""Latency against brute force, no faults on correct graphs, one report of everything, and mistakes refused at once."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from typing import Annotated, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fsw import In, KernelModule, Message, Module, ObjectMessage, Out, Simulation, StaleError, Task, WiringError, hz, s
from fsw.graph import Fault, Graph, GraphError
from fsw.ports import collect_wiring_errors


class CountMsg(Message):
    """A number."""

    n: Annotated[int, "-", "count"] = 0


class OtherMsg(Message):
    """A number of another kind."""

    n: Annotated[int, "-", "count"] = 0


class BlobMsg(ObjectMessage):
    """Anything."""

    data: Annotated[Any, "-", "anything"]


class Writer(Module):
    out_count = Out(CountMsg)

    def step(self, t_ns: int) -> None:
        self.out_count.write(CountMsg(), t_ns)


class Reader(Module):
    in_count = In(CountMsg)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.ages: list[int | None] = []

    def step(self, t_ns: int) -> None:
        written = self.in_count.t_ns
        self.ages.append(None if written is None else t_ns - written)


class Node(Module):
    in_a = In(CountMsg)
    in_b = In(CountMsg, optional=True)
    in_c = In(OtherMsg, optional=True)
    out_count = Out(CountMsg)
    out_other = Out(OtherMsg)

    def step(self, t_ns: int) -> None:
        self.out_count.write(CountMsg(), t_ns)
        self.out_other.write(OtherMsg(), t_ns)


def pair(
    periods: tuple[int | Fraction, int | Fraction],
    phases: tuple[int, int],
    reader_first: bool,
    one_task: bool = False,
) -> tuple[list[Task], Reader]:
    """A writer and a reader, in tasks with periods and phases in ns."""
    writer, reader = Writer("writer"), Reader("reader")
    modules: list[Module] = [reader, writer] if reader_first else [writer, reader]
    writer.out_count.connect(reader.in_count, delayed=reader_first)
    if one_task:
        return [Task("both", periods[0], modules, phase=phases[0])], reader
    tasks = [Task("w", periods[0], [writer], phase=phases[0]), Task("r", periods[1], [reader], phase=phases[1])]
    return tasks[::-1] if reader_first else tasks, reader


PERIOD, PHASE = st.integers(1, 12), st.integers(0, 30)


@settings(max_examples=150, deadline=None)
@given(st.tuples(PERIOD, PERIOD), st.tuples(PHASE, PHASE), st.booleans(), st.booleans())
def test_latency_is_what_a_run_shows(
    periods: tuple[int, int], phases: tuple[int, int], reader_first: bool, one_task: bool
) -> None:
    tasks, reader = pair(periods, phases, reader_first, one_task)
    graph = Graph(tasks)
    assert graph.faults() == []
    (edge,) = graph.edges
    Simulation(tasks).run_until(60 + 2 * 12 * 12)
    seen = [age for age in reader.ages if age is not None]
    assert edge.age_ns == (min(seen), max(seen))
    assert edge.unseen == reader.ages.count(None)
    assert edge.backward is reader_first


@settings(max_examples=40, deadline=None)
@given(st.tuples(PERIOD, PERIOD), st.tuples(PHASE, PHASE), st.booleans())
def test_max_age_is_refused_exactly_when_a_run_would_break_it(
    periods: tuple[int, int], phases: tuple[int, int], reader_first: bool
) -> None:
    tasks, reader = pair(periods, phases, reader_first)
    greatest = Graph(tasks).edges[0].age_ns[1]
    reader.in_count.max_age = greatest
    Simulation(tasks).run_until(400)
    if greatest > 0:
        tasks, reader = pair(periods, phases, reader_first)
        reader.in_count.max_age = greatest - 1
        assert [f.kind for f in Graph(tasks).faults()] == ["age"]
        simulation = Simulation(tasks)
        simulation.graph = lambda: Graph([Task("t", 1, [Writer("w")])])  # so that it runs in spite of the fault
        with pytest.raises(StaleError):
            simulation.run_until(400)


def test_warnings_that_some_steps_give_are_a_choice_but_not_at_every_step() -> None:
    tasks, reader = pair((10, 5), (0, 0), False)
    reader.in_count.max_age, reader.in_count.on_stale = 4, "warn"
    assert Graph(tasks).faults() == []
    reader.in_count.on_stale = "error"
    assert [f.kind for f in Graph(tasks).faults()] == ["age"]
    tasks, reader = pair((10, 10), (0, 5), False)
    reader.in_count.max_age, reader.in_count.on_stale = 4, "warn"
    assert [f.kind for f in Graph(tasks).faults()] == ["age"]


@st.composite
def correct_graphs(draw: st.DrawFn) -> list[Task]:
    """Any wiring that obeys the rules."""
    nodes: list[Any] = []
    tasks = [Task("source", 1, [])]
    for i in range(draw(st.integers(1, 4))):
        new = [Node(f"node_{i}_{j}") for j in range(draw(st.integers(1, 4)))]
        tasks.append(Task(f"t{i}", draw(PERIOD), new, phase=draw(PHASE)))
        nodes += new
    nodes.append(Writer("first"))
    tasks[0].modules.append(nodes[-1])
    for place, node in enumerate(nodes[:-1]):
        choices = [i for i in range(len(nodes)) if i != place]
        for port in (node.in_a, node.in_b, node.in_c):
            source = draw(st.sampled_from(choices if port is node.in_a else [None, *choices]))
            if source is None or (port is node.in_c and source == len(nodes) - 1):
                continue
            out: Any = nodes[source].out_other if port is node.in_c else nodes[source].out_count
            out.connect(port, delayed=place < source < len(nodes) - 1)
    return tasks


@settings(max_examples=100, deadline=None)
@given(correct_graphs())
def test_correct_graphs_have_no_faults_and_run(tasks: list[Task]) -> None:
    simulation = Simulation(tasks)
    assert simulation.graph().faults() == []
    simulation.run_until(50)
    assert simulation.graph().faults() == []
    assert simulation.graph().report("text").endswith("faults: 0")


def test_tasks_that_never_meet_need_no_order() -> None:
    writer, reader = Writer("writer"), Reader("reader")
    writer.out_count.connect(reader.in_count)
    graph = Graph([Task("r", 4, [reader], phase=1), Task("w", 4, [writer])])
    assert graph.faults() == []
    assert not graph.edges[0].meet
    assert graph.edges[0].age_ns == (1, 1)


def test_recordings_and_unread_outputs_are_no_faults() -> None:
    writer = Writer("writer")
    writer.out_count.record()
    writer.out_count.record(every=s(1))
    assert Graph([Task("t", s(1), [writer])]).faults() == []


def chain(length: int, inputs: int) -> list[Task]:
    """Modules in four tasks; each reads up to ``inputs`` others, a quarter of them backwards."""
    ports = {f"in_{i}": In(CountMsg, optional=True) for i in range(inputs)}
    kind: Any = type(
        "Many", (Module,), {**ports, "out_count": Out(CountMsg), "step": Writer.step, "__module__": __name__}
    )
    modules: list[Any] = [kind(f"m{i}") for i in range(length)]
    for place, module in enumerate(modules):
        for i in range(inputs):
            source = (place * 7 + i * 13 + 1) % length
            if source != place:
                modules[source].out_count.connect(vars(module)[f"in_{i}"], delayed=source > place)
    quarter = length // 4
    return [Task(f"t{i}", s(i + 1), modules[i * quarter : (i + 1) * quarter]) for i in range(4)]


@pytest.mark.parametrize("spoilt", [False, True])
def test_every_fault_of_200_modules_is_in_one_report(spoilt: bool) -> None:
    tasks = chain(200, 5)
    if spoilt:
        for port in [p for t in tasks for m in t.modules for p in m.inputs]:
            port.delayed = False
    graph = Graph(tasks)
    assert len(graph.edges) > 950
    assert (len(graph.faults()) > 100) is spoilt


def test_report_as_text_and_json() -> None:
    tasks, _ = pair((s(1), s(4)), (0, s(2)), False)
    spare = Reader("spare")
    tasks[1].modules.append(spare)
    text = Graph(tasks).report().split("\n")
    assert text == [
        "w, every 1 s from 0 s: writer (Writer)",
        "r, every 4 s from 2 s: reader (Reader), spare (Reader)",
        "writer.out_count -> reader.in_count: CountMsg, 1 s to 4 s, age 0 s",
        "faults: 1",
        "unconnected: spare.in_count (CountMsg) is not connected. Write writer.out_count.connect(spare.in_count).",
    ]
    found = json.loads(Graph(tasks).report("json"))
    assert found["tasks"][1] == {"name": "r", "period_ns": s(4), "phase_ns": s(2), "modules": ["reader", "spare"]}
    assert found["faults"] == [
        {
            "kind": "unconnected",
            "where": "spare.in_count",
            "message": "(CountMsg) is not connected",
            "advice": "Write writer.out_count.connect(spare.in_count)",
        }
    ]
    assert found["edges"][0]["source"] == "writer.out_count"
    assert found["edges"][0]["age_ns"] == [0, 0]


def test_label_says_what_a_reader_sees_at_first() -> None:
    tasks, _ = pair((s(5), s(2)), (s(3), 0), True)
    assert Graph(tasks).edges[0].label == "CountMsg, 5 s to 2 s, age 1 s to 5 s, none in the first 2 steps"


def test_faulty_graph_is_still_reported_and_drawn() -> None:
    tasks, reader = pair((s(1), s(4)), (0, 0), False)
    tasks[0].period = "1 s"  # pyright: ignore[reportAttributeAccessIssue]
    tasks[1].modules.append(reader)
    graph = Graph([*tasks, None])  # pyright: ignore[reportArgumentType]
    assert [f.kind for f in graph.faults()] == ["time", "twice", "task"]
    assert "every '1 s'" in graph.report()
    assert json.loads(graph.report("json"))["tasks"][0]["period_ns"] == "1 s"
    for form in ("svg", "dot", "mermaid"):
        assert "writer" in graph.picture(form)


def test_error_lists_all_faults() -> None:
    tasks = [Task("t", s(1), [Reader("a"), Reader("b")])]
    with pytest.raises(GraphError, match=r"a\.in_count(.|\n)*b\.in_count") as raised:
        Simulation(tasks).run_until(s(1))
    assert len(raised.value.faults) == 2
    assert all(isinstance(fault, Fault) and fault.kind == "unconnected" for fault in raised.value.faults)


def test_modules_that_ran_cannot_run_in_another_simulation() -> None:
    tasks, _ = pair((1, 1), (0, 0), False)
    first = Simulation(tasks)
    first.run_until(5)
    with pytest.raises(GraphError, match="writer has run in another simulation"):
        Simulation(tasks).run_until(5)
    first.run_until(10)


AT_ONCE: dict[str, tuple[Callable[[Any, Any], Any], type[Exception], str]] = {
    "two sources": (lambda w, n: w.out_count.connect(n.in_a), WiringError, r"n\.in_a already reads w\.out_count"),
    "type": (
        lambda w, n: w.out_count.connect(n.in_c),
        WiringError,
        r"w\.out_count gives CountMsg, but n\.in_c expects",
    ),
    "module": (lambda w, n: w.out_count.connect(n), WiringError, r"w\.out_count .* input port, not to Node"),
    "port of a class": (lambda w, n: w.out_count.connect(Node.in_a), WiringError, r"w\.out_count .* input port"),
    "output": (
        lambda w, n: w.out_count.connect(n.out_count),
        WiringError,
        r"w\.out_count .* input port, not to n\.out",
    ),
    "nothing": (lambda w, n: w.out_count.connect(None), WiringError, r"w\.out_count .* input port, not to None"),
    "payload": (
        lambda w, n: w.out_count.write(OtherMsg(), 0),
        TypeError,
        r"w\.out_count: expected CountMsg, got OtherMsg",
    ),
    "no name": (lambda w, n: Writer(""), ValueError, "Writer: a module name"),
    "dotted name": (lambda w, n: Writer("a.b"), ValueError, r"Writer: a module name .*'a\.b'"),
    "parameters of another class": (
        lambda w, n: Writer("x", CountMsg()),
        TypeError,
        "Writer 'x': params: expected NoFields",
    ),
    "derived": (lambda w, n: type("Sub", (Writer,), {}), TypeError, "Sub: Writer is final"),
    "no kernel": (lambda w, n: kernel_class(None), TypeError, "Bad: write a @staticmethod named kernel"),
    "kernel without its port": (
        lambda w, n: kernel_class(lambda t_ns, params, state: None, in_x=In(CountMsg)),
        TypeError,
        r"Bad\.kernel: expected arguments \(t_ns, params, state, in_x\)",
    ),
    "kernel with an undeclared port": (
        lambda w, n: kernel_class(lambda t_ns, params, state, in_x: None),
        TypeError,
        r"Bad\.kernel: expected arguments \(t_ns, params, state\), got",
    ),
    "object message for a kernel": (
        lambda w, n: kernel_class(lambda t_ns, params, state, in_x: None, in_x=In(BlobMsg)),
        TypeError,
        r"Bad\.in_x: BlobMsg",
    ),
}


def kernel_class(kernel: Any, **ports: Any) -> Any:
    """A kernel module class with that kernel and ports."""
    return type("Bad", (KernelModule,), {**ports, **({"kernel": staticmethod(kernel)} if kernel else {})})


@pytest.mark.parametrize("name", AT_ONCE)
def test_mistake_that_is_refused_at_once(name: str) -> None:
    make, kind, words = AT_ONCE[name]
    writer, node = Writer("w"), Node("n")
    writer.out_count.connect(node.in_a)
    with pytest.raises(kind, match=words):
        make(writer, node)


def test_collected_mistakes_are_merged() -> None:
    writer, node = Writer("w"), Node("n")
    with collect_wiring_errors() as collected:
        writer.out_count.connect(node.in_c)  # pyright: ignore[reportArgumentType]
    faults = Graph([Task("t", s(1), [writer, node])], collected).faults()
    assert [(f.kind, f.where) for f in faults] == [("type", "n.in_c"), ("unconnected", "n.in_a")]


@pytest.mark.parametrize("rates", [(3, 1), (1, 3), (3, 7), (7, 3)])
@pytest.mark.parametrize("reader_first", [False, True])
def test_latency_of_rates_that_are_no_whole_nanoseconds(rates: tuple[int, int], reader_first: bool) -> None:
    tasks, reader = pair((hz(rates[0]), hz(rates[1])), (0, 0), reader_first)
    (edge,) = Graph(tasks).edges
    Simulation(tasks).run_until(s(30))
    ages = [age for age in reader.ages if age is not None]
    assert edge.meet
    assert edge.age_ns[0] == pytest.approx(min(ages), abs=1)  # instants are rounded to whole nanoseconds
    assert edge.age_ns[1] == pytest.approx(max(ages), abs=1)
