"""Basilisk's unscented filters of orbits, fed as `benchmarks.filters` feeds ours."""

# pyright: basic, reportMissingImports=false
# Basilisk has no types, and is installed by ``make bench`` only

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from benchmarks.basilisk import new_simulation
from benchmarks.filters import DENSITY, FIELD, ORBIT_FILTER, PIXEL_FILTER, ROWS, SIZE, SPREAD, STEP_S, Course
from fsw import s

MARS = 2
"""Of Basilisk's numbers of planets."""


def _new(module: str) -> Any:
    return getattr(importlib.import_module(f"Basilisk.fswAlgorithms.{module}"), module)()


class Orbits:
    """Filters of one kind, in single steps with new messages before each."""

    def __init__(self, given: Course, kind: str, count: int) -> None:
        from Basilisk.architecture import messaging

        self.messaging, self.table, self.row, self.t = messaging, given.table, 0, 0
        self.circles, self.position = messaging.OpNavCirclesMsg(), messaging.OpNavMsg()
        self.attitude, self.camera = messaging.NavAttMsg(), messaging.CameraConfigMsg()
        self.camera.write(
            messaging.CameraConfigMsgPayload(
                cameraID=1,
                fieldOfView=FIELD,
                resolution=[SIZE, SIZE],
                sigma_CB=[0.0, 0.0, 0.0],
            ),
            0,
        )
        self.sim, self.filters = new_simulation(s(STEP_S)), []
        n = 9 if kind == PIXEL_FILTER else 6
        for _ in range(count):
            module = _new("pixelLineBiasUKF" if kind == PIXEL_FILTER else "relativeODuKF")
            module.alpha, module.beta, module.kappa = 0.02, 2.0, 0.0
            module.planetIdInit = MARS
            bias = [0.0] * 3 if n == 9 else []
            module.stateInit = [*given.start.tolist(), *bias]
            module.covarInit = np.diag(SPREAD[:n] ** 2).ravel().tolist()
            module.qNoise = (1e-6 * DENSITY[:n, :n]).ravel().tolist()
            if kind == PIXEL_FILTER:
                module.circlesInMsg.subscribeTo(self.circles)
                module.cameraConfigInMsg.subscribeTo(self.camera)
                module.attInMsg.subscribeTo(self.attitude)
            elif kind == ORBIT_FILTER:
                module.noiseSF = 1.0
                module.opNavInMsg.subscribeTo(self.position)
            self.filters.append(module)
            self.sim.AddModelToTask("t", module)
        self.sim.InitializeSimulation()

    def run(self, ticks: int) -> None:
        """Write and step, ``ticks`` times."""
        messaging, step = self.messaging, self.sim.TotalSim.SingleStepProcesses
        for _ in range(ticks):
            row, t = self.table[self.row].tolist(), self.t
            self.row = (self.row + 1) % ROWS
            circles = messaging.OpNavCirclesMsgPayload(
                valid=1,
                cameraID=1,
                timeTag=t,
                planetIds=[MARS] + [0] * 9,
                circlesCenters=row[3:5] + [0.0] * 18,
                circlesRadii=row[5:6] + [0.0] * 9,
                uncertainty=[0.25, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.25],
            )
            position = messaging.OpNavMsgPayload(
                valid=1,
                timeTag=float(t),
                planetID=MARS,
                r_BN_N=row[6:],
                covar_N=[1e8, 0.0, 0.0, 0.0, 1e8, 0.0, 0.0, 0.0, 1e8],
            )
            self.circles.write(circles, t)
            self.position.write(position, t)
            self.attitude.write(messaging.NavAttMsgPayload(timeTag=1e-9 * t, sigma_BN=row[:3]), t)
            step()
            self.t += s(STEP_S)
