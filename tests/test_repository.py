"""The rules that hold for the whole repository: layers, sizes, licences, and that it stands alone."""

import ast
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("messages", "fsw", "modules", "sim")
MAY_IMPORT = {
    "messages": {"messages"},
    "fsw": {"messages", "fsw"},
    "modules": {"messages", "fsw", "modules"},
    "sim": {"messages", "fsw", "sim"},
    "sim/scenarios": {"messages", "fsw", "sim", "modules"},
    "benchmarks": {"messages", "fsw", "sim", "modules", "benchmarks"},
}


@cache
def files() -> list[Path]:
    """Every file of the repository, without what programs leave behind."""
    folders = (*PACKAGES, "tests", "docs", "benchmarks", ".ci")
    inside = [p for folder in folders for p in (ROOT / folder).rglob("*") if "__pycache__" not in p.parts]
    return [p for p in (*ROOT.iterdir(), *inside) if p.is_file()]


def sources() -> list[Path]:
    return [p for p in files() if p.suffix == ".py"]


def name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def imported(path: Path) -> set[str]:
    """Top-level packages of ours that a file imports, at any depth of its code."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add((node.module or "").split(".")[0] if node.level == 0 else name(path).split("/")[0])
    return found & {*PACKAGES, "benchmarks", "tests"}


def layer_of(path: Path) -> str | None:
    layers = [layer for layer in MAY_IMPORT if name(path).startswith(layer + "/")]
    return max(layers, key=len, default=None)


def test_layers() -> None:
    wrong = [
        f"{name(p)} imports {sorted(imported(p) - MAY_IMPORT[layer])}"
        for p in sources()
        if (layer := layer_of(p)) is not None and imported(p) - MAY_IMPORT[layer]
    ]
    assert not wrong, "\n".join(wrong)


def test_layer_rule_sees_a_wrong_import(tmp_path: Path) -> None:
    file = tmp_path / "kernel.py"
    file.write_text("def f():\n    from sim.camera import x\n    import messages.base\n")
    assert imported(file) == {"sim", "messages"}


def test_messages_import_only_the_base_class() -> None:
    for path in (p for p in sources() if name(p).startswith("messages/") and p.stem not in ("base", "__init__")):
        modules = [n.module for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
        ours = [m for m in modules if m is not None and m.split(".")[0] in PACKAGES]
        assert set(ours) <= {"messages.base"}, f"{name(path)} imports {ours}"


def lines_of_code(path: Path) -> int:
    """Lines of a file without blank ones, comments and docstrings."""
    nodes = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.Expr)]
    strings = [n for n in nodes if isinstance(n.value, ast.Constant) and isinstance(n.value.value, str)]
    documentation = {line for n in strings for line in range(n.lineno, (n.end_lineno or n.lineno) + 1)}
    layout = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    with path.open("rb") as file:
        tokens = [t for t in tokenize.tokenize(file.readline) if t.type not in (*layout, tokenize.ENCODING)]
    return len({line for t in tokens for line in range(t.start[0], t.end[0] + 1)} - documentation)


def test_sizes() -> None:
    assert {name(p): n for p in sources() if (n := len(p.read_text().splitlines())) > 500} == {}
    beside = ("fsw/math/", "fsw/imaging/", "fsw/tools/")
    core = {
        name(p): lines_of_code(p) for p in sources() if name(p).startswith("fsw/") and not name(p).startswith(beside)
    }
    assert sum(core.values()) < 1500, core


def test_packages_are_regular_and_typed() -> None:
    """A namespace package would lose against another distribution's package of the same name."""
    for package in PACKAGES:
        init = ROOT / package / "__init__.py"
        assert init.is_file(), f"{package}/__init__.py is missing"
        assert ast.get_docstring(ast.parse(init.read_text())), f"{package}/__init__.py says nothing"
        assert (ROOT / package / "py.typed").is_file(), f"{package}/py.typed is missing"


def test_no_init_under_tests_and_unique_names() -> None:
    tests = [p for p in sources() if name(p).startswith("tests/")]
    assert [name(p) for p in tests if p.name == "__init__.py"] == []
    stems = [p.stem for p in tests if p.stem.startswith("test_")]
    assert {s for s in stems if stems.count(s) > 1} == set()


def test_every_data_file_has_a_licence_note() -> None:
    folders = ("sim/data/", "docs/images/")
    data = [p for p in files() if name(p).startswith(folders) and p.name not in ("LICENCE.md", "README.md")]
    assert data
    missing: list[str] = []
    for path in data:
        note = path.parent / "LICENCE.md"
        if not note.is_file() or f"`{path.name}`" not in note.read_text():
            missing.append(name(path))
    assert missing == []


ALONE = {
    "a path of one machine": re.compile(r"(^|[^\w.])/(work|farm|tmp|root|home|opt)/", re.MULTILINE),
    "a path outside of the repository": re.compile(r"\.\./shared\b|\bshared/(design|bench|anchors|seeds|basilisk)"),
    "an unfinished place": re.compile(r"\b(TODO|FIXME|XXX)\b"),
}


@pytest.mark.parametrize("what", ALONE)
def test_stands_alone(what: str) -> None:
    found: list[str] = []
    for path in files():
        if path.suffix in (".py", ".md", ".toml", ".txt", ".csv", ".json", "") and path != Path(__file__):
            hits = ALONE[what].finditer(path.read_text(errors="replace"))
            found += [f"{name(path)}: {hit.group()!r}" for hit in hits]
    assert not found, "\n".join(found)


def test_ignored_lint_rules_have_a_reason() -> None:
    text = (ROOT / "pyproject.toml").read_text()
    ignored = text.partition("\nignore = [\n")[2].partition("\n]")[0].splitlines()
    groups = [line.split("#")[0].strip()[1:3] for line in ignored]
    for line, group, before in zip(ignored, groups, ["", *groups], strict=False):
        assert "#" in line or group == before, f"give a reason: {line.strip()}"


def test_suppressions_name_their_rule() -> None:
    bare = re.compile(r"#\s*(type: ignore|pyright: ignore|noqa)\s*($|#)", re.MULTILINE)
    assert [name(p) for p in sources() if bare.search(p.read_text())] == []
