"""The fixture `criterion`: what passes, what fails, and what is written back into a spec."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEST = "tests/test_damper.py::test_"
SPEC = f"""# Damper

## Test description and success criteria

| id | criterion | tolerance | test |
|---|---|---|---|
| D-1 | largest of several | 0.5 | {TEST}several |
| D-2 | above | 0.5 | {TEST}above |
| D-3 | not a number | 0.5 | {TEST}nan |
| D-4 | of another test | 0.5 | {TEST}other |
| D-5 | fails later | 0.5 | {TEST}later |

## Measured results

| id | measured | tolerance |
|---|---|---|
| D-1 | - | 0.5 |
| D-2 | 0.1 | 0.5 |

## User guide
"""
TESTS = """
import pytest

@pytest.mark.parametrize("value", [0.1, -0.25, 0.0])
def test_several(criterion, value):
    criterion("D-1", value)

def test_above(criterion):
    criterion("D-2", -0.5001)

def test_nan(criterion):
    criterion("D-3", float("nan"))

def test_wrong(criterion):
    criterion("D-4", 0.0)

def test_later(criterion):
    criterion("D-5", 0.0)
    raise RuntimeError

def test_unknown(criterion):
    criterion("D-6", 0.0)
"""


@pytest.mark.parametrize("workers", ["0", "1"])
def test_measured_values_are_judged_and_written(tmp_path: Path, workers: str) -> None:
    for name in ("fsw", "messages"):
        (tmp_path / name).symlink_to(ROOT / name)
    spec, test = tmp_path / "sim/damper/SPEC.md", tmp_path / "tests/test_damper.py"
    for path, text in ((spec, SPEC), (test, TESTS), (tmp_path / "pytest.ini", "[pytest]")):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "tests/conftest.py", tmp_path / "tests")
    command = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider", "-n", workers]
    done = subprocess.run([*command, "--write-results"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "5 failed, 3 passed" in done.stdout, done.stdout + done.stderr
    for sentence in (
        "D-2: above: measured 0.5, tolerance 0.5",
        "D-3: not a number: measured nan, tolerance 0.5",
        f"D-4 is to be measured by {TEST}other, not by {TEST}wrong",
        "no SPEC.md has a criterion D-6",
        "wrote 1 results to sim/damper/SPEC.md",
        "not measured in this run: D-2, D-3, D-4, D-5",
    ):
        assert sentence in done.stdout
    rows = ["| D-1 | 0.25 | 0.5 |", "| D-2 | 0.1 | 0.5 |", *(f"| D-{i} | - | 0.5 |" for i in (3, 4, 5))]
    head = "## Measured results\n\n| id | measured | tolerance |\n|---|---|---|\n"
    assert spec.read_text(encoding="utf-8").endswith(head + "\n".join(rows) + "\n\n## User guide\n")
