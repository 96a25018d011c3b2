"""The module: motion, shutter, smear and detector, through its ports."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, ms, s
from fsw.imaging.maps import GeoMap
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraImageMsg
from messages.states import SCStatesMsg
from sim.camera.earth_camera import EarthCamera, EarthCameraParams, EarthRenderer, Pose
from tests.sim.camera.earth_rig import PLAIN, camera, centroids, dots, ecef, looking, project_cv, write_map

Criterion = Callable[[str, float], None]
SPIN = np.array([0.0, 0.0, 7.292115e-5])
LAT, LON = (a.ravel() for a in np.meshgrid(np.linspace(48.0, 49.0, 5), np.linspace(2.3, 3.7, 5)))


@pytest.fixture(scope="module")
def maps(tmp_path_factory: pytest.TempPathFactory) -> GeoMap:
    image, transform = dots(LON, LAT, 0.002, 2.5)
    return GeoMap.open([write_map(tmp_path_factory.mktemp("earth") / "dots.tif", image, "EPSG:4326", transform)])


class Rig(Module):
    """Publishes one motion again and again."""

    out_state = Out(SCStatesMsg)
    out_orientation = Out(PlanetOrientationMsg)
    out_sun = Out(EphemerisMsg)

    def __init__(self, v: Any = (0.0, 0.0, 0.0), omega: Any = (0.0, 0.0, 0.0), leave: tuple[str, ...] = ()) -> None:
        super().__init__("rig")
        pose, self.earth = looking(48.5, 3.0, 420e3), Rotation.from_euler("z", 40.0, degrees=True)
        self.sigma = Rotation.from_matrix((pose.dcm_CE[0] @ self.earth.as_matrix().T).T)
        self.r, self.v, self.omega = self.earth.apply(pose.r_CE_E[0]), np.array(v), np.array(omega)
        self.leave = leave

    def step(self, t_ns: int) -> None:
        state = {"r_BN_N": self.r, "v_BN_N": self.v, "sigma_BN": self.sigma.as_mrp(), "omega_BN_B": self.omega}
        orientation = PlanetOrientationMsg(dcm_EN=self.earth.inv().as_matrix(), omega_EN_N=SPIN)
        sun = EphemerisMsg(body_id=10, mu=1.3e20, radius=7e8, r_PN_N=1.5e11 * self.r / 6.8e6, v_PN_N=np.zeros(3))
        if "state" not in self.leave:
            self.out_state.write(SCStatesMsg(**state, omegaDot_BN_B=np.zeros(3)), t_ns)
        if "orientation" not in self.leave:
            self.out_orientation.write(orientation, t_ns)
        if "sun" not in self.leave:
            self.out_sun.write(sun, t_ns)

    def pose(self, t: float) -> Pose:
        """Of the camera after a time, by scipy."""
        to_n = self.sigma * Rotation.from_rotvec(self.omega * t)
        earth = Rotation.from_rotvec(SPIN * t) * self.earth
        dcm = to_n.inv().as_matrix() @ earth.as_matrix()
        return Pose(earth.inv().apply(self.r + self.v * t)[None], dcm[None], np.eye(3)[None])


def shot(maps: GeoMap, rig: Rig, seed: int = 1, cam: Any = None, at: int = 0, **params: Any) -> CameraImageMsg | None:
    """One picture."""
    eye = EarthCamera("eye", cam or camera(800.0, 320, 320), maps, EarthCameraParams(**{**PLAIN, **params}))
    wire(rig, eye)
    sim = Simulation([Task("one", s(1), [rig, eye])], seed=seed)
    sim.run_until(at)
    return eye.out_image.latest()


def wire(rig: Rig, eye: EarthCamera) -> None:
    rig.out_state.connect(eye.in_state)
    rig.out_orientation.connect(eye.in_orientation)
    rig.out_sun.connect(eye.in_sun)


def test_picture_of_a_still_camera(maps: GeoMap) -> None:
    """Time, kind, and dots in their places, colour and grey."""
    rig = Rig()
    message = shot(maps, rig)
    assert message is not None and message.exposure_ns == 0 and message.image.shape == (320, 320, 3)
    expected = project_cv(ecef(LAT, LON), rig.pose(0.0), camera(800.0, 320, 320))
    np.testing.assert_allclose(centroids(message.image[..., 0], expected, 6), expected, atol=0.1)
    grey = shot(maps, Rig(), colour=False)
    assert grey is not None and grey.image.shape == (320, 320)
    np.testing.assert_allclose(grey.image.astype(int), message.image[..., 1], atol=1)


@pytest.mark.parametrize("missing", ["state", "orientation", "sun"])
def test_nothing_without_its_inputs(maps: GeoMap, missing: str) -> None:
    assert shot(maps, Rig(leave=(missing,))) is None


def test_rolling_shutter_sees_each_row_at_its_time(criterion: Criterion, maps: GeoMap) -> None:
    """7 km/s and 14 degrees a second, 0.1 ms a row: dots move by more than 0.5 px against a global shutter."""
    rig, cam = Rig(v=[-3e3, 5e3, 4e3], omega=[0.1, -0.1, 0.2]), camera(800.0, 320, 320)
    message = shot(maps, rig, row_time=1e-4)
    assert message is not None
    still = project_cv(ecef(LAT, LON), rig.pose(0.0), cam)
    expected = still.copy()
    for k, place in enumerate(ecef(LAT, LON)):
        for _ in range(5):
            t = 1e-4 * (expected[k, 1] - 159.5)
            expected[k] = project_cv(place[None], rig.pose(t), cam)[0]
    assert np.max(np.linalg.norm(expected - still, axis=1)) > 0.5
    found = centroids(message.image[..., 0], expected, 6)
    criterion("EARTH-9", float(np.max(np.linalg.norm(found - expected, axis=1))))


def test_smear_spreads_along_the_motion(criterion: Criterion, maps: GeoMap) -> None:
    """Turning about the y axis of the camera for 40 ms moves the picture by 6 px along x."""
    sizes: dict[float, Any] = {}
    for time in (0.0, 0.04):
        message = shot(maps, Rig(omega=[0.0, 0.1875, 0.0]), smear_time=time)
        assert message is not None
        part = message.image[..., 0].astype(float)
        expected = project_cv(ecef(48.5, 3.0)[None], Rig().pose(0.0), camera(800.0, 320, 320))[0].round().astype(int)
        part = part[expected[1] - 12 : expected[1] + 13, expected[0] - 12 : expected[0] + 13] - np.median(part)
        part[part < 1.0] = 0.0
        y, x = np.mgrid[-12:13, -12:13]
        mean = (part * x).sum() / part.sum()
        sizes[time] = (part * (x - mean) ** 2).sum() / part.sum(), (part * y * y).sum() / part.sum()
    length = 800.0 * 0.1875 * 0.04
    criterion("EARTH-10", float((sizes[0.04][0] - sizes[0.0][0]) / (length**2 / 12.0) - 1.0))
    assert sizes[0.04][1] == pytest.approx(sizes[0.0][1], rel=0.03)


def test_old_inputs_are_carried_on(maps: GeoMap) -> None:
    """The camera runs at 50 ms where truth was written at 0: dots are where the moved body sees them."""
    rig, cam = Rig(v=[0.0, 7e3, 0.0], omega=[0.01, 0.02, 0.0]), camera(800.0, 320, 320)
    eye = EarthCamera("eye", cam, maps, EarthCameraParams(**PLAIN))
    wire(rig, eye)
    rig.step(0)
    eye.step(ms(50))
    message = eye.out_image.latest()
    assert message is not None and message.exposure_ns == ms(50)
    expected = project_cv(ecef(LAT, LON), rig.pose(0.05), cam)
    np.testing.assert_allclose(centroids(message.image[..., 0], expected, 6), expected, atol=0.1)


def test_noise_follows_the_seed_of_the_run(maps: GeoMap) -> None:
    noise: dict[str, Any] = {"shot_noise": True, "read_noise": 30.0}
    pictures = [shot(maps, Rig(), seed=k, **noise) for k in (1, 1, 2)]
    assert all(p is not None for p in pictures)
    a, b, c = (p.image for p in pictures if p is not None)
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_threads_do_not_change_the_picture(maps: GeoMap) -> None:
    pose = looking(48.4, 3.1, 420e3, 20.0, 30.0)
    for interpolated in (False, True):
        params = EarthCameraParams(interpolated=interpolated)
        pair = [EarthRenderer(camera(800.0, 320, 200), maps, params, workers=n) for n in (1, 4)]
        one, four = (renderer.render(pose, ecef(48.5, 3.0)) for renderer in pair)
        assert np.array_equal(one.radiance, four.radiance)


def test_snapshot_goes_on_alike(maps: GeoMap) -> None:
    """A run that is restored takes the same noisy picture again."""
    rig, eye = Rig(), EarthCamera("eye", camera(800.0, 64, 64), maps, EarthCameraParams(shot_noise=True))
    wire(rig, eye)
    sim = Simulation([Task("one", s(1), [rig, eye])], seed=5)
    sim.run_until(s(1))
    snapshot, pictures = sim.snapshot(), []
    for _ in range(2):
        sim.run_until(s(2))
        message = eye.out_image.latest()
        assert message is not None
        pictures.append(message.image.copy())
        sim.restore(snapshot)
    assert np.array_equal(*pictures)


def test_without_compilation() -> None:
    """A tiny picture of the same scene by a process that compiles nothing: the same to a grey level."""
    program = """
