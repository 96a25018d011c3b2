"""BDot: the command of a known rotation, its filter, and a tumble that dies away."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fsw import ms
from messages.base import F64
from messages.sensors import TAMSensorMsg
from modules.control.b_dot import BDot
from tests.modules.control.actuator_rig import Feed, padded, unit_rows

Criterion = Callable[[str, float], None]
TURN = np.array([0.0, 0.0, 0.01])
FIELD = np.array([2e-5, -1e-5, 3e-5])


def wired(coils: Any = None, limit: float = 1e6, **more: Any) -> tuple[Feed, BDot]:
    coils = np.eye(3) if coils is None else coils
    params = BDot.Params(torquer_axes_B=padded(coils), max_dipole=padded(np.full(len(coils), limit)), **more)
    feed, law = Feed("feed"), BDot("law", params)
    feed.out_field.connect(law.in_field)
    return feed, law


def command(feed: Feed, law: BDot, field: F64, t_ns: int) -> F64 | None:
    feed.out_field.write(TAMSensorMsg(B_S=field), t_ns)
    law.step(t_ns)
    message = law.out_dipole.latest()
    return None if message is None else message.dipole


def test_command_of_a_rotation(criterion: Criterion) -> None:
    """Samples 1 ms apart in a body that turns at w: the dipole is -k/|B| (B x w), spread over five coils."""
    rng = np.random.default_rng(2)
    coils, w = unit_rows(rng, 5), np.array([0.02, -0.05, 0.03])
    feed, law = wired(coils, gain=50.0)
    assert command(feed, law, Rotation.from_rotvec(-0.0005 * -w).apply(FIELD), 0) is None
    dipole = command(feed, law, Rotation.from_rotvec(-0.0005 * w).apply(FIELD), ms(1))
    assert dipole is not None
    expected = -50.0 / np.linalg.norm(FIELD) * np.cross(FIELD, w)
    criterion("BDOT-1", float(np.linalg.norm(dipole[:5] @ coils - expected) / np.linalg.norm(expected)))


def test_tumble_dies_away(criterion: Criterion) -> None:
    """A sphere in a field that turns slowly, sampled at 0.2 s, against DOP853 of I w' = m x B.

    The law takes the turn of the field for rotation: m = -k/|B| (B x (w - w_field)).
    """
    inertia, gain, h = 0.05, 5.0, 0.2

    def field_N(t: float) -> F64:
        return 4e-5 * np.array([np.cos(0.01 * t), np.sin(0.01 * t), 0.3])

    def slope(t: float, w: F64) -> F64:
        """In N components: a sphere has the same inertia about all axes."""
        b = field_N(t)
        return np.cross(-gain / np.linalg.norm(b) * np.cross(b, w - TURN), b) / inertia

    start = np.array([0.2, -0.1, 0.15])
    feed, law = wired(gain=gain)
    w, turn = start, Rotation.identity()
    for k in range(3000):
        b = field_N(h * k)
        dipole = command(feed, law, turn.inv().apply(b), round(k * h * 1e9))
        if dipole is not None:
            w = w + h * np.cross(turn.apply(dipole[:3].copy()), field_N(h * k)) / inertia
        turn = Rotation.from_rotvec(h * w) * turn
    exact = solve_ivp(slope, (0, 600), start, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    assert np.linalg.norm(exact - TURN) < 0.3 * np.linalg.norm(start - TURN)
    criterion("BDOT-2", float(np.linalg.norm(w - exact)))


def test_filter_and_limit() -> None:
    feed, law = wired(limit=2.0, gain=1e6, time_constant=1.0)
    command(feed, law, FIELD, 0)
    dipole = command(feed, law, FIELD + np.array([1e-7, 2e-7, 0.0]), ms(100))
    np.testing.assert_allclose(law.state.rate_S, -np.expm1(-0.1) * np.array([1e-6, 2e-6, 0.0]), rtol=1e-9)
    assert dipole is not None
    np.testing.assert_allclose(dipole[:3], [-1.0, -2.0, 0.0], rtol=1e-9)


def test_late_repeated_and_bad_samples() -> None:
    feed, law = wired()
    command(feed, law, FIELD, 0)
    law.step(ms(50))
    assert law.out_dipole.seq == 0, "the same sample again"
    command(feed, law, FIELD + 1e-7, ms(100))
    feed.out_field.row["B_S"][0, 0], feed.out_field.row["t_ns"] = np.nan, ms(200)
    law.step(ms(200))
    assert law.out_dipole.seq == 1
    assert law.state.sample_ns == ms(100)


def test_wrong_parameters() -> None:
    with pytest.raises(ValueError, match="reach 3 control axes"):
        wired(np.eye(3)[:2])
