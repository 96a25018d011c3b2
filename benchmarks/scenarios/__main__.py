"""Run the scenarios of the mission and write their page: ``python -m benchmarks.scenarios``."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from benchmarks.scenarios import disk, fusion, images, pose, propagation, short_arc
from benchmarks.scenarios.result import Scenario, section
from fsw.files import atomic

PAGE = Path(__file__).parents[2] / "docs" / "scenarios.md"
HEAD = """# Every filter in every scenario

Made by `python -m benchmarks.scenarios`; not to be edited. Each scenario runs all filters on the same truth and the
same measurements, many times with new errors of start, sensors and images.

*Position*, *attitude*: root mean square error of three axes over the second half of the arc. *Bound*: posterior
Cramer-Rao bound at the true trajectory (`modules.estimation.analysis`). *Ratio*: the first over the second; 1 is the
best that can be. *NEES*: normalised square error at the end of the arc, with the band in which the mean of an honest
filter lies in 95 of 100 such studies. *Diverged*: runs that end more than five times the bound off, or 10 km and
1 degree, with the upper bound of their probability at 95 %. *Settled*: time from which the error stays below twice the
bound. *ms*: processor time for each image, with all that is between the images. Our filters are in **bold**.
"""


def jobs(runs: int) -> dict[str, list[Callable[[], list[Scenario]]]]:
    """What there is to do, by scenario."""
    made: dict[str, list[Callable[[], list[Scenario]]]] = {}
    for case in pose.CASES:
        made.setdefault(case.name, []).append(partial(pose.study, case, runs))
    made["EKF"] = [partial(fusion.study, runs)]
    made["S12"] = [partial(disk.study, offset, max(2, runs // 20)) for offset in disk.OFFSETS_DEG]
    made["S13"] = [partial(short_arc.study, 10 * runs)]
    made["S9"] = [images.seasons]
    made["S14"] = [partial(images.cold, max(3, runs // 10))]
    made["S15"] = [propagation.study]
    return dict(sorted(made.items(), key=lambda pair: (pair[0][0] != "S", len(pair[0]), pair[0])))


def _run(job: Callable[[], list[Scenario]]) -> list[Scenario]:
    return job()


def main(arguments: list[str] | None = None) -> int:
    """Run, show and write."""
    known = list(jobs(2))
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.scenarios",
        description="Run every filter in the scenarios of the mission, against the Cramer-Rao bound; write a page.",
        epilog="With --only the page goes to standard output alone unless -o is given.",
    )
    parser.add_argument("--runs", type=int, default=100, help="runs of each scenario (default 100; S12 a twentieth)")
    parser.add_argument("--only", nargs="+", choices=known, metavar="S", help=f"some of {', '.join(known)}")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="page (default docs/scenarios.md)")
    given = parser.parse_args(arguments)
    if given.runs < 2 or given.jobs < 1:
        parser.error("--runs must be at least 2, --jobs at least 1")
    chosen = [job for name, work in jobs(given.runs).items() if not given.only or name in given.only for job in work]
    parts: list[str] = []
    started = time.monotonic()
    with ProcessPoolExecutor(given.jobs) as pool:
        for k, scenarios in enumerate(pool.map(_run, chosen)):
            for scenario in scenarios:
                parts.append(section(scenario))
                sys.stdout.write(parts[-1] + "\n")
            sys.stderr.write(f"{k + 1} of {len(chosen)} done after {time.monotonic() - started:.0f} s\n")
            sys.stdout.flush()
    fewer = "S12 a twentieth, S13 ten times, the long S10 a tenth, the source's filter a few"
    page = f"{HEAD}\nRuns of each scenario: {given.runs} ({fewer}).\n\n" + "\n".join(parts)
    output = given.output if given.output or given.only else PAGE
    if output:
        with atomic(output) as file:
            file.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
