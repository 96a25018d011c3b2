"""The calibration against simulated passes: pixels by OpenCV and attitudes by SciPy, not by the code under test."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, LandmarksMsg, PoseFixMsg
from messages.orbit import CameraAccuracyMsg, PhotoTimeMsg
from modules.estimation.orbit_mount_estimator import OrbitMountEstimator
from modules.estimation.orbit_mount_estimator.adjust import pose, start
from modules.estimation.orbit_mount_estimator.clock import line_within
from modules.estimation.orbit_mount_estimator.normals import accumulate, residuals
from modules.estimation.orbit_mount_estimator.solve import within_stamps
from modules.estimation.orbit_pose_prior import TleOrbit

TLE = Path(__file__).parents[3] / "sim" / "data" / "orbits" / "iss_tle_2023-05-03.txt"
ORBIT = TleOrbit.open(TLE, datetime(2023, 5, 5, 3, 28, 50, tzinfo=UTC))
MOUNTING = Rotation.from_rotvec([0.1, -0.12, 0.02]).as_matrix().T @ np.array([[0, 1.0, 0], [-1, 0, 0], [0, 0, 1]])
FOCAL, CENTER, DISTORTION = 1030.5, (636.0, 474.0), (0.032, -0.026, 0.001, -0.001, 0.0)
PERIOD, START = 12.12, 0.3
NOMINAL = CameraConfigMsg(width_px=1296, height_px=972, focal_px=np.full(2, 1055.0), center_px=np.array([647.5, 485.5]))
TRUE_CAMERA = CameraConfigMsg(
    width_px=1296,
    height_px=972,
    focal_px=np.full(2, FOCAL),
    center_px=np.array(CENTER),
    distortion=np.array(DISTORTION),
    dcm_CB=MOUNTING,
)
ACCURACY = CameraAccuracyMsg(
    photos=10, rms_px=1.0, sigma_focal_px=1.0, sigma_center_px=np.ones(2), sigma_distortion=np.zeros(5),
    sigma_mounting=np.full(3, 1e-3), sigma_common_H=np.array([300.0, 2000.0, 500.0]),
)  # fmt: skip


class Look(NamedTuple):
    time: PhotoTimeMsg
    landmarks: LandmarksMsg
    fix: PoseFixMsg


def orbit_frame(r: np.ndarray, v: np.ndarray) -> np.ndarray:
    z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    return np.array([np.cross(y, z), y, z])


def project(dcm_CE: np.ndarray, r_CE_E: np.ndarray, points: np.ndarray) -> np.ndarray:
    matrix = np.array([[FOCAL, 0, CENTER[0]], [0, FOCAL, CENTER[1]], [0, 0, 1]])
    points_C = np.ascontiguousarray((points - r_CE_E) @ dcm_CE.T)
    return cv2.projectPoints(points_C, np.zeros(3), np.zeros(3), matrix, np.array(DISTORTION))[0].reshape(-1, 2)


def simulated_pass(
    seed: int = 1,
    count: int = 10,
    offset_H: tuple[float, float, float] = (0, 0, 0),
    wobble: float = 5e-4,
    cut: bool = True,
) -> list[Look]:
    """Looks at landmarks spread over the image, with noise of 0.8 px and a tenth of gross errors."""
    rng = np.random.default_rng(seed)
    looks: list[Look] = []
    for k in range(count):
        t = START + PERIOD * k
        stamp = np.floor(t)
        exposure = t if not cut else 0.35 + (PERIOD + 0.002) * k  # what the stamps alone make of it
        r, v = (x[0] for x in ORBIT.at(t))
        h = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        up = r / np.linalg.norm(r)
        r = r + np.array([up, np.cross(h, up), h]).T @ np.array(offset_H, float)
        dcm_CE = Rotation.from_rotvec(wobble * rng.standard_normal(3)).as_matrix().T @ MOUNTING @ orbit_frame(r, v)
        rays = np.column_stack([rng.uniform(-0.62, 0.62, 400), rng.uniform(-0.46, 0.46, 400), np.ones(400)]) @ dcm_CE
        rays /= np.linalg.norm(rays, axis=1)[:, None]
        radius = 6371e3 + rng.uniform(0.0, 2e3, 400)
        down = rays @ r
        points = r + (-down - np.sqrt(down**2 - (r @ r - radius**2)))[:, None] * rays
        pixels = project(dcm_CE, r, points) + 0.8 * rng.standard_normal((400, 2))
        pixels[:40] += 10.0 * rng.standard_normal((40, 2))
        looks.append(look(exposure, stamp, points, pixels, dcm_CE, r, last=k == count - 1, calibrate=cut))
    return looks


def look(
    exposure: float,
    stamp: float,
    points: np.ndarray,
    pixels: np.ndarray,
    dcm: np.ndarray,
    r: np.ndarray,
    last: bool,
    calibrate: bool,
) -> Look:
    n, ns = len(points), s(exposure)
    time = PhotoTimeMsg(
        exposure_ns=ns,
        earliest_ns=s(stamp),
        latest_ns=s(stamp + 1.0),
        sigma_s=0.15,
        even=True,
        last=last,
        calibrate=calibrate,
    )
    fields: dict[str, Any] = {}
    for name, values in (("r_LE_E", points), ("pixel_px", pixels), ("sigma_px", np.ones(n)), ("score", np.ones(n))):
        fields[name] = np.full((MAX_LANDMARKS, *values.shape[1:]), np.nan)
        fields[name][:n] = values
    landmarks = LandmarksMsg(exposure_ns=ns, count=n, candidates=n, cells=24, **fields)
    beta = Rotation.from_matrix(dcm.T).as_quat(scalar_first=True)
    fix = PoseFixMsg(
        exposure_ns=ns, valid=True, status=0, inliers=n, candidates=n, cells=24, rms_px=1.0, r_CE_E=r, beta_CE=beta,
        P_pose=np.eye(6),
    )  # fmt: skip
    return Look(time, landmarks, fix)


class Finder(Module):
    """Plays looks, one each step."""

    out_time = Out(PhotoTimeMsg)
    out_landmarks = Out(LandmarksMsg)
    out_fix = Out(PoseFixMsg)

    def __init__(self, looks: list[Look]) -> None:
        super().__init__("finder")
        self.looks = looks

    def step(self, t_ns: int) -> None:
        k = t_ns // s(1)
        if k < len(self.looks):
            self.out_time.write(self.looks[k].time, t_ns)
            self.out_landmarks.write(self.looks[k].landmarks, t_ns)
            self.out_fix.write(self.looks[k].fix, t_ns)


def estimate(looks: list[Look], camera: CameraConfigMsg = NOMINAL, accuracy: CameraAccuracyMsg | None = None) -> Any:
    """Run the estimator in a simulation and return it with the simulation."""
    estimator = OrbitMountEstimator("estimator", ORBIT, camera, accuracy)
    finder = Finder(looks)
    for name in ("time", "landmarks", "fix"):
        getattr(finder, f"out_{name}").connect(getattr(estimator, f"in_{name}"))
    simulation = Simulation([Task("t", s(1), [finder, estimator])])
    simulation.run_until(s(len(looks)))
    return estimator, simulation


def angle(dcm: np.ndarray) -> float:
    return float(np.linalg.norm(Rotation.from_matrix(dcm).as_rotvec()))


def test_lens_mounting_and_cadence_are_recovered(criterion: Callable[[str, float], None]) -> None:
    """The start is 2.4 % off in focal length and 11 px in the principal point; the stamps are whole seconds."""
    looks = simulated_pass()
    estimator, _ = estimate([*looks, *looks])
    camera, clock = estimator.out_camera.latest(), estimator.out_clock.latest()
    criterion("MOUNT-1", camera.focal_px[0] - FOCAL)
    criterion("MOUNT-2", angle(camera.dcm_CB @ MOUNTING.T))
    period = (PERIOD + 0.002) * (1.0 + clock.clock_rate)
    criterion("MOUNT-3", period - PERIOD)
    assert abs(camera.focal_px[0] - FOCAL) < 3.0 * estimator.out_accuracy.latest().sigma_focal_px
    np.testing.assert_allclose(camera.center_px, CENTER, atol=4.0)  # slides with the mounting: 1 px is 3 arc minutes
    assert estimator.out_accuracy.latest().photos == 10


def test_track_is_recovered_with_a_calibration_made_before(criterion: Callable[[str, float], None]) -> None:
    offset = (400.0, 2500.0, -600.0)
    estimator, _ = estimate(simulated_pass(offset_H=offset, wobble=1e-4, cut=False), TRUE_CAMERA, ACCURACY)
    clock = estimator.out_clock.latest()
    assert estimator.out_camera.latest() is None and estimator.out_accuracy.latest() is None
    sigma = np.sqrt(np.diag(clock.P))[:3]
    error = (clock.offset_H - offset) / sigma
    criterion("MOUNT-4", float(np.abs(error).max()))
    assert np.all(sigma < [300.0, 1200.0, 700.0]) and abs(clock.rate_T) < 3.0
    assert clock.clock_s == 0.0 and clock.clock_rate == 0.0


def test_gross_errors_and_bad_fixes_do_not_matter() -> None:
    looks = simulated_pass()
    bad = looks[4]
    wrong = PoseFixMsg(
        exposure_ns=bad.fix.exposure_ns, valid=False, status=3, inliers=0, candidates=0, cells=0, rms_px=np.nan,
        r_CE_E=np.full(3, np.nan), beta_CE=np.full(4, np.nan), P_pose=np.full((6, 6), np.nan),
    )  # fmt: skip
    looks[4] = Look(bad.time, bad.landmarks, wrong)
    estimator, _ = estimate([*looks, *looks])
    assert estimator.out_clock.latest().photos == 9
    assert abs(estimator.out_camera.latest().focal_px[0] - FOCAL) < 1.5


def test_normal_equations_agree_with_differences_of_opencv() -> None:
    rng = np.random.default_rng(8)
    points = np.column_stack([rng.uniform(-2e5, 2e5, (20, 2)), rng.uniform(4e5, 5e5, 20)])
    lens = np.array([FOCAL, FOCAL, *CENTER, 0.0, *DISTORTION, 1e12])
    pixels = rng.uniform(300.0, 700.0, (20, 2))
    weight = rng.uniform(0.5, 2.0, 20)
    normal, right = np.zeros((16, 16)), np.zeros(16)
    accumulate(lens, np.eye(3), np.zeros(3), points, pixels, weight, normal, right)

    def predicted(x: np.ndarray) -> np.ndarray:
        """x: fx fy cx cy skew k1 k2 p1 p2 k3, displacement, attitude. OpenCV knows no skew."""
        matrix = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1]])
        turned = (points - x[10:13]) @ Rotation.from_rotvec(x[13:]).as_matrix()
        return cv2.projectPoints(turned, np.zeros(3), np.zeros(3), matrix, x[5:10])[0].ravel()

    x0 = np.concatenate([lens[:10], np.zeros(6)])
    columns = [j for j in range(16) if j != 4]
    steps = np.array([1e-2] * 5 + [1e-4] * 5 + [1.0] * 3 + [1e-5] * 3)
    jacobian = np.empty((40, 16))
    for j in columns:
        dx = np.zeros(16)
        dx[j] = steps[j]
        jacobian[:, j] = (predicted(x0 + dx) - predicted(x0 - dx)) / (2.0 * steps[j])
    w = np.repeat(weight, 2)
    expected = jacobian[:, columns].T @ (w[:, None] * jacobian[:, columns])
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # central differences of numbers near 500 with steps that move them by 1e-2 to 1 px are good to 1e-7
    np.testing.assert_allclose(normal[np.ix_(columns, columns)] / scale, expected / scale, atol=1e-6)
    wanted = jacobian[:, columns].T @ (w * (pixels.ravel() - predicted(x0)))
    np.testing.assert_allclose(
        right[columns] / np.sqrt(np.diag(expected)), wanted / np.sqrt(np.diag(expected)), rtol=1e-5
    )
    out = np.empty((20, 2))
    residuals(lens, np.eye(3), np.zeros(3), points, pixels, out)
    np.testing.assert_allclose(out.ravel(), pixels.ravel() - predicted(x0), atol=1e-9)


@pytest.mark.parametrize("column", range(10, 20))
def test_pose_moves_as_its_derivatives_say(column: int) -> None:
    step = {10: 0.1, 11: 0.002, 15: 1.0, 19: 0.1}.get(column, 1e-4 if column > 15 else 100.0)
    lens = np.zeros(11)
    poses: list[Any] = []
    for sign in (-1.0, 1.0):
        state = start(lens, MOUNTING, 4, np.zeros(2))
        if column < 16:
            state.common[column] += sign * step
        elif column < 19:
            state.attitude[3, column - 16] += sign * step
        else:
            state.time_s[3] += sign * step
        poses.append(pose(state, 3, 36.0, 20.0, ORBIT))
    moves = pose(start(lens, MOUNTING, 4, np.zeros(2)), 3, 36.0, 20.0, ORBIT)[2]
    middle = pose(start(lens, MOUNTING, 4, np.zeros(2)), 3, 36.0, 20.0, ORBIT)[1]
    displacement = middle @ (poses[1][0] - poses[0][0])
    turn = Rotation.from_matrix((poses[1][1] @ poses[0][1].T).T).as_rotvec()
    numeric = np.concatenate([displacement, turn]) / (2.0 * step)
    # SGP4's velocity is no exact derivative of its position (1e-6), and a second of track is curved (1e-3 rad)
    np.testing.assert_allclose(numeric, moves[:, column], rtol=2e-3, atol=2e-5 * np.abs(moves[:, column]).max())


def test_line_through_intervals_agrees_with_samples() -> None:
    """Accepting random lines gives the same mean and covariance."""
    rng = np.random.default_rng(4)
    x = np.array([-50.0, -20.0, 10.0, 50.0])
    earliest = np.array([-0.7, -0.5, -0.3, -0.6])
    latest = earliest + 1.0
    found = line_within(earliest, latest, x, np.linspace(-0.03, 0.03, 4001))
    assert found is not None
    a, b = rng.uniform(-1, 1, 400000), rng.uniform(-0.03, 0.03, 400000)
    value = a[:, None] + b[:, None] * x
    inside = np.all((value >= earliest) & (value <= latest), axis=1)
    samples = np.array([a[inside], b[inside]])
    error = 5.0 / np.sqrt(inside.sum())
    np.testing.assert_allclose(found[0], samples.mean(axis=1), atol=error * samples.std(axis=1).max())
    np.testing.assert_allclose(np.sqrt(np.diag(found[1])), samples.std(axis=1), rtol=error)
    assert line_within(np.array([0.0, 5.0]), np.array([1.0, 6.0]), np.array([0.0, 1.0]), np.linspace(-1, 1, 11)) is None


def test_clock_never_leaves_the_stamps() -> None:
    times = [entry.time for entry in simulated_pass()]
    reference = times[5].exposure_ns
    clock = within_stamps(times, reference, np.zeros(2), np.array([5.0, 0.0]))
    moved = np.array([t.exposure_ns * 1e-9 + clock[0] for t in times])
    assert 0.0 < clock[0] < 1.0 and np.all(moved <= np.array([t.latest_ns for t in times]) * 1e-9 + 1e-9)
    small = np.array([0.01, 0.0])
    np.testing.assert_array_equal(within_stamps(times, reference, np.zeros(2), small), small)


def test_without_a_valid_fix_nothing_is_published() -> None:
    looks = simulated_pass(count=2)
    looks = [Look(x.time, x.landmarks, msgspec.structs.replace(x.fix, valid=False)) for x in looks]
    estimator, _ = estimate(looks)
    assert all(port.seq == 0 for port in estimator.outputs)


def test_one_photo_is_enough_for_a_first_calibration() -> None:
    estimator, _ = estimate(simulated_pass(count=1))
    assert abs(estimator.out_camera.latest().focal_px[0] - FOCAL) < 3.0


def test_second_run_after_reset_is_identical() -> None:
    estimator, simulation = estimate(simulated_pass(count=3))
    first = estimator.out_camera.latest()
    simulation.reset()
    simulation.run_until(s(3))
    np.testing.assert_array_equal(estimator.out_camera.latest().focal_px, first.focal_px)
    np.testing.assert_array_equal(estimator.out_camera.latest().dcm_CB, first.dcm_CB)


def test_no_track_is_estimated_before_there_is_a_calibration() -> None:
    estimator, _ = estimate(simulated_pass(count=2, cut=False))
    assert all(port.seq == 0 for port in estimator.outputs)


def test_data_of_another_photo_are_not_mixed_in() -> None:
    looks = simulated_pass(count=2)
    mixed = [Look(looks[0].time, looks[1].landmarks, looks[0].fix), looks[1]]
    estimator, _ = estimate(mixed)
    assert estimator.out_clock.latest().photos == 1
