"""RateDamping: the torque, its limit, and the fall of rotational energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from messages.base import F64
from messages.sensors import IMUSensorMsg
from modules.control.rate_damping import RateDamping
from tests.modules.control.actuator_rig import Feed

Criterion = Callable[[str, float], None]
INERTIA = np.array([[900.0, 12.0, -7.0], [12.0, 800.0, 20.0], [-7.0, 20.0, 600.0]])


def wired(**params: Any) -> tuple[Feed, RateDamping]:
    feed, damping = Feed("feed"), RateDamping("damping", RateDamping.Params(**params))
    feed.out_imu.connect(damping.in_imu)
    return feed, damping


def torque(feed: Feed, damping: RateDamping, omega: F64) -> F64:
    feed.out_imu.write(IMUSensorMsg(omega_PN_P=omega, accel_P=np.full(3, np.nan)), 0)
    damping.step(0)
    message = damping.out_torque.latest()
    assert message is not None
    return message.torque_B


def test_rate_after_a_minute(criterion: Criterion) -> None:
    """A loop at 0.1 s by RK4 with the torque held, against DOP853 of I w' = -P w - w x I w, relative to the start."""

    def slope(t: float, w: F64, held: F64 | None = None) -> F64:
        given = -20.0 * w if held is None else held
        return np.asarray(np.linalg.solve(INERTIA, given - np.cross(w, INERTIA @ w)), np.float64)

    feed, damping = wired(P=20.0)
    start = np.array([0.05, -0.08, 0.06])
    w, h = start, 0.1
    for _ in range(600):
        u = torque(feed, damping, w)
        a = slope(0, w, u)
        b = slope(0, w + h / 2 * a, u)
        c = slope(0, w + h / 2 * b, u)
        w = w + h / 6 * (a + 2 * b + 2 * c + slope(0, w + h * c, u))
    exact = solve_ivp(slope, (0, 60), start, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    assert np.linalg.norm(exact) < 0.3 * np.linalg.norm(start)
    criterion("DAMPING-1", float(np.linalg.norm(w - exact) / np.linalg.norm(start)))


def test_limit_mounting_and_wanted_rate() -> None:
    omega = np.array([0.3, -0.4, 1.2])
    np.testing.assert_allclose(torque(*wired(P=2.0, max_torque=0.5), omega), -0.5 * omega / 1.3, rtol=1e-15)
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(torque(*wired(P=2.0, dcm_PB=turn), turn @ omega), -2.0 * omega, rtol=1e-15)
    np.testing.assert_allclose(torque(*wired(P=2.0, omega_RN_B=omega), omega), 0.0, atol=1e-16)


def test_bad_rate_gives_nan_and_nothing_before_the_first() -> None:
    feed, damping = wired()
    damping.step(0)
    assert damping.out_torque.latest() is None
    torque(feed, damping, np.ones(3))
    feed.out_imu.row["omega_PN_P"][0, 0] = np.nan
    damping.step(1)
    with pytest.raises(ValueError, match="NaN"):
        damping.out_torque.latest()


def test_wrong_parameters() -> None:
    with pytest.raises(ValueError, match="rotation matrix"):
        RateDamping.Params(dcm_PB=np.ones((3, 3)))
