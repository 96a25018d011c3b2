"""MagneticMomentumDump against Basilisk's three modules, and in a loop with wheels, torquers and a turning field."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from messages.base import F64
from messages.control import RWSpeedMsg
from messages.sensors import TAMSensorMsg
from modules.control.magnetic_momentum_dump import MagneticMomentumDump
from tests.modules.control.actuator_rig import Feed, basilisk, padded

Criterion = Callable[[str, float], None]


def wired(axes: Any, inertia: Any, coils: Any, limit: Any, **more: Any) -> tuple[Feed, MagneticMomentumDump]:
    params = MagneticMomentumDump.Params(
        wheel_axes_B=padded(axes),
        wheel_inertia=padded(inertia),
        torquer_axes_B=padded(coils),
        max_dipole=padded(limit),
        **more,
    )
    feed, dump = Feed("feed"), MagneticMomentumDump("dump", params)
    feed.out_speeds.connect(dump.in_speeds)
    feed.out_field.connect(dump.in_field)
    return feed, dump


def dipoles(feed: Feed, dump: MagneticMomentumDump, speeds: Any, field: Any) -> F64:
    feed.out_speeds.write(RWSpeedMsg(omega=padded(speeds)), 0)
    feed.out_field.write(TAMSensorMsg(B_S=np.array(field)), 0)
    dump.step(0)
    message = dump.out_dipole.latest()
    assert message is not None
    return message.dipole


def test_against_basilisk(criterion: Criterion) -> None:
    worst = 0.0
    for case in basilisk("dumps"):
        coils = case["torquer_axes_B"]
        many = np.full(len(coils), 1e9)
        feed, dump = wired(case["axes_B"], case["inertia"], coils, many, gain=case["gain"])
        mine, theirs = dipoles(feed, dump, case["speeds"], case["B_B"])[: len(coils)], np.array(case["dipole"])
        worst = max(worst, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
    criterion("DUMP-1", worst)


def test_momentum_falls_in_a_turning_field(criterion: Criterion) -> None:
    """Momentum in a field that turns about z, by the torque m x B on it, against DOP853 of the law without limits."""
    from scipy.integrate import solve_ivp

    def field(t: float) -> F64:
        return 3e-5 * np.array([np.cos(0.002 * t), np.sin(0.002 * t), 0.4])

    def law(t: float, h: F64) -> F64:
        b = field(t) / np.linalg.norm(field(t))
        return -2e-3 * (h - b * (b @ h))

    feed, dump = wired(np.eye(3), [0.1] * 3, np.eye(3), [1e6] * 3, gain=2e-3)
    h = np.array([1.0, -2.0, 3.0])
    for k in range(3000):
        b = field(k + 0.5)
        h = h + np.cross(dipoles(feed, dump, h / 0.1, b)[:3], b)
    exact = solve_ivp(law, (0, 3000), [1.0, -2.0, 3.0], "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    assert np.linalg.norm(exact) < 0.02 * np.sqrt(14.0)
    criterion("DUMP-2", float(np.linalg.norm(h - exact) / np.sqrt(14.0)))


def test_saturation_keeps_the_direction_and_takes_momentum() -> None:
    feed, dump = wired(np.eye(3), [0.1] * 3, np.eye(3), [5.0, 5.0, 5.0])
    h, b = np.array([10.0, -20.0, 15.0]), np.array([2e-5, 1e-5, -3e-5])
    dipole = dipoles(feed, dump, h / 0.1, b)[:3]
    assert np.max(np.abs(dipole)) == pytest.approx(5.0, rel=1e-15)
    np.testing.assert_allclose(np.cross(dipole, np.cross(b, h)), 0.0, atol=1e-12 * float(np.linalg.norm(h)))
    assert np.cross(dipole, b) @ h < 0.0


def test_target_mounting_and_weak_field() -> None:
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    h, b = np.array([0.3, -0.2, 0.1]), np.array([2e-5, 1e-5, -3e-5])
    plain = dipoles(*wired(np.eye(3), [0.1] * 3, np.eye(3), [1e3] * 3), h / 0.1, b)
    turned = dipoles(*wired(np.eye(3), [0.1] * 3, np.eye(3), [1e3] * 3, dcm_SB=turn), h / 0.1, turn @ b)
    np.testing.assert_allclose(turned, plain, rtol=1e-14)
    kept = dipoles(*wired(np.eye(3), [0.1] * 3, np.eye(3), [1e3] * 3, target_B=h), h / 0.1, b)
    np.testing.assert_allclose(kept, 0.0, atol=1e-12)
    weak = dipoles(*wired(np.eye(3), [0.1] * 3, np.eye(3), [1e3] * 3), h / 0.1, 0.01 * b)
    np.testing.assert_array_equal(weak, 0.0)


def test_bad_field_gives_nan_and_nothing_before_the_first() -> None:
    feed, dump = wired(np.eye(3), [0.1] * 3, np.eye(3), [5.0] * 3)
    dump.step(0)
    assert dump.out_dipole.latest() is None
    dipoles(feed, dump, [1.0, 2.0, 3.0], [2e-5, 1e-5, -3e-5])
    feed.out_field.row["B_S"][0, 0] = np.nan
    dump.step(1)
    assert np.all(np.isnan(dump.out_dipole.row["dipole"][0, :3]))


def test_wrong_parameters() -> None:
    with pytest.raises(ValueError, match="torquer_axes_B: expected axes that reach 3"):
        wired(np.eye(3), [0.1] * 3, np.eye(3)[:2], [5.0] * 2)
    with pytest.raises(ValueError, match="wheel_axes_B: expected unit vectors"):
        wired(2.0 * np.eye(3), [0.1] * 3, np.eye(3), [5.0] * 3)
