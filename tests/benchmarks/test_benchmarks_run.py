"""The benchmarks run and both sides compute the same; how fast they are is not a matter of tests."""

import importlib.util
import json
from pathlib import Path

import msgspec
import pytest

from benchmarks import closed_loop, dispatch, modules, truth
from benchmarks.__main__ import main, verdict
from benchmarks.timing import Figure, Line, interleaved, slope_figure, slopes
from fsw.math.gravity import J2_EARTH

without_basilisk = pytest.mark.skipif(
    importlib.util.find_spec("Basilisk") is None, reason="Basilisk is only installed by make bench"
)


def test_slope_of_known_costs() -> None:
    assert slopes([107.0, 207.0], [7.0, 7.0], 100) == [1.0, 2.0]


def test_slope_of_least_and_of_medians() -> None:
    assert slope_figure([40.0, 30.0, 60.0], [9.0, 30.0, 10.0], 10) == Figure(2.1, 3.0)


def test_cases_take_turns_and_the_first_round_does_not_count() -> None:
    calls: list[str] = []

    def case(name: str, value: float) -> float:
        calls.append(name)
        return value + len(calls)

    samples = interleaved({"a": lambda: case("a", 0.0), "b": lambda: case("b", 100.0)}, 2)
    assert calls == ["a", "b"] * 3
    assert samples == {"a": [3.0, 5.0], "b": [104.0, 106.0]}


def test_verdict_says_what_was_reached() -> None:
    line = Line("loop", "ns", Figure(1.0, 2.0), Figure(10.0, 20.0), "at least 8 times faster", 0.1, 0.125)
    assert line.passed
    assert verdict(line) == "at least 8 times faster: 10.0 times, [green]met[/]"
    faster = modules.judged("module", Figure(0.5, 0.6), Figure(0.9, 1.0), 0.5)
    assert verdict(faster) == "at least 2 times faster: 1.8 times, [red]missed[/]"
    assert modules.judged("module", Figure(0.5, 0.6), None, 0.5).passed is None
    assert "missed" in verdict(Line("x", "ns", None, None, "at most 14 ns", 15.0, 14.0))
    assert verdict(Line("x", "ns", None, None)) == ""


def test_chain_passes_the_message_to_its_end() -> None:
    sim = dispatch.chain(dispatch.Relay, 5)
    sim.step()
    message = vars(sim.modules[-1])["out_vector"].latest()
    assert message is not None
    assert message.vector.tolist() == [5.0, 0.0, 0.0]


def test_trial_of_this_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(modules, "MANY", 3)
    file = tmp_path / "figures.json"
    expected = {"framework": 9, "truth": 3 + len(truth.KINDS), "filters": 4}
    for part, count in expected.items():
        main(["--repeats", "1", "--scale", "0.001", "--no-start", "--only", part, "--json", str(file)])
        lines = json.loads(file.read_text())["lines"]
        assert len(lines) == count, part
        assert all(line["ours"]["least"] <= line["ours"]["median"] for line in lines)


def test_counterparts_and_comparisons_are_of_kinds_that_exist() -> None:
    assert set(modules.COUNTERPARTS) < set(truth.KINDS)
    assert set(modules.COMPARED) <= set(modules.COUNTERPARTS)


@without_basilisk
@pytest.mark.filterwarnings("default")  # of its libraries, not of ours
def test_truth_of_both_sides_is_the_same() -> None:
    allowed = {"Eclipse": 3e-4, "CssArray, 6 cells": 3e-4}  # Basilisk takes the disks as flat
    for found in modules.agreement(0.12):  # from light into shadow
        size = found.size if found.name not in allowed else allowed[found.name] / 1e-9
        assert found.largest <= 1e-9 * size, found


@without_basilisk
@pytest.mark.filterwarnings("default")  # of its libraries, not of ours
@pytest.mark.parametrize(
    ("j2", "position", "attitude"),
    [
        (0.0, 1e-8, 1e-15),  # the same formulas; position to a few units in the last place of 7e6 m
        (J2_EARTH, 1e-5, 1e-11),  # Basilisk's own J2 term is off by 1e-7 of itself: 1e-9 m/s^2 over 60 s
    ],
)
def test_both_sides_compute_the_same(j2: float, position: float, attitude: float) -> None:
    case = msgspec.structs.replace(closed_loop.same_case(), j2=j2)
    found = closed_loop.agreement(600, case)
    assert found["r_BN_N"] <= position
    assert found["sigma_BN"] <= attitude
    assert found["sigma_BR"] <= attitude
