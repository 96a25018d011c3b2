"""The executive's inner loop: one function over integer tables, the same compiled and in plain Python.

Tables (int64), built by `fsw.simulation`:

    tasks[i]   next instant, slot behind its last (its first while it is disabled), of the period's fraction of a ns:
               sum so far; period, first slot; of the fraction: numerator, denominator
    slots[j]   function address (0: Python), address of its row addresses, first check, first recording, watched,
               wall ns, calls
    checks[k]  row address, greatest age, stop on violation, violations
    records[r] row address, row size, buffer address, capacity, count, last seq, every ns, next due,
               on change, first still to come
    cursor     instant, task or -1, slot or -1, phase, item, new instants left
"""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.native import call, move, peek, table_at

DONE, PYTHON, FAILED, STALE, FULL, WATCHED, PAUSE = range(7)
"""Why `run` returned; the slot is in the cursor."""

WIDTHS = (7, 7, 4, 10)
"""Columns of tasks, slots, checks, records."""

NEXT, LAST, CARRY, PERIOD, FIRST, PART, WHOLE = range(7)
FUNCTION, ROWS, CHECK, RECORD, WATCH, WALL, CALLS = range(7)
C_ROW, C_AGE, C_STOP, C_COUNT = range(4)
R_ROW, R_SIZE, R_BUFFER, R_CAPACITY, R_COUNT, R_SEQ, R_EVERY, R_DUE, R_CHANGE, R_FIRST = range(10)
INSTANT, TASK, SLOT, PHASE, ITEM, LEFT = range(6)
BEFORE, AFTER = range(2)
HEADER = 16
"""Bytes of a row before its payload: t_ns, seq."""


@compiled
def unchanged(a: int, b: int, size: int) -> bool:
    """Whether two rows carry the same payload (rows are multiples of 8 bytes, padding is never written)."""
    for offset in range(HEADER, size, 8):
        if peek(a + offset) != peek(b + offset):
            return False
    return True


def run(control: int, unused: int) -> int:
    """Run up to the time given, at most as many new instants as are left in the cursor, and return why it stopped.

    ``control`` is the address of: time (ns), lengths and addresses of tasks, slots, checks, records, cursor; address of
    ``clock_gettime`` and of a timespec if modules are timed, else 0.
    """
    until, clock, stamp = peek(control), peek(control + 88), peek(control + 96)
    tasks = table_at(peek(control + 48), peek(control + 8), 7)
    slots = table_at(peek(control + 56), peek(control + 16), 7)
    checks = table_at(peek(control + 64), peek(control + 24), 4)
    records = table_at(peek(control + 72), peek(control + 32), 10)
    cursor = table_at(peek(control + 80), 1, 6)[0]
    while True:
        if cursor[TASK] < 0:
            t = tasks[0, NEXT]
            for i in range(1, tasks.shape[0]):
                t = min(t, tasks[i, NEXT])
            if t > until:
                return DONE
            if cursor[LEFT] <= 0:
                return PAUSE
            cursor[LEFT] -= 1
            cursor[INSTANT] = t
            cursor[TASK] = 0
            cursor[SLOT] = -1
        t = cursor[INSTANT]
        while cursor[TASK] < tasks.shape[0]:
            task = cursor[TASK]
            if tasks[task, NEXT] == t:
                if cursor[SLOT] < 0:
                    cursor[SLOT] = tasks[task, FIRST]
                while cursor[SLOT] < tasks[task, LAST]:
                    slot = cursor[SLOT]
                    if cursor[PHASE] == BEFORE:
                        for k in range(slots[slot, CHECK] + cursor[ITEM], slots[slot + 1, CHECK]):
                            row = checks[k, C_ROW]
                            if peek(row + 8) > 0 and t - peek(row) > checks[k, C_AGE]:
                                checks[k, C_COUNT] += 1
                                if checks[k, C_STOP] != 0:
                                    cursor[ITEM] = k - slots[slot, CHECK]
                                    return STALE
                        cursor[ITEM] = 0
                        cursor[PHASE] = AFTER
                        if slots[slot, FUNCTION] == 0:
                            return PYTHON
                        if clock == 0:
                            if call(slots[slot, FUNCTION], t, slots[slot, ROWS]) != 0:
                                cursor[PHASE] = BEFORE
                                return FAILED
                        else:
                            call(clock, 1, stamp)
                            started = peek(stamp) * 1_000_000_000 + peek(stamp + 8)
                            if call(slots[slot, FUNCTION], t, slots[slot, ROWS]) != 0:
                                cursor[PHASE] = BEFORE
                                return FAILED
                            call(clock, 1, stamp)
                            slots[slot, WALL] += peek(stamp) * 1_000_000_000 + peek(stamp + 8) - started
                            slots[slot, CALLS] += 1
                    for r in range(slots[slot, RECORD] + cursor[ITEM], slots[slot + 1, RECORD]):
                        row = records[r, R_ROW]
                        seq = peek(row + 8)
                        if seq != records[r, R_SEQ] and t >= records[r, R_DUE]:
                            size = records[r, R_SIZE]
                            count = records[r, R_COUNT]
                            end = records[r, R_BUFFER] + count * size
                            fresh = records[r, R_CHANGE] == 0 or records[r, R_FIRST] != 0
                            if fresh or not unchanged(row, end - size, size):
                                if count == records[r, R_CAPACITY]:
                                    cursor[ITEM] = r - slots[slot, RECORD]
                                    return FULL
                                move(end, row, size)
                                records[r, R_COUNT] = count + 1
                                records[r, R_FIRST] = 0
                            records[r, R_SEQ] = seq
                            if records[r, R_EVERY] > 0:
                                records[r, R_DUE] = (t // records[r, R_EVERY] + 1) * records[r, R_EVERY]
                    cursor[ITEM] = 0
                    cursor[PHASE] = BEFORE
                    cursor[SLOT] = slot + 1
                    if slots[slot, WATCH] != 0:
                        return WATCHED
                tasks[task, NEXT] += tasks[task, PERIOD]
                tasks[task, CARRY] += tasks[task, PART]
                if tasks[task, CARRY] >= tasks[task, WHOLE]:
                    tasks[task, CARRY] -= tasks[task, WHOLE]
                    tasks[task, NEXT] += 1
            cursor[TASK] = task + 1
            cursor[SLOT] = -1
        cursor[TASK] = -1