import numpy as np, sys, tempfile
from pathlib import Path
from fsw.imaging.maps import GeoMap
from fsw.math.compiled import COMPILE
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer
from tests.sim.camera.earth_rig import camera, dots, ecef, looking, write_map
LAT, LON = (a.ravel() for a in np.meshgrid(np.linspace(48.0, 49.0, 3), np.linspace(2.3, 3.7, 3)))
image, transform = dots(LON, LAT, 0.01, 2.5)
with tempfile.TemporaryDirectory() as folder:
    maps = GeoMap.open([write_map(Path(folder) / "dots.tif", image, "EPSG:4326", transform)])
    for interpolated in (False, True):
        made = EarthRenderer(camera(60.0, 24, 16), maps, EarthCameraParams(interpolated=interpolated), workers=1)
        light = made.render(looking(48.5, 3.0, 420e3, 20.0, 30.0), ecef(48.0, 10.0)).radiance
        print(COMPILE, *np.round(255.0 * light.ravel(), 3).tolist())
"""
    pictures: list[list[float]] = []
    for switch in ("0", "1"):
        environment = {**os.environ, "FSW_COMPILE": switch, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        lines = [line.split() for line in done.stdout.splitlines()]
        assert [line[0] for line in lines] == [str(switch == "1")] * 2
        pictures += [[float(x) for x in line[1:]] for line in lines]
    plain_rays, plain_grid, rays, grid = (np.array(p) for p in pictures)
    assert rays.size == 24 * 16 * 3 and rays.std() > 1.0
    np.testing.assert_allclose(plain_rays, rays, atol=0.01)
    np.testing.assert_allclose(plain_grid, grid, atol=0.01)
