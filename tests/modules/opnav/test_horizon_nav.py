"""HorizonNav against Basilisk's vectors, exact limbs projected by OpenCV, and the bound of the information in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import s
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.opnav import MAX_LIMB, MAX_MODES, CameraConfigMsg, OpNavMsg
from modules.opnav import relative
from modules.opnav.basilisk import body_of
from modules.opnav.horizon_nav import HorizonNav
from tests.modules.opnav.disk_truth import (
    FRAMES,
    Criterion,
    attitude,
    basilisk_camera,
    camera,
    limb_message,
    limb_points,
    pixels,
    sources,
    vectors,
    worst,
)

SPHERE, JUPITER, SATURN = (3.4e6,) * 3, (71492e3, 71492e3, 66854e3), (60268e3, 60268e3, 54364e3)
PHOBOS, MIMAS = (13.0e3, 11.4e3, 9.1e3), (207.8e3, 196.7e3, 190.6e3)
LENS = (-0.1, 0.02, 1e-3, -5e-4, 0.0)
SIGMA = 0.1


class Scene:
    """An arc of a limb, seen exactly, with the direction of the noise and the information that it holds."""

    def __init__(
        self, axes: tuple[float, ...], radius_px: float, off: float, half: float, seed: int, lens: Any = (0.0,) * 5
    ) -> None:
        rng = np.random.default_rng(seed)
        self.axes = np.array(axes)
        focal = 1500.0 if radius_px > 300.0 else 800.0
        self.camera = camera(focal, distortion=lens)
        self.range = float(np.mean(axes)) / np.sin(np.arctan(radius_px / focal))
        turn, angle = rng.uniform(0.0, 2 * np.pi), np.radians(off)
        self.r_C = -self.range * np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
        self.dcm_EC = Rotation.random(rng=rng).as_matrix()
        ring = np.linspace(0.0, 2 * np.pi, 20001)
        outline = self.limb(ring)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(outline, axis=0).T))])
        self.count = min(2000, int(length[-1] * half / 180.0))  # a point for each pixel
        along = rng.uniform() + np.arange(self.count) / self.count * half / 180.0
        at = np.interp((along % 1.0) * length[-1], length, ring)
        self.exact = self.limb(at)
        tangent = self.limb(at + 1e-5) - self.limb(at - 1e-5)
        tangent /= np.linalg.norm(tangent, axis=1)[:, None]
        self.normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        slopes = np.empty((self.count, 3))
        for k in range(3):
            step = 1e-6 * self.range * np.eye(3)[k]
            moved = self.limb(at, self.r_C + step) - self.limb(at, self.r_C - step)
            slopes[:, k] = np.sum(moved * self.normal, axis=1) / (2e-6 * self.range)
        self.bound = np.linalg.inv(slopes.T @ slopes) * SIGMA**2

    def limb(self, angle: F64, r_C: F64 | None = None) -> F64:
        return pixels(self.camera, limb_points(self.axes, self.dcm_EC, self.r_C if r_C is None else r_C, angle))

    def module(self, **params: Any) -> tuple[HorizonNav, Any]:
        made: dict[str, Any] = {"axes": self.axes, **params}
        nav = HorizonNav("nav", HorizonNav.Params(**made))
        feed = sources(nav)
        feed["in_camera"].write(self.camera, 0)
        feed["in_attitude"].write(attitude(), 0)
        feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=self.dcm_EC, omega_EN_N=np.zeros(3)), 0)
        return nav, feed["in_limb"]


def latest(nav: HorizonNav, t_ns: int = 0) -> OpNavMsg:
    nav.step(t_ns)
    message = nav.out_position.latest()
    assert message is not None
    return message


def basilisk(case: dict[str, Any]) -> tuple[HorizonNav, Any, F64]:
    nav = HorizonNav("nav", HorizonNav.Params(basilisk=True, noise_factor=case["noiseSF"]))
    feed = sources(nav)
    feed["in_camera"].write(basilisk_camera(case), 0)
    feed["in_attitude"].write(attitude(case["sigma_BN"]), 0)
    return nav, feed["in_limb"], np.array(case["limbPoints"]).reshape(-1, 2)


def test_basilisk_vectors(criterion: Criterion) -> None:
    """Positions and covariances in three frames; far planets are ill-conditioned in Basilisk's variables."""
    for case in vectors("horizon"):
        nav, limb, points = basilisk(case)
        limb.write(limb_message(points, 1.0, body_of(case["planet"])), 0)
        message = latest(nav)
        assert message.valid
        criterion("HORIZON-1", worst(message, case["out"]))


