"""Run all benchmarks and print one table: ``python -m benchmarks``."""

from __future__ import annotations

import argparse
import importlib.util
import os
import platform
import sys
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from benchmarks import closed_loop, dispatch, earth_tracker, filters, modules, start, vision_disks
from benchmarks.timing import Figure, Line

PARTS = "all", "framework", "truth", "filters", "vision"


class Report(msgspec.Struct, frozen=True):
    """Everything that was measured, and on what."""

    machine: str
    cores: int
    python: str
    lines: list[Line]
    agreement: dict[str, dict[str, float]]
    differences: list[modules.Difference]


def text(figure: Figure | None, unit: str) -> str:
    """Least and median of a figure for people."""
    if figure is None:
        return "-"
    digits = {"s": 2, "µs": 3}.get(unit, 1)
    return f"{figure.least:,.{digits}f} / {figure.median:,.{digits}f}"


def verdict(line: Line) -> str:
    """How a line stands to its bar."""
    if line.passed is None or line.judged is None:
        return line.rule
    reached = f"{text(Figure(line.judged, line.judged), line.unit).split(' / ')[0]} {line.unit}"
    if "times" in line.rule:
        reached = f"{1.0 / line.judged:.1f} times"
    elif "%" in line.rule:
        reached = f"{100.0 * line.judged:.1f} %"
    return f"{line.rule}: {reached}, {'[green]met[/]' if line.passed else '[red]missed[/]'}"


def table(report: Report) -> Table:
    """The result for people."""
    made = Table(title=f"{report.machine}, {report.cores} cores, Python {report.python}; least / median")
    for column in ("", "unit", "ours", "Basilisk 2.12.1", "median ratio", "bar"):
        made.add_column(column, justify="left" if column in ("", "bar") else "right")
    for line in report.lines:
        ratio = f"{line.basilisk.median / line.ours.median:.2f}" if line.basilisk and line.ours else "-"
        own, other = text(line.ours, line.unit), text(line.basilisk, line.unit)
        made.add_row(line.name, line.unit, own, other, ratio, verdict(line))
    return made


def main(arguments: list[str] | None = None) -> int:
    """Run as a program; returns 0 if every bar is met, else 1."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure this framework and Basilisk.")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures to this file too")
    parser.add_argument("--repeats", type=int, default=7, help="how often each is measured (default 7)")
    parser.add_argument("--scale", type=float, default=1.0, help="of the number of ticks; 0.01 for a quick trial")
    parser.add_argument("--no-start", action="store_true", help="leave out the starts, which take most of the time")
    parser.add_argument("--quick", action="store_true", help="as --no-start --repeats 3 --scale 0.1")
    parser.add_argument("--only", choices=PARTS, default="all", help="which part")
    given = parser.parse_args(arguments)
    if given.quick:
        given.no_start, given.repeats, given.scale = True, 3, 0.1
    if given.repeats < 1 or not 0.0 < given.scale <= 100.0:
        parser.error("--repeats must be at least 1 and --scale between 0 and 100")
    basilisk = importlib.util.find_spec("Basilisk") is not None
    console = Console() if sys.stdout.isatty() else Console(width=150)
    if not basilisk:
        console.print("Basilisk is not installed (pip install bsk==2.12.1, or make bench): only this side is measured")
    lines: list[Line] = []
    agreement: dict[str, dict[str, float]] = {}
    differences: list[modules.Difference] = []
    disks: list[tuple[str, dict[str, vision_disks.Result]]] = []
    with console.status("") as status:
        if given.only in ("all", "framework"):
            status.update("dispatch")
            lines += dispatch.measure(given.repeats, given.scale, basilisk=basilisk)
            status.update("closed loop")
            lines += closed_loop.measure(given.repeats, given.scale, basilisk=basilisk)
            if basilisk:
                status.update("do both sides compute the same?")
                point = msgspec.structs.replace(closed_loop.same_case(), j2=0.0)
                agreement = {"with J2": closed_loop.agreement(), "without J2": closed_loop.agreement(case=point)}
        if given.only in ("all", "truth"):
            status.update("spacecraft, environment and sensors")
            lines += modules.measure(given.repeats, given.scale, basilisk=basilisk)
            if basilisk:
                status.update("do both sides compute the same?")
                differences = modules.agreement(min(given.scale, 1.0))
        if given.only in ("all", "filters"):
            status.update("filters")
            lines += filters.measure(given.repeats, given.scale, basilisk=basilisk)
        if given.only in ("all", "vision"):
            status.update("disks in images")
            disks = vision_disks.measure(given.repeats, basilisk_too=vision_disks.installed())
            status.update("landmarks of the Earth")
            if given.scale >= 1.0:
                earth_tracker.main(["--repeats", str(given.repeats)])
        if given.only in ("all", "framework") and not given.no_start:
            status.update("start")
            lines += start.measure(given.repeats, basilisk=basilisk)
    machine, cores = platform.processor() or platform.machine(), os.cpu_count() or 1
    report = Report(machine, cores, platform.python_version(), lines, agreement, differences)
    if lines:
        console.print(table(report))
    if disks:
        console.print(vision_disks.table(disks))
        if given.scale >= 1.0:
            vision_disks.write(disks, f"{machine}, {cores} cores, Python {report.python}")
    if agreement:
        console.print(f"Both sides without noise after {closed_loop.AGREE_TICKS} ticks of 0.1 s, greatest difference:")
    for case, found in agreement.items():
        units = {"r_BN_N": "m", "v_BN_N": "m/s", "pointing_error": "rad (ours)"}
        console.print(f"  {case}: " + ", ".join(f"{n} {v:.2g} {units.get(n, 'MRP')}" for n, v in found.items()))
    if differences:
        console.print("Truth of both sides without noise over an orbit, greatest difference and greatest value:")
    for item in differences:
        console.print(f"  {item.name}: {item.largest:.2g} of {item.size:.3g} {item.unit}")
    if given.json is not None:
        given.json.write_bytes(msgspec.json.format(msgspec.json.encode(report)))
    return 0 if all(line.passed is not False for line in lines) else 1


if __name__ == "__main__":
    sys.exit(main())
