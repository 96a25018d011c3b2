"""PixelLineBiasUkf against Basilisk, its limb against OpenCV and scipy, and statistics; bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import OutPort, s
from fsw.math.attitude import mrp_to_dcm
from fsw.math.camera import lens_vector
from fsw.math.compiled import plain
from fsw.math.two_body import noise_of_interval
from fsw.math.vectors import mat3, matmul
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.filters import PixelLineFilterMsg
from messages.opnav import OpNavCirclesMsg
from modules.estimation.pixel_line_bias_ukf import PixelLineBiasUkf
from modules.estimation.pixel_line_bias_ukf.basilisk import basilisk_circles
from modules.estimation.pixel_line_bias_ukf.kernel import add_attitude_noise
from modules.estimation.pixel_line_bias_ukf.limb import POINTS, WORK, limb_circle
from modules.estimation.relative_od_ukf import status
from modules.estimation.relative_od_ukf.basilisk import basilisk_motion, gravity_km
from modules.opnav.basilisk import basilisk_radii, body_of
from tests.modules.estimation.filter_truth import (
    CAMERA,
    DENSITY,
    DIRECTIONS,
    FRAMES,
    MU,
    RADIUS,
    RANGES,
    SPREAD,
    STEP,
    Criterion,
    circles_of,
    histories,
    looking,
    normalised,
    outside_band,
    relative_error,
    square,
    triangle,
    vectors,
)
from tests.modules.opnav.disk_truth import attitude, basilisk_camera, camera, circles_message, pixels, sources
from tests.modules.opnav.test_pixel_line_converter import circle_of

SPHERE = np.full(3, RADIUS)
U = 0.09 * np.array([[1.0, 0.3, 0.0], [0.3, 1.5, 0.2], [0.0, 0.2, 0.8]])
R0, V0 = np.array([0.0, 0.0, -18e6]), np.array([1500.0, 0.0, 0.0])
Wired = tuple[PixelLineBiasUkf, dict[str, OutPort[Any]]]


def wired(**params: Any) -> Wired:
    start: dict[str, Any] = {
        "body_id": 499,
        "mu": MU,
        "axes": SPHERE,
        "r_CP_N": R0,
        "v_CP_N": V0,
        "P": np.diag(SPREAD**2),
        "process_noise": DENSITY,
    }
    ukf = PixelLineBiasUkf("ukf", PixelLineBiasUkf.Params(**{**start, **params}))
    feed = sources(ukf)
    feed["in_camera"].write(CAMERA, 0)
    return ukf, feed


def circles_of_basilisk(case: dict[str, Any]) -> OpNavCirclesMsg:
    rows = np.column_stack([np.array(case["circlesCenters"]).reshape(-1, 2), case["circlesRadii"]])
    P, body = square(case["uncertainty"], 3), body_of(case["planetIds"][0])
    return circles_message(rows, P, body, valid=bool(case["valid"]))


def as_basilisk(cfg: dict[str, Any]) -> Wired:
    x = np.array(cfg["stateInit"], np.float64)
    ukf, feed = wired(
        basilisk=True,
        body_id=body_of(cfg["planetIdInit"]),
        r_CP_N=x[:3],
        v_CP_N=x[3:6],
        bias_px=x[6:],
        P=square(cfg["covarInit"], 9),
        process_noise=square(cfg["qNoise"], 9),
        alpha=cfg["alpha"],
        beta=cfg["beta"],
        kappa=float(cfg["kappa"]),
    )
    feed["in_camera"].write(basilisk_camera(cfg["camera"]), 0)
    return ukf, feed


def step(ukf: PixelLineBiasUkf, t_ns: int) -> PixelLineFilterMsg:
    ukf.step(t_ns)
    message = ukf.out_filter.latest()
    assert message is not None
    return message


def test_basilisk_methods(criterion: Criterion) -> None:
    """The measurement model of the source's first test and others, and single steps."""
    for case in vectors("pixel_line_bias_ukf")["state_prop"]:
        state = np.array(case["state"], np.float64)
        plain(basilisk_motion)(state, float(case["dt"]), gravity_km(body_of(case["planetId"])))
        criterion("PIXELUKF-1", float(np.max(np.abs(state / case["out"] - 1.0))))
    for case in vectors("pixel_line_bias_ukf")["meas_model"]:
        cam, circle = basilisk_camera(case["camera"]), case["circles"]
        rows = plain(matmul)(plain(mat3)(cam.dcm_CB), plain(mrp_to_dcm)(tuple(case["sigma_BN"])))
        points, wanted = np.array(case["SP"], np.float64), np.array(case["out"]["yMeas"])
        seen, observed = np.empty((len(points), 6)), np.empty(6)
        radius = 1e-3 * basilisk_radii(body_of(circle["planetIds"][0]))[0]
        measured = np.array([*circle["circlesCenters"][:2], circle["circlesRadii"][0]], np.float64)
        plain(basilisk_circles)(points, cam, rows, radius, measured, seen, observed)
        # the source's measure: of all points together, by the size of one
        criterion("PIXELUKF-2", float(np.linalg.norm(seen - wanted) / np.linalg.norm(wanted)))
        np.testing.assert_array_equal(observed, case["out"]["obs"])


