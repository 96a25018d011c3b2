"""The pose of a camera from made-up landmarks: truth, honesty of the covariance, each check."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out
from messages.base import F64
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, LandmarksMsg, PoseFixMsg, PosePriorMsg
from modules.estimation.pose_from_landmarks import STATUS_TEXT, FixStatus, PoseFromLandmarks
from modules.estimation.rotations import beta_from_dcm, dcm_from_beta

CV: Any = cv2
ROTATION: Any = Rotation
CAMERA = CameraConfigMsg(
    width_px=1296,
    height_px=972,
    focal_px=np.array([1030.0, 1030.0]),
    center_px=np.array([636.0, 474.0]),
    distortion=np.array([0.03, -0.02, 0.001, 0.002, 0.0]),
)
DCM_CE: F64 = ROTATION.from_rotvec([1.0, -0.7, 2.0]).as_matrix()
R_CE_E = -6.79e6 * DCM_CE[2]


class Source(Module):
    """Writes what a test gives it."""

    out_landmarks = Out(LandmarksMsg)
    out_camera = Out(CameraConfigMsg)
    out_prior = Out(PosePriorMsg)


def scene(n: int = 400, seed: int = 1) -> tuple[F64, F64]:
    """Landmarks (n, 3) over the whole image, and their pixels by OpenCV."""
    rng = np.random.default_rng(seed)
    tangents = (rng.uniform(0, 1, (n, 2)) * [1296, 972] - CAMERA.center_px) / CAMERA.focal_px
    depth = 420e3 + rng.uniform(-3e3, 0.0, n) + 15e3 * (tangents**2).sum(axis=1)
    r_LC_C = depth[:, None] * np.column_stack([tangents, np.ones(n)])
    k = np.array([[1030.0, 0.0, 636.0], [0.0, 1030.0, 474.0], [0.0, 0.0, 1.0]])
    seen = CV.projectPoints(r_LC_C, np.zeros(3), np.zeros(3), k, CAMERA.distortion)[0].reshape(-1, 2)
    return R_CE_E + r_LC_C @ DCM_CE, np.asarray(seen)


def marks_of(ground: F64, pixel: F64, candidates: int | None = None, sigma: float = 1.0) -> LandmarksMsg:
    def filled(values: F64) -> F64:
        out = np.full((MAX_LANDMARKS, *values.shape[1:]), np.nan)
        out[: len(values)] = values
        return out

    n = len(ground)
    return LandmarksMsg(
        exposure_ns=5,
        count=n,
        candidates=n if candidates is None else candidates,
        cells=24 if n else 0,
        r_LE_E=filled(ground),
        pixel_px=filled(pixel),
        sigma_px=filled(np.full(n, sigma)),
        score=filled(np.full(n, 0.5)),
    )


def prior_of(
    offset: F64 | None = None, sigma: float = 30e3, turn: F64 | None = None, exposure_ns: int = 5
) -> PosePriorMsg:
    dcm = DCM_CE if turn is None else ROTATION.from_rotvec(turn).as_matrix() @ DCM_CE
    return PosePriorMsg(
        exposure_ns=exposure_ns,
        r_CE_E=R_CE_E + (np.zeros(3) if offset is None else offset),
        beta_CE=beta_from_dcm(dcm),
        P_pose=np.diag([sigma**2] * 3 + [3.0] * 3),
    )


def fix_of(
    marks: LandmarksMsg | None, prior: PosePriorMsg | None, params: PoseFromLandmarks.Params | None = None
) -> PoseFixMsg | None:
    source, pose = Source("source"), PoseFromLandmarks("pose", params)
    source.out_landmarks.connect(pose.in_landmarks)
    source.out_camera.connect(pose.in_camera)
    source.out_prior.connect(pose.in_prior)
    source.out_camera.write(CAMERA, 0)
    if marks is not None:
        source.out_landmarks.write(marks, 0)
    if prior is not None:
        source.out_prior.write(prior, 0)
    pose.step(7)
    return pose.out_fix.latest()


def valid(fix: PoseFixMsg | None) -> PoseFixMsg:
    assert fix is not None
    assert fix.valid, STATUS_TEXT[FixStatus(fix.status)]
    assert fix.status == 0
    assert fix.exposure_ns == 5
    return fix


def test_perfect_landmarks(criterion: Callable[[str, float], None]) -> None:
    """POSE-1: also with an attitude of the prior that is half a turn off."""
    fix = valid(fix_of(marks_of(*scene()), prior_of(np.array([2e4, -1e4, 1e4]), turn=np.array([0.0, 0.0, 3.0]))))
    criterion("POSE-1", float(np.abs(fix.r_CE_E - R_CE_E).max()))
    assert fix.inliers == 400
    assert fix.cells == 24


def test_perfect_attitude(criterion: Callable[[str, float], None]) -> None:
    """POSE-2."""
    fix = valid(fix_of(marks_of(*scene()), prior_of()))
    criterion("POSE-2", float(ROTATION.from_matrix(dcm_from_beta(fix.beta_CE) @ DCM_CE.T).magnitude()))


def normalised_squares(params: PoseFromLandmarks.Params, error_px: Callable[[np.random.Generator, F64], F64]) -> F64:
    """Error' P^-1 error / 6 of 200 fixes; their mean has a sigma of 0.04 about 1 if P is right."""
    ground, pixel = scene()
    rng = np.random.default_rng(2)
    squares: list[float] = []
    for _ in range(200):
        fix = valid(fix_of(marks_of(ground, pixel + error_px(rng, pixel)), prior_of(), params))
        theta = -ROTATION.from_matrix(DCM_CE @ dcm_from_beta(fix.beta_CE).T).as_rotvec()
        error = np.concatenate([R_CE_E - fix.r_CE_E, theta])
        squares.append(float(error @ np.linalg.solve(fix.P_pose, error)) / 6.0)
    return np.array(squares)


