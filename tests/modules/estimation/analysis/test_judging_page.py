"""The page about judging filters: its blocks run, and print what it says."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[4] / "docs" / "judging_filters.md"


def test_the_page_runs_and_says_what_comes_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = PAGE.read_text()
    program = tmp_path / "page.py"
    program.write_text("\n".join(re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)))
    runpy.run_path(str(program))
    printed = capsys.readouterr().out
    shown = re.findall(r"^```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert len(shown) == 1
    size = r"[\d.]+(e-\d+)?"  # of rounding, which another processor may do otherwise
    assert re.sub(size, "#", shown[0]) in re.sub(size, "#", printed)
    assert "0.787 sigma" in printed
    for part in (
        "Filter check-up: no mistake found",  # the module of the orbit
        "too small by a factor of 1.96 or there is a bias",
        "): consistent",
        "white",
        "Not observable: 0.71 attitude_x - 0.71 misalignment_x.",
        "Of the two only this is seen: 0.71 attitude_x + 0.71 misalignment_x.",
        "at the bound",
        "0/100 diverged (probability below 2.95% at 95%)",
        "converged at 10.0 s",
    ):
        assert part in printed, f"{part} is not in:\n{printed}"
