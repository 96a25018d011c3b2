"""What the sensors measured, against the truth of the same instant."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import ndtr

from fsw import OutPort, Recording, minutes
from fsw.math.forces import ASTRONOMICAL_UNIT
from messages.base import F64
from sim.environment.star_catalogue import bright_stars
from sim.scenarios.leo_sensors.graph import ARM_B, DCM_SIDE, DCM_ZENITH, GYRO_BIAS, LeoSensors
from sim.sensors.css_array.module import NORMALS_B
from sim.sensors.starlight import C_LIGHT

ARCSEC = np.pi / 180.0 / 3600.0


@dataclass(frozen=True)
class Compared:
    """A sensor and the truth; n samples.

    Attributes:
        title: name for people.
        t_min: times, minutes, (n,).
        measured: (n, k).
        true: of the same shape; NaN where there is nothing to compare with.
        unit: of measured and true.
        error: (n, m), not always their difference.
        error_unit: of the error.
        expected: size of the error that the parameters stand for, about its mean: of each column or of all, (m,) or
            (1,); or of each sample, (n, 1).
        offset: mean of the error that they stand for, (m,) or (1,).
    """

    title: str
    t_min: F64
    measured: F64
    true: F64
    unit: str
    error: F64
    error_unit: str
    expected: F64
    offset: F64 = field(default_factory=lambda: np.zeros(1))

    @property
    def rms(self) -> float:
        """Root mean square of the errors, without lost measurements."""
        return float(np.sqrt(np.nanmean(self.error**2)))

    @property
    def expected_rms(self) -> float:
        """What the root mean square should be."""
        return float(np.sqrt(np.mean(self.expected**2) + np.mean(self.offset**2)))

    @property
    def rate_hz(self) -> float:
        """Mean rate of the samples."""
        return float((len(self.t_min) - 1) / (self.t_min[-1] - self.t_min[0]) / 60.0)


class Flight:
    """A run with everything recorded that is to be compared."""

    def __init__(self, scenario: LeoSensors, duration_min: float) -> None:
        """Record and run."""
        ports: dict[str, OutPort[Any]] = {
            "state": scenario.spacecraft.out_state,
            "force": scenario.spacecraft.out_force,
            "orientation": scenario.orientation.out_orientation,
            "sun": scenario.sun.out_ephemeris,
            "light": scenario.eclipse.out_eclipse,
            "field": scenario.field.out_field,
            "gyro": scenario.gyro.out_imu,
            "accelerometer": scenario.accelerometer.out_accel,
            "star_tracker": scenario.star_tracker.out_attitude,
            "star_vectors": scenario.star_vectors.out_stars,
            "gps": scenario.gps.out_fix,
            "magnetometer": scenario.magnetometer.out_field,
            "css_array": scenario.css_array.out_css,
            "simple_nav": scenario.simple_nav.out_trans,
        }
        self.scenario = scenario
        self.records: dict[str, Recording[Any]] = {name: port.record() for name, port in ports.items()}
        scenario.sim.run_until(minutes(duration_min))

    def at(self, name: str, column: str, t_ns: NDArray[np.int64]) -> F64:
        """Recorded values at the given times, which must all have been recorded."""
        record = self.records[name]
        rows = np.searchsorted(record.t_ns, t_ns)
        if not np.array_equal(record.t_ns[rows], t_ns):
            raise LookupError(f"{name} was not written at all times of the sensor")
        return record[column][rows]

    def body(self, t_ns: NDArray[np.int64]) -> Rotation:
        """Attitudes that take components in B to N."""
        return Rotation.from_mrp(self.at("state", "sigma_BN", t_ns))

    def compared(self) -> dict[str, Compared]:
        """Every sensor against the truth, by the name of its module."""
        return {
            "gps": self.gps(),
            "simple_nav": self.simple_nav(),
            "gyro": self.gyro(),
            "accelerometer": self.accelerometer(),
            "star_tracker": self.star_tracker(),
            "star_vectors": self.star_vectors(),
            "magnetometer": self.magnetometer(),
            "css_array": self.css_array(),
        }

    def gps(self) -> Compared:
        """Position of the antenna, Earth-fixed."""
        record, params = self.records["gps"], self.scenario.gps.params
        t_ns = record.t_ns
        r_AN_N = self.at("state", "r_BN_N", t_ns) + self.body(t_ns).apply(ARM_B)
        true = np.einsum("nij,nj->ni", self.at("orientation", "dcm_EN", t_ns), r_AN_N)
        measured = record["r_AE_E"]
        sigma = np.hypot(params.sigma_r, params.sigma_slow)
        return Compared(
            "GPS position, Earth-fixed",
            record.t_s / 60.0,
            measured / 1e3,
            true / 1e3,
            "km",
            measured - true,
            "m",
            np.array([sigma]),
        )

    def simple_nav(self) -> Compared:
        """Position in N; what is expected of a walk grows with time."""
        record, params = self.records["simple_nav"], self.scenario.simple_nav.params
        true, measured = self.at("state", "r_BN_N", record.t_ns), record["r_BN_N"]
        expected = np.sqrt(params.sigma_r**2 + params.walk_r**2 * record.t_s)[:, None]
        return Compared(
            "Navigation stand-in, position",
            record.t_s / 60.0,
            measured / 1e3,
            true / 1e3,
            "km",
            measured - true,
            "m",
            expected,
        )

    def gyro(self) -> Compared:
        """Mean rate between samples; expected are the white noise and the bias at the start."""
        record, params = self.records["gyro"], self.scenario.gyro.params
        before = record.t_ns - np.diff(record.t_ns)[0]
        dt = float(np.diff(record.t_ns)[0]) / 1e9
        true = np.degrees((self.body(before).inv() * self.body(record.t_ns)).as_rotvec() / dt)
        measured = np.degrees(record["omega_PN_P"])
        sigma = np.full(3, params.arw / np.sqrt(dt)) / ARCSEC
        error, offset = (measured - true) * 3600.0, GYRO_BIAS / ARCSEC
        return Compared("Gyro", record.t_s / 60.0, measured, true, "deg/s", error, "deg/h", sigma, offset)

    def accelerometer(self) -> Compared:
        """Mean specific force between samples, at the place of the case."""
        record, params = self.records["accelerometer"], self.scenario.accelerometer.params
        before = record.t_ns - np.diff(record.t_ns)[0]
        dt = float(np.diff(record.t_ns)[0]) / 1e9

        def gained(t_ns: NDArray[np.int64]) -> F64:
            turning = np.cross(self.at("state", "omega_BN_B", t_ns), params.r_PB_B)
            return self.at("force", "dv_BN_N", t_ns) + self.body(t_ns).apply(turning)

        true = self.body(record.t_ns).inv().apply((gained(record.t_ns) - gained(before)) / dt)
        measured = record["accel_P"]
        sigma = np.array([params.vrw / np.sqrt(dt)])
        factor = 1e3
        return Compared(
            "Accelerometer",
            record.t_s / 60.0,
            measured * factor,
            true * factor,
            "mm/s^2",
            (measured - true) * factor,
            "mm/s^2",
            sigma * factor,
        )

    def star_tracker(self) -> Compared:
        """Attitude of the case: Euler parameters, and the error as a rotation vector in the case."""
        record, params = self.records["star_tracker"], self.scenario.star_tracker.params
        case = self.body(record.t_ns) * Rotation.from_matrix(DCM_SIDE.T)
        true, valid = case.as_quat(scalar_first=True, canonical=True), record["valid"]
        error = np.full((len(record), 3), np.nan)
        seen = Rotation.from_quat(record["beta_SN"][valid], scalar_first=True)
        error[valid] = (Rotation.from_quat(case.as_quat()[valid]).inv() * seen).as_rotvec()
        sigma = np.array([params.sigma_cross, params.sigma_cross, params.sigma_roll])
        return Compared(
            "Star tracker, attitude",
            record.t_s / 60.0,
            record["beta_SN"],
            true,
            "-",
            error / ARCSEC,
            "arcsec",
            sigma / ARCSEC,
        )

    def star_vectors(self) -> Compared:
        """Number of stars in view, and the errors of the directions, aberration taken out."""
        record, params = self.records["star_vectors"], self.scenario.star_vectors.params
        t_ns, stars = record.t_ns, bright_stars().u_N
        in_view = np.arange(16) < record["count"][:, None]
        v_N = self.at("state", "v_BN_N", t_ns) - self.sun_before(t_ns, "v_PN_N")
        u_N = stars[np.where(in_view, record["star"], 0)] + v_N[:, None, :] / C_LIGHT
        dcm_SN = DCM_ZENITH @ self.body(t_ns).inv().as_matrix()
        true = np.einsum("nij,nkj->nki", dcm_SN, u_N)
        image = (record["s_S"][..., :2] / record["s_S"][..., 2:] - true[..., :2] / true[..., 2:]) / ARCSEC
        error = np.where(in_view[..., None], image, np.nan).reshape(len(record), -1)
        bright = params.s_N[: params.stars]
        towards_N = dcm_SN[:, 2] - v_N / C_LIGHT  # stars are seen displaced, so that the field is of other stars
        cosine = towards_N @ bright.T / np.linalg.norm(towards_N, axis=1)[:, None]
        there = np.sum(cosine >= np.cos(params.fov), axis=1)[:, None]
        return Compared(
            "Star vectors: at most 16 stars, none while the Sun is within 35 degrees of the boresight",
            record.t_s / 60.0,
            record["count"].astype(np.float64)[:, None],
            there.astype(np.float64),
            "stars",
            error,
            "arcsec",
            np.array([params.sigma / ARCSEC]),
        )

    def sun_before(self, t_ns: NDArray[np.int64], column: str) -> F64:
        """The newest column of the Sun's ephemeris, which has a slower task."""
        record = self.records["sun"]
        return record[column][np.searchsorted(record.t_ns, t_ns, side="right") - 1]

    def magnetometer(self) -> Compared:
        """Flux density in the case."""
        record, params = self.records["magnetometer"], self.scenario.magnetometer.params
        true = self.body(record.t_ns).inv().apply(self.at("field", "B_N", record.t_ns))
        measured = record["B_S"]
        sigma = np.full(3, np.hypot(params.sigma, params.resolution / np.sqrt(12.0)))
        return Compared(
            "Magnetometer",
            record.t_s / 60.0,
            measured * 1e6,
            true * 1e6,
            "uT",
            (measured - true) * 1e9,
            "nT",
            sigma * 1e9,
            params.bias_S * 1e9,
        )

    def css_array(self) -> Compared:
        """Currents, against those of sunlight and earthshine (spec, Eq. 1 to 3).

        What is expected is the noise cut off at 0: of a current of mu, E(max(0, mu + sigma n) - mu)^2, mean of all.
        """
        record, params = self.records["css_array"], self.scenario.css_array.params
        t_ns = record.t_ns
        to_sun = self.at("sun", "r_PN_N", t_ns) - self.at("state", "r_BN_N", t_ns)
        distance = np.linalg.norm(to_sun, axis=1)[:, None]
        cosine = self.body(t_ns).inv().apply(to_sun / distance) @ NORMALS_B.T
        light = (ASTRONOMICAL_UNIT / distance) ** 2 * self.at("light", "illumination", t_ns)[:, None]
        up = self.at("state", "r_BN_N", t_ns)
        r, sun = np.linalg.norm(up, axis=1)[:, None], self.at("sun", "r_PN_N", t_ns)
        noon = np.sum(up * sun, axis=1)[:, None] / r / np.linalg.norm(sun, axis=1)[:, None]
        shine = params.albedo * (params.radius / r) ** 2 * np.maximum(noon, 0.0) * (ASTRONOMICAL_UNIT / distance) ** 2
        down = np.maximum(self.body(t_ns).inv().apply(-up / r) @ NORMALS_B.T, 0.0)
        true = np.where(cosine >= np.cos(params.fov), cosine, 0.0) * light + shine * down
        measured, level = record["signal"], true / params.sigma
        below, density = ndtr(-level), np.exp(-0.5 * level**2) / np.sqrt(2.0 * np.pi)
        square = params.sigma**2 * (1.0 - below - level * density) + true**2 * below
        return Compared(
            "Coarse Sun sensors in sunlight; +z looks down into earthshine",
            record.t_s / 60.0,
            measured,
            true,
            "full Sun",
            measured - true,
            "full Sun",
            np.array([np.sqrt(square.mean())]),
        )
