"""CobConverter against the light of a sphere integrated pixel by pixel, and CenterOfBrightness on such images."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.spatial.transform import Rotation

from fsw import s
from messages.base import F64
from messages.environment import EphemerisMsg
from messages.opnav import CameraConfigMsg, OpNavBrightnessMsg, OpNavDirectionMsg
from messages.states import NavTransMsg
from modules.opnav import relative
from modules.opnav.cob_converter import CobConverter
from modules.opnav.cob_converter.kernel import LAMBERT, NONE, UNIFORM, phase_shift
from tests.modules.opnav.disk_truth import FRAMES, Criterion, attitude, camera, sources
from tests.modules.opnav.lit_sphere import lit_sphere

LENS = (-0.1, 0.02, 1e-3, -5e-4, 0.0)
RADIUS = 3.4e6
P_PX = np.array([[0.01, 0.002], [0.002, 0.02]])


def brightness(center: F64, area: float = 1000.0, **more: Any) -> OpNavBrightnessMsg:
    fields: dict[str, Any] = {"exposure_ns": 0, "valid": True, "status": 0, "body_id": 499, "P_px": P_PX}
    return OpNavBrightnessMsg(center_px=center, area_px=area, **{**fields, **more})


def wired(cam: CameraConfigMsg, sun_N: F64, far: float = 0.0, **params: Any) -> tuple[CobConverter, dict[str, Any]]:
    made: dict[str, Any] = {"axes": np.full(3, RADIUS), **params}
    converter = CobConverter("converter", CobConverter.Params(**made))
    feed = sources(converter)
    feed["in_camera"].write(cam, 0)
    feed["in_attitude"].write(attitude(), 0)
    sun: dict[str, Any] = {"body_id": 10, "mu": 1.3e20, "radius": 7e8, "v_PN_N": np.zeros(3)}
    feed["in_sun"].write(EphemerisMsg(r_PN_N=1.5e11 * sun_N, **sun), 0)
    if far > 0.0:
        feed["in_trans"].write(NavTransMsg(r_BN_N=np.array([0.0, far, 0.0]), v_BN_N=np.zeros(3)), 0)
    return converter, feed


def latest(converter: CobConverter) -> OpNavDirectionMsg:
    converter.step(0)
    message = converter.out_direction.latest()
    assert message is not None
    return message


def scene(off: float, phase: float, turn: float) -> tuple[F64, F64]:
    """Directions of the body and of the Sun in C."""
    t = np.radians(off)
    u = np.array([np.sin(t) * np.cos(0.4), np.sin(t) * np.sin(0.4), np.cos(t)])
    side = np.cross(u, [np.cos(turn), np.sin(turn), 0.3])
    side /= np.linalg.norm(side)
    return u, -np.cos(phase) * u + np.sin(phase) * side


@pytest.mark.parametrize("law", [LAMBERT, UNIFORM])
def test_shift_of_a_far_disk(criterion: Criterion, law: int) -> None:
    """The two formulas against integrals over the lit part of the disk."""
    for phase in np.radians([1.0, 30.0, 90.0, 120.0, 150.0]):

        def light(y: float, x: float, a: float = float(phase)) -> float:
            z = np.sqrt(max(0.0, 1.0 - x * x - y * y))
            lit = x * np.sin(a) + z * np.cos(a)
            return float(lit > 0.0) if law == UNIFORM else max(0.0, lit)

        def first(x: float, a: float = float(phase)) -> float:
            return float(np.sqrt(1.0 - x * x))

        # the terminator is the ellipse x = -cos(a) sqrt(1 - y^2): integrate along x between it and the limb
        def edge(y: float, a: float = float(phase)) -> float:
            return float(-np.cos(a) * np.sqrt(1.0 - y * y))

        total = dblquad(lambda x, y: light(y, x), -1.0, 1.0, edge, first, epsabs=1e-9)[0]
        moment = dblquad(lambda x, y: x * light(y, x), -1.0, 1.0, edge, first, epsabs=1e-9)[0]
        criterion("COB-1", phase_shift(law, float(phase)) - moment / total)
    assert phase_shift(law, 0.0) == 0.0


@pytest.mark.parametrize("law", [LAMBERT, UNIFORM])
def test_direction(criterion: Criterion, law: int) -> None:
    """Spheres of 3 to 30 px radius, 0 to 20 degrees off axis, phases 0 to 120 degrees; range known."""
    for off, phase, focal, far in [(0, 30, 800, 100), (15, 90, 800, 60), (20, 120, 1500, 50), (10, 0, 800, 40)]:
        u, sun = scene(off, np.radians(phase), 1.0)
        cam = camera(focal, distortion=LENS)
        center, _, radius = lit_sphere(cam, far * u, sun, law)
        converter, feed = wired(cam, sun, far * RADIUS, law=law)
        feed["in_brightness"].write(brightness(center), 0)
        message = latest(converter)
        assert message.valid, message.status
        away = np.linalg.norm(np.cross(message.u_PC_C, u)) * focal
        criterion("COB-2", float(away) / radius)
        bare, feed = wired(cam, sun, law=NONE)
        feed["in_brightness"].write(brightness(center), 0)
        if phase > 0:
            assert np.linalg.norm(np.cross(latest(bare).u_PC_C, u)) * focal > 10 * away


def test_radius_from_the_light(criterion: Criterion) -> None:
    """Without a range the lit area says how large the disk is."""
    for off, phase in [(0, 40), (15, 100)]:
        u, sun = scene(off, np.radians(phase), 2.0)
        cam = camera(800.0)
        center, area, radius = lit_sphere(cam, 60.0 * u, sun, LAMBERT)
        converter, feed = wired(cam, sun)
        feed["in_brightness"].write(brightness(center, area), 0)
        away = np.linalg.norm(np.cross(latest(converter).u_PC_C, u)) * 800.0
        criterion("COB-3", float(away) / radius)


def test_covariance(criterion: Criterion) -> None:
    """Scatter of 4000 draws off axis; the attitude's error goes to N, that of the law along the shift."""
    u, sun = scene(20, np.radians(60.0), 1.0)
    cam, rng = camera(800.0, distortion=LENS), np.random.default_rng(1)
    center, _, _ = lit_sphere(cam, 60.0 * u, sun, LAMBERT)
    converter, feed = wired(cam, sun, 60.0 * RADIUS, sigma_law=0.0, sigma_att=1e-3)
    root, errors = np.linalg.cholesky(P_PX), list[F64]()
    feed["in_brightness"].write(brightness(center), 0)
    middle = latest(converter)
    for _ in range(4000):
        feed["in_brightness"].write(brightness(center + root @ rng.normal(size=2)), 0)
        errors.append(latest(converter).u_PC_C - middle.u_PC_C)
    e1 = np.cross(middle.u_PC_C, [0.0, 1.0, 0.0])
    plane = np.stack([e1 / np.linalg.norm(e1), np.cross(middle.u_PC_C, e1 / np.linalg.norm(e1))])
    whitened = np.linalg.solve(np.linalg.cholesky(plane @ middle.P_uu_C @ plane.T), plane @ np.array(errors).T)
    criterion("COB-4", float(np.max(np.abs(whitened @ whitened.T / 4000 - np.eye(2)))))
    np.testing.assert_allclose(middle.P_uu_C @ middle.u_PC_C, 0.0, atol=1e-20)
    added = 1e-6 * (np.eye(3) - np.outer(middle.u_PC_N, middle.u_PC_N))
    np.testing.assert_allclose(middle.P_uu_N - middle.P_uu_C, added, atol=1e-15)
    unsure, feed = wired(cam, sun, 60.0 * RADIUS, sigma_law=0.5)
    feed["in_brightness"].write(brightness(center), 0)
    more = latest(unsure).P_uu_C - middle.P_uu_C
    bare, feed = wired(cam, sun, 60.0 * RADIUS, law=NONE)
    feed["in_brightness"].write(brightness(center), 0)
    shift = latest(bare).u_PC_C - middle.u_PC_C
    np.testing.assert_allclose(more, 0.25 * np.outer(shift, shift), atol=0.02 * float(np.trace(more)))


