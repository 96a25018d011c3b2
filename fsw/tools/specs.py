"""Specs that run: the SPEC.md of each module folder is compared with the code, its tests and their results."""

from __future__ import annotations

import ast
import importlib
import inspect
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fsw.files import atomic
from fsw.module import Module
from fsw.ports import In
from messages.base import Field, fields_of

TABLES = {
    "Ports": ("port", "direction", "message", "description"),
    "Parameters": ("parameter", "shape", "unit", "default", "description"),
    "Test description and success criteria": ("id", "criterion", "tolerance", "test"),
    "Measured results": ("id", "measured", "tolerance"),
}
PORTS, PARAMETERS, CRITERIA, RESULTS = TABLES
HEADINGS = ("Purpose", PORTS, PARAMETERS, "Algorithm and equations")
HEADINGS += ("Assumptions, validity range and failure behaviour", CRITERIA, RESULTS, "User guide", "References")
Rows = dict[str, dict[str, str]]
"""A table of a spec: cells by column, by the entry in the first column."""


class Spec:
    """A SPEC.md as read.

    Attributes:
        path: the file. title: class name. sections: text by heading. tables: by heading, for those in `TABLES`.
        problems: what is wrong with the file itself.
    """

    def __init__(self, path: Path) -> None:
        head, *parts = re.split(r"^## +(.*?) *$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
        self.path, self.title = path, head.strip().partition("\n")[0].removeprefix("# ")
        self.sections = dict(zip(parts[::2], parts[1::2], strict=True))
        self.problems = [f"heading '## {h}' is missing" for h in HEADINGS if h not in parts[::2]]
        self.problems += [f"heading '## {h}' is none of a spec" for h in parts[::2] if h not in HEADINGS]
        if not self.problems and parts[::2] != list(HEADINGS):
            self.problems.append(f"headings are not in the order {', '.join(HEADINGS)}")
        self.problems += [f"{h}: nothing written" for h, text in self.sections.items() if not text.strip()]
        self.tables = {h: self._table(h, columns) for h, columns in TABLES.items()}

    def _table(self, heading: str, columns: tuple[str, ...]) -> Rows:
        text = self.sections.get(heading, "").strip()
        lines = [x.strip().strip("|").split("|") for x in text.splitlines() if x.lstrip().startswith("|")]
        cells = [tuple(cell.strip().strip("`") for cell in line) for line in lines]
        if text and text != "none" and (len(cells) < 2 or cells[0] != columns):
            self.problems.append(f"{heading}: expected a table with the columns {', '.join(columns)}, or the word none")
            return {}
        rows: Rows = {}
        for row in cells[2:]:
            if len(row) != len(columns) or "" in row or row[0] in rows:
                wrong = "is there twice" if row[0] in rows else f"needs {len(columns)} filled cells"
                self.problems.append(f"{heading}: row {row[0]!r} {wrong}")
            else:
                rows[row[0]] = dict(zip(columns, row, strict=True))
        return rows

    def faults(self, cls: type[Module], root: Path) -> Iterator[str]:
        """All that differs between this spec, the module class, and the tests in the repository ``root``."""
        yield from self.problems
        ports = {
            name: {"direction": _direction(port), "message": port.kind.__name__} for name, port in cls.ports.items()
        }
        params = {
            f.name: {"shape": str(f.shape or "scalar"), "unit": f.unit, "description": f.description.strip("`")}
            for f in fields_of(cls.Params)
        }
        yield from _differences(PORTS, self.tables[PORTS], ports)
        yield from _differences(PARAMETERS, self.tables[PARAMETERS], params)
        for field in fields_of(cls.Params):
            row, accepted = self.tables[PARAMETERS].get(field.name), _default_texts(field)
            if row and row["default"] not in accepted:
                expected = " or ".join(accepted)
                yield f"{PARAMETERS}: {field.name}: default is {row['default']}, the code says {expected}"
        if not self.tables[CRITERIA]:
            yield f"{CRITERIA}: a module needs one criterion at least"
        for criterion, row in self.tables[CRITERIA].items():
            for text in (_criterion_fault(criterion, row, root), self._result_fault(criterion, row)):
                if text:
                    yield text
        for name in self.tables[RESULTS].keys() - self.tables[CRITERIA].keys():
            yield f"{RESULTS}: {name} is no criterion"

    def _result_fault(self, criterion: str, row: dict[str, str]) -> str | None:
        result = self.tables[RESULTS].get(criterion)
        if result is None or result["measured"] == "-":
            return f"{RESULTS}: {criterion} is not measured; run 'make results'"
        if result["tolerance"] != row["tolerance"]:
            return f"{RESULTS}: {criterion}: tolerance is {result['tolerance']}, the criterion says {row['tolerance']}"
        if not abs(_number(result["measured"])) <= _number(row["tolerance"]):
            return f"{RESULTS}: {criterion}: measured {result['measured']} is not within {row['tolerance']}"
        return None

    def write_results(self, measured: Mapping[str, float]) -> None:
        """Rewrite the table of measured results; what is not in ``measured`` keeps its value."""
        columns, old = TABLES[RESULTS], self.tables[RESULTS]
        lines = [f"| {' | '.join(columns)} |", "|---|---|---|"]
        for name, row in self.tables[CRITERIA].items():
            value = f"{measured[name]:.2g}" if name in measured else old.get(name, {}).get("measured", "-")
            lines.append(f"| {name} | {value} | {row['tolerance']} |")
        prose = "\n".join(
            x for x in self.sections[RESULTS].splitlines() if not x.startswith("|") and x != "none"
        ).strip()
        section = "\n".join([f"## {RESULTS}", "", *lines, *(["", prose] if prose else []), "", ""])
        old_section = rf"(?ms)^## {RESULTS} *\n.*?(?=^## |\Z)"
        text = re.sub(old_section, lambda _: section, self.path.read_text(encoding="utf-8"))
        with atomic(self.path) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _direction(port: Any) -> str:
    return ("in, optional" if port.optional else "in") if isinstance(port, In) else "out"


def _default_texts(field: Field) -> list[str]:
    """How a spec may write the default of a parameter."""
    if field.default is msgspec.NODEFAULT:
        return ["required"]
    if not field.shape:
        return [repr(field.default)]
    named = {"zeros": np.zeros(field.shape), "eye": np.eye(field.shape[0])}
    return [str(field.default.tolist()), *(n for n, array in named.items() if np.array_equal(field.default, array))]


def _differences(table: str, written: Rows, actual: Rows) -> Iterator[str]:
    for name in [*actual, *(n for n in written if n not in actual)]:
        if name not in written or name not in actual:
            yield f"{table}: {name} is {'not in the table' if name in actual else 'in the table, but not in the code'}"
            continue
        for column, value in actual[name].items():
            if written[name][column] != value:
                yield f"{table}: {name}: {column} is {written[name][column]!r}, the code says {value!r}"


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _criterion_fault(criterion: str, row: dict[str, str], root: Path) -> str | None:
    """What is wrong with the id, the tolerance or the test of a criterion; the test has to name the id."""
    where, _, function = row["test"].partition("::")
    if not re.fullmatch(r"[A-Z][A-Z0-9-]*-\d+", criterion):
        return f"{CRITERIA}: {criterion!r} is no id; write one like GYRO-1"
    if not 0 <= _number(row["tolerance"]) < math.inf:
        return f"{CRITERIA}: {criterion}: tolerance {row['tolerance']!r} is not a number"
    if not (root / where).is_file():
        return f"{CRITERIA}: {criterion}: there is no test file {where}"
    for node in ast.walk(ast.parse((root / where).read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and node.name == function.rpartition("::")[2]:
            named = any(isinstance(n, ast.Constant) and n.value == criterion for n in ast.walk(node))
            return None if named else f"{CRITERIA}: {criterion}: the test {row['test']} does not measure it"
    return f"{CRITERIA}: {criterion}: there is no test {row['test']}"


def module_folders(root: Path) -> list[Path]:
    """All module folders of a repository: those under modules/ and sim/ with a module.py or a SPEC.md."""
    tops, files = ("modules", "sim"), ("module.py", "SPEC.md")
    return sorted({path.parent for top in tops for file in files for path in (root / top).rglob(file)})


def class_of(folder: Path, root: Path) -> type[Module]:
    """The module class that a module folder declares and exports.

    Raises:
        LookupError: if it is not exactly one.
    """
    package = importlib.import_module(".".join(folder.relative_to(root).parts))
    found = [x for x in vars(package).values() if inspect.isclass(x) and x.__module__ == f"{package.__name__}.module"]
    classes = [x for x in found if issubclass(x, Module)]
    if len(classes) != 1:
        names = ", ".join(c.__name__ for c in classes) or "none"
        raise LookupError(f"__init__.py must export the one module class of module.py, it exports {names}")
    return classes[0]


def check(root: Path) -> list[str]:
    """All faults of all module folders in a repository, each with its folder."""
    faults: list[str] = []
    owners: dict[str, str] = {}
    for folder in module_folders(root):
        name = folder.relative_to(root).as_posix()
        if missing := [f for f in ("__init__.py", "module.py", "SPEC.md") if not (folder / f).is_file()]:
            faults.append(f"{name}: {', '.join(missing)} missing")
            continue
        try:
            spec, cls = Spec(folder / "SPEC.md"), class_of(folder, root)
        except Exception as error:
            faults.append(f"{name}: {type(error).__name__}: {error}")
            continue
        if spec.title != cls.__name__:
            faults.append(f"{name}: the title is {spec.title!r}, the class {cls.__name__!r}")
        test = root / "tests" / Path(name).parent / f"test_{folder.name}.py"
        if not test.is_file():
            faults.append(f"{name}: its test {test.relative_to(root).as_posix()} is missing")
        taken = [i for i in spec.tables[CRITERIA] if owners.setdefault(i, name) != name]
        faults += [f"{name}: the id {i} belongs to {owners[i]} already" for i in taken]
        faults += [f"{name}: {text}" for text in spec.faults(cls, root)]
    return faults
