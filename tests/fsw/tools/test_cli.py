"""The command line: what it prints, its exit codes, and one clear sentence for each mistake."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from fsw import cache, compiler
from fsw.math.compiled import COMPILE
from fsw.tools.cli import main

SCENARIO = '''
"""A small scenario."""
from __future__ import annotations
import sys
from typing import Annotated
from fsw import In, KernelModule, Message, Module, Out, Row, Simulation, Task, publish, s

class WordMsg(Message):
    """A number."""
    value: Annotated[float, "m", "value"]

class OtherMsg(Message):
    """Another number."""
    value: Annotated[float, "m", "value"]

class Source(KernelModule):
    """Writes."""
    out_word = Out(WordMsg)
    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_word: Row) -> None:
        out_word.value = 1.0
        publish(out_word, t_ns)

class Reader(Module):
    """Reads."""
    in_word = In(WordMsg)
    in_other = In(OtherMsg, optional=True)
    def step(self, t_ns: int) -> None:
        self.in_word.take()

class Made:
    def __init__(self, sim: Simulation) -> None:
        self.sim = sim

def build(wrong: bool = False) -> Made:
    source, reader, lost = Source("source"), Reader("reader"), Reader("lost")
    source.out_word.connect(reader.in_word)
    modules = [source, reader]
    if wrong:
        source.out_word.connect(reader.in_other)
        source.out_word.connect(reader.in_word)
        modules.append(lost)
    return Made(Simulation([Task("work", period=s(1), modules=modules)]))
'''
BROKEN = """
class Broken(Module):
    def step(self, t_ns: int) -> None:
        1 / 0
Simulation([Task("work", period=s(1), modules=[Broken("broken")])]).run_until(s(5))
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of its own as the current one; what a command does to the process is undone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", list(sys.argv))
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(cache, "progress", lambda text: None)
    yield tmp_path
    for name in ("scenario_small", "scenario_wrong"):
        sys.modules.pop(name, None)


def scenario(folder: Path, more: str = "", text: str = SCENARIO) -> str:
    (folder / "small.py").write_text(text + more, encoding="utf-8")
    return "small.py"


def fails(capsys: pytest.CaptureFixture[str], code: int, *arguments: str) -> str:
    """Run a command that must fail with one sentence, and return it."""
    assert main(list(arguments)) == code
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("fsw: ")
    assert output.err.count("\n") == 1
    assert "Traceback" not in output.err
    return output.err


