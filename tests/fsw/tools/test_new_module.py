"""``fsw new-module`` makes folders that pass every check at once: format, lint, types, specs, tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fsw.tools.scaffold import new_module

ROOT = Path(__file__).parents[3]
MADE = {"control/damper": "kernel", "sensors/thermal_line_camera_assembly": "python", "sim/thermal/plate2": "kernel"}


@pytest.fixture(scope="module")
def repository(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A repository with the real framework and messages, and no modules but the new ones."""
    root = tmp_path_factory.mktemp("repository")
    for folder in ("fsw", "messages"):
        (root / folder).symlink_to(ROOT / folder)
    for side in ("modules", "sim"):
        (root / side).mkdir()
        shutil.copy(ROOT / side / "__init__.py", root / side)
    (root / "tests").mkdir()
    shutil.copy(ROOT / "tests/conftest.py", root / "tests")
    shutil.copy(ROOT / "pyproject.toml", root)
    for name, tier in MADE.items():
        new_module(name, root, tier)
    return root


def run(repository: Path, *command: str) -> str:
    """Output of ``python -m command`` in the repository; it must succeed."""
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=repository, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_files_are_those_of_a_module(repository: Path) -> None:
    names = {p.name for p in (repository / "modules/control/damper").iterdir()}
    assert names == {"__init__.py", "module.py", "kernel.py", "SPEC.md"}
    assert (repository / "tests/sim/sensors/test_thermal_line_camera_assembly.py").is_file()
    assert "class ThermalLineCameraAssembly(Module)" in (
        repository / "sim/sensors/thermal_line_camera_assembly/module.py"
    ).read_text(encoding="utf-8")
    assert "thermal" in (repository / "sim/thermal/__init__.py").read_text(encoding="utf-8")


def test_format_lint_and_specs_pass(repository: Path) -> None:
    new = ["modules", "sim", "tests"]
    run(repository, "ruff", "format", "--check", *new)
    run(repository, "ruff", "check", *new)
    assert run(repository, "fsw.tools.cli", "check") == "specs: no faults\n"


@pytest.mark.typing
def test_types_pass(repository: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", repository)
    run(repository, "pyright", "--pythonpath", sys.executable, "modules", "sim", "tests")


def test_tests_pass_and_their_results_are_those_of_the_spec(repository: Path) -> None:
    specs = sorted(repository.rglob("SPEC.md"))
    before = {p: p.read_text(encoding="utf-8") for p in specs}
    output = run(repository, "pytest", "-q", "-p", "no:cacheprovider", "--write-results")
    assert "18 passed" in output
    assert output.count("wrote 1 results to") == 3
    assert "not measured" not in output
    assert {p: p.read_text(encoding="utf-8") for p in specs} == before


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("damper", "no module name"),
        ("control/Damper", "no module name"),
        ("control/2damper", "no module name"),
        ("control/class", "no module name"),
        ("control/", "no module name"),
        ("../control/damper", "no module name|no domain"),
        ("control/sub/../damper", "no module name"),
        ("control/" + 31 * "a", "no module name"),
        ("thermal/plate", "no domain 'thermal'.*a new one is made by modules/thermal/plate"),
        ("sim/scenarios/plate", "no domain"),
        ("fsw/control/plate", "no domain"),
        ("control/damper", "modules/control/damper exists already"),
        ("guidance/damper", "tests/modules/control/test_damper.py exists already"),
    ],
)
def test_unusable_names_are_refused(repository: Path, name: str, sentence: str) -> None:
    before = sorted(repository.rglob("*"))
    with pytest.raises(ValueError, match=sentence):
        new_module(name, repository, "kernel")
    assert sorted(repository.rglob("*")) == before


def test_nothing_half_written_is_left(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write = Path.write_text

    def full(path: Path, text: str, encoding: str) -> int:
        if path.name == "SPEC.md":
            raise OSError(28, "No space left on device", str(path))
        return write(path, text, encoding=encoding)

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left"):
        new_module("control/second", repository, "kernel")
    assert not (repository / "modules/control/second").exists()
    assert not (repository / "tests/modules/control/test_second.py").exists()
