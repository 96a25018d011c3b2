"""The executive: tasks of modules at fixed rates on integer nanoseconds, the same way every time."""

from __future__ import annotations

import ctypes
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import Any, TypeAlias, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from fsw import loop
from fsw.graph import Graph
from fsw.math.compiled import COMPILE
from fsw.module import KernelModule, Module
from fsw.ports import OutPort
from fsw.streams import stream_words
from fsw.tables import Tables
from fsw.time import text
from messages.base import I64, Message, ObjectMessage

M = TypeVar("M", bound="Message | ObjectMessage")
Stop: TypeAlias = tuple[OutPort[Any], Callable[[Any], bool]]


class ModuleError(RuntimeError):
    """A module raised; the text names it and the simulation time, the cause is the module's own exception."""


class StaleError(RuntimeError):
    """An input was older than it accepts."""


class StaleWarning(UserWarning):
    """An input was older than it accepts, and declares that this is to be counted only."""


class Task:
    """Modules that run one after the other at a period.

    Args:
        name: unique name. period: ns, with `hz` also a fraction; instants are then rounded down, without drift.
        modules: in the order in which they run. phase: ns, time of the first run.
    """

    def __init__(self, name: str, period: int | Fraction, modules: Sequence[Module] | Module, phase: int = 0) -> None:
        self.modules = [modules] if isinstance(modules, Module) else list(modules)
        self.name, self.period, self.phase = name, period, phase

    def __repr__(self) -> str:
        return f"Task({self.name!r})"


class Snapshot(msgspec.Struct, frozen=True):
    """Everything a run can change, at one time; it can be pickled and restored in an equal simulation."""

    t_ns: int
    layout: tuple[Any, ...]
    arena: NDArray[np.uint8]
    next_ns: I64
    cursor: I64
    modules: list[dict[str, Any]]


class Timing(msgspec.Struct, frozen=True):
    """Wall time of one module (``module`` is "" for the sum of a task)."""

    task: str
    module: str
    calls: int
    wall_ns: int


