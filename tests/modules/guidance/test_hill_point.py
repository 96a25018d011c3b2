"""HillPoint against Basilisk, and its rates against differences of the frame along a two-body orbit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, ModuleError, Out, Simulation, Task, s
from fsw.math.kepler import elements_to_rv, mean_to_true
from messages.attitude import AttRefMsg
from messages.base import F64
from messages.states import NavTransMsg
from modules.guidance.hill_point import HillPoint

Criterion = Callable[[str, float], None]
MU = 3.986e14


class Orbit(Module):
    """Writes what a test sets."""

    out_trans = Out(NavTransMsg)

    def step(self, t_ns: int) -> None:
        self.out_trans.write(NavTransMsg(r_BN_N=np.array([7e6, 0, 0]), v_BN_N=np.array([1e3, 0, 0])), t_ns)


def reference(r: Any, v: Any, params: HillPoint.Params | None = None) -> AttRefMsg:
    orbit, hill = Orbit("orbit"), HillPoint("hill", params)
    orbit.out_trans.connect(hill.in_trans)
    orbit.out_trans.write(NavTransMsg(r_BN_N=np.array(r), v_BN_N=np.array(v)), 0)
    hill.step(0)
    message = hill.out_ref.latest()
    assert message is not None
    return message


def test_against_basilisk(criterion: Criterion) -> None:
    path = Path(__file__).parents[2] / "data" / "basilisk_hill_point.json"
    cases: list[dict[str, Any]] = json.loads(path.read_text())["cases"]
    worst = 0.0
    for case in cases:
        if np.linalg.norm(case["r_BN_N"]) <= 1.0 or np.linalg.norm(case["v_BN_N"]) == 0.0:
            continue
        mine = reference(case["r_BN_N"], case["v_BN_N"])
        out = case["out"]
        turn = Rotation.from_mrp(mine.sigma_RN.copy()).inv() * Rotation.from_mrp(out["sigma_RN"])
        worst = max(worst, float(turn.magnitude()))
        for a, b in [(mine.omega_RN_N, out["omega_RN_N"]), (mine.domega_RN_N, out["domega_RN_N"])]:
            scale = float(np.linalg.norm(b)) or 1.0
            worst = max(worst, float(np.linalg.norm(a - np.array(b))) / scale)
    criterion("HILL-1", worst)


def test_rates_along_an_orbit(criterion: Criterion) -> None:
    """Central differences of attitude and rate on an ellipse (e = 0.3), relative."""
    motion = np.sqrt(MU / 9e6**3)

    def at(t: float) -> AttRefMsg:
        return reference(*elements_to_rv((9e6, 0.3, 1.0, 2.0, 0.7, mean_to_true(0.4 + motion * t, 0.3)), MU))

    def rotation(t: float) -> Rotation:
        return Rotation.from_mrp(at(t).sigma_RN.copy())

    here = at(0.0)
    omega: F64 = (rotation(0.5) * rotation(-0.5).inv()).as_rotvec()
    domega = at(0.5).omega_RN_N - at(-0.5).omega_RN_N
    worst = float(np.linalg.norm(omega - here.omega_RN_N) / np.linalg.norm(omega))
    worst = max(worst, float(np.linalg.norm(domega - here.domega_RN_N) / np.linalg.norm(domega)))
    criterion("HILL-2", worst)


def test_offset_to_nadir_pointing() -> None:
    """With dcm_RH from H to the O frame, z points down and x along the track of a circular orbit."""
    dcm_OH = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    mine = reference([7e6, 0.0, 0.0], [0.0, 7.5e3, 0.0], HillPoint.Params(dcm_RH=dcm_OH))
    axes_N = Rotation.from_mrp(mine.sigma_RN.copy()).as_matrix().T
    np.testing.assert_allclose(axes_N, [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(mine.omega_RN_N, [0.0, 0.0, 7.5e3 / 7e6], rtol=1e-15)


def test_no_orbital_plane_stops_the_run() -> None:
    orbit, hill = Orbit("orbit"), HillPoint("hill")
    orbit.out_trans.connect(hill.in_trans)
    with pytest.raises(ModuleError, match=r"hill.*no orbital plane"):
        Simulation([Task("flight", s(1), [orbit, hill])]).run_until(0)
    assert hill.out_ref.latest() is None


def test_nothing_before_the_first_message() -> None:
    orbit, hill = Orbit("orbit"), HillPoint("hill")
    orbit.out_trans.connect(hill.in_trans)
    hill.step(0)
    assert hill.out_ref.latest() is None


def test_wrong_parameter() -> None:
    with pytest.raises(ValueError, match="rotation matrix"):
        HillPoint.Params(dcm_RH=np.ones((3, 3)))
