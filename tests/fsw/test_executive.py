"""The executive: order, rates, feedback, freshness, stopping, errors, snapshots, in compiled and plain mode."""

import os
import pickle
import signal
import subprocess
import sys
import threading
import warnings
from typing import Annotated, Any

import numpy as np
import pytest

from fsw import (
    F64,
    Bound,
    In,
    KernelModule,
    Message,
    Module,
    ModuleError,
    ObjectMessage,
    Out,
    Record,
    Row,
    Shape,
    Simulation,
    StaleError,
    StaleWarning,
    Stream,
    Task,
    compiled,
    hz,
    ms,
    publish,
    s,
    unseeded,
)
from fsw.math.compiled import COMPILE


class CountMsg(Message):
    """A count."""

    n: Annotated[int, "-", "count"]
    x: Annotated[F64, Shape(2), "m", "two numbers"]


class PictureMsg(ObjectMessage):
    """A picture."""

    image: Annotated[Any, "-", "pixels"]


@compiled
def guard(n: int, limit: int) -> None:
    """Raise at a limit, in a function that the kernel calls."""
    if n == limit:
        raise ValueError("the limit is reached")


class Source(KernelModule):
    """Counts its own steps; adds a random number and what it reads."""

    class Params(Record):
        fail_at: Annotated[int, "-", "raise at this count, 0 never", Bound(ge=0)] = 0

    class State(Record):
        n: Annotated[int, "-", "steps"] = 0
        noise: Stream = unseeded

    in_back = In(CountMsg, optional=True)
    out_count = Out(CountMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_back: Row, out_count: Row) -> None:
        state.n += 1
        out_count.n = state.n
        out_count.x[0] = t_ns * 1e-9
        out_count.x[1] = in_back.n if in_back.seq > 0 else -1.0
        guard(state.n, params.fail_at)
        publish(out_count, t_ns)


class Relay(Module):
    """Copies its input, in Python, and remembers what it saw."""

    in_count = In(CountMsg, optional=True)
    out_count = Out(CountMsg)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.seen: list[tuple[int, int | None]] = []

    def step(self, t_ns: int) -> None:
        """Copy what is new."""
        message = self.in_count.take()
        self.seen.append((t_ns, None if message is None else message.n))
        if message is not None:
            self.out_count.write(message, t_ns)


class Breaking(Module):
    """Raises at a time."""

    def step(self, t_ns: int) -> None:
        """Raise at two seconds."""
        if t_ns == s(2):
            raise OSError("no such photo")


def run_alone(*modules: Module, period: int = s(1), **options: Any) -> Simulation:
    return Simulation([Task("only", period=period, modules=list(modules))], **options)


def test_tasks_run_top_to_bottom_and_modules_left_to_right() -> None:
    source, first, second = Source("source"), Relay("first"), Relay("second")
    source.out_count.connect(first.in_count)
    first.out_count.connect(second.in_count)
    sim = Simulation([Task("fast", ms(500), [source, first]), Task("slow", s(1), [second], phase=s(1))])
    sim.run_until(s(3))
    assert first.seen == [(ms(500) * k, k + 1) for k in range(7)]
    assert second.seen == [(s(1), 3), (s(2), 5), (s(3), 7)]


