"""The modules of the scenario and how they are connected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fsw import Simulation, Task, ms, s
from fsw.math.attitude import dcm_to_mrp
from fsw.math.compiled import plain
from fsw.math.earth_orientation import assumed_parameters
from fsw.math.epoch import epoch
from fsw.math.gravity import MU_EARTH
from fsw.math.kepler import elements_to_rv
from fsw.math.local_frames import orbit_frame
from fsw.math.vectors import mat3
from sim.dynamics.spacecraft import Spacecraft
from sim.environment.atmosphere import Atmosphere
from sim.environment.earth_orientation import EarthOrientation, earth_rotation
from sim.environment.eclipse import Eclipse
from sim.environment.ephemeris import Ephemeris
from sim.environment.magnetic_field import MagneticField
from sim.environment.star_catalogue import bright_stars
from sim.scenarios.leo_sensors.burn import Burn
from sim.sensors.accelerometer import Accelerometer
from sim.sensors.css_array import CssArray
from sim.sensors.gps import Gps
from sim.sensors.gyro import Gyro
from sim.sensors.magnetometer import Magnetometer
from sim.sensors.simple_nav import SimpleNav
from sim.sensors.star_tracker import StarTracker
from sim.sensors.star_vectors import StarVectors, catalogue

EPOCH = "2023-06-21T10:30:00Z"
"""UTC of simulation time zero."""
MASS, INERTIA_B = 12.0, np.diag([0.04, 0.05, 0.02])
"""Of a small box, kg and kg m^2: the gravity gradient holds its z axis near nadir."""
ARM_B = np.array([0.1, 0.0, -0.15])
"""Antenna of the receiver, m."""
DCM_ZENITH = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
"""Case of a sensor that looks to zenith, away from the nadir axis z of B."""
DCM_SIDE = Rotation.from_euler("x", -120.0, degrees=True).as_matrix().T
"""Case of a sensor that looks to the right of the track (y of B), 30 degrees up."""
GYRO_BIAS = np.radians([5.0, -3.0, 4.0]) / 3600.0
"""Bias of the gyro at the start, rad/s."""
SUN_EXCLUSION = np.radians(35.0)


@dataclass(frozen=True)
class LeoSensors:
    """The simulation and its modules."""

    sim: Simulation
    spacecraft: Spacecraft
    burn: Burn
    orientation: EarthOrientation
    sun: Ephemeris
    moon: Ephemeris
    eclipse: Eclipse
    field: MagneticField
    gyro: Gyro
    accelerometer: Accelerometer
    star_tracker: StarTracker
    star_vectors: StarVectors
    gps: Gps
    magnetometer: Magnetometer
    css_array: CssArray
    simple_nav: SimpleNav


def _spacecraft() -> Spacecraft:
    """500 km, Sun-synchronous, descending node at about 10:30; the axes of the orbit frame turned by a few degrees."""
    orbit = (6878.137e3, 0.001, *np.radians([97.4, 247.0, 0.0, 0.0]).tolist())
    r, v = plain(elements_to_rv)(orbit, MU_EARTH)
    dcm_ON = np.array(plain(orbit_frame)(r, v))
    dcm_BN = Rotation.from_euler("xy", [8.0, 5.0], degrees=True).as_matrix() @ dcm_ON
    rate = float(np.linalg.norm(np.cross(r, v)) / np.dot(r, r))
    start = Spacecraft.State(
        r_BN_N=np.array(r),
        v_BN_N=np.array(v),
        sigma_BN=np.array(plain(dcm_to_mrp)(plain(mat3)(dcm_BN))),
        omega_BN_B=dcm_BN @ dcm_ON.T @ np.array([0.0, -rate, 0.0]),
    )
    params = Spacecraft.Params(
        inertia_B=INERTIA_B, mass=MASS, gravity_gradient=True, drag_coefficient=2.0, drag_area=0.05
    )
    return Spacecraft("spacecraft", params, start)


def build(seed: int = 1) -> LeoSensors:
    """Make the graph; ``seed`` is that of the sensors' noise. Nothing is recorded yet."""
    start = epoch(EPOCH)
    spacecraft = _spacecraft()
    burn = Burn("burn")
    turning = earth_rotation(start, assumed_parameters(start, 0.0))
    orientation = EarthOrientation("orientation", turning)
    sun = Ephemeris("sun", Ephemeris.Params(epoch_tai_ns=start))
    moon = Ephemeris("moon", Ephemeris.Params(epoch_tai_ns=start, body_id=301))
    eclipse, atmosphere = Eclipse("eclipse"), Atmosphere("atmosphere")
    field = MagneticField("field", MagneticField.Params(epoch_tai_ns=start))

    gyro = Gyro("gyro", state=Gyro.State(bias_P=GYRO_BIAS))
    accelerometer = Accelerometer("accelerometer", Accelerometer.Params(r_PB_B=np.array([0.05, 0.0, 0.02])))
    star_tracker = StarTracker("star_tracker", StarTracker.Params(dcm_SB=DCM_SIDE, sun_exclusion=SUN_EXCLUSION))
    stars = bright_stars()
    seen = catalogue(stars.u_N, stars.magnitude, faintest=5.0)
    star_vectors = StarVectors(
        "star_vectors", StarVectors.Params(**seen, dcm_SB=DCM_ZENITH, sun_exclusion=SUN_EXCLUSION, aberration=True)
    )
    gps = Gps("gps", Gps.Params(r_AB_B=ARM_B))
    bias_S = np.array([3e-7, -2e-7, 5e-7])
    magnetometer = Magnetometer("magnetometer", Magnetometer.Params(bias_S=bias_S, resolution=1e-8, max_field=1e-4))
    css_array = CssArray("css_array")
    simple_nav = SimpleNav("simple_nav", SimpleNav.Params(sigma_r=10.0, sigma_v=0.01, walk_r=0.2))

    for module in (eclipse, atmosphere, field):
        spacecraft.out_state.connect(module.in_state)
    for module in (gyro, accelerometer, star_tracker, star_vectors, gps, magnetometer, css_array, simple_nav):
        spacecraft.out_state.connect(module.in_state)
    burn.out_push.connect(spacecraft.in_force, delayed=True)
    spacecraft.out_force.connect(accelerometer.in_force)
    sun.out_ephemeris.connect(spacecraft.in_sun, delayed=True)
    moon.out_ephemeris.connect(spacecraft.in_moon, delayed=True)
    atmosphere.out_atmosphere.connect(spacecraft.in_atmosphere, delayed=True)
    orientation.out_orientation.connect(atmosphere.in_orientation)
    orientation.out_orientation.connect(field.in_orientation)
    orientation.out_orientation.connect(gps.in_orientation)
    sun.out_ephemeris.connect(eclipse.in_sun)
    moon.out_ephemeris.connect(eclipse.in_moon)
    sun.out_ephemeris.connect(css_array.in_sun)
    for module in (star_tracker, star_vectors):
        sun.out_ephemeris.connect(module.in_sun)
        moon.out_ephemeris.connect(module.in_moon)
    eclipse.out_eclipse.connect(css_array.in_eclipse)
    field.out_field.connect(magnetometer.in_field)

    tasks = [
        Task("truth", period=ms(100), modules=[spacecraft, burn]),
        Task("environment", period=s(1), modules=[orientation, sun, moon, eclipse, atmosphere, field]),
        Task("inertial", period=ms(100), modules=[gyro, accelerometer]),
        Task("stars", period=ms(500), modules=[star_tracker, star_vectors]),
        Task("slow", period=s(1), modules=[gps, magnetometer, css_array, simple_nav]),
    ]
    return LeoSensors(
        sim=Simulation(tasks, seed=seed),
        spacecraft=spacecraft,
        burn=burn,
        orientation=orientation,
        sun=sun,
        moon=moon,
        eclipse=eclipse,
        field=field,
        gyro=gyro,
        accelerometer=accelerometer,
        star_tracker=star_tracker,
        star_vectors=star_vectors,
        gps=gps,
        magnetometer=magnetometer,
        css_array=css_array,
        simple_nav=simple_nav,
    )