def test_covariance_is_honest(criterion: Callable[[str, float], None]) -> None:
    """POSE-3."""
    params = PoseFromLandmarks.Params(shared_px=0.0, reject=6.0)
    squares = normalised_squares(params, lambda rng, pixel: rng.normal(0, 0.8, pixel.shape))
    criterion("POSE-3", float(np.mean(squares)) - 1.0)


def test_shared_errors(criterion: Callable[[str, float], None]) -> None:
    """POSE-6: one error for each 216 x 243 px, and a tenth of it for each landmark."""

    def error_px(rng: np.random.Generator, pixel: F64) -> F64:
        cell = np.clip((pixel + 0.5) // [216, 243], 0, [5, 3]).astype(int)
        return rng.normal(0, 0.6, (6, 4, 2))[cell[:, 0], cell[:, 1]] + rng.normal(0, 0.06, pixel.shape)

    # The residuals show the shared errors too, as if they were independent: a twentieth is counted twice
    squares = normalised_squares(PoseFromLandmarks.Params(shared_px=0.6, reject=9.0), error_px)
    criterion("POSE-6", float(np.mean(squares)) - 1.0)


def test_prior_does_not_pull(criterion: Callable[[str, float], None]) -> None:
    """POSE-4."""
    ground, pixel = scene()
    marks = marks_of(ground, pixel + np.random.default_rng(3).normal(0, 0.8, pixel.shape))
    here = valid(fix_of(marks, prior_of()))
    there = valid(fix_of(marks, prior_of(np.array([12e3, -12e3, 10e3]), turn=np.array([0.05, 0.0, -0.3]))))
    criterion("POSE-4", float(np.linalg.norm(here.r_CE_E - there.r_CE_E)))


def test_false_landmarks(criterion: Callable[[str, float], None]) -> None:
    """POSE-5."""
    ground, pixel = scene()
    rng = np.random.default_rng(4)
    pixel = pixel + rng.normal(0, 0.8, pixel.shape)
    pixel[:100] += rng.normal(0, 8.0, (100, 2)) + np.array([6.0, 0.0])
    fix = valid(fix_of(marks_of(ground, pixel), prior_of()))
    assert 280 <= fix.inliers <= 340
    error = fix.r_CE_E - R_CE_E
    criterion("POSE-5", float(np.sqrt(error @ np.linalg.solve(fix.P_pose[:3, :3], error))))


def test_shared_errors_widen_the_covariance() -> None:
    ground, pixel = scene()
    marks = marks_of(ground, pixel + np.random.default_rng(3).normal(0, 0.8, pixel.shape))
    sharing = [0.0, 0.5, 1.0]
    none, half, one = (valid(fix_of(marks, prior_of(), PoseFromLandmarks.Params(shared_px=x))).P_pose for x in sharing)
    np.testing.assert_allclose(one - none, 4.0 * (half - none), rtol=1e-9, atol=1e-9)
    assert np.linalg.eigvalsh(one - none)[0] > 0.0


def noisy(n: int = 400, spread: float = 0.8) -> tuple[F64, F64]:
    ground, pixel = scene(n)
    return ground, pixel + np.random.default_rng(9).normal(0, spread, pixel.shape)


REFUSED: dict[FixStatus, Callable[[], PoseFixMsg | None]] = {
    FixStatus.NO_LANDMARKS: lambda: fix_of(marks_of(np.empty((0, 3)), np.empty((0, 2))), prior_of()),
    FixStatus.NO_PRIOR: lambda: fix_of(marks_of(*noisy()), prior_of(exposure_ns=6)),
    FixStatus.NO_SOLUTION: lambda: fix_of(marks_of(*noisy(5)), prior_of()),
    FixStatus.FEW_INLIERS: lambda: fix_of(marks_of(*noisy(60)), prior_of()),
    FixStatus.LOW_SHARE: lambda: fix_of(marks_of(*noisy(), candidates=1000), prior_of()),
    FixStatus.BADLY_SPREAD: lambda: fix_of(one_corner(), prior_of()),
    FixStatus.LARGE_RESIDUALS: lambda: fix_of(marks_of(*noisy(spread=3.0)), prior_of()),
    FixStatus.ALTITUDE: lambda: fix_of(marks_of(*noisy()), prior_of(), PoseFromLandmarks.Params(min_altitude=500e3)),
    FixStatus.AGAINST_PRIOR: lambda: fix_of(marks_of(*noisy()), prior_of(np.array([2e4, 0.0, 0.0]), sigma=2e3)),
    FixStatus.WEAK: lambda: fix_of(marks_of(*noisy()), prior_of(), PoseFromLandmarks.Params(max_sigma=10.0)),
}


def one_corner() -> LandmarksMsg:
    ground, pixel = noisy(2000)
    there = (pixel < [500, 480]).all(axis=1)
    return marks_of(ground[there], pixel[there])


@pytest.mark.parametrize("status", REFUSED)
def test_each_check_refuses(status: FixStatus) -> None:
    fix = REFUSED[status]()
    assert fix is not None
    assert not fix.valid
    assert FixStatus(fix.status) is status
    known = np.isfinite(fix.r_CE_E).all()
    assert known == (status > FixStatus.NO_SOLUTION)


def test_every_status_has_a_test_and_a_text() -> None:
    assert {*REFUSED, FixStatus.VALID} == set(FixStatus) == set(STATUS_TEXT)


def test_prior_gate_can_be_off() -> None:
    far = prior_of(np.array([2e4, 0.0, 0.0]), sigma=2e3)
    valid(fix_of(marks_of(*noisy()), far, PoseFromLandmarks.Params(prior_gate_sigma=0.0)))


def test_nothing_in_nothing_out() -> None:
    assert fix_of(None, prior_of()) is None
    assert not valid(fix_of(marks_of(*noisy()), prior_of())).P_pose.flags.writeable
    fix = fix_of(marks_of(*noisy()), None)
    assert fix is not None
    assert fix.status == FixStatus.NO_PRIOR


def test_one_fix_per_message_and_the_same_each_time() -> None:
    marks = marks_of(*noisy())
    first, second = (valid(fix_of(marks, prior_of())) for _ in range(2))
    assert first.r_CE_E.tobytes() == second.r_CE_E.tobytes()
    assert first.P_pose.tobytes() == second.P_pose.tobytes()
