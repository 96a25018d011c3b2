"""What the documents say is true: their Python runs, their links lead somewhere, their commands exist."""

import re
import runpy
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), ROOT / "benchmarks" / "README.md"]


def blocks(path: Path, language: str) -> list[str]:
    """The fenced code blocks of a document, in order."""
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```$", path.read_text(), re.MULTILINE | re.DOTALL)
    return [textwrap.dedent(body) for _, body in found]


def test_python_of_the_readme_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All blocks, one after the other in one program, as a reader would run them."""
    program = tmp_path / "readme.py"
    program.write_text("\n".join(blocks(ROOT / "README.md", "python")))
    names = runpy.run_path(str(program), run_name="__main__")
    free, damped = (line for line in capsys.readouterr().out.splitlines() if line.startswith("rate"))
    assert "damped" in damped
    assert "damped" not in free
    # the torque is -gain omega: with 0.5 N m s and 9 kg m^2 the rate falls by e in 18 s, far below the noise in 10 min
    rate = names["craft"].out_state.latest().omega_BN_B
    assert abs(rate).max() < 1e-4
    assert abs(names["imu"]["omega_PN_P"][-1]).max() > 1e-2


def test_scenario_of_the_readme_has_ten_lines() -> None:
    lines = [line for line in blocks(ROOT / "README.md", "python")[0].splitlines() if line and "import" not in line]
    assert len(lines) <= 10


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(document: Path) -> None:
    targets = re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", document.read_text())
    missing = [t for t in targets if not t.startswith("http") and not (document.parent / t).exists()]
    assert missing == []


def test_make_targets_of_the_documents_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = {t for d in DOCUMENTS for t in re.findall(r"(?:`|^)make ([a-z-]+)", d.read_text(), re.MULTILINE)}
    assert {"demo", "test"} <= named <= targets
    offered = set(re.findall(r'echo "make ([a-z-]+)', (ROOT / "Makefile").read_text()))
    assert offered == targets - {"help"}


def test_continuous_integration_runs_the_test_command_of_the_readme() -> None:
    assert "make test" in "\n".join(blocks(ROOT / "README.md", "bash"))
    assert (ROOT / ".ci" / "run").read_text().rstrip().endswith("exec make test")
