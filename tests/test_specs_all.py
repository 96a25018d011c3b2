"""Every module of the repository has its spec, and the spec says what the code, the tests and the results say."""

from __future__ import annotations

from pathlib import Path

import pytest

from fsw.tools.specs import check, module_folders

ROOT = Path(__file__).parents[1]


def test_no_spec_has_a_fault(request: pytest.FixtureRequest) -> None:
    faults = check(ROOT)
    if request.config.getoption("--write-results"):  # they are written when this session ends
        faults = [f for f in faults if ": Measured results: " not in f]
    assert not faults, "\n".join(["faults in the specs:", *faults])


def test_module_folders_are_found() -> None:
    found = {folder.relative_to(ROOT).parts[0] for folder in module_folders(ROOT)}
    assert found == {"modules", "sim"}