def test_frames() -> None:
    """Directions in B and N."""
    dcm_CB, body = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix(), Rotation.from_mrp([0.2, 0.6, -1.1])
    cam = camera(800.0, dcm_CB=dcm_CB)
    u, sun = scene(10, np.radians(50.0), 1.0)
    dcm_NC = body.as_matrix() @ dcm_CB.T
    converter, feed = wired(cam, dcm_NC @ sun, 60.0 * RADIUS)
    feed["in_attitude"].write(attitude([0.2, 0.6, -1.1]), 0)
    feed["in_brightness"].write(brightness(lit_sphere(cam, 60.0 * u, sun, LAMBERT)[0]), 0)
    message = latest(converter)
    np.testing.assert_allclose(message.u_PC_C, u, atol=5e-5)  # the shift is that of a far sphere
    np.testing.assert_allclose(message.u_PC_B, dcm_CB.T @ message.u_PC_C, atol=1e-14)
    np.testing.assert_allclose(message.u_PC_N, dcm_NC @ message.u_PC_C, atol=1e-14)
    np.testing.assert_allclose(message.P_uu_N, dcm_NC @ message.P_uu_C @ dcm_NC.T, atol=1e-20)
    np.testing.assert_allclose(message.P_uu_B, dcm_CB.T @ message.P_uu_C @ dcm_CB, atol=1e-20)


