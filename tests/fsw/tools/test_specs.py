"""A spec that differs from the code in anything is found out; results are written where they belong."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from fsw import F64, Bound, In, Mat3, Message, Module, Out, Record, Shape, Vec3, eye, zeros
from fsw.tools.specs import HEADINGS, Spec, check


class DemandMsg(Message):
    """What the module reads and writes."""

    torque_B: Annotated[Vec3, "N*m", "torque"]


class Damper(Module):
    """A module with every kind of parameter."""

    class Params(Record):
        K: Annotated[float, "N*m", "gain", Bound(gt=0)] = 3.5
        steps: Annotated[int, "-", "steps"] = 4
        on: Annotated[bool, "-", "whether it works"] = True
        mass: Annotated[float, "kg", "mass"]
        r_BN_N: Annotated[Vec3, "m", "position"] = zeros(3)
        inertia: Annotated[Mat3, "kg*m^2", "`inertia` of the body"] = eye(3)
        weights: Annotated[F64, Shape(2), "-", "weights"] = np.array([0.5, 1e-05])

    in_rate = In(DemandMsg)
    in_bias = In(DemandMsg, optional=True)
    out_torque = Out(DemandMsg)


SPEC = """# Damper

## Purpose

It damps.

## Ports

| port | direction | message | description |
|------|-----------|---------|-------------|
| in_rate | in | DemandMsg | rate |
| `in_bias` | in, optional | `DemandMsg` | bias |
| out_torque | out | DemandMsg | torque |

## Parameters

| parameter | shape | unit | default | description |
|---|---|---|---|---|
| K | scalar | N*m | 3.5 | gain |
| steps | scalar | - | 4 | steps |
| on | scalar | - | True | whether it works |
| mass | scalar | kg | required | mass |
| r_BN_N | (3,) | m | zeros | position |
| inertia | (3, 3) | kg*m^2 | eye | `inertia` of the body |
| weights | (2,) | - | [0.5, 1e-05] | weights |

## Algorithm and equations

None.

## Assumptions, validity range and failure behaviour

None.

## Test description and success criteria

Two.

| id | criterion | tolerance | test |
|---|---|---|---|
| DAMPER-1 | error | 1e-12 | `tests/modules/test_damper.py::test_error` |
| DAMPER-2 | drift | 0.5 | tests/modules/test_damper.py::TestDrift::test_drift |

## Measured results

| id | measured | tolerance |
|---|---|---|
| DAMPER-1 | 2.5e-13 | 1e-12 |
| DAMPER-2 | 0 | 0.5 |

## User guide

None.

## References

None.
"""
TEST = """
def test_error(criterion):
    criterion("DAMPER-1", 0.0)

def test_other(criterion):
    pass

class TestDrift:
    @parametrize("name", ["DAMPER-2"])
    def test_drift(self, criterion, name):
        criterion(name, 0.0)
