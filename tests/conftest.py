"""The fixture `criterion`: tests measure what a spec promises, and ``--write-results`` writes it back into the spec."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fsw.tools.specs import CRITERIA, Spec, module_folders

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-results", action="store_true", help="write measured results into the SPEC.md files")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(Results(config), "measured-results")


class Results:
    """Collects in the main process what tests have measured, in all workers."""

    def __init__(self, config: pytest.Config) -> None:
        self.config = config
        self.measured: dict[str, float] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.passed:
            for key, noted in report.user_properties:
                if key == "criterion":
                    name, value = noted  # pyright: ignore[reportGeneralTypeIssues]
                    self.measured[name] = max(value, self.measured.get(name, 0.0))

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if not self.config.getoption("--write-results"):
            return
        specs = read_specs().values()
        for spec in specs:
            noted = {n: v for n, v in self.measured.items() if n in spec.tables[CRITERIA]}
            if noted:
                spec.write_results(noted)
                terminalreporter.write_line(f"wrote {len(noted)} results to {spec.path.relative_to(ROOT)}")
        missing = [n for spec in specs for n in spec.tables[CRITERIA] if n not in self.measured]
        if missing:
            terminalreporter.write_line(f"not measured in this run: {', '.join(missing)}")


def read_specs() -> dict[Path, Spec]:
    """The specs of all module folders that have one, by path."""
    paths = [folder / "SPEC.md" for folder in module_folders(ROOT)]
    return {p: Spec(p) for p in paths if p.is_file()}


@pytest.fixture(scope="session")
def criteria() -> dict[str, dict[str, str]]:
    """The rows of all tables of success criteria, by id."""
    return {name: row for spec in read_specs().values() for name, row in spec.tables[CRITERIA].items()}


@pytest.fixture
def criterion(request: pytest.FixtureRequest, criteria: dict[str, dict[str, str]]) -> Callable[[str, float], None]:
    """``criterion("GYRO-1", error)``: the absolute error is within the tolerance that the spec states; it is noted."""

    def measure(name: str, measured: float) -> None:
        assert name in criteria, f"no SPEC.md has a criterion {name}"
        row, here = criteria[name], request.node.nodeid.partition("[")[0]
        assert row["test"] == here, f"{name} is to be measured by {row['test']}, not by {here}"
        value, tolerance = abs(float(measured)), float(row["tolerance"])
        assert value <= tolerance, f"{name}: {row['criterion']}: measured {value:.3g}, tolerance {tolerance:g}"
        request.node.user_properties.append(("criterion", (name, value)))

    return measure