REASONS: dict[str, tuple[int, dict[str, Any]]] = {
    "invalid": (relative.NOTHING_FOUND, {"valid": False}),
    "nan": (relative.BAD_NUMBERS, {"center_px": np.array([np.nan, 3.0])}),
    "covariance": (relative.BAD_NUMBERS, {"P_px": np.array([[1.0, 2.0], [2.0, 1.0]])}),
    "area": (relative.BAD_NUMBERS, {"area_px": np.nan}),
    "lens": (relative.OUTSIDE_LENS, {"center_px": np.array([1e6, 0.0])}),
    "time": (relative.OLD_ATTITUDE, {"exposure_ns": s(20)}),
}


@pytest.mark.parametrize("kind", REASONS)
def test_no_direction(kind: str) -> None:
    status, changed = REASONS[kind]
    converter, feed = wired(camera(800.0, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0)), np.array([0.0, 1.0, 0.0]))
    good = brightness(np.array([500.0, 510.0]))
    feed["in_brightness"].write(
        OpNavBrightnessMsg(**{**{f: getattr(good, f) for f in good.__struct_fields__}, **changed}), 0
    )
    message = latest(converter)
    assert (message.valid, message.status) == (False, status)
    for f in FRAMES:
        assert np.all(np.isnan(getattr(message, f"u_PC_{f}")))
    feed["in_brightness"].write(good, 0)
    assert latest(converter).valid


def test_no_direction_beyond_the_largest_phase_or_without_inputs() -> None:
    converter, feed = wired(camera(800.0), np.array([0.05, 0.0, 1.0]))
    feed["in_brightness"].write(brightness(np.array([500.0, 510.0])), 0)
    assert latest(converter).status == relative.TOO_UNSURE
    feed["in_trans"].write(NavTransMsg(r_BN_N=np.array([0.0, 0.5 * RADIUS, 0.0]), v_BN_N=np.zeros(3)), 0)
    feed["in_brightness"].write(brightness(np.array([500.0, 510.0])), 0)
    assert latest(converter).status == relative.NO_SOLUTION
    unknown, feed = wired(camera(800.0), np.array([0.0, 1.0, 0.0]), 1e9, axes=np.zeros(3))
    feed["in_brightness"].write(brightness(np.array([500.0, 510.0]), body_id=2), 0)
    assert latest(unknown).status == relative.UNKNOWN_BODY
    blind = CobConverter("converter")
    blind.step(0)
    assert blind.out_direction.latest() is None
    sources(blind)["in_brightness"].write(brightness(np.array([500.0, 510.0])), 0)
    assert latest(blind).status == relative.NO_INPUT