@pytest.mark.parametrize("arguments", [[], ["fly"], ["graph"], ["run"], ["graph", "x", "--format", "png"]])
def test_bad_usage_ends_with_2(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "usage: fsw" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["run", "graph", "check", "dictionary", "new-module", "compile", "info"])
def test_help_has_an_example(capsys: pytest.CaptureFixture[str], command: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert f"Example: fsw {command}" in " ".join(capsys.readouterr().out.split())


def test_run_passes_the_arguments_on(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "small_pack").mkdir()
    (folder / "small_pack" / "__main__.py").write_text("import sys\nprint(__name__, sys.argv[1:])", encoding="utf-8")
    assert main(["run", "small_pack", "--debug", "--help", "x"]) == 0
    assert main(["run", scenario(folder, "print(__name__, sys.argv)"), "-o", "y"]) == 0
    assert capsys.readouterr().out == "__main__ ['--debug', '--help', 'x']\n__main__ ['small.py', '-o', 'y']\n"


def test_run_has_the_exit_code_of_the_scenario(folder: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["run", scenario(folder, "sys.exit(5)")])
    assert ended.value.code == 5


def test_a_run_that_fails_says_so_in_one_sentence(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = scenario(folder, BROKEN)
    text = fails(capsys, 1, "run", name)
    assert "Broken 'broken' failed at t = 0 s: ZeroDivisionError: division by zero" in text
    assert main(["--debug", "run", name]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_interrupted(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", scenario(folder, "raise KeyboardInterrupt")]) == 130
    assert capsys.readouterr().err == "fsw: interrupted\n"


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("sim.scenarios.nowhere", "", "there is no scenario sim.scenarios.nowhere"),
        ("nowhere.at.all", "", "there is no scenario nowhere.at.all"),
        ("nowhere.py", "", "there is no scenario nowhere.py"),
        ("..", "", "there is no scenario .."),
        ("small.py", "x = 1", "has no function build()"),
        ("small.py", "def build(n): ...", "build() of small.py needs n"),
        ("small.py", "def build(*, n): ...", "build() of small.py needs n"),
        ("small.py", "def build(*n, **m): return 3", "returned 3; expected a Simulation"),
    ],
)
def test_what_is_no_scenario(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, sentence: str
) -> None:
    scenario(folder, text=text)
    assert sentence in fails(capsys, 2, "graph", name)


def test_graph_in_every_format(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = scenario(folder)
    for form, start in {"text": "work", "json": "{", "mermaid": "flowchart", "dot": "digraph", "svg": "<svg"}.items():
        assert main(["graph", name, "--format", form]) == 0
        printed = capsys.readouterr().out
        assert printed.startswith(start)
        assert "WordMsg" in printed
        assert main(["graph", name, "--format", form, "-o", f"graph.{form}"]) == 0
        assert (folder / f"graph.{form}").read_text(encoding="utf-8") == printed
    assert "No such file" in fails(capsys, 1, "graph", name, "-o", "no/folder/graph.txt")


def test_check_finds_all_wiring_faults(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good = scenario(folder)
    (folder / "wrong.py").write_text(SCENARIO.replace("wrong: bool = False", "wrong: bool = True"), encoding="utf-8")
    assert main(["check", good]) == 0
    assert capsys.readouterr().out == "small.py: no faults\n"
    assert main(["check", good, "wrong.py"]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == ["small.py: no faults", "wrong.py: 3 faults"]
    assert [part in line for part, line in zip(("in_other", "in_word", "lost"), lines[2:], strict=True)] == [True] * 3
    assert main(["check", "wrong.py", "--json"]) == 1
    faults: list[dict[str, Any]] = json.loads(capsys.readouterr().out)["wrong.py"]
    assert {f["kind"] for f in faults} == {"type", "two sources", "unconnected"}
    assert all(f["where"] and f["message"] and f["advice"] for f in faults)


def test_outside_a_repository_there_are_no_specs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["check"], ["new-module", "control/damper"], ["compile"]):
        if COMPILE or arguments != ["compile"]:
            assert "not in a repository" in fails(capsys, 2, *arguments)


def test_new_module_refuses_a_bad_name(
    capsys: pytest.CaptureFixture[str], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("modules", "sim", "tests"):
        (folder / name).mkdir()
    (folder / "pyproject.toml").touch()
    monkeypatch.chdir(folder / "tests")
    assert "write DOMAIN/NAME" in fails(capsys, 2, "new-module", "Damper")
    assert main(["new-module", "control/damper", "--python"]) == 0
    assert (folder / "modules/control/damper/SPEC.md").is_file()
    assert "test_damper.py" in capsys.readouterr().out
    assert "exists already" in fails(capsys, 2, "new-module", "control/damper")


def test_dictionary(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dictionary"]) == 0
    everything = capsys.readouterr().out
    assert all(name in everything for name in ("CmdTorqueBodyMsg", "CameraImageMsg", "torque_B", "N*m", "(3,)"))
    assert main(["dictionary", "CmdTorqueBodyMsg", "--json"]) == 0
    entry: dict[str, Any] = json.loads(capsys.readouterr().out)[0]
    assert entry["message"] == "CmdTorqueBodyMsg"
    assert entry["fields"][0] | {"description": ""} == {
        "name": "torque_B",
        "type": "float",
        "shape": "(3,)",
        "unit": "N*m",
        "description": "",
    }
    assert main(["dictionary", "--schema"]) == 0
    schemas: list[dict[str, Any]] = json.loads(capsys.readouterr().out)
    titles = [s["title"] for s in schemas]
    assert titles == sorted(set(titles))
    assert "Message" not in titles
    assert "did you mean CmdTorqueBodyMsg" in fails(capsys, 2, "dictionary", "CmdTorqueMsg")


def test_compile_fills_the_cache(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = scenario(folder)
    if not COMPILE:
        assert "switched off" in fails(capsys, 2, "compile", name)
        return
    monkeypatch.setenv("FSW_CACHE_DIR", str(folder / "cache"))
    for made_now in (2, 0):
        compiler.entry_of.cache_clear()
        compiler.loop_entry.cache_clear()
        assert main(["compile", name]) == 0
        text = f"2 compiled, {made_now} of them now, {2 - made_now} earlier; in {folder / 'cache'}\n"
        assert capsys.readouterr().out == text


def test_info(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(["info"]) == 0
    assert "not in a repository" in capsys.readouterr().out
    monkeypatch.chdir(Path(__file__).parent)
    assert main(["info"]) == 0
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("numba", "cores", "cache", " modules, ", " messages"))
