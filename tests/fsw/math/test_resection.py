"""The pose fit against scipy, OpenCV, and its own covariance."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fsw.math import resection
from fsw.math.resection import attitude_from_rays, fit_pose, pose_derivatives, turned
from messages.base import F64

CV: Any = cv2
ROTATION: Any = Rotation
LENS = np.array([1030.0, 1032.0, 636.0, 474.0, 0.0, 0.03, -0.02, 0.001, 0.002, 0.0, 3.3])
K = np.array([[LENS[0], 0.0, LENS[2]], [0.0, LENS[1], LENS[3]], [0.0, 0.0, 1.0]])


def scene(n: int = 300, seed: int = 1) -> tuple[F64, F64, F64, F64]:
    """Points on a bumpy ground 420 km below a camera, and where it sees them: r_LE_E, pixel, r_CE_E, dcm_CE."""
    rng = np.random.default_rng(seed)
    dcm_CE: F64 = ROTATION.random(rng=np.random.default_rng(3)).as_matrix()
    r_CE_E = -6.8e6 * dcm_CE[2]
    tangents = (rng.uniform(0, 1, (n, 2)) * [1296, 972] - LENS[2:4]) / LENS[:2]
    depth = 420e3 + rng.uniform(-3e3, 0.0, n) + 15e3 * (tangents**2).sum(axis=1)
    r_LC_C = depth[:, None] * np.column_stack([tangents, np.ones(n)])
    r_LE_E = r_CE_E + r_LC_C @ dcm_CE
    return r_LE_E, seen_by(r_LE_E, r_CE_E, dcm_CE), r_CE_E, dcm_CE


def seen_by(r_LE_E: F64, r_CE_E: F64, dcm_CE: F64) -> F64:
    """Pixels (n, 2), by OpenCV."""
    turn = CV.Rodrigues(np.ascontiguousarray(dcm_CE))[0]
    return np.asarray(CV.projectPoints(r_LE_E - r_CE_E, turn, np.zeros(3), K, LENS[5:10])[0]).reshape(-1, 2)


def angle(a: F64, b: F64) -> float:
    return float(ROTATION.from_matrix(a @ b.T).magnitude())


def test_perfect_points_give_the_pose() -> None:
    ground, pixel, r, dcm = scene()
    start = turned(dcm, np.array([0.2, -0.1, 0.3]))
    fit = fit_pose(LENS, ground, pixel, np.ones(len(ground)), r + np.array([30e3, -20e3, 10e3]), start)
    assert fit is not None
    np.testing.assert_allclose(fit.r_CE_E, r, atol=1e-3)
    assert angle(fit.dcm_CE, dcm) < 1e-9
    assert fit.inlier.all()
    np.testing.assert_allclose(fit.dcm_CE @ fit.dcm_CE.T, np.eye(3), atol=1e-14)


def test_derivatives_are_differences() -> None:
    ground, _, r, dcm = scene(20)
    pixel, slopes = np.empty((20, 2)), np.empty((20, 2, 6))
    pose_derivatives(LENS, ground, r, dcm, pixel, slopes)
    np.testing.assert_allclose(pixel, seen_by(ground, r, dcm), atol=1e-6)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 10.0 if k < 3 else 1e-5
        ends = [seen_by(ground, r + s * step[:3], turned(dcm, s * step[3:])) for s in (1.0, -1.0)]
        np.testing.assert_allclose(slopes[:, :, k], (ends[0] - ends[1]) / (2 * step[k]), rtol=1e-5, atol=1e-6)


def test_same_answer_as_scipy() -> None:
    ground, pixel, r, dcm = scene(200)
    rng = np.random.default_rng(5)
    sigma = rng.uniform(0.5, 1.5, len(ground))
    pixel = pixel + sigma[:, None] * rng.normal(size=pixel.shape)
    fit = fit_pose(LENS, ground, pixel, sigma, r + np.array([500.0, 0.0, -800.0]), dcm, reject=50.0)
    assert fit is not None

    def misfit(x: F64) -> F64:
        at = seen_by(ground, r + 1e3 * x[:3], ROTATION.from_rotvec(x[3:]).as_matrix() @ dcm)
        return ((pixel - at) / sigma[:, None]).ravel()

    theirs: Any = least_squares(misfit, np.zeros(6), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    np.testing.assert_allclose(fit.r_CE_E, r + 1e3 * theirs.x[:3], atol=0.05)  # of a sigma of 200 m
    assert angle(fit.dcm_CE, ROTATION.from_rotvec(theirs.x[3:]).as_matrix() @ dcm) < 1e-7
    scale2 = 2 * theirs.cost / (2 * len(ground) - 6)
    formal = scale2 * np.linalg.inv(theirs.jac.T @ theirs.jac)[:3, :3] * 1e6
    np.testing.assert_allclose(fit.P_pose[:3, :3], formal, rtol=2e-3, atol=1e-3 * formal.max())
    assert fit.scale == pytest.approx(np.sqrt(scale2), rel=1e-6)


def test_covariance_is_that_of_the_errors() -> None:
    ground, pixel, r, dcm = scene(120)
    rng = np.random.default_rng(6)
    squares: list[float] = []
    for _ in range(150):
        noisy = pixel + rng.normal(size=pixel.shape)
        fit = fit_pose(LENS, ground, noisy, np.ones(len(ground)), r, dcm, reject=10.0)
        assert fit is not None
        # dcm_CE_true = (I - [theta x]) dcm_CE_fitted, so theta is minus the rotation vector of true from fitted
        theta = -ROTATION.from_matrix(dcm @ fit.dcm_CE.T).as_rotvec()
        error = np.concatenate([r - fit.r_CE_E, theta])
        squares.append(float(error @ np.linalg.solve(fit.P_pose, error)))
    # The mean of 150 chi-square numbers of 6 degrees: 6 +- 0.28; three sigma
    assert abs(np.mean(squares) - 6.0) < 0.85


def test_outliers_do_not_count() -> None:
    ground, pixel, r, dcm = scene(400)
    rng = np.random.default_rng(7)
    pixel = pixel + 0.5 * rng.normal(size=pixel.shape)
    wrong = rng.permutation(400)[:120]
    pixel[wrong] += rng.normal(0.0, 60.0, (120, 2)) + np.array([30.0, 0.0])
    fit = fit_pose(LENS, ground, pixel, np.ones(400), r + np.array([5e3, 5e3, 0.0]), turned(dcm, np.full(3, 0.01)))
    assert fit is not None
    assert fit.inlier[np.setdiff1d(np.arange(400), wrong)].mean() > 0.97
    assert fit.inlier[wrong].mean() < 0.05
    error = r - fit.r_CE_E
    assert error @ np.linalg.solve(fit.P_pose[:3, :3], error) < 16.3  # 99.9 % of chi-square with 3 degrees


def test_what_does_not_fix_a_pose_is_refused() -> None:
    ground, pixel, r, dcm = scene(60)
    ones = np.ones(60)
    assert fit_pose(LENS, ground[:5], pixel[:5], ones[:5], r, dcm) is None
    assert fit_pose(LENS, np.repeat(ground[:1], 60, 0), np.repeat(pixel[:1], 60, 0), ones, r, dcm) is None
    behind = np.diag([1.0, -1.0, -1.0]) @ dcm
    assert fit_pose(LENS, ground, pixel, ones, r, behind) is None
    line = ground[0] + np.linspace(0.0, 1.0, 60)[:, None] * (ground[1] - ground[0])
    assert fit_pose(LENS, line, seen_by(line, r, dcm), ones, r, dcm) is None


def test_attitude_from_rays_needs_no_start() -> None:
    ground, pixel, r, dcm = scene(50)
    np.testing.assert_allclose(attitude_from_rays(LENS, ground, pixel, r), dcm, atol=1e-9)
    moved = attitude_from_rays(LENS, ground, pixel, r + 20e3)
    assert angle(moved, dcm) < 0.1
    pixel[3] = np.nan
    np.testing.assert_allclose(attitude_from_rays(LENS, ground, pixel, r), dcm, atol=1e-9)


@pytest.mark.parametrize("size", [1e-12, 1e-6, 0.1, 3.0])
def test_turned_is_scipys_rotation(size: float) -> None:
    theta = size * np.array([0.6, -0.48, 0.64])
    np.testing.assert_allclose(turned(np.eye(3), theta), ROTATION.from_rotvec(theta).as_matrix().T, atol=1e-15)
    assert resection.MIN_POINTS == 6
