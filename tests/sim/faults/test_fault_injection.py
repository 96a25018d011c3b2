"""Faults on connections: what the reader sees of each, nothing else changes, and every mistake has its sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from fsw import (
    GraphError,
    In,
    KernelModule,
    Message,
    Module,
    Out,
    Record,
    Recording,
    Row,
    Simulation,
    StaleError,
    Task,
    Vec3,
    WiringError,
    ms,
    publish,
    s,
)
from messages.faults import FaultActionMsg
from messages.opnav import CameraImageMsg
from sim.faults import Fault, bias, bit_flip, delay, drop, duplicate, freeze, inject, nan, noise, scale
from sim.scenarios.hill_pointing import build


class NumberMsg(Message):
    """Numbers that tell which message it is."""

    x: Annotated[Vec3, "m", "k, 2 k, 3 k"]
    k: Annotated[int, "-", "number of the message, from 1"]
    even: Annotated[bool, "-", "k is even"]


class Counter(KernelModule):
    """Writes message after message."""

    class State(Record):
        """The count."""

        k: Annotated[int, "-", "messages"] = 0

    out_number = Out(NumberMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_number: Row) -> None:
        """Write the next."""
        state.k += 1
        for i in range(3):
            out_number.x[i] = (i + 1.0) * state.k
        out_number.k, out_number.even = state.k, state.k % 2 == 0
        publish(out_number, t_ns)


class SeenMsg(Message):
    """What a reader sees at a step."""

    written_ns: Annotated[int, "ns", "time written"]
    number: Annotated[int, "-", "count of messages"]
    k: Annotated[int, "-", "number"]
    x: Annotated[Vec3, "m", "numbers, -1 for NaN"]


class Reader(KernelModule):
    """Copies what it sees."""

    in_number = In(NumberMsg)
    out_seen = Out(SeenMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_number: Row, out_seen: Row) -> None:
        """Copy."""
        out_seen.written_ns, out_seen.number, out_seen.k = in_number.t_ns, in_number.seq, in_number.k
        for i in range(3):
            out_seen.x[i] = -1.0 if np.isnan(in_number.x[i]) else in_number.x[i]
        publish(out_seen, t_ns)


class Case:
    """A counter at one rate, a reader at another, faults between."""

    def __init__(self, *faults: Fault, period: int = s(1), reader_first: bool = False, seed: int = 1) -> None:
        self.counter, self.reader = Counter("counter"), Reader("reader")
        self.counter.out_number.connect(self.reader.in_number, delayed=reader_first)
        tasks = [Task("a", s(1), [self.counter]), Task("b", period, [self.reader])]
        self.sim = Simulation(tasks[::-1] if reader_first else tasks, seed=seed)
        self.actions: Recording[FaultActionMsg] | None = None
        if faults:
            self.actions = inject(self.sim, self.counter.out_number, self.reader.in_number, *faults).record()
        self.seen = self.reader.out_seen.record()

    def run(self, seconds: float = 10.0) -> Recording[SeenMsg]:
        self.sim.run_until(s(seconds))
        return self.seen


def numbers(*faults: Fault, **options: Any) -> list[int]:
    """The numbers of the messages that the reader sees, second by second."""
    return Case(*faults, **options).run()["k"].tolist()


def test_drop_in_a_window() -> None:
    assert numbers(drop().between(s(3), s(6))) == [1, 2, 3, 3, 3, 3, 7, 8, 9, 10, 11]
    seen = Case(drop().between(s(3), s(6))).run()
    assert seen["number"].tolist() == [1, 2, 3, 3, 3, 3, 4, 5, 6, 7, 8]
    assert seen["written_ns"].tolist()[5:7] == [s(2), s(6)]


def test_drop_by_chance_is_seeded_and_has_its_probability() -> None:
    seen = [Case(drop(0.3), seed=k).run(2000.0)["k"] for k in (1, 1, 2)]
    np.testing.assert_array_equal(seen[0], seen[1])
    assert np.any(seen[0] != seen[2])
    lost = np.mean(np.diff(seen[0][1:]) == 0)
    assert abs(lost - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / 2000.0)


def test_delay() -> None:
    """2.5 s late is three steps late for a reader at 1 Hz; what is on the way at the end is overtaken."""
    assert numbers(delay(ms(2500)).between(s(3), s(7))) == [1, 2, 3, 3, 3, 3, 4, 8, 9, 10, 11]
    fast = Case(delay(ms(2500)), period=ms(500)).run(4.0)
    assert fast["number"].tolist() == [0, 0, 0, 0, 0, 1, 1, 2, 2]
    assert fast["written_ns"].tolist()[5:] == [0, 0, s(1), s(1)]


def test_freeze() -> None:
    """Messages keep coming, with the contents of the last one before the window."""
    seen = Case(freeze().between(s(3), s(6))).run()
    assert seen["k"].tolist() == [1, 2, 3, 3, 3, 3, 7, 8, 9, 10, 11]
    assert seen["number"].tolist() == list(range(1, 12))
    assert seen["written_ns"].tolist() == [s(k) for k in range(11)]
    assert numbers(freeze())[:3] == [1, 1, 1]


def test_duplicate() -> None:
    """A reader at 2 Hz sees each message of a writer at 1 Hz twice, as two messages."""
    seen = Case(duplicate().between(s(2), s(4)), period=ms(500)).run(5.0)
    assert seen["number"].tolist() == [1, 1, 2, 2, 3, 4, 5, 6, 7, 7, 8]
    assert seen["k"].tolist() == [1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 6]
    assert seen["written_ns"].tolist()[4:6] == [s(2), s(2)]


def test_bias_and_scale() -> None:
    both = Case(bias("x", [1.0, 0.0, -1.0]), scale("x", 2.0, place=1).between(s(5))).run()["x"]
    k = np.arange(1.0, 12.0)
    expected = np.stack([k + 1.0, np.where(k > 5, 4.0, 2.0) * k, 3.0 * k - 1.0], axis=1)
    np.testing.assert_array_equal(both, expected)


def test_noise_has_its_standard_deviation_and_its_own_stream() -> None:
    k = np.arange(1.0, 2002.0)[:, None] * [1.0, 2.0, 3.0]
    alone = Case(noise("x", [0.1, 0.0, 5.0])).run(2000.0)["x"] - k
    np.testing.assert_allclose(np.std(alone, axis=0), [0.1, 0.0, 5.0], rtol=0.06)
    np.testing.assert_allclose(np.mean(alone, axis=0), 0.0, atol=4.0 * 5.0 / np.sqrt(2000.0))
    more = Case(drop(0.5).between(s(5000)), noise("x", [0.1, 0.0, 5.0])).run(2000.0)["x"] - k
    np.testing.assert_array_equal(more, alone)


def test_nan() -> None:
    seen = Case(nan("x", place=2).between(s(3), s(5))).run()["x"]
    assert seen[3:5, 2].tolist() == [-1.0, -1.0]
    np.testing.assert_array_equal(np.delete(seen, [3, 4], axis=0)[:, 2] / 3.0, [1, 2, 3, 6, 7, 8, 9, 10, 11])
    assert seen[3, 1] == 8.0


def test_bit_flip() -> None:
    """Bit 63 of a double is its sign, bit 52 halves or doubles it, bit 1 of an int is 2."""
    assert Case(bit_flip("x", 63, place=0)).run()["x"][:2, 0].tolist() == [-1.0, -2.0]
    assert Case(bit_flip("x", 52, place=1)).run()["x"][0].tolist() == [1.0, 4.0 / 2.0 * 2.0, 3.0]
    assert Case(bit_flip("k", 1)).run()["k"].tolist()[:4] == [3, 0, 1, 6]
    seen = Case(bit_flip("x")).run(200.0)["x"]
    k = np.arange(1.0, 202.0)[:, None] * [1.0, 2.0, 3.0]
    changed = np.ascontiguousarray(seen).view(np.uint64) ^ k.view(np.uint64)
    changed = np.where(seen == -1.0, 0, changed)  # the reader shows NaN so
    assert np.all(np.bitwise_count(changed).sum(axis=1) <= 1)
    assert np.count_nonzero(changed) > 190
    assert len(np.unique(changed)) > 45


def test_bool_is_turned() -> None:
    """Seen by the condition of another fault, so that nothing else tells it."""
    counter, reader = Counter("counter"), Reader("reader")
    counter.out_number.connect(reader.in_number)
    sim = Simulation([Task("a", s(1), [counter, reader])])
    inject(sim, counter.out_number, reader.in_number, bit_flip("even"))
    turned = reader.in_number.source
    assert turned is not None
    sim.run_until(0)
    message = turned.latest()
    assert message is not None
    assert message.even


def test_condition_of_another_port() -> None:
    """Dropped while the counter itself shows an even number."""
    case = Case(period=s(1))
    fault = drop().when(case.counter.out_number, lambda m: m.even)
    inject(case.sim, case.counter.out_number, case.reader.in_number, fault)
    assert case.run()["k"].tolist() == [1, 1, 3, 3, 5, 5, 7, 7, 9, 9, 11]


def test_slow_reader_and_feedback() -> None:
    """A reader at 0.5 Hz keeps the count of the source; one that runs first sees the value before."""
    choices: list[dict[str, Any]] = [{"period": s(2)}, {"reader_first": True}]
    for options in choices:
        plain, idle = Case(**options).run(), Case(drop().between(s(99)), **options).run()
        for field in ("number", "written_ns", "k", "x"):
            np.testing.assert_array_equal(idle[field], plain[field])


def test_actions_are_recorded() -> None:
    """One message for each step in which a fault acts, one more when it is over."""
    case = Case(drop().between(s(3), s(5)), bias("x", 1.0).between(s(4), s(7)))
    case.run()
    assert case.actions is not None
    assert case.actions.t_ns.tolist() == [s(k) for k in (3, 4, 5, 6, 7)]
    assert case.actions["acting"].tolist() == [1, 1, 2, 2, 0]
    assert case.actions["taken"].tolist() == [1] * 5
    assert case.actions["delivered"].tolist() == [0, 0, 1, 1, 1]
    assert case.actions["written_ns"].tolist() == [s(k) for k in (2, 2, 5, 6, 7)]


def test_snapshot_and_reset_are_bit_identical() -> None:
    faults = (noise("x", 1.0), drop(0.3), delay(ms(2500)), duplicate(0.5), bit_flip("x", probability=0.2))

    def bits(case: Case) -> bytes:
        return case.seen.rows().tobytes()

    whole = Case(*faults)
    whole.run(40.0)
    pieces = Case(*faults)
    pieces.run(17.0)
    kept = pieces.sim.snapshot()
    pieces.run(30.0)
    pieces.sim.restore(kept)
    pieces.run(40.0)
    assert bits(pieces) == bits(whole)
    pieces.sim.reset()
    pieces.run(40.0)
    assert bits(pieces) == bits(whole)


def test_idle_faults_on_every_connection_change_no_bit() -> None:
    """The closed loop of hill pointing with a fault that never acts on each wire."""

    def final(with_faults: bool) -> bytes:
        case = build(seed=3)
        wires = [(port.source, port) for m in case.sim.modules for port in m.inputs if port.source is not None]
        for out, reader in wires if with_faults else []:
            inject(case.sim, out, reader, drop().between(s(1000)), nan_of_any(reader.kind).between(s(1000)))
        case.sim.run_until(s(60))
        return case.spacecraft.rows()[1].tobytes()

    def nan_of_any(kind: Any) -> Fault:
        return nan(next(n for n in kind.__struct_fields__ if n[-3:] != "_ns" and n != "valid"))

    assert final(with_faults=True) == final(with_faults=False)


class Camera(Module):
    """Writes an image each second."""

    out_image = Out(CameraImageMsg)

    def step(self, t_ns: int) -> None:
        image = np.full((2, 3), t_ns // s(1), np.uint8)
        self.out_image.write(CameraImageMsg(image=image, exposure_ns=t_ns), t_ns)


class Viewer(Module):
    """Keeps what it takes."""

    in_image = In(CameraImageMsg)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.taken: list[tuple[int, int]] = []

    def step(self, t_ns: int) -> None:
        message = self.in_image.take()
        if message is not None:
            self.taken.append((t_ns // ms(100), int(message.image[0, 0])))


def images(*faults: Fault) -> list[tuple[int, int]]:
    """Tenths of a second and seconds of the exposure of each image that is taken."""
    camera, viewer = Camera("camera"), Viewer("viewer")
    camera.out_image.connect(viewer.in_image)
    sim = Simulation([Task("camera", s(1), [camera]), Task("viewer", ms(500), [viewer])])
    inject(sim, camera.out_image, viewer.in_image, *faults)
    sim.run_until(s(4))
    return viewer.taken


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (drop().between(s(9)), [(0, 0), (10, 1), (20, 2), (30, 3), (40, 4)]),
        (drop().between(s(1), s(3)), [(0, 0), (30, 3), (40, 4)]),
        (delay(ms(1200)), [(15, 0), (25, 1), (35, 2)]),
        (freeze().between(s(2)), [(0, 0), (10, 1), (20, 1), (30, 1), (40, 1)]),
        (duplicate().between(s(3)), [(0, 0), (10, 1), (20, 2), (30, 3), (35, 3), (40, 4)]),
    ],
    ids=["none", "drop", "delay", "freeze", "duplicate"],
)
def test_images(fault: Fault, expected: list[tuple[int, int]]) -> None:
    assert images(fault) == expected


class Fresh(Module):
    """Accepts what is not older than two seconds."""

    in_number = In(NumberMsg, max_age=s(2))

    def step(self, t_ns: int) -> None:
        """Look."""
        self.in_number.latest()


def test_lost_messages_are_found_stale_and_nan_is_refused() -> None:
    for fault, error in [(drop().between(s(4)), StaleError), (nan("x").between(s(4)), RuntimeError)]:
        counter, fresh = Counter("counter"), Fresh("fresh")
        counter.out_number.connect(fresh.in_number)
        sim = Simulation([Task("a", s(1), [counter, fresh])])
        inject(sim, counter.out_number, fresh.in_number, fault)
        sim.run_until(s(3))
        with pytest.raises(error, match=r"NaN|older|old at"):
            sim.run_until(s(9))


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: bias("y", 1.0), r"NumberMsg has no field 'y'; it has x, k, even"),
        (lambda: bias("k", 1.0), r"k is int, not float"),
        (lambda: bias("x", [1.0, 2.0]), r"shape \(3,\); index None and value"),
        (lambda: nan("x", place=3), r"shape \(3,\); index 3"),
        (lambda: bit_flip("even", 3), r"a bit from 0 to 0"),
        (lambda: bit_flip("x", 64), r"a bit from 0 to 63"),
        (lambda: drop(1.5), r"probability from 0 to 1"),
        (lambda: delay(0), r"above 0"),
        (lambda: noise("x", -1.0), r"standard deviation"),
        (lambda: bias("x", np.nan), r"finite numbers"),
        (lambda: drop().between(s(3), s(2)), r"end after the start"),
        (lambda: drop().between(3.5), r"ints in ns"),  # pyright: ignore[reportArgumentType]
    ],
)
def test_wrong_faults(make: Callable[[], Fault], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        Case(make())


def test_wrong_connections() -> None:
    case, other = Case(), Case()
    counter, reader = case.counter.out_number, case.reader.in_number
    with pytest.raises(WiringError, match=r"reader.in_number reads counter.out_number; connect first"):
        inject(case.sim, other.counter.out_number, reader, drop())
    with pytest.raises(WiringError, match=r"'reader' is in no task"):
        inject(Simulation([]), counter, reader, drop())
    with pytest.raises(ValueError, match=r"none given"):
        inject(case.sim, counter, reader)
    inject(case.sim, counter, reader, drop())
    with pytest.raises(WiringError, match=r"give all faults in one call"):
        inject(case.sim, counter, reader, freeze())
    case.sim.run_until(0)
    other.sim.run_until(0)
    with pytest.raises(ValueError, match=r"the simulation has run"):
        inject(other.sim, other.counter.out_number, other.reader.in_number, drop())
    with pytest.raises(ValueError, match=r"object message; it takes drop, delay, freeze, duplicate"):
        images(bias("image", 1.0))


def test_the_graph_shows_the_fault() -> None:
    case = Case(drop())
    edges = [(e.source, e.reader) for e in case.sim.graph().edges]
    assert ("counter.out_number", "faults_reader_in_number.in_message") in edges
    assert ("faults_reader_in_number.out_message", "reader.in_number") in edges
    lonely = Reader("lonely")
    with pytest.raises(GraphError, match="unconnected"):
        Simulation([Task("a", s(1), [lonely])]).run_until(0)


def test_the_example_of_the_guide_runs(capsys: pytest.CaptureFixture[str]) -> None:
    """And the star tracker's messages are lost and late there."""
    text = (Path(__file__).parents[3] / "docs" / "fault_injection.md").read_text()
    names: dict[str, Any] = {}
    exec(text.split("```python\n")[1].split("```")[0], names)
    assert int(capsys.readouterr().out.split(":")[1]) == len(names["actions"]) > 100
    assert set(names["actions"]["acting"].tolist()) == {0, 1, 2, 3}
