"""From the start of the process to the end of the first tick, with a warm and with an empty compile cache."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.timing import Line, figure

WARM_BAR_S = 1.0
COLD_BAR_S = 10.0

_OURS = """
import time
from sim.scenarios.hill_pointing import build
imported = time.time()
build().sim.step()
print(imported, time.time())
"""

_BASILISK = """
import time
from benchmarks.basilisk import ClosedLoop
from benchmarks.case import Case
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, hillPoint, mrpFeedback
from Basilisk.simulation import extForceTorque, imuSensor, simpleNav, spacecraft, starTracker
from Basilisk.utilities import SimulationBaseClass, simIncludeGravBody
imported = time.time()
import numpy as np
r, v, zero = np.array([7e6, 0, 0]), np.array([0, 7.5e3, 0]), np.zeros(3)
case = Case(r_BN_N=r, v_BN_N=v, sigma_BN=zero, omega_BN_B=zero, inertia_B=np.eye(3), mu=4e14, radius=6.4e6, j2=1e-3)
ClosedLoop(case, noise=True, record=False).run(1)
print(imported, time.time())
"""


def started(program: str, cache: Path) -> tuple[float, float]:
    """Seconds from the start of a process to the end of its imports, and to the end of its first tick."""
    environment = {**os.environ, "FSW_CACHE_DIR": str(cache)}
    root = Path(__file__).parents[1]
    begun = time.time()
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, cwd=root, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"the process to be timed failed: {done.stderr.strip().splitlines()[-1]}")
    imported, ticked = map(float, done.stdout.split())
    return imported - begun, ticked - begun


def measure(repeats: int = 5, *, basilisk: bool = True) -> list[Line]:
    """Measure both starts; the cold one compiles every kernel of the scenario, twice in all.

    Args:
        repeats: how often the warm one is measured. basilisk: measure that side too.
    """
    with tempfile.TemporaryDirectory(prefix="fsw-start-") as folder:
        cold = [started(_OURS, Path(folder) / str(i))[1] for i in range(2)]
        warm: list[tuple[float, float]] = []
        other: list[tuple[float, float]] = []
        for turn in range(repeats + 1):
            ours = started(_OURS, Path(folder) / "0")
            theirs = [started(_BASILISK, Path(folder) / "0")] if basilisk else []
            if turn:
                warm.append(ours)
                other += theirs
    first, last = (figure([pair[i] for pair in warm]) for i in range(2))
    imports, ticked = (figure([pair[i] for pair in other]) if other else None for i in range(2))
    end = figure(cold)
    return [
        Line("start to first tick, warm cache", "s", last, ticked, "below 1 s", last.least, WARM_BAR_S),
        Line("of that, imports", "s", first, imports),
        Line("start to first tick, empty cache", "s", end, None, "below 10 s", end.least, COLD_BAR_S),
    ]
