"""The integer tables that the executive's loop works on, made from tasks, wires and recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from fsw import loop
from fsw.math.compiled import COMPILE
from fsw.module import KernelModule, Module
from fsw.ports import InPort
from fsw.recorder import Recording
from messages.base import I64, ObjectMessage

if TYPE_CHECKING:
    from fsw.simulation import Task


class Tables:
    """The tables of `fsw.loop` (tasks, slots, checks, records, cursor) and what their rows stand for.

    Args:
        tasks: of the simulation, in order. old: the tables before a change of wires; times and counts go on from there.

    Attributes:
        now: the cursor for reading and writing single numbers fast.
        modules: of each slot. checked: input of each check. recordings: of each record.
        objects: recordings of object ports, for each slot.
        runs_on: for each slot, whether it and the next are Python modules with nothing for the loop to do between.
        pointers: of each kernel module, what its compiled function takes.
    """

    def __init__(self, tasks: Sequence[Task], old: Tables | None = None) -> None:
        self.modules: list[Module] = [m for t in tasks for m in t.modules]
        n = len(self.modules)
        ends = np.cumsum([0] + [len(t.modules) for t in tasks])
        timed = [(t, Fraction(t.period), i) for i, t in enumerate(tasks)]
        begins = [(t.phase, ends[i + 1], 0, p // 1, ends[i]) for t, p, i in timed]
        rows = [(*b, p.numerator % p.denominator, p.denominator) for b, (_, p, _) in zip(begins, timed, strict=True)]
        self.tasks: I64 = np.array(rows, np.int64)
        self.slots: I64 = np.zeros((n + 1, loop.WIDTHS[1]), np.int64)
        self.cursor: I64 = np.array([-1, -1, -1, loop.BEFORE, 0, 0], np.int64)
        if old is not None:
            self.cursor = old.cursor
            self.times[:] = old.times
            self.slots[:, [loop.WALL, loop.CALLS]] = old.slots[:, [loop.WALL, loop.CALLS]]
        self.now = memoryview(cast(Any, self.cursor))
        self.checked: list[InPort[Any]] = []
        self.recordings: list[Recording[Any]] = []
        self.objects: list[list[Recording[Any]]] = []
        self.pointers: dict[Module, I64] = {}
        checks: list[list[int]] = []
        if COMPILE:
            from fsw.compiler import compile_all

            compile_all(dict.fromkeys(type(m) for m in self.modules if isinstance(m, KernelModule)))
        for slot, module in zip(self.slots, self.modules, strict=False):
            slot[[loop.CHECK, loop.RECORD]] = len(checks), len(self.recordings)
            for port in module.inputs:
                if port.max_age is not None and port.source is not None:
                    checks.append([port.source.row.ctypes.data, port.max_age, port.on_stale == "error", 0])
                    self.checked.append(port)
            kept = [r for out in module.outputs for r in out.recordings]
            self.objects.append([r for r in kept if issubclass(r.port.kind, ObjectMessage)])
            self.recordings += [r for r in kept if not issubclass(r.port.kind, ObjectMessage)]
            if COMPILE and isinstance(module, KernelModule):
                slot[[loop.FUNCTION, loop.ROWS]] = self._function(module)
        self.slots[n, [loop.CHECK, loop.RECORD]] = len(checks), len(self.recordings)
        self.checks: I64 = np.array(checks, np.int64).reshape(-1, loop.WIDTHS[2])
        self.records: I64 = np.zeros((len(self.recordings), loop.WIDTHS[3]), np.int64)
        for entry, recording in zip(self.records, self.recordings, strict=True):
            recording.attach(entry)
        python = self.slots[:-1, loop.FUNCTION] == 0
        quiet = (np.diff(self.slots[:, loop.RECORD]) == 0) & np.array([not o for o in self.objects])
        free = python & (np.diff(self.slots[:, loop.CHECK]) == 0) & ~np.isin(np.arange(n), ends)
        self.runs_on: list[bool] = [*(python & quiet)[:-1] & free[1:], False]
        self._prepare_call()

    @property
    def times(self) -> I64:
        """View of what a run changes in `tasks`: next instants, ends of slots, sums of fractions, (n, 3)."""
        return self.tasks[:, : loop.PERIOD]

    def _function(self, module: KernelModule) -> tuple[int, int]:
        from fsw.compiler import entry_of

        entry = entry_of(type(module))
        self.pointers[module] = pointers = entry.pointers(module.kernel_rows())
        return entry.address, pointers.ctypes.data

    def _prepare_call(self) -> None:
        tables: list[NDArray[Any]] = [self.tasks, self.slots, self.checks, self.records, self.cursor]
        self._stamp = np.zeros(2, np.int64)
        lengths, addresses = [len(t) for t in tables], [t.ctypes.data for t in tables]
        self._control = np.array([0, *lengths, *addresses, 0, self._stamp.ctypes.data], np.int64)
        self._address: int = self._control.ctypes.data
        self._call: Callable[[int, int], int] = loop.run
        if COMPILE:
            from fsw.compiler import loop_entry

            self._call = loop_entry().function

    def begin(self, until: int, clock: int) -> None:
        """Set how far to run, ns, and the address of the clock that times modules, 0 for none."""
        self._control[[0, 11]] = until, clock

    def run(self) -> int:
        """Call the loop; returns why it stopped, see `fsw.loop`."""
        return self._call(self._address, 0)