def test_basilisk_quirks() -> None:
    """Points beyond 1365 are not used, and a new planet takes effect one call late."""
    case = vectors("horizon")[0]
    nav, limb, points = basilisk(case)
    many = np.resize(points, (1400, 2))
    limb.write(limb_message(many, 1.0, 399), 0)
    few = latest(nav)
    many[1365:] += 50.0
    limb.write(limb_message(many, 1.0, 599), 0)
    late = latest(nav)
    assert late.body_id == 399
    np.testing.assert_array_equal(late.r_CP_N, few.r_CP_N)
    limb.write(limb_message(many, 1.0, 599, valid=False), 0)
    assert not latest(nav).valid
    limb.write(limb_message(many, 1.0, 499), 0)
    assert latest(nav).body_id == 599
    limb.write(limb_message(many[:2], 1.0, 599), 0)
    assert latest(nav).status == relative.TOO_FEW


@pytest.mark.parametrize("axes", [SPHERE, JUPITER, SATURN, PHOBOS, MIMAS], ids=["sphere", "jup", "sat", "pho", "mim"])
def test_exact_limbs(criterion: Criterion, axes: tuple[float, ...]) -> None:
    """Without noise the position comes back, off axis, with a distorting lens, and from arcs."""
    for k, (radius, off, half) in enumerate([(20, 0, 180), (100, 20, 90), (800, 10, 30), (300, 20, 180)]):
        scene = Scene(axes, radius, off, half, k, LENS)
        nav, limb = scene.module()
        limb.write(limb_message(scene.exact, SIGMA), 0)
        message = latest(nav)
        assert message.valid
        criterion("HORIZON-2", float(np.linalg.norm(message.r_CP_C - scene.r_C)) / scene.range)
        np.testing.assert_allclose(message.P_rr_C, scene.bound, rtol=0, atol=2e-3 * float(np.trace(scene.bound)))


@pytest.mark.slow
def test_monte_carlo(criterion: Criterion) -> None:
    """1000 draws of each case: root mean square error over the bound, NEES of 3, bias in standard deviations."""
    cases = [(a, r, o, h) for a in (SPHERE, SATURN, PHOBOS) for r, o, h in [(20, 10, 180), (20, 20, 30), (100, 0, 90)]]
    cases += [(JUPITER, 100, 20, 30), (MIMAS, 20, 0, 30), (SPHERE, 800, 20, 180), (MIMAS, 800, 10, 30)]
    rng, pooled = np.random.default_rng(1), list[float]()
    for k, (axes, radius, off, half) in enumerate(cases):
        scene = Scene(axes, radius, off, half, k)
        errors, nees = run(scene, rng, 1000)
        pooled += nees
        criterion("HORIZON-3", float(np.sqrt(np.mean(np.sum(errors**2, axis=1)) / np.trace(scene.bound))))
        criterion("HORIZON-4", float(np.mean(nees)) - 3.0)
        whitened = np.linalg.solve(np.linalg.cholesky(scene.bound), errors.T)
        criterion("HORIZON-6", float(np.max(np.abs(np.mean(whitened, axis=1)))))
    criterion("HORIZON-5", float(np.mean(pooled)) - 3.0)


