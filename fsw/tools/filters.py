"""``fsw check-filter``: a check-up of a filter that names the usual mistakes."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

ANALYSIS = "modules.estimation.analysis"
"""Loaded by name when the command runs: the framework does not import flight code."""
EXAMPLE = f"check-filter {ANALYSIS}:ExtendedFilter"


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    made.description = (
        "Find the usual mistakes in a filter: variance given as sigma, transposed noise\n"
        "factor, sigma points not redrawn, wrong sign, double use of data, and more. The\n"
        "filter is a class or function in your file that makes one for a problem; the page\n"
        "docs/judging_filters.md shows one. The exit code is 1 if a mistake was found."
    )
    made.add_argument("filter", metavar="FILE:NAME", help="my_filter.py:MyFilter, or a module: package.module:MyFilter")
    made.add_argument("--json", action="store_true", help="print JSON")
    made.add_argument("--seed", type=int, default=0, metavar="N", help="of the random numbers; default: 0")
    made.add_argument("--runs", type=int, default=40, metavar="N", help="runs of each problem; default: 40")
    made.add_argument("--epochs", type=int, default=25, metavar="N", help="of each run; default: 25")
    made.add_argument(
        "--false-alarm",
        type=float,
        default=1e-4,
        metavar="P",
        help="probability that a right filter is called wrong; default: 1e-4",
    )


def load(text: str) -> Any:
    """What FILE:NAME or MODULE:NAME names.

    Raises:
        ValueError: if there is no such thing.
    """
    where, colon, name = text.rpartition(":")
    if not colon or not where or not name:
        raise ValueError(f"{text}: expected FILE:NAME, such as my_filter.py:MyFilter")
    if where.endswith(".py"):
        path = Path(where)
        if not path.is_file():
            raise ValueError(f"{where}: there is no such file")
        spec = importlib.util.spec_from_file_location(f"filter_{path.stem}", path)
        assert spec is not None and spec.loader is not None
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    else:
        try:
            module = importlib.import_module(where)
        except ModuleNotFoundError as error:
            raise ValueError(f"{where}: no module is named {error.name}; give a file or a module") from None
    if not callable(getattr(module, name, None)):
        raise ValueError(f"{where} has no class or function {name}; it must make a filter for a problem")
    return getattr(module, name)


def run(args: argparse.Namespace) -> int:
    """Examine a filter; 1 if a mistake was found."""
    factory = load(args.filter)
    analysis: Any = importlib.import_module(ANALYSIS)
    report = analysis.check_up(
        factory, seed=args.seed, runs=args.runs, epochs=args.epochs, false_alarm=args.false_alarm
    )
    text = str(report)
    if args.json:
        findings: list[Any] = [vars(f) for f in report.findings]
        text = json.dumps({"passed": report.passed, "mistakes": report.mistakes, "findings": findings}, indent=2)
    sys.stdout.write(text + "\n")
    return 0 if report.passed else 1
