"""LandmarkOracle against OpenCV's projection, ERFA's heights, and the statistics that were asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from messages.environment import PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, LandmarksMsg
from messages.states import SCStatesMsg
from sim.camera.landmark_oracle import LandmarkOracle, of_camera

Criterion = Callable[[str, float], None]
ERFA: Any = erfa
SIZE = (1200, 900)
SPIN = np.array([0.0, 0.0, 7.292115e-5])
R_BN_N = np.array([4.1e6, -3.2e6, 4.6e6])
V_BN_N = np.array([3.1e3, 6.4e3, 1.7e3])
DCM_EN = Rotation.from_euler("zx", [130.0, 0.1], degrees=True).as_matrix()
DCM_CB = Rotation.from_euler("xyz", [3.0, -2.0, 40.0], degrees=True).as_matrix()


def camera(distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)) -> CameraConfigMsg:
    return CameraConfigMsg(
        width_px=SIZE[0],
        height_px=SIZE[1],
        focal_px=np.array([2000.0, 1990.0]),
        center_px=np.array([601.0, 447.0]),
        distortion=np.array(distortion),
        dcm_CB=DCM_CB,
    )


def pointed(off_nadir_deg: float) -> np.ndarray:
    """dcm_BN with the camera's boresight so far from nadir."""
    z = -R_BN_N / np.linalg.norm(R_BN_N)
    x = np.cross(V_BN_N, z)
    x /= np.linalg.norm(x)
    nadir = np.vstack([x, np.cross(z, x), z])
    return DCM_CB.T @ Rotation.from_euler("x", off_nadir_deg, degrees=True).as_matrix() @ nadir


