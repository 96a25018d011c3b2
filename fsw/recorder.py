"""Recordings: what a port carried, kept by the executive in growing buffers, read as numpy arrays, saved to disk."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from fsw import loop
from fsw.files import atomic
from messages.base import Message, ObjectMessage, json_schema

if TYPE_CHECKING:
    from fsw.ports import OutPort

M = TypeVar("M", bound="Message | ObjectMessage")
_FIRST_BYTES, _LARGEST_BYTES = 1 << 16, 1 << 24


class Recording(Generic[M]):
    """The recorded messages of one port; made by `OutPort.record`.

    What the port holds when its owner's step ends is recorded, if it was written in that step.
    """

    def __init__(self, port: OutPort[M], *, every: int | None, on_change: bool) -> None:
        if every is not None and every <= 0:
            raise ValueError(f"recording of {port}: every must be positive (ns), got {every}")
        self.port, self.every, self.on_change = port, every or 0, on_change
        self.size = port.row.dtype.itemsize
        self.entry: NDArray[np.int64] = np.zeros(loop.WIDTHS[3], np.int64)
        self._chunks: list[NDArray[Any]] = []  # row 0 of each repeats the last row of the one before
        self._spare: list[NDArray[Any]] = []
        self._objects: list[tuple[NDArray[Any], M]] = []
        self._resume()

    def _resume(self) -> None:
        """Bookkeeping for what comes after the rows there are."""
        last, entry = self.last_row, self.entry
        entry[[loop.R_SIZE, loop.R_SEQ]] = self.size, self.port.seq
        entry[[loop.R_EVERY, loop.R_CHANGE]] = self.every, self.on_change
        entry[loop.R_DUE] = 0 if last is None else self._next_due(int(last["t_ns"][0]))
        entry[loop.R_FIRST] = last is None

    def _next_due(self, t_ns: int) -> int:
        return (t_ns // self.every + 1) * self.every if self.every else 0

    def attach(self, entry: NDArray[np.int64]) -> None:
        """Move the bookkeeping into a row of the executive's table."""
        entry[:] = self.entry
        entry[loop.R_ROW] = self.port.row.ctypes.data
        self.entry = entry

    def grow(self) -> None:
        """Start a new chunk: one that was used before, or one twice as large as the last."""
        last = self.last_row
        largest = self._chunks[-1].nbytes if self._chunks else _FIRST_BYTES // 2
        rows = min(2 * largest, _LARGEST_BYTES) // self.size + 2
        chunk = self._spare.pop() if self._spare else np.empty(rows, self.port.row.dtype)
        if last is not None:
            chunk[0] = last[0]
        self._chunks.append(chunk)
        self._fill(0)

    def _fill(self, count: int) -> None:
        """Let the executive write on behind the first ``count`` rows of the last chunk."""
        chunk, columns = self._chunks[-1], [loop.R_BUFFER, loop.R_CAPACITY, loop.R_COUNT]
        self.entry[columns] = chunk.ctypes.data + self.size, len(chunk) - 1, count

    def keep_object(self, t_ns: int) -> None:
        """Record an object port, as the executive does with rows."""
        entry, held = self.entry, self.port.held()
        if held is None or entry[loop.R_SEQ] == self.port.seq or t_ns < entry[loop.R_DUE]:
            return
        entry[loop.R_SEQ], entry[loop.R_DUE] = self.port.seq, self._next_due(t_ns)
        if not (self.on_change and self._objects and self._objects[-1][1] is held):
            self._objects.append((self.port.row.copy(), held))

    def truncate(self, t_ns: int) -> None:
        """Forget everything written after ``t_ns``, or all with -1; its memory is used again."""
        left = int(np.searchsorted(self.t_ns, t_ns, side="right"))
        self._objects = self._objects[:left]
        while self._chunks and left <= len(self) - self.count:
            self._spare.append(self._chunks.pop())
            self.entry[[loop.R_CAPACITY, loop.R_COUNT]] = 0
            if self._chunks:
                self._fill(len(self._chunks[-1]) - 1)
        if self._chunks:
            self._fill(left - len(self) + self.count)
        self._resume()

    @property
    def count(self) -> int:
        """Rows in the newest chunk."""
        return int(self.entry[loop.R_COUNT])

    def rows(self) -> NDArray[Any]:
        """All rows as one structured array, header included."""
        parts = [row for row, _ in self._objects] + [c[1:] for c in self._chunks[:-1]]
        parts += [c[1 : self.count + 1] for c in self._chunks[-1:]]
        return np.concatenate([np.zeros(0, self.port.row.dtype), *parts])

    @property
    def last_row(self) -> NDArray[Any] | None:
        """The newest row as an array of one, or None."""
        if self._objects:
            return self._objects[-1][0]
        return self._chunks[-1][self.count : self.count + 1] if len(self) else None

    @property
    def t_ns(self) -> NDArray[np.int64]:
        """Times at which the messages were written, (n,) ns."""
        return self.rows()["t_ns"]

    @property
    def t_s(self) -> NDArray[np.float64]:
        """Times at which the messages were written, (n,) s."""
        return np.asarray(self.t_ns * 1e-9, np.float64)

    @property
    def objects(self) -> list[M]:
        """The recorded messages of an object port."""
        return [held for _, held in self._objects]

    def __getitem__(self, field: str) -> NDArray[Any]:
        """All values of a field, (n, *shape of the field)."""
        if issubclass(self.port.kind, ObjectMessage):
            return np.array([getattr(o, field) for o in self.objects], dtype=object)
        names = [n for n in self.port.row.dtype.names or () if n not in ("t_ns", "seq")]
        if field not in names:
            raise KeyError(f"{self.port} has no field {field!r}; it has {', '.join(names)}")
        return self.rows()[field]

    def __len__(self) -> int:
        return len(self._objects) + sum(len(c) - 1 for c in self._chunks[:-1]) + self.count

    def __repr__(self) -> str:
        return f"Recording({self.port}, {len(self)} rows)"


def _save_npz(path: Path, recordings: Sequence[Recording[Any]]) -> None:
    arrays = {repr(r.port): r.rows() for r in recordings}
    schema = {repr(r.port): json_schema(r.port.kind) for r in recordings}
    np.savez_compressed(path, schema=np.array(json.dumps(schema)), allow_pickle=False, **arrays)


_WRITERS: dict[str, Callable[[Path, Sequence[Recording[Any]]], None]] = {".npz": _save_npz}


def save(path: Path | str, recordings: Sequence[Recording[Any]]) -> None:
    """Save recordings in the format of the path's suffix (now: ``.npz``); nothing is left behind if it fails.

    Raises:
        ValueError: if the format is unknown, or a recording is of an object port, which no format here can hold.
        OSError: if the file cannot be written.
    """
    writer = _WRITERS.get(Path(path).suffix)
    if writer is None:
        raise ValueError(f"cannot save {path}: formats are {', '.join(_WRITERS)}")
    for r in recordings:
        if issubclass(r.port.kind, ObjectMessage):
            raise ValueError(f"cannot save {r.port}: {r.port.kind.__name__} is an object message; save its parts")
    with atomic(path) as temporary:
        writer(temporary, recordings)


def load(path: Path | str) -> dict[str, NDArray[Any]]:
    """Read what `save` wrote: one structured array for every port, named ``module.port``.

    Raises:
        ValueError: if the file is damaged or not of this kind.
    """
    with Path(path).open("rb") as file:
        try:
            archive = np.load(file, allow_pickle=False)
            return {name: archive[name] for name in archive.files if name != "schema"}
        except Exception as error:
            raise ValueError(f"{path} is damaged or no recording: {error}") from error
