"""The compile cache: never stale, never fatal; compiled and plain code agree."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

HELPER = """
    from fsw import compiled

    GAIN = 2.0

    @compiled
    def scaled(x: float) -> float:
        return {factor} * x * GAIN
"""

MODULE = """
    from typing import Annotated
    from fsw import KernelModule, Message, Out, Row, Simulation, Task, publish, s
    import helper
    from table import TABLE

    class ValueMsg(Message):
        x: Annotated[float, "m", "value"]

    class Scaler(KernelModule):
        out_value = Out(ValueMsg)

        @staticmethod
        def kernel(t_ns: int, params: Row, state: Row, out_value: Row) -> None:
            out_value.x = helper.scaled(1.5) + TABLE[1]
            publish(out_value, t_ns)

    if __name__ == "__main__":
        scaler = Scaler("scaler")
        Simulation([Task("only", s(1), [scaler])]).run_until(0)
        print("value", scaler.out_value.latest().x)
"""


class Project:
    """A user's folder with a module that calls a helper in another file."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.cache = folder, folder / "cache"
        self.write("module.py", MODULE)
        self.write("helper.py", HELPER.format(factor=1.0))
        self.write("table.py", "import numpy as np\nTABLE = np.array([0.0, 10.0])\n")

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(textwrap.dedent(text))

    def run(self, **environment: str) -> tuple[float, str]:
        """Run it in a fresh process: the value that it prints, and the standard error."""
        settings = {"PYTHONPATH": str(ROOT), "FSW_CACHE_DIR": str(self.cache), "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, "module.py"]
        done = subprocess.run(
            command,
            check=False,
            cwd=self.folder,
            env={**os.environ, **settings, **environment},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return float(done.stdout.split()[-1]), done.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A project that has run once; tests may edit it, and put it back."""
    project = Project(tmp_path_factory.mktemp("project"))
    value, error = project.run()
    assert value == 13.0 and "compiling __main__.Scaler" in error and "compiling fsw.loop.run" in error
    return project


def test_the_second_start_compiles_nothing(built: Project) -> None:
    value, error = built.run()
    assert value == 13.0 and error == ""


def test_an_edit_in_a_file_that_the_kernel_calls_is_seen(built: Project) -> None:
    built.write("helper.py", HELPER.format(factor=3.0))
    try:
        value, error = built.run()
    finally:
        built.write("helper.py", HELPER.format(factor=1.0))
    assert value == 19.0
    assert re.findall(r"compiling (\S+)", error) == ["__main__.Scaler"]


def test_an_edit_of_a_constant_elsewhere_is_seen(built: Project) -> None:
    built.write("table.py", "import numpy as np\nTABLE = np.array([0.0, 20.0])\n")
    try:
        value, _ = built.run()
    finally:
        built.write("table.py", "import numpy as np\nTABLE = np.array([0.0, 10.0])\n")
    assert value == 23.0


def test_a_changed_layout_of_a_row_is_seen(built: Project) -> None:
    built.write(
        "module.py", MODULE.replace("x: Annotated", 'n: Annotated[int, "-", "other"] = 0\n        x: Annotated')
    )
    try:
        value, error = built.run()
    finally:
        built.write("module.py", MODULE)
    assert value == 13.0 and "compiling __main__.Scaler" in error


def damage(cache: Path, how: str) -> None:
    for file in cache.glob("*.o"):
        data = bytearray(file.read_bytes())
        if how == "garbage":
            data[:] = b"garbage"
        if how == "cut":
            del data[len(data) // 2 :]
        if how == "bit":
            data[-len(data) // 4] ^= 1
        if how == "head":
            data[0] = 0
        if how == "symbol":
            data[:] = data.replace(b'"externals": [', b'"externals": ["no_such_function", ').replace(b", ]", b"]")
        file.write_bytes(data)


@pytest.mark.parametrize("how", ["garbage", "cut", "bit", "head", "symbol"])
def test_a_corrupt_cache_is_reported_and_built_again(built: Project, how: str) -> None:
    damage(built.cache, how)
    value, error = built.run()
    assert value == 13.0 and "CacheWarning" in error and "damaged" in error
    assert built.run() == (13.0, "")


def test_a_cache_that_cannot_be_written_works_and_says_so(built: Project) -> None:
    (built.folder / "a_file").write_text("not a folder")
    value, error = built.run(FSW_CACHE_DIR=str(built.folder / "a_file"))
    assert value == 13.0 and "CacheWarning" in error and "cannot write" in error


def test_plain_python_gives_the_same(built: Project) -> None:
    value, error = built.run(FSW_COMPILE="0", FSW_CACHE_DIR=str(built.folder / "unused"))
    assert value == 13.0 and error == "" and not (built.folder / "unused").exists()


def test_two_processes_at_once_share_a_cold_cache(tmp_path: Path) -> None:
    project = Project(tmp_path)
    settings = {**os.environ, "PYTHONPATH": str(ROOT), "FSW_CACHE_DIR": str(project.cache)}
    both = [
        subprocess.Popen([sys.executable, "module.py"], cwd=tmp_path, env=settings, stdout=-1, stderr=-1, text=True)
        for _ in range(2)
    ]
    for process in both:
        out, error = process.communicate(timeout=120)
        assert process.returncode == 0 and float(out.split()[-1]) == 13.0, error
    assert project.run() == (13.0, "")
    assert {file.suffix for file in project.cache.iterdir()} == {".o"}, "no half-built entry stays"


ALLOCATING = """
    from typing import Annotated
    import numpy as np
    from fsw import KernelModule, Message, Out, Row, Simulation, Task, publish, s

    class ValueMsg(Message):
        x: Annotated[float, "m", "value"]

    class Scaler(KernelModule):
        out_value = Out(ValueMsg)

        @staticmethod
        def kernel(t_ns: int, params: Row, state: Row, out_value: Row) -> None:
            out_value.x = np.linalg.solve(np.eye(3) * 2.0, np.full(3, t_ns + 26.0))[1]
            publish(out_value, t_ns)

    scaler = Scaler("scaler")
    Simulation([Task("only", s(1), [scaler])]).run_until(0)
    print("value", scaler.out_value.latest().x)
"""


def test_a_kernel_that_needs_the_run_time_library_of_the_compiler(tmp_path: Path) -> None:
    project = Project(tmp_path)
    project.write("module.py", ALLOCATING)
    value, error = project.run()
    assert value == 13.0
    assert "compiling __main__.Scaler" in error
    assert project.run() == (13.0, "")


FUNCTIONS = """
import sys
from pathlib import Path
sys.path.insert(0, {folder!r})
from outer import outer
print(outer(3.0))
"""


def call_outer(folder: Path, **environment: str) -> str:
    """What a new process prints that calls ``outer(3.0)``."""
    script = folder / "run.py"
    script.write_text(FUNCTIONS.format(folder=str(folder)))
    env = {**os.environ, "FSW_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(ROOT), **environment}
    done = subprocess.run([sys.executable, str(script)], env=env, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.strip()


def test_functions_called_from_python_are_kept_and_never_stale(tmp_path: Path) -> None:
    """The second process reads what the first compiled; a change of a function that is called elsewhere is seen."""
    head = "from fsw.math.compiled import compiled\n"
    (tmp_path / "inner.py").write_text(head + "@compiled\ndef inner(x):\n    return 2.0 * x\n")
    (tmp_path / "outer.py").write_text(
        head + "from inner import inner\n@compiled\ndef outer(x):\n    return inner(x) + 1.0\n"
    )
    assert call_outer(tmp_path) == "7.0"
    kept = sorted((tmp_path / "cache" / "functions").iterdir())
    assert [p.suffix for p in kept] == [".nbc", ".nbi"]
    written = kept[0].stat().st_mtime_ns
    assert call_outer(tmp_path) == "7.0"
    assert kept[0].stat().st_mtime_ns == written
    (tmp_path / "inner.py").write_text(head + "@compiled\ndef inner(x):\n    return 3.0 * x\n")
    assert call_outer(tmp_path) == "10.0"
    for path in kept:
        path.write_bytes(b"damaged")
    (tmp_path / "inner.py").write_text(head + "@compiled\ndef inner(x):\n    return 2.0 * x\n")
    assert call_outer(tmp_path) == "7.0"
    assert call_outer(tmp_path, FSW_CACHE_DIR="/proc/nowhere") == "7.0"
