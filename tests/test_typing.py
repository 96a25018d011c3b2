"""The type checker flags wrong wiring, and has nothing to say against right wiring."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
IGNORED = re.compile(r"  # pyright: ignore\[([\w, ]+)\]")


def marked(text: str) -> dict[int, set[str]]:
    """Rules that each line of a file is expected to break, by line from 1."""
    found = ((i, IGNORED.search(line)) for i, line in enumerate(text.splitlines(), 1))
    return {i: set(match[1].split(", ")) for i, match in found if match}


@pytest.mark.typing
def test_wrong_wiring_is_flagged_line_by_line_and_right_wiring_is_not(tmp_path: Path) -> None:
    expected: dict[str, dict[int, set[str]]] = {}
    for source in sorted((ROOT / "tests" / "typing").glob("*.py")):
        text = source.read_text()
        expected[source.name] = marked(text)
        (tmp_path / source.name).write_text(IGNORED.sub("", text))
    settings = {"extraPaths": [str(ROOT)], "reportMissingTypeStubs": False, "pythonVersion": "3.11"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "pyright", "--outputjson", "-p", str(tmp_path), "--pythonpath", sys.executable]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    found: dict[str, dict[int, set[str]]] = {name: {} for name in expected}
    for entry in json.loads(done.stdout)["generalDiagnostics"]:
        line = entry["range"]["start"]["line"] + 1
        found[Path(entry["file"]).name].setdefault(line, set()).add(entry.get("rule", "syntax"))
    assert found == expected
    assert expected["right_wiring.py"] == {}
    assert len(expected["wrong_wiring.py"]) >= 40
