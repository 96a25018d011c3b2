"""The scenario as a program."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sim.scenarios.leo_sensors.errors import Compared, Flight
from sim.scenarios.leo_sensors.graph import build
from sim.scenarios.leo_sensors.plots import plot

ORBIT_MIN = 94.6
"""One orbit, minutes."""
OUT = Path("out/leo_sensors")
"""Folder of the pictures unless told otherwise."""
SENSORS = Path(__file__).parents[2] / "sensors"
IN_SPECS = ("gps", "star_tracker", "star_vectors", "magnetometer", "css_array")
"""Modules whose SPEC.md shows the picture of this scenario."""


def table(results: dict[str, Compared]) -> list[str]:
    """Lines for people: rate, samples, root mean square error and what was expected of it."""
    lines = ["sensor          rate [Hz]  samples   rms error    expected  unit"]
    for name, x in results.items():
        size = f"{x.rms:11.4g} {x.expected_rms:11.4g}"
        lines.append(f"{name:14s} {x.rate_hz:10.3g} {len(x.t_min):8d} {size}  {x.error_unit}")
    return [
        *lines,
        "simple_nav: random walks, of which one run may be far from the mean of many",
        "css_array: less than its noise of 0.02, as dark cells cannot read below 0",
    ]


def main(arguments: list[str] | None = None) -> int:
    """Run the scenario; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.leo_sensors",
        description="One orbit at 500 km with all sensors, each against the truth.",
    )
    parser.add_argument(
        "--out", type=Path, default=OUT, metavar="DIR", help=f"folder for one picture a sensor (default {OUT})"
    )
    parser.add_argument("--no-plots", action="store_true", help="print the table only")
    parser.add_argument("--minutes", type=float, default=ORBIT_MIN, help=f"simulated time (default {ORBIT_MIN:g})")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sensors' noise (default 1)")
    parser.add_argument("--figures", action="store_true", help="also save the pictures of the specs, beside the specs")
    given = parser.parse_args(arguments)
    if not 0.1 <= given.minutes <= 10_000.0:
        parser.error(f"--minutes: expected a number between 0.1 and 10000, got {given.minutes:g}")
    if not given.no_plots:
        try:
            given.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            parser.error(f"--out: cannot make the folder {given.out} ({error.strerror}); choose another")

    results = Flight(build(seed=given.seed), given.minutes).compared()
    sys.stdout.write("\n".join(table(results)) + "\n")
    pictures = [(n, given.out / f"{n}.png") for n in results] if not given.no_plots else []
    if given.figures:
        pictures += [(n, SENSORS / n / f"{n}.png") for n in IN_SPECS]
    for name, path in pictures:
        try:
            plot(name, results[name], path)
        except OSError as error:
            sys.stderr.write(f"cannot save {path}: {error.strerror}; choose another folder with --out\n")
            return 1
        sys.stdout.write(f"saved {path}\n")
    return 0
