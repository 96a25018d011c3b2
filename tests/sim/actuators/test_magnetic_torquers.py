"""MagneticTorquers against numpy, the exponential of a lag, and Basilisk's MtbEffector."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, ms
from messages.base import F64
from messages.control import MTBDipoleMsg
from messages.environment import MagneticFieldMsg
from messages.states import SCStatesMsg
from sim.actuators.magnetic_torquers import MagneticTorquers

Criterion = Callable[[str, float], None]
FIELD = np.array([2e-5, -1e-5, 4e-5])


class Feed(Module):
    """Holds what a test writes."""

    out_state = Out(SCStatesMsg)
    out_field = Out(MagneticFieldMsg)
    out_dipole = Out(MTBDipoleMsg)


def padded(a: Any) -> F64:
    """Eight places."""
    a = np.asarray(a, float)
    return np.concatenate([a, np.zeros((8 - len(a), *a.shape[1:]))])


def wired(axes: Any, limit: Any, sigma: F64, **more: Any) -> tuple[Feed, MagneticTorquers]:
    params = MagneticTorquers.Params(axes_B=padded(axes), max_dipole=padded(limit), **more)
    feed, torquers = Feed("feed"), MagneticTorquers("torquers", params)
    feed.out_state.connect(torquers.in_state)
    feed.out_field.connect(torquers.in_field)
    feed.out_dipole.connect(torquers.in_dipole)
    nothing = dict.fromkeys(("r_BN_N", "v_BN_N", "omega_BN_B", "omegaDot_BN_B"), np.zeros(3))
    feed.out_state.write(SCStatesMsg(sigma_BN=sigma, **nothing), 0)
    return feed, torquers


def torque_of(feed: Feed, torquers: MagneticTorquers, command: Any, field: Any, t_ns: int = 0) -> F64:
    feed.out_field.write(MagneticFieldMsg(B_N=np.array(field)), t_ns)
    feed.out_dipole.write(MTBDipoleMsg(dipole=padded(command)), t_ns)
    torquers.step(t_ns)
    message = torquers.out_torque.latest()
    assert message is not None
    return message.torque_B


def test_torque(criterion: Criterion) -> None:
    rng = np.random.default_rng(1)
    worst = 0.0
    for n in range(1, 9):
        axes = rng.normal(size=(n, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        limit, command, turn = rng.uniform(0.2, 2.0, n), rng.normal(size=n), Rotation.random(rng=rng)
        feed, torquers = wired(axes, limit, turn.as_mrp(), residual_B=np.array([0.1, -0.2, 0.3]))
        mine = torque_of(feed, torquers, command, FIELD)
        dipole = np.array([0.1, -0.2, 0.3]) + np.clip(command, -limit, limit) @ axes
        expected = np.cross(dipole, turn.inv().apply(FIELD))
        worst = max(worst, float(np.linalg.norm(mine - expected) / np.linalg.norm(expected)))
    criterion("TORQUERS-1", worst)


def test_lag(criterion: Criterion) -> None:
    """A step of the command through uneven steps; the torque follows in the same way."""
    feed, torquers = wired(np.eye(3), [5.0, 5.0, 5.0], np.zeros(3), time_constant=0.3)
    worst, torque = 0.0, np.zeros(3)
    for t in (0, 50, 120, 500, 1300):
        torque = torque_of(feed, torquers, [2.0, 0.0, -9.0], FIELD, ms(t))
        expected = np.array([2.0, 0.0, -5.0]) * -np.expm1(-t * 1e-3 / 0.3)
        worst = max(worst, float(np.max(np.abs(torquers.state.dipole[:3] - expected))) / 5.0)
    np.testing.assert_allclose(torque, np.cross(torquers.state.dipole[:3], FIELD), rtol=1e-14)
    criterion("TORQUERS-2", worst)


def test_against_basilisk(criterion: Criterion) -> None:
    path = Path(__file__).parents[2] / "data" / "basilisk_magnetic_torquers.json"
    worst = 0.0
    for case in json.loads(path.read_text())["cases"]:
        feed, torquers = wired(case["axes_B"], case["max_dipole"], np.array(case["sigma_BN"]))
        mine, theirs = torque_of(feed, torquers, case["command"], case["B_N"]), np.array(case["torque_B"])
        worst = max(worst, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
    criterion("TORQUERS-3", worst)


def test_bad_command_and_missing_field() -> None:
    feed, torquers = wired(np.eye(3), [1.0, 1.0, 1.0], np.zeros(3))
    torquers.step(0)
    assert torquers.out_torque.latest() is None
    torque_of(feed, torquers, [0.5, 0.0, 0.0], FIELD)
    feed.out_dipole.row["dipole"][0, 1] = np.nan
    with pytest.raises(ValueError, match=r"in_dipole\.dipole"):
        torquers.step(1)
    assert torquers.out_torque.t_ns == 0
    np.testing.assert_array_equal(torquers.state.dipole[:3], [0.5, 0.0, 0.0])


def test_wrong_axes() -> None:
    with pytest.raises(ValueError, match="axes_B: expected unit vectors"):
        MagneticTorquers.Params(axes_B=padded(2.0 * np.eye(3)), max_dipole=padded([1.0]))
