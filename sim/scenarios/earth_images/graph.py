"""The modules of the scenario and how they are connected: a platform over a place, Earth, Sun, camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from fsw import Module, Out, Simulation, Task, s
from fsw.imaging.maps import GeoMap
from fsw.math.attitude import dcm_to_mrp
from fsw.math.compiled import plain
from fsw.math.earth_orientation import OMEGA_EARTH, assumed_parameters, earth_rotation_angle, spin
from fsw.math.epoch import epoch
from fsw.math.geodesy import ecef_from_geodetic, enu_dcm, ray_to_spheroid
from fsw.math.gravity import MU_EARTH
from fsw.math.vectors import mat3
from messages.base import F64
from messages.opnav import CameraConfigMsg
from messages.states import SCStatesMsg
from sim.camera.earth_camera import EarthCamera, EarthCameraParams
from sim.environment.earth_orientation import EarthOrientation, earth_rotation
from sim.environment.ephemeris import Ephemeris
from sim.scenarios.earth_images.scenes import BARE, SCENES, Effect, Scene, effects, with_effect


class Platform(Module):
    """A body on a circular orbit, at the instant at which it looks at a place. Publishes its motion once."""

    out_state = Out(SCStatesMsg)

    def __init__(self, name: str, scene: Scene, dcm_EN: F64, omega_BN_B: F64) -> None:
        """Find position and attitude.

        Raises:
            ValueError: if no camera of this height and direction sees the place.
        """
        super().__init__(name)
        r_E, dcm_CE = viewpoint(scene)
        r_N, dcm_BN = dcm_EN.T @ r_E, dcm_CE @ dcm_EN
        along = np.cross([0.0, 0.0, 1.0], r_N)
        along /= np.linalg.norm(along)
        v_N = math.sqrt(MU_EARTH / float(np.linalg.norm(r_N))) * along
        self._state = SCStatesMsg(
            r_BN_N=r_N,
            v_BN_N=v_N,
            sigma_BN=np.array(plain(dcm_to_mrp)(plain(mat3)(dcm_BN))),
            omega_BN_B=omega_BN_B,
            omegaDot_BN_B=np.zeros(3),
        )

    def step(self, t_ns: int) -> None:
        """Publish the motion."""
        self.out_state.write(self._state, t_ns)


def viewpoint(scene: Scene) -> tuple[F64, F64]:
    """Position (3,) [m] and attitude dcm_CE (3, 3) from which a camera sees the place in its middle.

    The direction in which it looks is up in the picture. If the camera looks past the Earth, it is above the place.

    Raises:
        ValueError: if the place or the angle is none.
    """
    if not (abs(scene.lat_deg) <= 90.0 and abs(scene.lon_deg) <= 360.0 and scene.height_km > 0.0):
        text = f"{scene.lat_deg:g}, {scene.lon_deg:g}, {scene.height_km:g} km"
        raise ValueError(f"expected a latitude, a longitude and a height above ground, got {text}")
    lat, lon = math.radians(scene.lat_deg), math.radians(scene.lon_deg)
    off, azimuth = math.radians(scene.off_deg), math.radians(scene.azimuth_deg)
    target = np.array(ecef_from_geodetic(lat, lon, 0.0))
    east_north_up = np.empty((3, 3))
    enu_dcm(lat, lon, east_north_up)
    east, north, up = east_north_up
    ahead = math.sin(azimuth) * east + math.cos(azimuth) * north
    size = float(np.linalg.norm(target))
    sine = (size + 1e3 * scene.height_km) / size * math.sin(off)
    if sine < 1.0:  # stand back, so that the axis meets the place: in the triangle of camera, place and centre
        incidence = math.asin(sine)
        back = math.cos(incidence) * up - math.sin(incidence) * ahead
        start = target + 1e8 * back
        shell = 1e3 * scene.height_km
        r = start - _distance(start, -back, shell) * back
        z = -back
        y_up = math.cos(incidence) * ahead + math.sin(incidence) * up
    else:
        r = np.array(ecef_from_geodetic(lat, lon, 1e3 * scene.height_km))
        z = math.sin(off) * ahead - math.cos(off) * up
        y_up = math.cos(off) * ahead + math.sin(off) * up
    return r, np.array([np.cross(z, y_up), -y_up, z])


def _distance(r: F64, d: F64, height: float) -> float:
    x, y, z = (float(c) for c in r)
    return ray_to_spheroid(x, y, z, float(d[0]), float(d[1]), float(d[2]), height)


@dataclass(frozen=True)
class EarthImages:
    """The simulation of one picture, and its camera."""

    sim: Simulation
    eye: EarthCamera


def build(
    scene: Scene | None = None,
    effect: Effect | None = None,
    size_px: int = 1024,
    seed: int = 1,
    maps: GeoMap | None = None,
) -> EarthImages:
    """Make and connect the modules of one picture.

    Args:
        scene: what is looked at; Paris unless told otherwise.
        effect: what is shown; haze unless told otherwise.
        size_px: rows and columns.
        seed: of the detector's noise.
        maps: the opened maps of the scene, if they are open already.

    Raises:
        MapError: if a map cannot be used.
        ValueError: if the place, the time or the camera is none.
    """
    scene = scene or SCENES["paris"]
    effect = effect or effects(scene)[2]
    scene = with_effect(scene, effect)
    start = epoch(scene.utc)
    earth = EarthOrientation("earth", earth_rotation(start, assumed_parameters(start, 0.0)))
    sun = Ephemeris("sun", Ephemeris.Params(epoch_tai_ns=start))
    dcm_EN = np.array(plain(spin)(plain(earth_rotation_angle)(start, earth.params.ut1_minus_tai), OMEGA_EARTH)[0])
    platform = Platform("platform", scene, dcm_EN, effect.omega_B)
    focal = scene.focal_px * size_px / 1024.0
    camera = CameraConfigMsg(
        width_px=size_px,
        height_px=size_px,
        focal_px=np.array([focal, focal]),
        center_px=np.full(2, 0.5 * (size_px - 1)),
        **effect.lens,
    )
    numbers: dict[str, Any] = {"brightness": scene.brightness, **BARE, "haze": 1.0, **effect.params}
    eye = EarthCamera("eye", camera, maps or GeoMap.open(scene.files, scene.dem), EarthCameraParams(**numbers))
    platform.out_state.connect(eye.in_state)
    earth.out_orientation.connect(eye.in_orientation)
    sun.out_ephemeris.connect(eye.in_sun)
    return EarthImages(Simulation([Task("one picture", s(1), [platform, earth, sun, eye])], seed=seed), eye)
