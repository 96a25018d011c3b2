"""OpNavPoint against Basilisk, and what it does when measurements stop."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, s
from messages.attitude import AttGuidMsg
from messages.base import F64
from messages.opnav import CameraConfigMsg, OpNavDirectionMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.guidance.opnav_point import OpNavPoint

Criterion = Callable[[str, float], None]
SEARCH = np.array([0.01, -0.02, 0.03])


class Feed(Module):
    """Holds what a test writes."""

    out_att = Out(NavAttMsg)
    out_camera = Out(CameraConfigMsg)
    out_position = Out(OpNavMsg)
    out_direction = Out(OpNavDirectionMsg)


def dcm(sigma: Any) -> F64:
    """dcm_BN of an MRP of any set, by scipy."""
    return Rotation.from_mrp(np.array(sigma)).as_matrix().T


class Rig:
    """A module with its sources."""

    def __init__(self, dcm_CB: F64 | None = None, **params: Any) -> None:
        self.feed, self.point = Feed("feed"), OpNavPoint("point", OpNavPoint.Params(**params))
        feed, point = self.feed, self.point
        feed.out_att.connect(point.in_att)
        feed.out_camera.connect(point.in_camera)
        feed.out_position.connect(point.in_position)
        feed.out_direction.connect(point.in_direction)
        numbers: dict[str, Any] = {"width_px": 512, "height_px": 512, "focal_px": np.full(2, 500.0)}
        mounted = np.eye(3) if dcm_CB is None else dcm_CB
        feed.out_camera.write(CameraConfigMsg(center_px=np.full(2, 255.5), dcm_CB=mounted, **numbers), 0)

    def position(self, r_CP_N: F64, t_ns: int, valid: bool = True) -> None:
        fields: dict[str, Any] = {f"r_CP_{f}": np.full(3, np.nan) for f in "BC"}
        fields |= {f"P_rr_{f}": np.full((3, 3), np.nan) for f in "NBC"}
        fields |= {"exposure_ns": t_ns, "status": 0, "fault_detected": False, "body_id": 499}
        self.feed.out_position.write(OpNavMsg(valid=valid, r_CP_N=r_CP_N, **fields), t_ns)

    def direction(self, u_PC_N: F64, t_ns: int) -> None:
        fields: dict[str, Any] = {f"u_PC_{f}": np.full(3, np.nan) for f in "BC"}
        fields |= {f"P_uu_{f}": np.full((3, 3), np.nan) for f in "NBC"}
        fields |= {"exposure_ns": t_ns, "status": 0, "body_id": 499}
        self.feed.out_direction.write(OpNavDirectionMsg(valid=True, u_PC_N=u_PC_N, **fields), t_ns)

    def step(self, sigma: Any, omega: Any, t_ns: int) -> AttGuidMsg:
        self.feed.out_att.write(NavAttMsg(sigma_BN=np.array(sigma), omega_BN_B=np.array(omega)), t_ns)
        self.point.step(t_ns)
        message = self.point.out_guid.latest()
        assert message is not None
        return message


def test_against_basilisk(criterion: Criterion) -> None:
    """Twelve calls with gaps; its error, which is in C components, turned into B.

    At half a turn another way about is chosen, which is as short.
    """
    path = Path(__file__).parents[2] / "data" / "basilisk_opnav_point.json"
    worst = 0.0
    for case in json.loads(path.read_text())["cases"]:
        dcm_CB = dcm(case["sigma_CB"])
        rig = Rig(
            dcm_CB,
            align_axis_C=np.array(case["alignAxis_C"]),
            timeout=case["timeOut"],
            search_rate_B=np.array(case["omega_RN_B"]),
            small_angle=case["smallAngle"],
        )
        for step in case["steps"]:
            att, t = step["att"], step["t"]
            r_N = (dcm_CB @ dcm(att["sigma_BN"])).T @ step["r_BN_C"]
            rig.position(r_N, t, bool(step["valid"]))
            mine = rig.step(att["sigma_BN"], att["omega_BN_B"], t)
            if np.linalg.norm(step["sigma_BR"]) < 0.999:
                worst = max(worst, float(np.max(np.abs(mine.sigma_BR - dcm_CB.T @ step["sigma_BR"]))))
            else:
                np.testing.assert_allclose(np.linalg.norm(mine.sigma_BR), np.linalg.norm(step["sigma_BR"]), rtol=1e-9)
            worst = max(worst, float(np.max(np.abs(mine.omega_BR_B - step["omega_BR_B"]))))
            worst = max(worst, float(np.max(np.abs(mine.omega_RN_B - step["omega_RN_B"]))))
    criterion("OPNAVPOINT-1", worst)


def test_the_turn_brings_the_axis_to_the_body(criterion: Criterion) -> None:
    """The reference attitude, made by scipy from body and error, has the axis of the camera along the direction."""
    rng = np.random.default_rng(1)
    worst = 0.0
    for k in range(30):
        mount, body = Rotation.random(rng=rng).as_matrix(), Rotation.random(rng=rng)
        axis, away = rng.normal(size=3), rng.normal(size=3) * 1e7
        if k == 0:  # opposite
            away = body.apply(mount.T @ axis)
        rig = Rig(mount, align_axis_C=axis)
        if k % 2:
            rig.direction(-away / np.linalg.norm(away), 0)
        else:
            rig.position(away, 0)
        error = rig.step(body.as_mrp(), np.zeros(3), 0).sigma_BR
        reference = body * Rotation.from_mrp(error.copy()).inv()  # maps R to N components
        looks = reference.apply(mount.T @ axis / np.linalg.norm(axis))
        worst = max(worst, float(np.linalg.norm(looks + away / np.linalg.norm(away))))
        assert np.linalg.norm(error) <= 1.0 + 1e-12
    criterion("OPNAVPOINT-2", worst)


def test_timeout_search_and_spin() -> None:
    rig = Rig(timeout=10.0, search_rate_B=SEARCH, spin_rate=0.002)
    omega = np.array([0.1, 0.2, 0.3])
    lost = rig.step(np.zeros(3), omega, 0)
    np.testing.assert_array_equal(lost.sigma_BR, 0.0)
    np.testing.assert_allclose(lost.omega_BR_B, omega - SEARCH, rtol=1e-15)
    rig.position(np.array([0.0, -1e7, 0.0]), s(1))
    seen = rig.step(np.zeros(3), omega, s(5))
    np.testing.assert_allclose(seen.sigma_BR, [np.tan(np.pi / 8), 0.0, 0.0], rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(seen.omega_RN_B, [0.0, 0.002, 0.0], atol=1e-17)
    rig.position(np.array([0.0, 0.0, -1e7]), s(6), valid=False)
    assert rig.step(np.zeros(3), omega, s(10)).sigma_BR[0] > 0.4, "an invalid position changes nothing"
    np.testing.assert_array_equal(rig.step(np.zeros(3), omega, s(11)).omega_RN_B, SEARCH)


def test_older_and_bad_measurements_are_left_out() -> None:
    rig = Rig()
    rig.position(np.array([0.0, 0.0, -1e7]), s(5))
    rig.step(np.zeros(3), np.zeros(3), s(5))
    rig.direction(np.array([1.0, 0.0, 0.0]), s(4))
    np.testing.assert_array_equal(rig.step(np.zeros(3), np.zeros(3), s(6)).sigma_BR, 0.0)
    rig.position(np.full(3, np.nan), s(7))
    np.testing.assert_array_equal(rig.step(np.zeros(3), np.zeros(3), s(7)).sigma_BR, 0.0)
    before = rig.point.out_guid.seq
    rig.feed.out_att.row["omega_BN_B"] = np.nan
    rig.point.step(s(8))
    assert rig.point.out_guid.seq == before


def test_wrong_axis() -> None:
    with pytest.raises(ValueError, match="align_axis_C: expected a vector longer"):
        Rig(align_axis_C=np.zeros(3))
