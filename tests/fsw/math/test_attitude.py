"""Attitude functions against scipy's Rotation, mpmath and vectors computed with Basilisk."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from fsw.math import attitude as at
from fsw.math.vectors import M3, V3, V4
from messages.base import F64

DATA: dict[str, Any] = json.loads((Path(__file__).parents[2] / "data" / "basilisk_attitude.json").read_text())
ROTATIONS = Rotation.random(40, rng=np.random.default_rng(3))
# a matrix or vector element is a sum of four products of numbers below 1, after up to three roundings each
ULPS = 8 * np.finfo(float).eps


def v3(x: Any) -> V3:
    return (float(x[0]), float(x[1]), float(x[2]))


def v4(x: Any) -> V4:
    return (float(x[0]), float(x[1]), float(x[2]), float(x[3]))


def m3(x: Any) -> M3:
    return (v3(x[0]), v3(x[1]), v3(x[2]))


def beta_of(rotation: Rotation) -> V4:
    """Euler parameters of the frame that ``rotation`` turns N into; its matrix is the transposed of dcm_BN."""
    return v4(rotation.as_quat(scalar_first=True, canonical=True))


def close(a: Any, b: Any, tolerance: float = ULPS) -> None:
    np.testing.assert_allclose(np.array(a), np.array(b), rtol=0, atol=tolerance)


@pytest.mark.parametrize("k", range(40))
def test_conversions_against_scipy(k: int) -> None:
    rotation = ROTATIONS[k]
    beta, dcm = beta_of(rotation), m3(rotation.as_matrix().T)
    sigma, phi = v3(rotation.as_mrp()), v3(rotation.as_rotvec())
    close(at.ep_to_dcm(beta), dcm)
    close(at.dcm_to_ep(dcm), beta)
    close(at.ep_to_mrp(beta), sigma)
    close(at.mrp_to_ep(sigma), beta)
    close(at.mrp_to_dcm(sigma), dcm)
    close(at.dcm_to_mrp(dcm), sigma)
    close(at.rotvec_to_ep(phi), beta)
    close(at.ep_to_rotvec(beta), phi, 4 * ULPS)  # lengths up to pi
    close(at.rotvec_to_dcm(phi), dcm)
    close(at.dcm_to_rotvec(dcm), phi, 8 * ULPS)
    close(at.ep_normalize(v4(-7.0 * np.array(beta))), beta)


@pytest.mark.parametrize("k", range(0, 40, 2))
def test_composition_against_scipy(k: int) -> None:
    bn, cb = ROTATIONS[k], ROTATIONS[k + 1]
    cn = bn * cb  # the frames' own rotations compose in the other order than components
    close(at.ep_compose(beta_of(cb), beta_of(bn)), beta_of(cn))
    close(at.mrp_compose(v3(cb.as_mrp()), v3(bn.as_mrp())), cn.as_mrp(), 2 * ULPS)
    close(at.ep_relative(beta_of(cn), beta_of(bn)), beta_of(cb))
    close(at.mrp_relative(v3(cn.as_mrp()), v3(bn.as_mrp())), cb.as_mrp(), 2 * ULPS)
    close(at.ep_inverse(beta_of(bn)), beta_of(bn.inv()))


@pytest.mark.parametrize("case", DATA["attitudes"])
def test_conversions_against_basilisk(case: dict[str, Any]) -> None:
    sigma = v3(case["mrp"])
    dcm = m3(case["MRP2C"])
    close(at.mrp_to_dcm(sigma), dcm)
    ep = np.array(case["MRP2EP"]) * (1.0 if case["MRP2EP"][0] >= 0 else -1.0)
    close(at.mrp_to_ep(sigma), ep)
    if abs(case["C2EP"][0]) > 1e-6:  # at half a turn both signs are right
        close(at.dcm_to_ep(dcm), case["C2EP"], 4 * ULPS)
        close(at.dcm_to_mrp(dcm), case["C2MRP"], 4 * ULPS)
        close(at.dcm_to_rotvec(dcm), case["C2PRV"], 1e-14)
    close(at.mrp_to_dcm(at.mrp_inner(sigma)), dcm)
    assert np.linalg.norm(at.mrp_inner(sigma)) <= 1.0


@pytest.mark.parametrize("case", DATA["operations"])
def test_operations_against_basilisk(case: dict[str, Any]) -> None:
    q1, q2, omega = v3(case["q1"]), v3(case["q2"]), v3(case["omega"])
    b1, b2 = v4(case["b1"]), v4(case["b2"])
    # the outer set of the data and a rotation of half a turn lose some digits: compare as rotations
    close(at.mrp_to_dcm(at.mrp_compose(q2, q1)), at.mrp_to_dcm(v3(case["addMRP"])), 4e-15)
    close(at.mrp_to_dcm(at.mrp_relative(q1, q2)), at.mrp_to_dcm(v3(case["subMRP"])), 4e-15)
    add, sub = np.array(case["addEP"]), np.array(case["subEP"])
    close(at.ep_compose(b2, b1), add * (1.0 if add[0] >= 0 else -1.0), 4e-15)
    close(np.abs(at.ep_relative(b1, b2)), np.abs(sub), 4e-15)
    close(at.mrp_rate(q1, omega), case["dMRP"], 4e-15)
    close(at.mrp_rate_to_omega(q1, v3(case["dMRP"])), omega, 8e-15)
    close(at.ep_rate(b1, omega), case["dEP"], 4e-15)


def test_kinematics_against_matrix_exponential() -> None:
    """The derivative of a conversion, in 40 digits, for a frame that turns at a constant rate."""
    omega = np.array([0.3, -1.2, 0.7])
    cross = np.array([[0, -omega[2], omega[1]], [omega[2], 0, -omega[0]], [-omega[1], omega[0], 0]])
    dcm = ROTATIONS[5].as_matrix().T
    step = 1e-5

    def at_time(t: float) -> F64:
        return expm(-cross * t) @ dcm

    ahead, behind = at.dcm_to_ep(m3(at_time(step))), at.dcm_to_ep(m3(at_time(-step)))
    numeric = (np.array(ahead) - np.array(behind)) / (2 * step)
    close(at.ep_rate(at.dcm_to_ep(m3(dcm)), v3(omega)), numeric, 1e-9)  # central difference: 1e-10 and rounding 1e-11
    sigma = (np.array(at.dcm_to_mrp(m3(at_time(step)))) - np.array(at.dcm_to_mrp(m3(at_time(-step))))) / (2 * step)
    close(at.mrp_rate(at.dcm_to_mrp(m3(dcm)), v3(omega)), sigma, 1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-5, 9e-5, 2.1e-4, 1.0, 3.14, 4.0, 6.28, 12.0])
def test_rotation_vector_at_all_lengths_against_mpmath(angle: float) -> None:
    axis = np.array([0.48, -0.6, 0.64])
    phi = angle * axis
    with mpmath.workdps(40):
        half: Any = mpmath.sqrt(sum((mpmath.mpf(float(x)) ** 2 for x in phi), mpmath.mpf(0))) / 2
        k = mpmath.sin(half) / (2 * half) if half else mpmath.mpf("0.5")
        cosine: Any = mpmath.cos(half)
        sign = -1 if cosine < 0 else 1
        expected = [float(sign * cosine), *(float(sign * k * mpmath.mpf(float(x))) for x in phi)]
    got = at.rotvec_to_ep(v3(phi))
    # towards a whole turn the sine vanishes, and what stays at the last bits is the absolute error
    relative, absolute = (1e-15, 0.0) if angle < np.pi else (0.0, 1e-15)
    np.testing.assert_allclose(got[1:], expected[1:], rtol=relative, atol=absolute)
    assert got[0] == pytest.approx(expected[0], abs=1e-15)
    if angle < np.pi:
        np.testing.assert_allclose(at.ep_to_rotvec(got), phi, rtol=1e-15, atol=0)


def test_half_turn_and_shadow() -> None:
    close(at.mrp_shadow((0.2, 0.0, 0.0)), (-5.0, 0.0, 0.0))
    assert np.all(np.isnan(at.mrp_shadow((0.0, 0.0, 0.0))))
    assert at.mrp_inner((0.0, 1.0, 0.0)) == (0.0, 1.0, 0.0)
    for axis in np.eye(3):
        dcm = 2.0 * np.outer(axis, axis) - np.eye(3)
        close(at.mrp_to_dcm(at.dcm_to_mrp(m3(dcm))), dcm)
        close(np.linalg.norm(at.dcm_to_rotvec(m3(dcm))), np.pi)


def test_no_composition_of_mrps_is_singular() -> None:
    """The textbook formula divides by 1 + |a|^2 |b|^2 - 2 a.b, which is 0 here."""
    close(at.mrp_compose((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), (0.0, 0.0, 0.0))


def test_nan_stays_nan() -> None:
    bad = (np.nan, 0.1, 0.2)
    assert np.isnan(at.mrp_compose(bad, (0.1, 0.0, 0.0))).all()
    assert np.isnan(at.rotvec_to_ep(bad)).all()
    assert np.isnan(at.ep_normalize((0.0, 0.0, 0.0, 0.0))).all()
