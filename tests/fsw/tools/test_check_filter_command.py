"""The command ``fsw check-filter``: text, JSON, exit codes, and what it says to wrong arguments."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fsw.tools.cli import main

GOOD = """
import numpy as np


class Good:
    def __init__(self, problem):
        self.problem, self.x, self.P = problem, problem.x0.copy(), problem.P0.copy()

    def predict(self, dt):
        F = self.problem.F(self.x, dt)
        self.x, self.P = self.problem.motion(self.x, dt), F @ self.P @ F.T + self.problem.noise(dt)

    def update(self, z, R, sign=1.0):
        H = self.problem.H(self.x)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        left = np.eye(len(self.x)) - K @ H
        self.x = self.x + sign * K @ (z - self.problem.measure(self.x))
        self.P = left @ self.P @ left.T + K @ R @ K.T


class Bad(Good):
    def update(self, z, R):
        super().update(z, R, -1.0)


number = 3
"""
FAST = ["--runs", "3", "--epochs", "7"]


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "my_filter.py"
    path.write_text(GOOD)
    return str(path)


def test_a_right_filter(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-filter", f"{file}:Good", *FAST]) == 0
    assert capsys.readouterr().out.startswith("Filter check-up: no mistake found")


def test_a_wrong_filter(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-filter", f"{file}:Bad", *FAST]) == 1
    assert "MISTAKE  wrong measurement sign" in capsys.readouterr().out
    assert main(["check-filter", f"{file}:Bad", "--json", *FAST]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["passed"] is False
    assert told["mistakes"][0] == "wrong measurement sign"
    assert {"mistake", "stage", "problem", "figure"} == set(told["findings"][0])


@pytest.mark.parametrize(
    ("named", "text"),
    [
        ("my_filter.py", "expected FILE:NAME"),
        ("nowhere.py:Good", "there is no such file"),
        ("no.such.package:Good", "no module is named no"),
        ("{file}:Absent", "no class or function Absent"),
        ("{file}:number", "no class or function number"),
    ],
)
def test_what_cannot_be_found(file: str, named: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-filter", named.replace("{file}", file)]) == 2
    assert text in capsys.readouterr().err


def test_bad_numbers(file: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-filter", f"{file}:Good", "--runs", "1"]) == 2
    assert "runs >= 2" in capsys.readouterr().err
