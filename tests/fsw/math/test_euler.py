"""The twelve Euler sequences against scipy, Basilisk's vectors and differences of the rotation."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from fsw.math import euler
from fsw.math.vectors import M3, V3, V4
from messages.base import F64

PATH = Path(__file__).parents[2] / "data" / "basilisk_rigid_body_kinematics.json"
DATA: dict[str, Any] = json.loads(PATH.read_text())
SEQUENCES = [121, 123, 131, 132, 212, 213, 231, 232, 312, 313, 321, 323]
ULPS = 8 * np.finfo(float).eps  # products of three matrices whose elements carry a rounding each


def v3(x: Any) -> V3:
    return (float(x[0]), float(x[1]), float(x[2]))


def v4(x: Any) -> V4:
    return (float(x[0]), float(x[1]), float(x[2]), float(x[3]))


def m3(x: Any) -> M3:
    return (v3(x[0]), v3(x[1]), v3(x[2]))


def close(a: Any, b: Any, tolerance: float = ULPS) -> None:
    np.testing.assert_allclose(np.array(a), np.array(b), rtol=0, atol=tolerance)


def by_scipy(sequence: int, angles: Any) -> F64:
    """dcm_BN: scipy's intrinsic rotation turns vectors, so its matrix is the transposed."""
    axes = "".join("?XYZ"[int(c)] for c in str(sequence))
    return Rotation.from_euler(axes, angles).as_matrix().T


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_angles_both_ways_against_scipy(sequence: int) -> None:
    rng = np.random.default_rng(sequence)
    proper = sequence // 100 == sequence % 10
    for _ in range(20):
        angles = rng.uniform(-3.1, 3.1, 3)
        angles[1] = rng.uniform(0.05, 3.09) if proper else rng.uniform(-1.52, 1.52)
        dcm = by_scipy(sequence, angles)
        close(euler.euler_to_dcm(sequence, v3(angles)), dcm)
        # an error of the matrix grows by the inverse of the sine that the outer angles come from
        sine = abs(math.sin(angles[1]) if proper else math.cos(angles[1]))
        close(euler.dcm_to_euler(sequence, m3(dcm)), angles, 2 * ULPS / sine)
        beta = Rotation.from_matrix(dcm.T).as_quat(canonical=True, scalar_first=True)
        close(euler.euler_to_ep(sequence, v3(angles)), beta)
        close(euler.ep_to_euler(sequence, v4(beta)), angles, 2 * ULPS / sine)


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("off", [0.0, 1e-17, 1e-15, 1e-12, 1e-8, 1e-4])
def test_rotation_survives_gimbal_lock(sequence: int, off: float) -> None:
    proper = sequence // 100 == sequence % 10
    for end in (0.0, math.pi) if proper else (math.pi / 2, -math.pi / 2):
        dcm = by_scipy(sequence, [0.7, end - math.copysign(off, end) if end else off, -1.9])
        found = euler.dcm_to_euler(sequence, m3(dcm))
        close(by_scipy(sequence, found), dcm)


@pytest.mark.parametrize("case", DATA["euler"])
def test_sequences_against_basilisk(case: dict[str, Any]) -> None:
    sequence, angles, second = int(case["seq"]), v3(case["angles"]), v3(case["angles2"])
    close(euler.euler_to_dcm(sequence, angles), case["euler2C"], 1e-15)
    beta = np.array(case["euler2EP"])
    close(euler.euler_to_ep(sequence, angles), math.copysign(1.0, beta[0]) * beta, 1e-15)
    omega, rates = v3(case["omega"]), v3(case["rates"])
    size = float(np.abs(case["Bmat"]).max())
    close(euler.euler_matrix(sequence, angles), case["Bmat"], 4e-15 * size)
    close(euler.euler_rates(sequence, angles, omega), rates, 8e-15 * size)
    close(euler.euler_rates_to_omega(sequence, angles, rates), omega, 8e-15 * size)
    # first the angles, then the second: compare as rotations, which have no branches
    close(by_scipy(sequence, euler.euler_compose(sequence, second, angles)), by_scipy(sequence, case["add"]), 4e-15)
    close(by_scipy(sequence, euler.euler_relative(sequence, angles, second)), by_scipy(sequence, case["sub"]), 4e-15)


@pytest.mark.parametrize("case", DATA["attitudes"])
def test_angles_of_matrices_against_basilisk(case: dict[str, Any]) -> None:
    dcm = m3(case["MRP2C"])
    for sequence in SEQUENCES:
        found, known = euler.dcm_to_euler(sequence, dcm), case[f"C2Euler{sequence}"]
        proper = sequence // 100 == sequence % 10
        sine = abs(math.sin(known[1]) if proper else math.cos(known[1]))
        close(by_scipy(sequence, found), dcm, 2e-15)
        if sine > 1e-3:  # next to gimbal lock Basilisk's angles depend on rounding
            close(np.exp(1j * np.array(found)), np.exp(1j * np.array(known)), 1e-14 / sine)


@pytest.mark.parametrize("sequence", SEQUENCES)
def test_rates_against_the_matrix_exponential(sequence: int) -> None:
    angles, omega = (0.4, 1.1, -0.8), np.array([0.3, -1.2, 0.7])
    cross = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
    dcm, step = by_scipy(sequence, angles), 1e-5
    ahead = euler.dcm_to_euler(sequence, m3(expm(-cross * step) @ dcm))
    behind = euler.dcm_to_euler(sequence, m3(expm(cross * step) @ dcm))
    numeric = (np.array(ahead) - np.array(behind)) / (2 * step)
    close(euler.euler_rates(sequence, angles, v3(omega)), numeric, 1e-8)  # third derivatives times step^2
    close(euler.euler_rates_to_omega(sequence, angles, euler.euler_rates(sequence, angles, v3(omega))), omega, 2e-15)


def test_gimbal_lock_has_no_rates() -> None:
    assert np.isnan(euler.euler_rates(321, (0.1, math.pi / 2, 0.2), (0.1, 0.2, 0.3))).all()
    assert np.isnan(euler.euler_matrix(313, (0.1, 0.0, 0.2))).all()


@pytest.mark.parametrize("sequence", [0, 122, 112, 320, 421, 32, 3211, -321])
def test_what_is_no_sequence_is_refused(sequence: int) -> None:
    with pytest.raises(ValueError, match="Euler sequence: expected three axes such as 321"):
        euler.euler_to_dcm(sequence, (0.1, 0.2, 0.3))
