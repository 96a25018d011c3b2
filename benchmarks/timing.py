"""Fair measuring: all cases take turns, so that a busy moment of the machine meets each of them alike.

Both sides compute in one thread at a time and never wait, so the processor time of the process (not of the thread:
Basilisk starts one of its own) is what a quiet machine would show as wall time.
"""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Mapping, Sequence

import msgspec


class Figure(msgspec.Struct, frozen=True):
    """Least and median of repeated measurements, in the unit of the line they stand in."""

    least: float
    median: float


class Line(msgspec.Struct, frozen=True):
    """One line of the result: what was measured, on both sides, and whether it meets its bar.

    ``bar`` is the greatest value accepted of ``judged``, which is the figure of ours or the ratio that ``rule`` names.
    """

    name: str
    unit: str
    ours: Figure | None
    basilisk: Figure | None
    rule: str = ""
    judged: float | None = None
    bar: float | None = None

    @property
    def passed(self) -> bool | None:
        """Whether the bar is met; None if there is no bar or nothing was measured."""
        return None if self.bar is None or self.judged is None else self.judged <= self.bar


def figure(samples: Sequence[float]) -> Figure:
    """Summary of some measurements."""
    return Figure(min(samples), statistics.median(samples))


def interleaved(cases: Mapping[str, Callable[[], float]], repeats: int) -> dict[str, list[float]]:
    """Run every case ``repeats`` times, in turns, after one round that does not count.

    Args:
        cases: functions that run once and return what they measured, by name. repeats: how often each counts.

    Returns:
        The measurements by name, in order.
    """
    samples: dict[str, list[float]] = {name: [] for name in cases}
    for turn in range(repeats + 1):
        for name, case in cases.items():
            gc.collect()
            measured = case()
            if turn:
                samples[name].append(measured)
    return samples


def timed(run: Callable[[int], object], ticks: int) -> float:
    """Processor time of the process for each of ``ticks`` ticks, ns; ``run`` advances by the number it is given."""
    started = time.process_time_ns()
    run(ticks)
    return (time.process_time_ns() - started) / ticks


def slope_figure(many: Sequence[float], few: Sequence[float], difference: int) -> Figure:
    """Cost of one more unit from the least and from the medians of both, not of their differences, which can be less.

    For units so cheap that the noise of the rest hides them: the least of differences would pick the noise.
    """
    a, b = figure(many), figure(few)
    return Figure((a.least - b.least) / difference, (a.median - b.median) / difference)


def slopes(many: Sequence[float], few: Sequence[float], difference: int) -> list[float]:
    """Cost of one more unit from measurements with many and with few of them, which differ by ``difference`` units."""
    return [(a - b) / difference for a, b in zip(many, few, strict=True)]
