"""WheelTorqueMap against numpy's pseudo-inverse and Basilisk's rwMotorTorque and rwNullSpace."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from messages.base import F64
from messages.control import CmdTorqueBodyMsg, RWSpeedMsg
from modules.control.wheel_torque_map import WheelTorqueMap
from tests.modules.control.actuator_rig import Feed, basilisk, padded, unit_rows

Criterion = Callable[[str, float], None]


def wired(axes: F64, limit: Any, **more: Any) -> tuple[Feed, WheelTorqueMap]:
    params = WheelTorqueMap.Params(wheel_axes_B=padded(axes), max_torque=padded(limit), **more)
    feed, wheels = Feed("feed"), WheelTorqueMap("map", params)
    feed.out_torque.connect(wheels.in_torque)
    feed.out_speeds.connect(wheels.in_speeds)
    return feed, wheels


def motors(feed: Feed, wheels: WheelTorqueMap, torque: Any, speeds: Any = None) -> F64:
    feed.out_torque.write(CmdTorqueBodyMsg(torque_B=np.array(torque, float)), 0)
    if speeds is not None:
        feed.out_speeds.write(RWSpeedMsg(omega=padded(speeds)), 0)
    wheels.step(0)
    message = wheels.out_motor.latest()
    assert message is not None
    return message.torque


def test_against_basilisk(criterion: Criterion) -> None:
    worst, worst_null = 0.0, 0.0
    for case in basilisk("maps"):
        axes, n = np.array(case["axes_B"]), len(case["axes_B"])
        control = np.zeros((3, 3))
        control[: len(case["control_axes_B"])] = case["control_axes_B"]
        feed, wheels = wired(axes, np.full(n, 1e9), control_axes_B=control)
        mine, theirs = motors(feed, wheels, case["torque_B"])[:n], np.array(case["motor"])
        worst = max(worst, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
        if len(case["control_axes_B"]) == 3:
            more = {"null_gain": case["null_gain"], "null_speed": padded(case["wanted"])}
            feed, wheels = wired(axes, np.full(n, 1e9), **more)
            mine = motors(feed, wheels, case["torque_B"], case["speeds"])[:n]
            theirs = np.array(case["with_null"])
            worst_null = max(worst_null, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
    criterion("TORQUEMAP-1", worst)
    criterion("TORQUEMAP-2", worst_null)


def test_pseudo_inverse(criterion: Criterion) -> None:
    """One to eight wheels, as many control axes as they reach, against numpy."""
    rng = np.random.default_rng(3)
    worst = 0.0
    for n in range(1, 9):
        axes, torque = unit_rows(rng, n), rng.normal(size=3)
        control = np.zeros((3, 3))
        control[: min(n, 3)] = axes[:1] if n == 1 else np.linalg.qr(axes[: min(n, 3)].T)[0].T
        feed, wheels = wired(axes, np.full(n, 1e6), control_axes_B=control)
        expected = -np.linalg.pinv(control @ axes.T) @ (control @ torque)
        mine = motors(feed, wheels, torque)
        worst = max(worst, float(np.linalg.norm(mine[:n] - expected) / np.linalg.norm(expected)))
        assert not mine[n:].any()
    criterion("TORQUEMAP-3", worst)


def test_limits_keep_the_direction_and_the_null_space_leaves_the_body_alone() -> None:
    rng = np.random.default_rng(5)
    axes, limit, torque = unit_rows(rng, 5), np.array([0.1, 0.2, 0.3, 0.1, 0.15]), np.array([0.9, -0.4, 0.7])
    given = motors(*wired(axes, limit), torque)[:5]
    body = -given @ axes
    np.testing.assert_allclose(np.cross(body, torque), 0.0, atol=1e-15)
    assert 0.0 < body @ torque < torque @ torque
    np.testing.assert_allclose(np.max(np.abs(given) / limit), 1.0, rtol=1e-15)
    speeds = rng.normal(size=5) * 100.0
    moved = motors(*wired(axes, limit, null_gain=0.01), 0.05 * torque, speeds)[:5]
    np.testing.assert_allclose(-moved @ axes, 0.05 * torque, rtol=1e-13)
    assert np.all(np.abs(moved) <= limit * (1.0 + 1e-15))
    np.testing.assert_allclose(np.max(np.abs(moved) / limit), 1.0, rtol=1e-14)


def test_null_space_evens_out_the_speeds() -> None:
    """A pyramid without any torque: the part of the speeds without momentum dies away, the rest stays."""
    axes = np.array([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]]) / np.sqrt(2.0)
    feed, wheels = wired(axes, np.full(4, 1.0), null_gain=0.01)
    speeds = np.array([100.0, 80.0, -20.0, 10.0])
    start = speeds @ axes
    for _ in range(300):
        speeds = speeds + 0.1 * motors(feed, wheels, np.zeros(3), speeds)[:4] / 0.01
    np.testing.assert_allclose(speeds @ axes, start, rtol=1e-12)
    np.testing.assert_allclose(speeds @ [1, 1, -1, -1], 0.0, atol=1e-9)


def test_bad_torque_gives_nan_for_every_wheel() -> None:
    feed, wheels = wired(np.eye(3), np.ones(3))
    wheels.step(0)
    assert wheels.out_motor.latest() is None
    motors(feed, wheels, [0.1, 0.2, 0.3])
    feed.out_torque.row["torque_B"][0, 1] = np.nan
    wheels.step(1)
    assert np.all(np.isnan(wheels.out_motor.row["torque"][0, :3]))


@pytest.mark.parametrize(
    ("axes", "limit", "text"),
    [
        (2.0 * np.eye(3), np.ones(3), "unit vectors"),
        (np.eye(3)[:2], np.ones(2), "reach 3 control axes"),
        (np.eye(3), np.array([1.0, 1.0, 0.0]), "reach 3 control axes"),
        (np.eye(3), np.array([1.0, -1.0, 1.0]), ">= 0"),
    ],
)
def test_wrong_parameters(axes: F64, limit: F64, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        WheelTorqueMap.Params(wheel_axes_B=padded(axes), max_torque=padded(limit))
