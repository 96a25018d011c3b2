"""Same seed, same bits: twice, in two processes, after a snapshot, recorded or not, with modules added or moved."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from fsw import Simulation, Task, minutes, ms, s
from sim.scenarios.hill_pointing import HillPointing, build
from sim.sensors.gyro import Gyro
from sim.sensors.star_tracker import StarTracker

END = minutes(5)
ULPS_OF_COMPILATION = 8
"""Of each vector's length. Compiled code contracts no operation and reorders no sum, and on Linux it calls the same
mathematical library as Python (there the difference is zero); another library may differ in the last bits."""


def digest(case: HillPointing) -> str:
    """Of every row of every module."""
    rows = b"".join(row.tobytes() for module in case.sim.modules for row in module.rows())
    return hashlib.sha256(rows).hexdigest()


def finished(change: Callable[[HillPointing], Any] = lambda case: None) -> HillPointing:
    case = build(seed=5)
    change(case)
    case.sim.run_until(END)
    return case


@pytest.fixture(scope="module")
def reference() -> str:
    return digest(finished())


def test_twice(reference: str) -> None:
    assert digest(finished()) == reference


def test_another_seed_differs(reference: str) -> None:
    case = build(seed=6)
    case.sim.run_until(END)
    assert digest(case) != reference


def test_in_another_process(reference: str) -> None:
    code = "from test_determinism import digest, finished; print(digest(finished()))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([".", "tests"]), "PYTHONHASHSEED": "17"}
    done = subprocess.run([sys.executable, "-c", code], check=True, env=environment, capture_output=True, text=True)
    assert done.stdout.split()[-1] == reference


def test_recorded_and_timed(reference: str) -> None:
    def watch(case: HillPointing) -> None:
        for module in case.sim.modules:
            for port in module.outputs:
                port.record()
        case.sim.timed = True

    assert digest(finished(watch)) == reference


def test_in_pieces(reference: str) -> None:
    case = build(seed=5)
    for k in range(1, 20):
        case.sim.run_until(END * k // 20)
    case.sim.run_until(END, stop=(case.spacecraft.out_state, lambda message: False))
    assert digest(case) == reference


def test_after_a_snapshot(reference: str) -> None:
    case = build(seed=5)
    case.sim.run_until(minutes(2))
    snapshot = case.sim.snapshot()
    case.sim.run_until(minutes(4))
    case.sim.restore(snapshot)
    case.sim.run_until(END)
    assert digest(case) == reference
    other = build(seed=99)
    other.sim.restore(snapshot)
    other.sim.run_until(END)
    assert digest(other) == reference, "a snapshot holds all that matters, random streams included"


def test_after_reset(reference: str) -> None:
    case = finished()
    case.sim.reset()
    case.sim.run_until(END)
    assert digest(case) == reference


def test_an_added_module_changes_no_other_noise(reference: str) -> None:
    case = build(seed=5)
    extra = [StarTracker("a_first_tracker"), Gyro("zz_last_gyro")]
    for module in extra:
        case.spacecraft.out_state.connect(module.in_state)
    first, *others = case.sim.tasks
    longer = Task(first.name, first.period, [*first.modules, *extra], first.phase)
    sim = Simulation([longer, Task("more", s(1), [StarTracker("unread")]), *others], seed=5)
    case.spacecraft.out_state.connect(sim.modules[-1 - sum(len(t.modules) for t in others)].in_state)  # type: ignore[attr-defined]
    sim.run_until(END)
    assert digest(case) == reference


def test_uncompiled_agrees_to_the_last_bits() -> None:
    code = """
import sys, numpy as np
from fsw import s
from sim.scenarios.hill_pointing import build
case = build(seed=5)
case.sim.run_until(s(5))
state = case.spacecraft.state
sys.stdout.buffer.write(np.concatenate([state.r_BN_N, state.v_BN_N, state.sigma_BN, state.omega_BN_B]).tobytes())
"""
    results = [
        np.frombuffer(
            subprocess.run(
                [sys.executable, "-c", code],
                check=True,
                env={**os.environ, "PYTHONPATH": ".", "FSW_COMPILE": mode},
                capture_output=True,
            ).stdout
        )
        for mode in ("1", "0")
    ]
    assert results[0].shape == (12,)
    scale = np.repeat([np.linalg.norm(results[0][i : i + 3]) for i in range(0, 12, 3)], 3)
    assert np.all(np.abs(results[0] - results[1]) <= ULPS_OF_COMPILATION * np.spacing(scale))


def test_the_scenario_runs_at_its_rates() -> None:
    assert {t.period for t in build().sim.tasks} == {ms(100)}