"""


@pytest.fixture
def root(tmp_path: Path) -> Path:
    (tmp_path / "tests/modules").mkdir(parents=True)
    (tmp_path / "tests/modules/test_damper.py").write_text(TEST, encoding="utf-8")
    return tmp_path


def faults(root: Path, text: str) -> list[str]:
    (root / "SPEC.md").write_text(text, encoding="utf-8")
    return list(Spec(root / "SPEC.md").faults(Damper, root))


def test_a_true_spec_has_no_fault(root: Path) -> None:
    assert faults(root, SPEC) == []


def test_defaults_may_be_written_out(root: Path) -> None:
    text = SPEC.replace("| zeros |", "| [0.0, 0.0, 0.0] |")
    text = text.replace("| eye |", "| [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] |")
    assert faults(root, text) == []


CRITERIA, RESULTS = HEADINGS[5], HEADINGS[6]


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("## Purpose\n\nIt damps.\n\n", "", "heading '## Purpose' is missing"),
        ("## Purpose", "## Aim", "heading '## Aim' is none of a spec"),
        ("It damps.", "", "Purpose: nothing written"),
        ("| in_rate | in | DemandMsg | rate |\n", "", "Ports: in_rate is not in the table"),
        ("| in_rate | in |", "| in_speed | in |", "Ports: in_speed is in the table, but not in the code"),
        ("in, optional", "in", "Ports: in_bias: direction is 'in', the code says 'in, optional'"),
        (
            "| out | DemandMsg",
            "| out | OtherMsg",
            "Ports: out_torque: message is 'OtherMsg', the code says 'DemandMsg'",
        ),
        ("| rate |", "| |", "Ports: row 'in_rate' needs 4 filled cells"),
        ("| rate |", "| rate | too many |", "Ports: row 'in_rate' needs 4 filled cells"),
        ("| in_rate | in |", "| out_torque | in |", "Ports: row 'out_torque' is there twice"),
        ("| port | direction |", "| direction | port |", "Ports: expected a table with the columns port, direction"),
        ("| K | scalar | N*m |", "| K | scalar | Nm |", "Parameters: K: unit is 'Nm', the code says 'N*m'"),
        ("| K | scalar |", "| K | (1,) |", "Parameters: K: shape is '(1,)', the code says 'scalar'"),
        ("| 3.5 | gain |", "| 3.50 | gain |", "Parameters: K: default is 3.50, the code says 3.5"),
        ("| 3.5 | gain |", "| 3.5 | Gain |", "Parameters: K: description is 'Gain', the code says 'gain'"),
        ("| required |", "| 0.0 |", "Parameters: mass: default is 0.0, the code says required"),
        ("| zeros |", "| eye |", "default is eye, the code says [0.0, 0.0, 0.0] or zeros"),
        ("| [0.5, 1e-05] |", "| [0.5, 1e-06] |", "Parameters: weights: default is [0.5, 1e-06]"),
        ("| K | scalar | N*m | 3.5 | gain |\n", "", "Parameters: K is not in the table"),
        ("| DAMPER-1 | error |", "| first | error |", f"{CRITERIA}: 'first' is no id"),
        ("| error | 1e-12 |", "| error | small |", f"{CRITERIA}: DAMPER-1: tolerance 'small' is not a number"),
        ("| error | 1e-12 |", "| error | nan |", f"{CRITERIA}: DAMPER-1: tolerance 'nan' is not a number"),
        ("| error | 1e-12 |", "| error | -1 |", f"{CRITERIA}: DAMPER-1: tolerance '-1' is not a number"),
        ("test_damper.py::test_error", "test_none.py::test_error", "there is no test file tests/modules/test_none.py"),
        ("::test_error", "::test_missing", "there is no test tests/modules/test_damper.py::test_missing"),
        (
            "::test_error",
            "::test_other",
            "DAMPER-1: the test tests/modules/test_damper.py::test_other does not measure",
        ),
        ("| 2.5e-13 |", "| - |", f"{RESULTS}: DAMPER-1 is not measured; run 'make results'"),
        ("| DAMPER-1 | 2.5e-13 | 1e-12 |\n", "", f"{RESULTS}: DAMPER-1 is not measured"),
        ("| DAMPER-2 | 0 |", "| DAMPER-3 | 0 |", f"{RESULTS}: DAMPER-3 is no criterion"),
        ("| 2.5e-13 | 1e-12 |", "| 2.5e-13 | 1e-11 |", f"{RESULTS}: DAMPER-1: tolerance is 1e-11"),
        ("| 2.5e-13 |", "| 2.5e-11 |", f"{RESULTS}: DAMPER-1: measured 2.5e-11 is not within 1e-12"),
        ("| 2.5e-13 |", "| nan |", f"{RESULTS}: DAMPER-1: measured nan is not within 1e-12"),
    ],
)
def test_each_difference_is_found(root: Path, old: str, new: str, fault: str) -> None:
    assert old in SPEC
    found = faults(root, SPEC.replace(old, new, 1))
    assert any(fault in text for text in found), found


def test_order_of_headings_is_checked(root: Path) -> None:
    text = SPEC.replace("## Ports", "## X").replace("## Parameters", "## Ports").replace("## X", "## Parameters")
    assert any("headings are not in the order Purpose, Ports" in f for f in faults(root, text))


def test_all_faults_come_in_one_report(root: Path) -> None:
    text = SPEC.replace("N*m | 3.5", "N | 3.6").replace("| in_rate |", "| in_x |").replace("| 2.5e-13 |", "| - |")
    assert len(faults(root, text)) == 5


def test_a_module_without_a_criterion_is_refused(root: Path) -> None:
    keep = [x for x in SPEC.splitlines() if not x.startswith("| DAMPER")]
    assert faults(root, "\n".join(keep)) == [f"{CRITERIA}: a module needs one criterion at least"]


def test_results_are_written_and_the_rest_stays(root: Path) -> None:
    path = root / "SPEC.md"
    path.write_text(SPEC.replace("| DAMPER-2 | 0 | 0.5 |\n", "\nOn two cores.\n"), encoding="utf-8")
    Spec(path).write_results({"DAMPER-2": 0.1234, "OTHER-1": 1.0})
    written = path.read_text(encoding="utf-8")
    assert "| DAMPER-1 | 2.5e-13 | 1e-12 |\n| DAMPER-2 | 0.12 | 0.5 |\n" in written
    before, after = SPEC.split("## Measured results", maxsplit=1)[0], SPEC[SPEC.index("## User guide") :]
    assert written.startswith(before)
    assert written.endswith(f"\n\nOn two cores.\n\n{after}")
    Spec(path).write_results({})
    assert path.read_text(encoding="utf-8") == written
    assert faults(root, written) == []


def test_folders_that_are_no_modules_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package of a name that is nowhere else stands for the module packages."""
    for name, files in {
        "no_spec": {"__init__.py": "", "module.py": ""},
        "no_module": {"__init__.py": "", "SPEC.md": SPEC},
        "no_class": {"__init__.py": "", "module.py": "", "SPEC.md": SPEC},
        "no_import": {"__init__.py": "import nowhere", "module.py": "", "SPEC.md": SPEC},
        "two_classes": {
            "__init__.py": "from .module import *",
            "module.py": "from fsw import Module\nclass A(Module): ...\nclass B(Module): ...\n",
            "SPEC.md": SPEC,
        },
    }.items():
        for file, text in files.items():
            path = tmp_path / "sim" / "spec_faults" / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    import sim

    monkeypatch.setattr(sim, "__path__", [*sim.__path__, str(tmp_path / "sim")])
    found = check(tmp_path)
    assert len(found) == 5
    assert "sim/spec_faults/no_import: ModuleNotFoundError: No module named 'nowhere'" in found
    assert "sim/spec_faults/no_spec: SPEC.md missing" in found
    assert "sim/spec_faults/no_module: module.py missing" in found
    assert any("no_class" in f and "it exports none" in f for f in found)
    assert any("two_classes" in f and "it exports A, B" in f for f in found)