class Truth(Module):
    """Publishes one pose at every step."""

    out_state = Out(SCStatesMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def __init__(self, dcm_BN: np.ndarray, omega_BN_B: np.ndarray, r_BN_N: np.ndarray) -> None:
        super().__init__("truth")
        sigma = Rotation.from_matrix(dcm_BN.T).as_mrp()
        rest: dict[str, Any] = {"omega_BN_B": omega_BN_B, "omegaDot_BN_B": np.zeros(3)}
        self.state = SCStatesMsg(r_BN_N=r_BN_N, v_BN_N=V_BN_N, sigma_BN=sigma, **rest)
        self.turn = PlanetOrientationMsg(dcm_EN=DCM_EN, omega_EN_N=SPIN)

    def step(self, t_ns: int) -> None:
        self.out_state.write(self.state, t_ns)
        self.out_orientation.write(self.turn, t_ns)


def seen(
    params: LandmarkOracle.Params,
    *,
    off_nadir_deg: float = 30.0,
    omega: tuple[float, ...] = (0.0, 0.0, 0.0),
    images: int = 1,
    r_BN_N: np.ndarray = R_BN_N,
) -> list[LandmarksMsg]:
    truth, oracle = Truth(pointed(off_nadir_deg), np.array(omega), r_BN_N), LandmarkOracle("oracle", params)
    truth.out_state.connect(oracle.in_state)
    truth.out_orientation.connect(oracle.in_orientation)
    sim = Simulation([Task("all", period=s(1), modules=[truth, oracle])], seed=3)
    out: list[LandmarksMsg] = []
    for k in range(images):
        sim.run_until(s(k))
        message = oracle.out_landmarks.latest()
        assert message is not None
        out.append(message)
    return out


def projected(place_E: np.ndarray, shot: CameraConfigMsg, dcm_BN: np.ndarray, after: float = 0.0) -> np.ndarray:
    """Pixels of places by OpenCV, ``after`` s."""
    earth = DCM_EN @ Rotation.from_rotvec(-after * SPIN).as_matrix()
    dcm_CE = DCM_CB @ dcm_BN @ earth.T
    r_CE_E = earth @ (R_BN_N + after * V_BN_N)
    matrix = np.array([[2000.0, 0.0, 601.0], [0.0, 1990.0, 447.0], [0.0, 0.0, 1.0]])
    rotation = Rotation.from_matrix(dcm_CE).as_rotvec()
    out, _ = cv2.projectPoints(place_E.reshape(-1, 1, 3), rotation, -dcm_CE @ r_CE_E, matrix, np.array(shot.distortion))
    return out.reshape(-1, 2)


@pytest.mark.parametrize("distortion", [(0.0, 0.0, 0.0, 0.0, 0.0), (-0.12, 0.03, 1e-3, -5e-4, 0.01)])
def test_places_project_where_they_are_seen(distortion: tuple[float, ...], criterion: Criterion) -> None:
    shot = camera(distortion)
    params = LandmarkOracle.Params(**of_camera(shot), count=200, sigma_px=1e-12)
    (found,) = seen(params)
    assert found.count == 200
    assert found.cells == 24
    expected = projected(found.r_LE_E[:200], shot, pointed(30.0))
    criterion("ORACLE-1", np.abs(expected - found.pixel_px[:200]).max())
    assert np.isnan(found.r_LE_E[200:]).all()


def test_places_lie_on_the_ground(criterion: Criterion) -> None:
    params = LandmarkOracle.Params(**of_camera(camera()), count=300, sigma_height=0.0)
    (flat,) = seen(params)
    _, _, height = ERFA.gc2gd(1, flat.r_LE_E[:300])
    criterion("ORACLE-2", np.abs(height).max())
    params = LandmarkOracle.Params(**of_camera(camera()), count=1024, sigma_height=500.0)
    (rough,) = seen(params)
    _, _, height = ERFA.gc2gd(1, rough.r_LE_E[:1024])
    assert height.std() == pytest.approx(500.0, rel=4.0 / np.sqrt(2048))


def test_noise_is_what_was_asked(criterion: Criterion) -> None:
    clean = LandmarkOracle.Params(**of_camera(camera()), count=1000, sigma_px=1e-12)
    noisy = LandmarkOracle.Params(**of_camera(camera()), count=1000, sigma_px=0.4, sigma_map=25.0)
    pixel, place = [], []
    for a, b in zip(seen(clean, images=40), seen(noisy, images=40), strict=True):
        pixel.append((b.pixel_px - a.pixel_px)[:1000])
        place.append((b.r_LE_E - a.r_LE_E)[:1000])
    ratios = [np.std(pixel, axis=(0, 1)) / 0.4 - 1.0, np.std(place, axis=(0, 1)) / 25.0 - 1.0]
    criterion("ORACLE-3", np.abs(np.concatenate(ratios)).max())
    assert np.abs(np.mean(pixel, axis=(0, 1))).max() < 4.0 * 0.4 / 200.0


def test_rolling_shutter(criterion: Criterion) -> None:
    shot, omega, row_time = camera(), (0.002, -0.003, 0.004), 0.02 / 900
    params = LandmarkOracle.Params(**of_camera(shot), count=60, sigma_px=1e-12, row_time=row_time)
    (found,) = seen(params, omega=omega)
    worst = 0.0
    for place, pixel in zip(found.r_LE_E[:60], found.pixel_px[:60], strict=True):
        after = row_time * (pixel[1] - 449.5)
        turned = Rotation.from_rotvec(-after * np.array(omega)).as_matrix() @ pointed(30.0)
        worst = max(worst, float(np.abs(projected(place, shot, turned, after)[0] - pixel).max()))
    criterion("ORACLE-4", worst)
    still = projected(found.r_LE_E[:60], shot, pointed(30.0))
    assert np.abs(still - found.pixel_px[:60]).max() > 0.05  # the shutter does matter here


def test_false_matches_cloud_and_empty_sky() -> None:
    kept = of_camera(camera())
    clean = seen(LandmarkOracle.Params(**kept, count=1000, sigma_px=1e-12))[0]
    false = seen(LandmarkOracle.Params(**kept, count=1000, sigma_px=1e-12, outliers=0.3))[0]
    moved = np.linalg.norm(false.pixel_px - clean.pixel_px, axis=1)[:1000] > 1e-6
    assert abs(moved.mean() - 0.3) < 4.0 * np.sqrt(0.3 * 0.7 / 1000)
    np.testing.assert_array_equal(false.r_LE_E, clean.r_LE_E)  # the false ones change no other number
    images = seen(LandmarkOracle.Params(**kept, clear=0.2), images=200)
    clear = np.mean([m.count > 0 for m in images])
    assert abs(clear - 0.2) < 4.0 * np.sqrt(0.2 * 0.8 / 200)
    assert {m.status for m in images if m.count == 0} == {3}
    (away,) = seen(LandmarkOracle.Params(**kept), off_nadir_deg=150.0)
    assert (away.count, away.status, away.cells) == (0, 3, 0)
    (inside,) = seen(LandmarkOracle.Params(**kept), r_BN_N=0.5 * R_BN_N)
    assert inside.count == 0


def test_parameters_are_checked() -> None:
    with pytest.raises(ValueError, match=r"lens: expected the lens vector of a camera; make it with of_camera"):
        LandmarkOracle.Params(lens=np.zeros(11))
    wrong: dict[str, Any] = {**of_camera(camera()), "dcm_CB": np.ones((3, 3))}
    with pytest.raises(ValueError, match="dcm_CB"):
        LandmarkOracle.Params(**wrong)