class Simulation:
    """Runs tasks of modules.

    Tasks due at one instant run in the order given, their modules in the order of the task. Nothing is checked or
    compiled before the first run, so wires and recordings may be added until then (and between runs).

    Attributes:
        t_ns: all instants up to this time have run. tasks, seed: as given.
        timed: set it to measure the wall time of each module, see `timing`.
    """

    def __init__(self, tasks: Sequence[Task], seed: int = 0) -> None:
        self.tasks, self.seed = list(tasks), seed
        self.t_ns = 0
        self.timed = False
        self._arena: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self._tables: Tables | None = None
        self._initial: Snapshot | None = None
        self._ready = False
        self._stop_requested = False

    @property
    def modules(self) -> list[Module]:
        """All modules, in the order in which they run."""
        return [m for t in self.tasks for m in t.modules]

    # --- building ---------------------------------------------------------------------------------------------------

    def graph(self) -> Graph:
        """The graph of modules as it is wired now: checks, tables, pictures."""
        return Graph(self.tasks, simulation=self)

    def rewired(self) -> None:
        """A module's connections or recordings have changed; the tables are built again before the next run."""
        self._ready = False

    def _prepare(self) -> Tables:
        if self._tables is None or not self._ready:
            self.graph().require_sound()
            if self._initial is None:
                self._adopt()
            elif self._tables is not None and self._tables.modules != self.modules:
                raise ValueError("the modules of a simulation cannot change after its first run; make a new one")
            self._tables, self._ready = Tables(self.tasks, self._tables), True
            if self._initial is None:
                self._initial = self.snapshot()
        return self._tables

    def _adopt(self) -> None:
        """Move every module into one arena, seed the streams."""
        rows = [m.rows() for m in self.modules]
        sizes = [-(-r.nbytes // 16) * 16 for group in rows for r in group]
        raw = np.zeros(sum(sizes) + 64, np.uint8)
        start = -raw.ctypes.data % 64
        self._arena = arena = raw[start : start + sum(sizes)]
        offset = 0
        for module, group in zip(self.modules, rows, strict=True):
            moved: list[NDArray[Any]] = []
            for row in group:
                place = arena[offset : offset + row.nbytes].view(row.dtype)
                place[:] = row
                moved.append(place)
                offset += -(-row.nbytes // 16) * 16
            module.bind(moved)
            module.attach(self)
            module.seed(lambda stream, name=module.name: stream_words(self.seed, name, stream))

    # --- running ----------------------------------------------------------------------------------------------------

    def run_until(self, t_ns: int, *, stop: tuple[OutPort[M], Callable[[M], bool]] | None = None) -> int:
        """Run all instants up to and including ``t_ns``.

        Args:
            t_ns: simulation time, ns. stop: a port and a condition on its newest message, looked at whenever the
                port's owner has run; when it is true, the run ends after that instant.

        Returns:
            The time reached, ns.

        Raises:
            GraphError: before anything runs, if the graph has faults.
            ModuleError: if a module raises. StaleError: if an input is too old. KeyboardInterrupt: on Ctrl-C, after the
                instant is complete; the run can go on.
        """
        if not isinstance(t_ns, int) or isinstance(t_ns, bool):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"time is an int in ns, got {t_ns!r}; write s(10) for ten seconds")
        if t_ns < self.t_ns:
            now = text(self.t_ns)
            raise ValueError(f"cannot run until {text(t_ns)}: the time is {now}; use restore or reset to go back")
        tables = self._prepare()
        stopped = self._advance(tables, t_ns, 2**62, stop)
        self.t_ns = tables.now[loop.INSTANT] if stopped else t_ns
        return self.t_ns

    def run_for(self, duration_ns: int, *, stop: tuple[OutPort[M], Callable[[M], bool]] | None = None) -> int:
        """Run for a duration from `t_ns`; see `run_until`."""
        return self.run_until(self.t_ns + duration_ns, stop=stop)

    def step(self, instants: int = 1) -> int:
        """Run the next instants at which any task is due, and return the time of the last."""
        tables = self._prepare()
        self._advance(tables, 2**62, instants, None)
        self.t_ns = tables.now[loop.INSTANT]
        return self.t_ns

    def enable(self, task: Task, on: bool) -> None:
        """Let a task run, or not, from its next instant on; from this one if a module that runs before it calls.

        Instants stay on the task's grid, outputs keep their last values, and snapshots include what is enabled.

        Raises:
            ValueError: if the task is not of this simulation.
        """
        row = self._prepare().tasks[self.tasks.index(task)]
        row[loop.LAST] = row[loop.FIRST] + (len(task.modules) if on else 0)

    def _advance(self, tables: Tables, until: int, instants: int, stop: Stop | None) -> bool:
        """Run; True if the stop condition or the number of instants ended it."""
        runs_on, stale_before = tables.runs_on, tables.checks[:, loop.C_COUNT].copy()
        if stop is not None:
            watched = self.modules.index(stop[0].owner)
            tables.slots[watched, loop.WATCH] = 1
            tables.runs_on = [on and j != watched for j, on in enumerate(runs_on)]
        tables.begin(until, _clock_address() if self.timed else 0)
        try:
            with self._interruptible(tables):
                return self._drive(tables, instants, stop)
        finally:
            tables.runs_on = runs_on
            tables.slots[:, loop.WATCH] = 0
            more: list[int] = (tables.checks[:, loop.C_COUNT] - stale_before).tolist()
            for count, port in zip(more, tables.checked, strict=True):
                if count > 0 and port.on_stale == "warn":
                    age = f"older than {text(port.max_age or 0)} at {count} steps"
                    warnings.warn(f"{port}: the message of {port.source} was {age}", StaleWarning, stacklevel=4)

    def _drive(self, tables: Tables, instants: int, stop: Stop | None) -> bool:
        """Run in slices of some milliseconds, so that Ctrl-C is heard."""
        now = tables.now
        size, left, enough = 64, instants, False
        while True:
            begun = now[loop.LEFT] = 0 if enough or self._stop_requested else min(size, left)
            started = time.perf_counter()
            why = self._run_slice(tables)
            left -= begun - now[loop.LEFT]
            if why == loop.WATCHED:
                assert stop is not None
                message = stop[0].latest()
                enough = enough or (message is not None and bool(stop[1](message)))
            elif self._stop_requested:
                self.t_ns = max(self.t_ns, now[loop.INSTANT])
                raise KeyboardInterrupt
            elif why == loop.DONE or enough or left <= 0:
                return why != loop.DONE or enough
            elif time.perf_counter() - started < 0.005:
                size = min(2 * size, 1 << 20)
            else:
                size = max(size // 2, 1)

    def _run_slice(self, tables: Tables) -> int:
        """Run the instants left in the cursor, Python modules included, until the loop says anything else."""
        now, modules, runs_on = tables.now, tables.modules, tables.runs_on
        while True:
            why = tables.run()
            slot, t_ns = now[loop.SLOT], now[loop.INSTANT]
            if why == loop.PYTHON:
                try:
                    if self.timed or tables.objects[slot] or not COMPILE:
                        self._step_watched(tables, slot, t_ns)
                    else:
                        modules[slot].step(t_ns)
                        while runs_on[slot]:
                            slot += 1
                            modules[slot].step(t_ns)
                except BaseException as error:
                    now[loop.SLOT], now[loop.PHASE] = slot, loop.BEFORE
                    if isinstance(error, Exception):
                        raise self._module_error(modules[slot], t_ns, error) from error
                    raise
                now[loop.SLOT] = slot
            elif why == loop.FULL:
                tables.recordings[tables.slots[slot, loop.RECORD] + now[loop.ITEM]].grow()
            elif why == loop.FAILED:
                self._explain(tables, modules[slot], t_ns)
            elif why == loop.STALE:
                port = tables.checked[int(tables.slots[slot, loop.CHECK]) + now[loop.ITEM]]
                now[loop.ITEM] = 0
                age = f"{text(t_ns - (port.t_ns or 0))} old at t = {text(t_ns)}, accepted are {text(port.max_age or 0)}"
                raise StaleError(f"{port}: the message of {port.source} is {age}")
            else:
                return why

    def _step_watched(self, tables: Tables, slot: int, t_ns: int) -> None:
        """Step one module from Python with all that can be asked for: timing, object recordings, plain kernels."""
        module = tables.modules[slot]
        started = time.perf_counter_ns()
        if isinstance(module, KernelModule):
            module.step_uncompiled(t_ns)
        else:
            module.step(t_ns)
        if self.timed:
            tables.slots[slot, [loop.WALL, loop.CALLS]] += time.perf_counter_ns() - started, 1
        for recording in tables.objects[slot]:
            recording.keep_object(t_ns)

    def _module_error(self, module: Module, t_ns: int, error: Exception) -> ModuleError:
        what = f"{type(module).__name__} {module.name!r} failed at t = {text(t_ns)}"
        return ModuleError(f"{what}: {type(error).__name__}: {error}")

    def _explain(self, tables: Tables, module: Module, t_ns: int) -> None:
        """Raise what a failed kernel raised: put back the rows it had written and run it again uncompiled."""
        from fsw.compiler import entry_of

        assert isinstance(module, KernelModule)
        entry_of(type(module)).undo(tables.pointers[module], module.kernel_rows())
        try:
            module.step_uncompiled(t_ns)
        except Exception as error:
            raise self._module_error(module, t_ns, error) from error
        raise self._module_error(module, t_ns, RuntimeError("raised when compiled, but not when run as plain Python"))

    @contextmanager
    def _interruptible(self, tables: Tables) -> Generator[None]:
        """Turn the first Ctrl-C into a request to stop after the instant; a second one interrupts at once."""
        self._stop_requested = False
        ours = threading.current_thread() is threading.main_thread()
        if not ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            yield
            return

        def request(number: int, frame: Any) -> None:
            if self._stop_requested:
                raise KeyboardInterrupt
            self._stop_requested = True
            tables.now[loop.LEFT] = 0

        signal.signal(signal.SIGINT, request)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)

    # --- state of the run -------------------------------------------------------------------------------------------

    def _layout(self) -> tuple[Any, ...]:
        tasks = tuple((t.name, t.period, t.phase) for t in self.tasks)
        return tasks, tuple((m.name, type(m).__qualname__, *(str(r.dtype) for r in m.rows())) for m in self.modules)

    def snapshot(self) -> Snapshot:
        """A copy of everything that a run can change; continuing from it is bit-identical."""
        tables = self._prepare()
        modules = [m.saved() for m in self.modules]
        times = tables.times.copy(), tables.cursor.copy()
        return Snapshot(self.t_ns, self._layout(), self._arena.copy(), *times, modules)

    def restore(self, snapshot: Snapshot) -> None:
        """Go (back) to a snapshot; recordings forget what came after it.

        Raises:
            ValueError: if the snapshot is of a simulation with other tasks, modules or message layouts.
        """
        tables = self._prepare()
        if snapshot.layout != self._layout():
            raise ValueError("the snapshot is of another simulation: tasks, modules or row layouts differ")
        self._arena[:] = snapshot.arena
        tables.times[:], tables.cursor[:] = snapshot.next_ns, snapshot.cursor
        self.t_ns = snapshot.t_ns
        for module, saved in zip(self.modules, snapshot.modules, strict=True):
            module.load(saved)
        for recording in [r for m in self.modules for p in m.outputs for r in p.recordings]:
            recording.truncate(min(snapshot.t_ns, int(snapshot.cursor[loop.INSTANT])))

    def reset(self) -> None:
        """Go back to time zero: parameters, states, messages, random streams and recordings as before the first run."""
        if self._initial is not None:
            self.restore(self._initial)

    def timing(self) -> list[Timing]:
        """Wall time of each task and module since the start, as far as `timed` was set."""
        counted: list[list[int]] = self._prepare().slots[:, [loop.CALLS, loop.WALL]].tolist()
        found: list[Timing] = []
        for task in self.tasks:
            rows = [Timing(task.name, m.name, *counted.pop(0)) for m in task.modules]
            calls, wall = max((r.calls for r in rows), default=0), sum(r.wall_ns for r in rows)
            found += [Timing(task.name, "", calls, wall), *rows]
        return found


def _clock_address() -> int:
    """Address of C's clock_gettime, or 0 where there is none (then only Python modules are timed)."""
    try:
        return ctypes.cast(ctypes.CDLL(None).clock_gettime, ctypes.c_void_p).value or 0
    except (AttributeError, OSError, TypeError):
        return 0