def test_basilisk_propagation(criterion: Criterion) -> None:
    """The source's second test."""
    case = vectors("pixel_line_bias_ukf")["propagation"]
    ukf, feed = as_basilisk(case["cfg"])
    feed["in_attitude"].write(attitude([0.6, 1.0, 0.1]), 0)
    for k in range(361):
        ukf.step(s(10 * k))
        if k % 36 == 0:
            criterion("PIXELUKF-3", relative_error(ukf.state.x, case["state"][k // 36]))
            criterion("PIXELUKF-3", relative_error(triangle(ukf.state.S), case["sBar"][k // 36]))


@pytest.mark.parametrize("number", range(5))
def test_basilisk_updates(criterion: Criterion, number: int) -> None:
    """Planets that change, bad updates, late and stale attitude, odd resolution, circles as they really are."""
    case = vectors("pixel_line_bias_ukf")["histories"][number]
    ukf, feed = as_basilisk(case["cfg"])
    for k, now in enumerate(case["steps"]):
        if "sigma_BN" in now:
            feed["in_attitude"].write(attitude(now["sigma_BN"]), now["attTimeWritten"])
        if "circles" in now:
            feed["in_circles"].write(circles_of_basilisk(now["circles"]), now["callTime"])
        message = step(ukf, now["callTime"])
        if k % 5 == 0:
            out = case["out"][k // 5]
            criterion("PIXELUKF-4", relative_error(triangle(ukf.state.S), out["sBar"]))
            criterion("PIXELUKF-4", relative_error(ukf.state.x, out["state"]))
            if "msg_covar" in out:
                criterion("PIXELUKF-4", relative_error(message.P.ravel(), out["msg_covar"]))
            assert ukf.state.time == out["timeTag"]
            np.testing.assert_array_equal(message.x[6:], out["state"][6:])
            np.testing.assert_allclose(message.x[:6], out["msg_state"][:6], rtol=1e-7, atol=0)
            np.testing.assert_allclose(message.residual, out["postFitRes"], rtol=0, atol=1e-5)


@pytest.mark.parametrize("axes", [SPHERE, (60268e3, 60268e3, 54364e3), (207.8e3, 196.7e3, 190.6e3)])
def test_limb(criterion: Criterion, axes: Any) -> None:
    """Against circles that scipy fits to 20,000 points that OpenCV projects, as for the pixel and line converter."""
    dcm_EC = Rotation.from_euler("zyx", [0.4, -1.0, 2.0]).as_matrix()
    rows: Any = tuple(tuple(row) for row in dcm_EC)
    for off, far, bent in ((0.0, 5.0, 0.0), (20.0, 5.0, 1.0), (30.0, 3.0, 0.0), (30.0, 2.0, 1.0), (10.0, 100.0, 1.0)):
        lens = (-0.1 * bent, 0.02 * bent, 1e-3 * bent, -5e-4 * bent, 0.0)
        cam, t = camera(492.0, distortion=lens), np.radians(off)
        r = -far * axes[0] * np.array([0.8 * np.sin(t), 0.6 * np.sin(t), np.cos(t)])
        place: Any = tuple(r)
        good, circle = limb_circle(lens_vector(cam), tuple(axes), rows, place, np.empty((WORK, POINTS)), np.zeros(2))
        assert good
        criterion("PIXELUKF-5", float(np.max(np.abs(circle - circle_of(cam, np.array(axes), dcm_EC, r, count=20000)))))


def test_attitude_noise(criterion: Criterion) -> None:
    """Scatter of a centre far off axis under small rotations, projected by OpenCV."""
    cam, rng = camera(492.0), np.random.default_rng(1)
    line = np.array([0.5, -0.3, 1.0])
    turned = Rotation.from_rotvec(1e-4 * rng.normal(size=(40000, 3))).apply(line)
    center = pixels(cam, line[None])[0]
    R = np.zeros((3, 3))
    add_attitude_noise(lens_vector(cam), center[0], center[1], 1e-4, R)
    root = np.linalg.cholesky(R[:2, :2])
    white = np.linalg.solve(root, (pixels(cam, turned) - center).T)
    criterion("PIXELUKF-6", float(np.max(np.abs(white @ white.T / 40000 - np.eye(2)))))


def run(far: float, direction: F64, runs: int, seed: int, basilisk: bool = False) -> tuple[list[float], float]:
    """NEES at the end of each run, of nine numbers (``basilisk``: position and velocity), and the position's RMS [m].

    Circles are those of the limb with noise and a bias that walks, 9 degrees off axis.
    """
    rng = np.random.default_rng(seed)
    guess, truth = histories(far, direction, runs, rng)
    root, Q, n = np.linalg.cholesky(U), DENSITY, 9
    if basilisk:
        Q, n = np.empty((9, 9)), 6
        noise_of_interval(DENSITY, STEP, Q)
        Q *= np.outer([1e-3] * 6 + [1.0] * 3, [1e-3] * 6 + [1.0] * 3)
    feeds = [
        wired(
            basilisk=basilisk,
            r_CP_N=guess[i, :3],
            v_CP_N=guess[i, 3:6],
            process_noise=Q,
            alpha=0.02 if basilisk else 1.0,
        )
        for i in range(runs)
    ]
    for k in range(FRAMES):
        dcm_CN, t = looking(truth[k, :, :3]), s((k + 1) * STEP)
        sigma = Rotation.from_matrix(np.swapaxes(dcm_CN, 1, 2)).as_mrp()
        seen = circles_of(CAMERA, np.einsum("kij,kj->ki", dcm_CN, truth[k, :, :3]))
        seen += rng.normal(size=(runs, 3)) @ root.T - truth[k, :, 6:]
        for i, (ukf, feed) in enumerate(feeds):
            feed["in_attitude"].write(attitude(sigma[i]), t)
            feed["in_circles"].write(circles_message(seen[i : i + 1], U, 499, t), t)
            ukf.step(t)
    nees, squares = list[float](), list[float]()
    for i, (ukf, _) in enumerate(feeds):
        x, S = np.array(ukf.state.x), np.array(ukf.state.S)
        if basilisk:
            x[:6], S[:6] = 1e3 * x[:6], 1e3 * S[:6]
        error, P = x - truth[-1, i], S @ S.T
        nees.append(normalised(error[:n], P[:n, :n]))
        squares.append(float(error[:3] @ error[:3]))
    return nees, float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("far", RANGES)
def test_consistency(criterion: Criterion, far: float) -> None:
    """Few runs, one direction; the test of 100 runs is slow."""
    nees, _ = run(far, DIRECTIONS[0], 20, 1)
    criterion("PIXELUKF-7", outside_band(nees, 9))


@pytest.mark.slow
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("far", RANGES)
def test_consistency_of_100_runs(criterion: Criterion, far: float, direction: F64) -> None:
    nees, rms = run(far, direction, 100, 2)
    criterion("PIXELUKF-8", outside_band(nees, 9))
    as_is, rms_as_is = run(far, direction, 100, 2, basilisk=True)
    criterion("PIXELUKF-9", float(np.mean(as_is)))
    criterion("PIXELUKF-10", rms / rms_as_is)


def circle(t: float = 10.0, **more: Any) -> OpNavCirclesMsg:
    """What is seen of R0 from the first attitude, a little moved."""
    rows = circles_of(CAMERA, (R0 + V0 * t)[None])
    return circles_message(rows, U, 499, s(t), **more)


def looked(**params: Any) -> Wired:
    ukf, feed = wired(**params)
    feed["in_attitude"].write(attitude(), s(10))
    return ukf, feed


BAD: dict[str, tuple[int, dict[str, Any]]] = {
    "invalid": (status.INVALID, {"valid": False}),
    "none": (status.INVALID, {"count": 0}),
    "other body": (status.OTHER_BODY, {"body_id": 399}),
    "NaN": (status.BAD_NUMBERS, {"radius_px": np.full(10, np.nan)}),
    "negative radius": (status.BAD_NUMBERS, {"radius_px": np.full(10, -1.0)}),
    "zero covariance": (status.BAD_NUMBERS, {"P_px": np.zeros((10, 3, 3))}),
    "NaN covariance": (status.BAD_NUMBERS, {"P_px": np.full((10, 3, 3), np.nan)}),
    "future": (status.FROM_FUTURE, {"exposure_ns": s(11)}),
    "old attitude": (status.OLD_ATTITUDE, {"exposure_ns": s(21)}),
    "far off": (status.GATED, {"radius_px": np.full(10, 300.0)}),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_circles_leave_the_prediction(kind: str) -> None:
    expected, changed = BAD[kind]
    (ukf, feed), (free, _) = looked(), looked()
    message = circle()
    fields = {f: getattr(message, f) for f in message.__struct_fields__}
    feed["in_circles"].write(OpNavCirclesMsg(**{**fields, **changed}), s(10))
    refused = step(ukf, s(10))
    assert (refused.status, refused.refused, refused.used) == (expected, 1, 0)
    np.testing.assert_array_equal(refused.x, step(free, s(10)).x)
    np.testing.assert_array_equal(refused.P, step(free, s(10)).P)
    feed["in_circles"].write(circle(), s(10))
    assert step(ukf, s(10)).status == status.UPDATED
    assert step(ukf, s(10)).status == status.NO_MEASUREMENT
    feed["in_circles"].write(circle(), s(10))  # the same image, sent again
    assert step(ukf, s(10)).status == status.TOO_LATE


def test_inputs_that_are_missing() -> None:
    ukf, feed = wired(axes=np.array([60268e3, 60268e3, 54364e3]), r_CP_N=10 * R0)
    feed["in_circles"].write(circle(), s(10))
    assert step(ukf, s(10)).status == status.NO_INPUT
    feed["in_attitude"].write(attitude(), s(10))
    feed["in_circles"].write(circle(), s(10))
    assert step(ukf, s(10)).status == status.NO_ORIENTATION
    feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=np.eye(3), omega_EN_N=np.zeros(3)), 0)
    feed["in_circles"].write(circle(), s(10))
    assert step(ukf, s(10)).status == status.GATED  # the circle of another body
    ukf, feed = looked(r_CP_N=np.array([0.0, 0.0, -3.3e6]))
    feed["in_circles"].write(circle(), s(10))
    assert step(ukf, s(10)).status == status.OUTSIDE_LENS


def test_shape_and_pole(criterion: Criterion) -> None:
    """A flat body seen askew: what its own circle says leaves the residual small only if its pole is known."""
    axes, r = np.array([60268e3, 60268e3, 54364e3]), np.array([2e7, -1e7, -6e8])
    pole = Rotation.from_euler("zyx", [0.4, -1.0, 2.0]).as_matrix()
    rows = circle_of(CAMERA, axes, pole, r)[None]
    for params in ({"pole_N": pole[2]}, {}):
        known = {"axes": axes, "r_CP_N": r, "v_CP_N": np.zeros(3), "mu": 1.0, **params}
        ukf, feed = looked(**known)
        if not params:
            feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=pole, omega_EN_N=np.zeros(3)), s(10))
        feed["in_circles"].write(circles_message(rows, U, 499, s(10)), s(10))
        message = step(ukf, s(10))
        assert message.status == status.UPDATED
        criterion("PIXELUKF-11", float(np.max(np.abs(message.innovation))))


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ("positive definite", {"P": np.zeros((9, 9))}),
        ("positive semidefinite", {"process_noise": -np.eye(9)}),
        ("alpha", {"alpha": 0.0}),
        ("noise_scale", {"noise_scale": -1.0}),
        ("body_id", {"mu": 0.0, "body_id": 3}),
    ],
)
def test_wrong_parameters_are_refused(text: str, changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=text):
        wired(**changed)