def run(
    scene: Scene, rng: np.random.Generator, draws: int, wrong: float = 0.0, **params: Any
) -> tuple[F64, list[float]]:
    """Errors (n, 3) [m] and normalised squared errors; ``wrong`` is the part of points moved by up to 60 px."""
    nav, limb = scene.module(**params)
    errors, nees = list[F64](), list[float]()
    for _ in range(draws):
        points = scene.exact + SIGMA * rng.normal(size=(scene.count, 1)) * scene.normal
        moved = rng.random(scene.count) < wrong
        points[moved] += rng.uniform(-60.0, 60.0, (int(moved.sum()), 2))
        limb.write(limb_message(points, SIGMA), 0)
        message = latest(nav)
        assert message.valid, message.status
        errors.append(message.r_CP_C - scene.r_C)
        nees.append(float(errors[-1] @ np.linalg.solve(message.P_rr_C, errors[-1])))
    return np.array(errors), nees


def test_wrong_points(criterion: Criterion) -> None:
    """Five per cent of the points are elsewhere; they hold no information."""
    rng = np.random.default_rng(2)
    for k, (radius, half) in enumerate([(20, 180), (100, 90), (100, 30)]):
        scene = Scene(SATURN, radius, 10, half, k)
        errors, _ = run(scene, rng, 200, wrong=0.05)
        criterion("HORIZON-7", float(np.sqrt(np.mean(np.sum(errors**2, axis=1)) / np.trace(scene.bound))))
    # a single far point can bend a short arc of a small disk to itself; the other points cannot tell
    scene = Scene(SPHERE, 20, 0, 30, 3)
    points = scene.exact + SIGMA * rng.normal(size=(scene.count, 1)) * scene.normal
    middle = pixels(scene.camera, -scene.r_C[None])[0]
    points[0] = middle - 1.05 * (scene.exact[scene.count // 2] - middle)
    nav, limb = scene.module()
    limb.write(limb_message(points, SIGMA), 0)
    message = latest(nav)
    error = message.r_CP_C - scene.r_C
    assert message.valid
    assert error @ np.linalg.solve(message.P_rr_C, error) < 20.0
    nav, limb = scene.module(robust=False)
    limb.write(limb_message(points, SIGMA), 0)
    error = latest(nav).r_CP_C - scene.r_C
    assert error @ np.linalg.solve(latest(nav).P_rr_C, error) > 100.0


def test_closed_form_bound(criterion: Criterion) -> None:
    """A small full disk on the boresight: r s / f sqrt(2 / N) across, r s / (f tan rho sqrt(N)) along."""
    scene = Scene(SPHERE, 20, 0, 180, 0)
    nav, limb = scene.module()
    limb.write(limb_message(scene.exact, SIGMA), 0)
    P, angle = latest(nav).P_rr_C, SIGMA / 800.0
    across = scene.range * angle * np.sqrt(2.0 / scene.count)
    along = scene.range * angle / (20.0 / 800.0 * np.sqrt(scene.count))
    criterion("HORIZON-8", float(np.max(np.abs(np.sqrt(np.diag(P)) / [across, across, along] - 1.0))))


def test_frames_and_times() -> None:
    """Attitude and body are turned on to the exposure; N components go with both, and attitude errors to N only."""
    scene = Scene(MIMAS, 100, 10, 180, 5)
    rng = np.random.default_rng(3)
    dcm_CB, body = Rotation.random(rng=rng).as_matrix(), Rotation.from_mrp([0.3, -0.5, 0.9])
    rate, spin = np.array([0.01, -0.02, 0.005]), np.array([1e-3, 2e-3, -1e-3])
    late = (body * Rotation.from_rotvec(2.0 * rate)).as_matrix().T  # scipy's rotations map B to N
    dcm_EN = scene.dcm_EC @ dcm_CB @ late
    nav = HorizonNav("nav", HorizonNav.Params(axes=scene.axes, sigma_att=1e-4))
    feed = sources(nav)
    cam = camera(800.0)
    feed["in_camera"].write(
        CameraConfigMsg(**{**{f: getattr(cam, f) for f in cam.__struct_fields__}, "dcm_CB": dcm_CB}), 0
    )
    feed["in_attitude"].write(attitude([0.3, -0.5, 0.9], rate.tolist()), s(5))
    before = dcm_EN @ Rotation.from_rotvec(3.0 * spin).as_matrix()
    feed["in_orientation"].write(PlanetOrientationMsg(dcm_EN=before, omega_EN_N=spin), s(4))
    feed["in_limb"].write(limb_message(scene.exact, SIGMA, when=s(7)), s(8))
    message = latest(nav, s(8))
    assert (message.valid, message.exposure_ns) == (True, s(7))
    np.testing.assert_allclose(message.r_CP_C, scene.r_C, rtol=0, atol=1e-9 * scene.range)
    np.testing.assert_allclose(message.r_CP_B, dcm_CB.T @ scene.r_C, rtol=0, atol=1e-9 * scene.range)
    np.testing.assert_allclose(message.r_CP_N, late.T @ dcm_CB.T @ scene.r_C, rtol=0, atol=1e-9 * scene.range)
    across = scene.range**2 * np.eye(3) - np.outer(message.r_CP_N, message.r_CP_N)
    dcm_NC = (dcm_CB @ late).T
    np.testing.assert_allclose(message.P_rr_N, dcm_NC @ message.P_rr_C @ dcm_NC.T + 1e-8 * across, rtol=1e-9)
    np.testing.assert_allclose(message.P_rr_B, dcm_CB.T @ message.P_rr_C @ dcm_CB, rtol=1e-9, atol=1e-9)


def test_options() -> None:
    """Pole of a spheroid, height of the limb, noise larger than stated."""
    scene = Scene(SATURN, 100, 10, 180, 6)
    pole: dict[str, Any] = {"axes": scene.axes - 50e3, "limb_height": 50e3, "pole_N": 4.0 * scene.dcm_EC[2]}
    nav = HorizonNav("nav", HorizonNav.Params(**pole))  # C, B and N are the same
    feed = sources(nav)
    feed["in_camera"].write(scene.camera, 0)
    feed["in_attitude"].write(attitude(), 0)
    feed["in_limb"].write(limb_message(scene.exact, SIGMA), 0)
    np.testing.assert_allclose(latest(nav).r_CP_C, scene.r_C, rtol=0, atol=1e-9 * scene.range)
    rng = np.random.default_rng(4)
    points = scene.exact + 5.0 * SIGMA * rng.normal(size=(scene.count, 1)) * scene.normal
    feed["in_limb"].write(limb_message(points, SIGMA), 0)
    np.testing.assert_allclose(np.trace(latest(nav).P_rr_C) / np.trace(scene.bound), 25.0, rtol=0.15)


def spoiled(scene: Scene, kind: str) -> tuple[F64, Any, dict[str, Any], dict[str, Any]]:
    """Points, sigma, fields and parameters of a limb that gives no position."""
    points, sigma = scene.exact.copy(), np.full(scene.count, SIGMA)
    rng = np.random.default_rng(7)
    if kind == "nan":
        points[5, 1] = np.nan
    if kind == "sigma":
        sigma[3] = 0.0
    if kind == "lens":
        points[2] = [1e5, 0.0]
    if kind == "noise":
        points = rng.uniform(0.0, 1024.0, points.shape)
    if kind == "line":
        points = np.stack([np.linspace(100.0, 900.0, scene.count), np.full(scene.count, 300.0)], axis=1)
    if kind == "same":
        points[:] = points[0]
    if kind == "arc":
        points = points[:4] + SIGMA * rng.normal(size=(4, 1)) * scene.normal[:4]
        sigma = sigma[:4]
    if kind == "few":
        points, sigma = points[::20][:3], sigma[:3]
    fields: dict[str, Any] = {"valid": kind != "invalid", "body_id": 12345 if kind == "body" else 499}
    params: dict[str, Any] = {"axes": np.zeros(3)} if kind == "body" else {}
    return points, sigma, fields, params


REASONS = {
    "invalid": {relative.NOTHING_FOUND},
    "nan": {relative.BAD_NUMBERS},
    "sigma": {relative.BAD_NUMBERS},
    "lens": {relative.OUTSIDE_LENS},
    "noise": {relative.NO_SOLUTION, relative.OUTLIERS},
    "line": {relative.NO_SOLUTION, relative.TOO_UNSURE, relative.OUTLIERS},
    "same": {relative.NO_SOLUTION},
    "arc": {relative.NO_SOLUTION, relative.TOO_UNSURE, relative.OUTLIERS},
    "few": {relative.TOO_FEW},
    "body": {relative.UNKNOWN_BODY},
}


@pytest.mark.parametrize("kind", REASONS)
def test_no_position_from_bad_limbs(kind: str) -> None:
    scene = Scene(SPHERE, 100, 5, 180, 8, (-0.3 if kind == "lens" else 0.0, 0.0, 0.0, 0.0, 0.0))
    points, sigma, fields, params = spoiled(scene, kind)
    nav, limb = scene.module(**params)
    limb.write(limb_message(points, sigma, **fields), 0)
    message = latest(nav)
    assert not message.valid
    assert message.status in REASONS[kind]
    for f in FRAMES:
        assert np.all(np.isnan(getattr(message, f"r_CP_{f}")))
        assert np.all(np.isnan(getattr(message, f"P_rr_{f}")))


def test_no_position_without_inputs() -> None:
    scene = Scene(MIMAS, 100, 5, 180, 8)
    nav = HorizonNav("nav", HorizonNav.Params(axes=scene.axes))
    nav.step(0)
    assert nav.out_position.latest() is None
    feed = sources(nav)
    feed["in_limb"].write(limb_message(scene.exact, SIGMA), 0)
    assert latest(nav).status == relative.NO_INPUT
    feed["in_camera"].write(scene.camera, 0)
    feed["in_attitude"].write(attitude(), 0)
    feed["in_limb"].write(limb_message(scene.exact, SIGMA), 0)
    assert latest(nav).status == relative.NO_ORIENTATION
    feed["in_limb"].write(limb_message(scene.exact, SIGMA, when=s(11)), 0)
    assert latest(nav).status == relative.OLD_ATTITUDE
    before = nav.out_position.seq
    nav.step(s(1))
    assert nav.out_position.seq == before  # the same limb is not used twice


def test_shift_that_all_points_share() -> None:
    """What `common_px` adds to the covariance is the change of the position when the limb is moved outward."""
    scene = Scene(SPHERE, 150.0, 10.0, 60.0, 4)
    nav, feed = scene.module()
    found: list[OpNavMsg] = []
    for shift, common in ((0.0, 0.0), (0.0, 0.05), (0.01, 0.0), (-0.01, 0.0)):
        points = limb_message(scene.exact + shift * scene.normal, SIGMA, common_px=common)
        feed.write(points, 0)
        nav.step(0)
        message = nav.out_position.latest()
        assert message is not None and message.valid
        found.append(message)
    slope = (found[2].r_CP_C - found[3].r_CP_C) / 0.02
    added = found[1].P_rr_C - found[0].P_rr_C
    np.testing.assert_allclose(added, 0.05**2 * np.outer(slope, slope), rtol=1e-3, atol=1e-4 * np.max(np.abs(added)))


def test_shifts_that_go_together() -> None:
    """A column of `modes_px` adds the change of the position when each point is moved outward by its part of it."""
    scene = Scene(SPHERE, 150.0, 10.0, 60.0, 4)
    nav, feed = scene.module()
    n = len(scene.exact)
    modes = np.zeros((MAX_LIMB, MAX_MODES))
    modes[:n, 2] = 0.05 * np.sin(np.arange(n) / 9.0)
    found: list[OpNavMsg] = []
    for shift, stated in ((0.0, 0.0), (0.0, 1.0), (0.1, 0.0), (-0.1, 0.0)):
        points = scene.exact + shift * modes[:n, 2:3] * scene.normal
        feed.write(limb_message(points, SIGMA, modes_px=stated * modes), 0)
        nav.step(0)
        message = nav.out_position.latest()
        assert message is not None and message.valid
        found.append(message)
    slope = (found[2].r_CP_C - found[3].r_CP_C) / 0.2
    added = found[1].P_rr_C - found[0].P_rr_C
    np.testing.assert_allclose(added, np.outer(slope, slope), rtol=2e-3, atol=1e-3 * np.max(np.abs(added)))