def test_thirds_of_a_second_stay_exact() -> None:
    thirds, seconds = Relay("thirds"), Relay("seconds")
    sim = Simulation([Task("a", hz(3), [thirds]), Task("b", hz(1), [seconds])])
    sim.run_until(s(500))
    snapshot = sim.snapshot()
    sim.run_until(s(1000))
    assert [t for t, _ in thirds.seen] == [k * 10**9 // 3 for k in range(3001)]
    assert [t for t, _ in seconds.seen] == [k * 10**9 for k in range(1001)]
    sim.restore(snapshot)
    sim.run_until(s(1000))
    assert [t for t, _ in thirds.seen] == [k * 10**9 // 3 for k in range(3001)]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_a_rate_is_positive(rate: float) -> None:
    with pytest.raises(ValueError, match="a rate is positive"):
        hz(rate)


def test_feedback_shows_the_previous_value() -> None:
    source, relay = Source("source"), Relay("relay")
    source.out_count.connect(relay.in_count)
    relay.out_count.connect(source.in_back, delayed=True)
    record = source.out_count.record()
    run_alone(source, relay).run_until(s(3))
    assert record["x"][:, 1].tolist() == [-1.0, 1.0, 2.0, 3.0]


def test_run_for_step_and_run_until_agree_on_time() -> None:
    source = Source("source")
    sim = run_alone(source)
    assert sim.run_for(ms(1500)) == ms(1500) and source.state.n == 2
    assert sim.step() == s(2) and source.state.n == 3
    assert sim.step(3) == s(5) and source.state.n == 6
    assert sim.run_until(s(5)) == s(5) and source.state.n == 6
    with pytest.raises(ValueError, match="restore or reset"):
        sim.run_until(s(1))
    with pytest.raises(TypeError, match=r"s\(10\)"):
        sim.run_until(10.0)  # type: ignore[arg-type]


def test_a_condition_stops_after_the_instant_and_the_run_goes_on() -> None:
    source, relay = Source("source"), Relay("relay")
    source.out_count.connect(relay.in_count)
    sim = run_alone(source, relay)
    assert sim.run_until(s(100), stop=(source.out_count, lambda m: m.n == 5)) == s(4)
    assert relay.seen[-1] == (s(4), 5), "the rest of the instant runs"
    assert sim.run_until(s(10), stop=(relay.out_count, lambda m: m.n > 1000)) == s(10)
    assert sim.run_for(s(5)) == s(15) and source.state.n == 16


def test_take_gives_a_message_once_and_latest_again() -> None:
    source, relay = Source("source"), Relay("relay")
    source.out_count.connect(relay.in_count)
    sim = Simulation([Task("slow", s(2), [source]), Task("fast", s(1), [relay])])
    sim.run_until(s(3))
    assert [n for _, n in relay.seen] == [1, None, 2, None]
    latest = relay.in_count.latest()
    assert latest is not None and latest.n == 2
    assert relay.in_count.latest() is latest, "an unchanged message is not built again"


def test_a_port_that_was_never_written_is_none() -> None:
    source, relay = Source("source"), Relay("relay")
    source.out_count.connect(relay.in_count)
    assert relay.in_count.latest() is None and relay.in_count.take() is None
    sim = Simulation([Task("late", s(1), [source], phase=s(2)), Task("early", s(1), [relay])])
    sim.run_until(s(1))
    assert [n for _, n in relay.seen] == [None, None]


@pytest.mark.parametrize("at", [1, 4])
def test_a_kernel_that_raises_stops_with_its_name_time_and_traceback(at: int) -> None:
    before, source = Source("before"), Source("source", Source.Params(fail_at=at))
    record = source.out_count.record()
    sim = run_alone(before, source)
    with pytest.raises(
        ModuleError, match=rf"Source 'source' failed at t = {at - 1} s: ValueError: the limit"
    ) as caught:
        sim.run_until(s(10))
    frames: list[str] = []
    trace = caught.value.__cause__.__traceback__ if caught.value.__cause__ else None
    while trace:
        frames.append(trace.tb_frame.f_code.co_name)
        trace = trace.tb_next
    assert frames[-2:] == ["kernel", "guard"], "the traceback leads into the function that the kernel calls"
    assert source.state.n == at - 1 and len(record) == at - 1, "state and outputs are as before the step"
    assert before.state.n == at


def test_a_python_module_that_raises_is_named() -> None:
    with pytest.raises(ModuleError, match=r"Breaking 'camera' failed at t = 2 s: OSError: no such photo") as caught:
        run_alone(Breaking("camera")).run_until(s(10))
    assert isinstance(caught.value.__cause__, OSError)


class Fussy(Module):
    """Wants fresh messages."""

    in_count = In(CountMsg, max_age=s(1))

    def step(self, t_ns: int) -> None:
        """Do nothing."""


class Tolerant(KernelModule):
    """Counts stale messages only."""

    in_count = In(CountMsg, max_age=s(1), on_stale="warn")
    out_count = Out(CountMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_count: Row, out_count: Row) -> None:
        out_count.n = in_count.n
        out_count.x[0] = 0.0
        out_count.x[1] = 0.0
        publish(out_count, t_ns)


class Once(Module):
    """Writes once."""

    out_count = Out(CountMsg)

    def step(self, t_ns: int) -> None:
        """Write at time zero."""
        if t_ns == 0:
            self.out_count.write(CountMsg(n=1, x=np.zeros(2)), t_ns)


def test_a_stale_input_is_an_error() -> None:
    once, fussy = Once("once"), Fussy("fussy")
    once.out_count.connect(fussy.in_count)
    sim = run_alone(once, fussy)
    with pytest.raises(
        StaleError, match=r"fussy\.in_count: the message of once\.out_count is 2 s old at t = 2 s, accepted are 1 s"
    ):
        sim.run_until(s(10))


def test_a_stale_input_may_be_a_counted_warning() -> None:
    once, tolerant = Once("once"), Tolerant("tolerant")
    once.out_count.connect(tolerant.in_count)
    sim = run_alone(once, tolerant)
    with pytest.warns(StaleWarning, match=r"tolerant\.in_count.*at 9 steps"):
        sim.run_until(s(10))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(StaleWarning, match="at 2 steps"):
            sim.run_until(s(12))


def closed_loop(name: str = "source") -> tuple[Simulation, Source, Relay]:
    source, relay = Source(name), Relay("relay")
    source.out_count.connect(relay.in_count)
    relay.out_count.connect(source.in_back, delayed=True)
    return Simulation([Task("a", ms(100), [source]), Task("b", ms(300), [relay])], seed=3), source, relay


def test_snapshot_and_restore_continue_to_the_bit() -> None:
    sim, source, relay = closed_loop()
    record = source.out_count.record()
    sim.run_until(s(2))
    snapshot = pickle.loads(pickle.dumps(sim.snapshot()))
    sim.run_until(s(5))
    rows, seen = record.rows().tobytes(), list(relay.seen)
    sim.restore(snapshot)
    assert sim.t_ns == s(2) and source.state.n == 21 and len(record) == 21
    sim.run_until(s(5))
    assert record.rows().tobytes() == rows and relay.seen == seen
    other, _, _ = closed_loop()
    other_record = other.modules[0].outputs[0].record()
    other.restore(snapshot)
    other.run_until(s(5))
    assert other_record.rows().tobytes() == rows[-len(other_record.rows().tobytes()) :]
    assert len(other_record) == 30


def test_a_snapshot_of_another_simulation_is_refused() -> None:
    with pytest.raises(ValueError, match="another simulation"):
        closed_loop()[0].restore(closed_loop("other")[0].snapshot())


def test_reset_goes_back_to_before_the_first_run() -> None:
    sim, source, relay = closed_loop()
    record = source.out_count.record()
    sim.run_until(s(2))
    rows = record.rows().tobytes()
    sim.reset()
    assert sim.t_ns == 0 and source.state.n == 0 and relay.seen == [] and len(record) == 0
    assert relay.in_count.latest() is None
    sim.run_until(s(2))
    assert record.rows().tobytes() == rows


def test_what_cannot_be_copied_is_named() -> None:
    relay = Relay("relay")
    relay.lock = threading.Lock()  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match=r"relay\.lock cannot be copied.*Relay\.shared"):
        run_alone(relay).run_until(0)


class Interrupting(Module):
    """Presses Ctrl-C at two seconds."""

    def step(self, t_ns: int) -> None:
        """Send the signal."""
        if t_ns == s(2):
            signal.raise_signal(signal.SIGINT)


def test_ctrl_c_ends_the_run_after_the_instant() -> None:
    source, after = Source("source"), Source("after")
    sim = run_alone(source, Interrupting("keyboard"), after)
    with pytest.raises(KeyboardInterrupt):
        sim.run_until(s(10))
    assert source.state.n == after.state.n == 3 and sim.t_ns == s(2)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    sim.run_until(s(10))
    assert source.state.n == after.state.n == 11


def test_ctrl_c_is_heard_during_a_long_compiled_run() -> None:
    source = Source("source")
    sim = run_alone(source)
    sim.step()
    threading.Timer(0.2, signal.raise_signal, [signal.SIGINT]).start()
    with pytest.raises(KeyboardInterrupt):
        sim.run_until(s(10**9))
    assert sim.t_ns == s(source.state.n - 1)


def test_time_is_measured_on_request() -> None:
    sim, _, _ = closed_loop()
    sim.run_until(s(1))
    assert all(row.calls == 0 for row in sim.timing())
    sim.timed = True
    sim.run_until(s(4))
    timing = {(row.task, row.module): row for row in sim.timing()}
    assert timing["a", "source"].calls == timing["a", ""].calls == 30 and timing["b", "relay"].calls == 10
    assert timing["b", "relay"].wall_ns > 0 and timing["a", "source"].wall_ns > 0


def test_one_step_outside_a_simulation() -> None:
    source = Source("source")
    source.step(s(1))
    source.step(s(2))
    message = source.out_count.latest()
    assert message is not None and message.n == 2 and message.x[0] == 2.0


def test_rewiring_between_runs_takes_effect() -> None:
    one, two, relay = Source("one"), Source("two"), Relay("relay")
    one.out_count.connect(relay.in_count)
    sim = run_alone(one, two, relay)
    sim.run_until(s(1))
    relay.in_count.disconnect()
    two.out_count.connect(relay.in_count)
    two.state.n = 100
    sim.run_until(s(2))
    assert [n for _, n in relay.seen] == [1, 2, 101]


def test_a_value_that_the_message_refuses_is_found_when_python_reads_it() -> None:
    source, relay = Source("source"), Relay("relay")
    source.out_count.connect(relay.in_count)
    sim = run_alone(source, relay)
    source.out_count.row["x"] = np.nan  # the port moves its row into the arena with its content
    sim.run_until(0)

    class Poison(KernelModule):
        """Publishes NaN."""

        out_count = Out(CountMsg)

        @staticmethod
        def kernel(t_ns: int, params: Row, state: Row, out_count: Row) -> None:
            publish(out_count, t_ns)

    poison, reader = Poison("poison"), Relay("reader")
    poison.out_count.connect(reader.in_count)
    with pytest.raises(ModuleError, match=r"poison\.out_count holds a bad value: CountMsg\.x.*NaN"):
        run_alone(poison, reader).run_until(0)


def test_writing_another_message_is_refused() -> None:
    relay = Relay("relay")
    with pytest.raises(TypeError, match=r"relay\.out_count: expected CountMsg, got PictureMsg"):
        relay.out_count.write(PictureMsg(image=0), 0)  # type: ignore[arg-type]


@pytest.mark.parametrize("body", ["class Derived(Relay): pass", "class Derived(Source): pass"])
def test_concrete_modules_are_final(body: str) -> None:
    with pytest.raises(TypeError, match="is final; to vary a module, wrap it"):
        exec(body, globals(), {})


def test_a_kernel_must_name_every_port() -> None:
    with pytest.raises(
        TypeError, match=r"expected arguments \(t_ns, params, state, in_count\), got \(t_ns, params, state\)"
    ):

        class Forgetful(KernelModule):
            """Forgets its input."""

            in_count = In(CountMsg)

            @staticmethod
            def kernel(t_ns: int, params: Row, state: Row) -> None:
                """Nothing."""


def test_a_kernel_cannot_read_objects() -> None:
    with pytest.raises(TypeError, match=r"Seeing\.in_image: PictureMsg: an object message is for Python modules"):

        class Seeing(KernelModule):
            """Sees."""

            in_image = In(PictureMsg)

            @staticmethod
            def kernel(t_ns: int, params: Row, state: Row, in_image: Row) -> None:
                """Nothing."""


@pytest.mark.parametrize("name", ["", "a.b", "a\nb"])
def test_a_bad_module_name_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="module name"):
        Relay(name)


def test_parameters_of_another_module_are_refused() -> None:
    with pytest.raises(TypeError, match=r"Source 'source': params: expected Source\.Params"):
        Source("source", Tolerant.Params())
    with pytest.raises(ValueError, match=r"Source\.Params\.fail_at.*>= 0"):
        Source.Params(fail_at=-1)


@pytest.mark.skipif(not COMPILE, reason="this is the compiled side of the pair")
def test_everything_above_holds_uncompiled() -> None:
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", __file__]
    done = subprocess.run(
        command, check=False, env={**os.environ, "FSW_COMPILE": "0"}, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
