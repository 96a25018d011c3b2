"""PixelLineConverter against Basilisk's vectors, and against circles fitted by scipy to limbs projected by OpenCV."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares as _least_squares
from scipy.spatial.transform import Rotation

from fsw import s
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, OpNavMsg
from modules.opnav import relative
from modules.opnav.basilisk import body_of
from modules.opnav.pixel_line_converter import PixelLineConverter
from tests.modules.opnav.disk_truth import (
    FRAMES,
    Criterion,
    attitude,
    basilisk_camera,
    camera,
    circles_message,
    limb_points,
    pixels,
    sources,
    vectors,
    worst,
)

least_squares: Any = _least_squares
SPHERE, SATURN = np.full(3, 3.4e6), np.array([60268e3, 60268e3, 54364e3])
MIMAS = np.array([207.8e3, 196.7e3, 190.6e3])
LENS = (-0.1, 0.02, 1e-3, -5e-4, 0.0)
U = np.array([[0.3, 0.05, -0.02], [0.05, 0.4, 0.03], [-0.02, 0.03, 0.2]])


def circle_of(
    cam: CameraConfigMsg, axes: F64, dcm_EC: F64, r_C: F64, sun_C: F64 | None = None, count: int = 4000
) -> F64:
    """Least squares circle, by scipy, through the limb as OpenCV projects it, or its lit half; evenly along it."""
    angle = (np.arange(count) + 0.5) / count * 2 * np.pi
    sight = limb_points(axes, dcm_EC, r_C, angle)
    seen = pixels(cam, sight)
    weight = np.linalg.norm(np.roll(seen, -1, axis=0) - np.roll(seen, 1, axis=0), axis=1)
    if sun_C is not None:
        normal_E = (sight + r_C) @ dcm_EC.T / axes**2
        weight *= normal_E @ dcm_EC @ sun_C > 0.0
    root = np.sqrt(weight / weight.max())

    def residual(c: F64) -> F64:
        return root * (np.hypot(seen[:, 0] - c[0], seen[:, 1] - c[1]) - c[2])

    def slopes(c: F64) -> F64:
        away = seen - c[:2]
        return -root[:, None] * np.column_stack([away / np.linalg.norm(away, axis=1)[:, None], np.ones(count)])

    start = np.array([*np.mean(seen, axis=0), np.ptp(seen[:, 0]) / 2])
    return least_squares(residual, start, slopes, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def wired(cam: CameraConfigMsg, dcm_EC: F64 | None = None, **params: Any) -> tuple[PixelLineConverter, dict[str, Any]]:
    converter = PixelLineConverter("converter", PixelLineConverter.Params(**params))
    feed = sources(converter)
    feed["in_camera"].write(cam, 0)
    feed["in_attitude"].write(attitude(), 0)
    if dcm_EC is not None:
        feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=dcm_EC, omega_EN_N=np.zeros(3)), 0)
    return converter, feed


def latest(converter: PixelLineConverter, t_ns: int = 0) -> OpNavMsg:
    converter.step(t_ns)
    message = converter.out_position.latest()
    assert message is not None
    return message


def place(off: float, far: float, turn: float = 0.7) -> F64:
    """Camera relative to the body, which is ``off`` degrees off axis."""
    t = np.radians(off)
    return -far * np.array([np.sin(t) * np.cos(turn), np.sin(t) * np.sin(turn), np.cos(t)])


def basilisk(case: dict[str, Any]) -> OpNavMsg:
    converter = PixelLineConverter("converter", PixelLineConverter.Params(basilisk=True))
    feed = sources(converter)
    feed["in_camera"].write(basilisk_camera(case), 0)
    feed["in_attitude"].write(attitude(case["sigma_BN"]), 0)
    circles = np.column_stack([np.array(case["circlesCenters"]).reshape(-1, 2), case["circlesRadii"]])
    P, body = np.array(case["uncertainty"]).reshape(3, 3), body_of(case["planetIds"][0])
    feed["in_circles"].write(circles_message(circles, P, body, case["timeTag"], valid=bool(case["valid"])), 0)
    return latest(converter)


def test_basilisk_vectors(criterion: Criterion) -> None:
    """All resolutions, attitudes beyond 1, several circles; planets that Basilisk makes up are refused."""
    for case in vectors("pixel_line"):
        message = basilisk(case)
        assert message.valid == bool(case["out"]["valid"])
        criterion("PIXELLINE-1", worst(message, case["out"]))
    for case in vectors("pixel_line_refused"):
        message = basilisk(case)
        assert (message.valid, message.status) == (False, relative.UNKNOWN_BODY)
    none = basilisk({**vectors("pixel_line")[0], "valid": 0})
    assert not none.valid
    np.testing.assert_array_equal(none.r_CP_N, np.zeros(3))
    assert body_of(2.9) == 499


@pytest.mark.parametrize("axes", [SPHERE, SATURN, MIMAS], ids=["sphere", "saturn", "mimas"])
def test_whole_limb(criterion: Criterion, axes: F64) -> None:
    """0 to 30 degrees off axis, 3 to 100 radii away, with and without distortion."""
    dcm_EC = Rotation.from_euler("zyx", [0.4, -1.0, 2.0]).as_matrix()
    for off, radii, lens in [
        (0, 100, (0.0,) * 5),
        (10, 5.3, LENS),
        (20, 10, (0.0,) * 5),
        (30, 3, (0.0,) * 5),
        (25, 4, LENS),
    ]:
        cam, r_C = camera(492.0, distortion=lens), place(off, radii * axes[0])
        converter, feed = wired(cam, dcm_EC, axes=axes)
        feed["in_circles"].write(circles_message(circle_of(cam, axes, dcm_EC, r_C)[None], 1e-4 * U), 0)
        message = latest(converter)
        assert message.valid, message.status
        criterion("PIXELLINE-2", float(np.linalg.norm(message.r_CP_C - r_C) / np.linalg.norm(r_C)))


def test_lit_half(criterion: Criterion) -> None:
    """The circle through the lit part of the limb is another one, up to a pixel."""
    cam, r_C, dcm_EC = camera(492.0), place(20, 5 * SPHERE[0]), np.eye(3)
    for sun in ([1.0, 0.2, -0.3], [0.0, -1.0, 1.0], [-1.0, 0.5, 0.0]):
        sun_C = np.array(sun) / np.linalg.norm(sun)
        converter, feed = wired(cam, axes=SPHERE, lit_half=True)
        fields: dict[str, Any] = {"body_id": 10, "mu": 1.3e20, "radius": 7e8, "v_PN_N": np.zeros(3)}
        feed["in_sun"].write(EphemerisMsg(r_PN_N=2e11 * sun_C, **fields), 0)
        circle = circle_of(cam, SPHERE, dcm_EC, r_C, sun_C, 40000)
        assert np.linalg.norm(circle - circle_of(cam, SPHERE, dcm_EC, r_C)) > 0.3
        feed["in_circles"].write(circles_message(circle[None], 1e-4 * U), 0)
        message = latest(converter)
        assert message.valid
        criterion("PIXELLINE-3", float(np.linalg.norm(message.r_CP_C - r_C) / np.linalg.norm(r_C)))


def test_off_axis_bias_of_a_circle_about_the_center() -> None:
    """The row of the audit: f = 492 px, 10 degrees, 18,000 km: 3.3 px that Basilisk misses."""
    cam, r_C, radius = camera(492.0), place(10, 18e6, 0.0), 3396.19e3
    circle = circle_of(cam, np.full(3, radius), np.eye(3), r_C)
    center = pixels(cam, -r_C[None])[0]
    assert abs(np.hypot(*(circle[:2] - center)) - 3.3) < 0.05
    as_is = PixelLineConverter("as_is", PixelLineConverter.Params(basilisk=True))
    feed = sources(as_is)
    feed["in_camera"].write(cam, 0)
    feed["in_attitude"].write(attitude(), 0)
    feed["in_circles"].write(circles_message(circle[None], U), 0)
    assert abs(np.linalg.norm(latest(as_is).r_CP_C - r_C)) > 300e3


def test_covariance(criterion: Criterion) -> None:
    """2000 draws of a noisy circle, far off axis: NEES of 3, and the scatter is the covariance."""
    cam, r_C, rng = camera(492.0), place(25, 6 * SPHERE[0]), np.random.default_rng(1)
    converter, feed = wired(cam, axes=SPHERE)
    circle, root, P_px = circle_of(cam, SPHERE, np.eye(3), r_C), np.linalg.cholesky(0.01 * U), 0.01 * U
    errors, nees = list[F64](), list[float]()
    for _ in range(2000):
        feed["in_circles"].write(circles_message((circle + root @ rng.normal(size=3))[None], P_px), 0)
        message = latest(converter)
        errors.append(message.r_CP_C - r_C)
        nees.append(float(errors[-1] @ np.linalg.solve(message.P_rr_C, errors[-1])))
    criterion("PIXELLINE-4", float(np.mean(nees)) - 3.0)
    feed["in_circles"].write(circles_message(circle[None], P_px), 0)
    whitened = np.linalg.solve(np.linalg.cholesky(latest(converter).P_rr_C), np.array(errors).T)
    criterion("PIXELLINE-5", float(np.max(np.abs(whitened @ whitened.T / 2000 - np.eye(3)))))


def test_frames_and_unknown_shape() -> None:
    """Position in three frames; without an attitude of the body its shape is an uncertainty of the distance."""
    dcm_CB, body = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix(), Rotation.from_mrp([0.2, 0.6, -1.1])
    plain = camera(800.0)
    cam = CameraConfigMsg(**{**{f: getattr(plain, f) for f in plain.__struct_fields__}, "dcm_CB": dcm_CB})
    r_C, mean = place(15, 1e9), float(np.mean(SATURN))
    converter, feed = wired(cam, axes=SATURN, sigma_att=1e-4)
    feed["in_attitude"].write(attitude([0.2, 0.6, -1.1]), 0)
    circle = circle_of(cam, np.full(3, mean), np.eye(3), r_C)
    feed["in_circles"].write(circles_message(circle[None], 1e-6 * U), 0)
    message = latest(converter)
    dcm_NC = body.as_matrix() @ dcm_CB.T
    np.testing.assert_allclose(message.r_CP_C, r_C, rtol=0, atol=10.0)
    np.testing.assert_allclose(message.r_CP_B, dcm_CB.T @ message.r_CP_C, rtol=0, atol=1e-4)
    np.testing.assert_allclose(message.r_CP_N, dcm_NC @ message.r_CP_C, rtol=0, atol=1e-4)
    u = r_C / np.linalg.norm(r_C)
    width = (SATURN[0] - SATURN[2]) / mean / np.sqrt(12.0)
    np.testing.assert_allclose(np.sqrt(u @ message.P_rr_C @ u) / 1e9, width, rtol=1e-3)
    added = message.P_rr_N - dcm_NC @ message.P_rr_C @ dcm_NC.T
    np.testing.assert_allclose(added, 1e-8 * (1e18 * np.eye(3) - np.outer(message.r_CP_N, message.r_CP_N)), atol=1e3)
    pole = Rotation.from_euler("zyx", [0.4, -1.0, 2.0]).as_matrix()
    converter, feed = wired(plain, axes=SATURN, pole_N=pole[2])
    feed["in_circles"].write(circles_message(circle_of(plain, SATURN, pole, r_C)[None], 1e-6 * U), 0)
    np.testing.assert_allclose(latest(converter).r_CP_C, r_C, rtol=0, atol=10.0)


REASONS: dict[str, tuple[int, dict[str, Any]]] = {
    "invalid": (relative.NOTHING_FOUND, {"valid": False}),
    "none": (relative.NOTHING_FOUND, {"count": 0}),
    "nan": (relative.BAD_NUMBERS, {"radius_px": np.full(10, np.nan)}),
    "radius": (relative.BAD_NUMBERS, {"radius_px": np.full(10, -5.0)}),
    "covariance": (relative.BAD_NUMBERS, {"P_px": np.zeros((10, 3, 3))}),
    "body": (relative.UNKNOWN_BODY, {"body_id": 2}),
    "time": (relative.OLD_ATTITUDE, {"exposure_ns": s(20)}),
    "outside": (relative.OUTSIDE_LENS, {"center_px": np.full((10, 2), 1e6)}),
    "tiny": (relative.TOO_UNSURE, {"radius_px": np.full(10, 1.0)}),
}


@pytest.mark.parametrize("kind", REASONS)
def test_no_position_from_bad_circles(kind: str) -> None:
    status, changed = REASONS[kind]
    converter, feed = wired(camera(492.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0)))
    good = circles_message(np.array([[500.0, 520.0, 60.0]]), U)
    fields = {f: getattr(good, f) for f in good.__struct_fields__}
    feed["in_circles"].write(type(good)(**{**fields, **changed}), 0)
    message = latest(converter)
    assert (message.valid, message.status) == (False, status)
    for f in FRAMES:
        assert np.all(np.isnan(getattr(message, f"r_CP_{f}")))
    feed["in_circles"].write(good, 0)
    assert latest(converter).valid


def test_no_position_without_inputs() -> None:
    converter = PixelLineConverter("converter", PixelLineConverter.Params(lit_half=True))
    converter.step(0)
    assert converter.out_position.latest() is None
    feed = sources(converter)
    circles = circles_message(np.array([[500.0, 520.0, 60.0]]), U)
    feed["in_circles"].write(circles, 0)
    assert latest(converter).status == relative.NO_INPUT
    feed["in_camera"].write(camera(492.0), 0)
    feed["in_attitude"].write(attitude(), 0)
    feed["in_circles"].write(circles, 0)
    assert latest(converter).status == relative.NO_INPUT  # the Sun is missing
    seq = converter.out_position.seq
    converter.step(0)
    assert converter.out_position.seq == seq
