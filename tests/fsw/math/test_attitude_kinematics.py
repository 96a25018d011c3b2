"""Matrices, second rates and the exponential map of attitudes against Basilisk's vectors, mpmath and scipy."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from fsw.math import attitude as at
from fsw.math.vectors import V3, V4

PATH = Path(__file__).parents[2] / "data" / "basilisk_rigid_body_kinematics.json"
DATA: dict[str, Any] = json.loads(PATH.read_text())
MPMATH: Any = mpmath


def v3(x: Any) -> V3:
    return (float(x[0]), float(x[1]), float(x[2]))


def v4(x: Any) -> V4:
    return (float(x[0]), float(x[1]), float(x[2]), float(x[3]))


def close(a: Any, b: Any, tolerance: float) -> None:
    np.testing.assert_allclose(np.array(a), np.array(b), rtol=0, atol=tolerance)


@pytest.mark.parametrize("case", DATA["operations"])
def test_matrices_against_basilisk(case: dict[str, Any]) -> None:
    q, beta = v3(case["q1"]), v4(case["b1"])
    q_dot, omega, omega_dot = v3(case["dMRP"]), v3(case["omega"]), v3(case["omegaDot"])
    big = 1.0 + float(np.abs(case["BmatMRP"]).max() + np.abs(case["BdotmatMRP"]).max())
    close(at.mrp_matrix(q), case["BmatMRP"], 1e-15 * big)
    inverse = np.array(at.mrp_matrix(q)).T / (1.0 + float(np.dot(q, q))) ** 2
    close(inverse, case["BinvMRP"], 2e-15)
    close(at.mrp_matrix_rate(q, q_dot), case["BdotmatMRP"], 1e-15 * big)
    close(at.mrp_second_rate(q, q_dot, omega, omega_dot), case["ddMRP"], 4e-15 * big)
    back = at.mrp_second_rate_to_omega_dot(q, q_dot, v3(case["ddMRP"]))
    close(back, omega_dot, 2e-14 * big)
    close(at.ep_matrix(beta), case["BmatEP"], 0.0)
    close(np.array(at.ep_matrix(beta)).T, case["BinvEP"], 0.0)
    close(at.ep_rate_to_omega(beta, v4(case["dEP"])), omega, 8e-15)


@pytest.mark.parametrize("case", DATA["attitudes"])
def test_principal_rotation_and_gibbs_against_basilisk(case: dict[str, Any]) -> None:
    beta = v4(np.array(case["C2EP"]))
    sigma = v3(case["mrp"])
    phi = np.array(case["MRP2PRV"])
    # Basilisk keeps rotations of more than half a turn: compare as rotations
    close(Rotation.from_rotvec(at.mrp_to_rotvec(sigma)).as_matrix(), Rotation.from_rotvec(phi).as_matrix(), 4e-15)
    close(at.mrp_to_dcm(at.rotvec_to_mrp(v3(phi))), case["MRP2C"], 4e-15)
    axis, angle = at.ep_to_axis_angle(beta)
    close(at.ep_to_dcm(at.axis_angle_to_ep((3.0 * axis[0], 3.0 * axis[1], 3.0 * axis[2]), angle)), case["MRP2C"], 4e-15)
    assert 0.0 <= angle <= math.pi
    gibbs = np.array(case["MRP2Gibbs"], float)
    if np.abs(gibbs).max() < 1e3:
        close(at.ep_to_gibbs(at.mrp_to_ep(sigma)), gibbs, 4e-15 * (1.0 + float(gibbs @ gibbs)))
        close(at.ep_to_dcm(at.gibbs_to_ep(v3(gibbs))), case["MRP2C"], 4e-15)


def test_no_turn_has_axis_x_and_no_axis_is_refused() -> None:
    assert at.ep_to_axis_angle((1.0, 0.0, 0.0, 0.0)) == ((1.0, 0.0, 0.0), 0.0)
    assert np.isnan(at.axis_angle_to_ep((0.0, 0.0, 0.0), 1.0)[1:]).all()


def test_exponential_map_after_1000_steps() -> None:
    """A constant rate for 1000 steps is one turn about its axis, and the Euler parameters stay of length 1."""
    omega, dt = np.array([0.3, -1.2, 0.7]), 0.1
    beta = v4(Rotation.from_rotvec([0.4, 0.1, -0.2]).as_quat(canonical=True, scalar_first=True))
    start = np.array(at.ep_to_dcm(beta))
    for _ in range(1000):
        beta = at.ep_step(beta, v3(omega), dt)
    cross = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
    angle = float(np.linalg.norm(omega)) * 100.0
    unit = cross / np.linalg.norm(omega)
    turned = (np.eye(3) - math.sin(angle) * unit + (1.0 - math.cos(angle)) * unit @ unit) @ start
    close(at.ep_to_dcm(beta), turned, 1e-12)
    assert abs(float(np.linalg.norm(beta)) - 1.0) < 4e-16


def test_rotation_matrix_is_the_exponential() -> None:
    for phi in (np.array([0.4, -0.7, 1.9]), np.array([0.0, 3.0, 0.1])):
        cross = np.array([[0, -phi[2], phi[1]], [phi[2], 0, -phi[0]], [-phi[1], phi[0], 0]])
        close(at.rotvec_to_dcm(v3(phi)), expm(-cross), 4e-15)


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.0099, 0.0101, 0.1, 1.0, 3.0, 5.0])
def test_rotation_vector_kinematics_against_mpmath(angle: float) -> None:
    """Both coefficients in 40 digits, across the change from series to closed form."""
    axis, omega = np.array([0.48, -0.6, 0.64]), np.array([0.3, -1.2, 0.7])
    phi = angle * axis
    with MPMATH.workdps(40):
        length = MPMATH.sqrt(sum(MPMATH.mpf(float(x)) ** 2 for x in phi))
        k = float((1 - length / 2 * MPMATH.cot(length / 2)) / length**2)
        a, b = float((1 - MPMATH.cos(length)) / length**2), float((1 - MPMATH.sin(length) / length) / length**2)
    rate = omega + 0.5 * np.cross(phi, omega) + k * np.cross(phi, np.cross(phi, omega))
    close(at.rotvec_rate(v3(phi), v3(omega)), rate, 1e-15 * (1.0 + k * angle**2) * 4)
    back = rate - a * np.cross(phi, rate) + b * np.cross(phi, np.cross(phi, rate))
    close(at.rotvec_rate_to_omega(v3(phi), v3(rate)), back, 8e-15)
    close(at.rotvec_rate_to_omega(v3(phi), v3(rate)), omega, 2e-14)


def test_rotation_vector_rate_is_that_of_the_rotation() -> None:
    phi, omega, step = np.array([0.4, -0.7, 1.1]), np.array([0.3, -1.2, 0.7]), 1e-5

    def later(t: float) -> V3:
        turn = at.rotvec_to_ep(v3(omega * t))
        return at.ep_to_rotvec(at.ep_compose(turn, at.rotvec_to_ep(v3(phi))))

    numeric = (np.array(later(step)) - np.array(later(-step))) / (2 * step)
    close(at.rotvec_rate(v3(phi), v3(omega)), numeric, 1e-9)
    assert np.isnan(at.rotvec_rate((0.0, 2.0 * math.pi, 0.0), (0.1, 0.2, 0.3))).all()
