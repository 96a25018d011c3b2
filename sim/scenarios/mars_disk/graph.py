"""The modules of the scenario and how they are connected."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fsw import Simulation, Task, minutes
from fsw.math.bodies import body
from fsw.math.epoch import epoch
from messages.base import F64
from messages.opnav import CameraConfigMsg
from modules.opnav.circle_finder import CircleFinder
from modules.opnav.horizon_nav import HorizonNav
from modules.opnav.limb_finder import LimbFinder
from modules.opnav.pixel_line_converter import PixelLineConverter
from sim.camera.disk_camera import DiskCamera, disk_body, invented
from sim.environment.ephemeris import Ephemeris
from sim.environment.star_catalogue import bright_stars
from sim.scenarios.mars_disk.orbit import PointedOrbit
from sim.sensors.simple_nav import SimpleNav

EPOCH = "2024-01-15T00:00:00Z"
"""UTC of simulation time zero."""
MARS = body("Mars")
A, E = 18000e3, 0.2
"""Orbit, m and -."""
PERIOD_S = 2.0 * math.pi * math.sqrt(A**3 / MARS.mu)
SIZE_PX, FIELD_DEG = 512, 55.0
DAY_S = 86400.0
J2000_TAI_NS = 32_184_000_000
"""TT is ahead of TAI by 32.184 s; epochs count from J2000 in TAI."""


@dataclass(frozen=True)
class MarsDisk:
    """The simulation and its modules."""

    sim: Simulation
    orbit: PointedOrbit
    sun: Ephemeris
    camera: DiskCamera
    limb_finder: LimbFinder
    horizon: HorizonNav
    circle_finder: CircleFinder
    converter: PixelLineConverter


def mars_attitude(epoch_tai_ns: int) -> F64:
    """dcm_PN of Mars: pole and prime meridian of Archinal et al. (2011), Celest. Mech. Dyn. Astr. 109, table 1."""
    days = (epoch_tai_ns + J2000_TAI_NS) / 1e9 / DAY_S
    ra, dec = 317.68143 - 0.1061 * days / 36525.0, 52.88650 - 0.0609 * days / 36525.0
    meridian = 176.630 + 350.89198226 * days
    turn = Rotation.from_euler("ZXZ", [90.0 + ra, 90.0 - dec, meridian % 360.0], degrees=True)
    return turn.as_matrix().T


def camera_config(distortion: F64 | None = None) -> CameraConfigMsg:
    """The lens: 512 x 512 pixels, 55 degrees from edge to edge; ``distortion`` (5,) as in `CameraConfigMsg`."""
    focal = SIZE_PX / 2.0 / math.tan(math.radians(FIELD_DEG / 2.0))
    return CameraConfigMsg(
        width_px=SIZE_PX,
        height_px=SIZE_PX,
        focal_px=np.full(2, focal),
        center_px=np.full(2, (SIZE_PX - 1) / 2.0),
        distortion=np.zeros(5) if distortion is None else distortion,
    )


def build(seed: int = 1, picture_ns: int = minutes(10), distortion: F64 | None = None) -> MarsDisk:
    """Make the graph; nothing is recorded yet.

    Args:
        seed: of the detector's noise.
        picture_ns: from picture to picture; a whole number of minutes.
        distortion: of the lens, (5,) as in `CameraConfigMsg`; none by default.
    """
    start = epoch(EPOCH)
    inclination, node, periapsis = np.radians([25.0, 20.0, 110.0]).tolist()
    orbit = PointedOrbit(
        "orbit",
        PointedOrbit.Params(
            mu=MARS.mu,
            a=A,
            e=E,
            inclination=inclination,
            node=node,
            periapsis=periapsis,
            axis_O=np.array([1.0, 0.6, 0.0]),
            sway=math.radians(9.0),
            sway_rate=2.0 * math.pi * 5.0 / PERIOD_S,
        ),
    )
    sun = Ephemeris("sun", Ephemeris.Params(body_id=10, center_id=499, epoch_tai_ns=start))
    mars = disk_body(
        "Mars",
        dcm_PN=mars_attitude(start),
        albedo=0.55,
        law="minnaert",
        exponent=0.75,
        texture=invented(seed=4, contrast=0.18),
    )
    camera = DiskCamera(
        "camera",
        DiskCamera.Params(
            center_id=499,
            star_light=3.0,
            psf_sigma_px=0.7,
            shot_noise=True,
            full_well=40000.0,
            read_noise=20.0,
            bits=12,
            black_level=0.01,
            hot_pixels=2e-5,
        ),
        camera_config(distortion),
        [mars],
        bright_stars(),
    )
    attitude = SimpleNav("attitude")  # the truth: what is shown is the error of the images alone
    pole_N = mars_attitude(start)[2]
    limb_finder, horizon = LimbFinder("limb_finder"), HorizonNav("horizon", HorizonNav.Params(pole_N=pole_N))
    circle_finder = CircleFinder("circle_finder")
    converter = PixelLineConverter("converter", PixelLineConverter.Params(pole_N=pole_N))
    orbit.out_state.connect(camera.in_state)
    orbit.out_state.connect(attitude.in_state)
    sun.out_ephemeris.connect(camera.in_sun)
    for finder in (limb_finder, circle_finder):
        camera.out_image.connect(finder.in_image)
        camera.out_camera.connect(finder.in_camera)
        attitude.out_att.connect(finder.in_attitude)
        sun.out_ephemeris.connect(finder.in_sun)
    limb_finder.out_limb.connect(horizon.in_limb)
    circle_finder.out_circles.connect(converter.in_circles)
    sun.out_ephemeris.connect(converter.in_sun)
    for module in (horizon, converter):
        camera.out_camera.connect(module.in_camera)
        attitude.out_att.connect(module.in_attitude)
    flight = [limb_finder, horizon, circle_finder, converter]
    tasks = [
        Task("truth", period=minutes(1), modules=[orbit, sun, attitude]),
        Task("camera", period=picture_ns, modules=[camera, *flight]),
    ]
    return MarsDisk(Simulation(tasks, seed=seed), orbit, sun, camera, limb_finder, horizon, circle_finder, converter)
