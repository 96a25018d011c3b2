"""The source's 13-state filter as a baseline: as it is printed, with its equations repaired, and repaired and tuned.

Row numbers (E-, T-) are those of the audit of the sources. State: r, v (N), quaternion of B relative to O, scalar
first, and the rate of B relative to O; covariance (13, 13). The Earth tracker's measurement is in all flavours that of
the source: pixel coordinates and focal length, times a ground sampling distance that is assumed (T-68): a vector of
three numbers that holds the assumed range as if it had been measured.

As written (`AS_WRITTEN`), errors included:

- explicit Euler steps, the quaternion added and never normalised (E-4, E-8); Euler's equation for the relative rate
  (E-9); J2 with the wrong sign and the radius not squared (T-27)
- orbit frame z = -r, y = +(r x v), x backward (T-9); Earth to inertial by the inverse rotation (T-7)
- the attitude matrix of a quaternion is the transposed of the one that its rate equation needs (T-21, E-19)
- homogeneous transformations applied to directions of Sun, stars and field (E-17); the Sun along +x for ever (T-37)
- one step for all numerical derivatives (E-3); GPS in degrees and metres (E-13); a rate of circular orbits (E-14);
  all six Sun sensors, clamped ones too (E-15); principal point at half the size (T-52)
- noisy sensors first (E-6)

`BUG_FIXED` repairs all of these but for the Earth tracker's vector and the added quaternion, which it normalises.
`tuned` chooses factors of R and Q by trying them on training seeds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from messages.base import F64

MU, RADIUS, J2, SPIN = 3.986004418e14, 6378137.0, 1.08262668e-3, 7.292115e-5
AS_WRITTEN, BUG_FIXED = "as written", "bug-fixed"


def _covariance() -> F64:
    return np.diag(np.repeat([2000.0, 3.0], 3).tolist() + [2.6e-3] * 4 + [1e-4] * 3) ** 2


def _process() -> F64:
    return np.diag([1e-4] * 3 + [1e-6] * 3 + [1e-10] * 4 + [1e-11] * 3)


@dataclass(frozen=True)
class Settings:
    """What the source leaves open (E-21), with the values of the audit's configuration.

    Attributes:
        flavour: `AS_WRITTEN` or `BUG_FIXED`.
        inertia: principal moments [kg m^2].
        focal_px: focal length over pixel size [px].
        size_px: side of the image [px].
        altitude: assumed, for the ground sampling distance [m].
        dcm_CB: mounting of the camera.
        P0, Q: covariances (13, 13), Q for each second.
        sigma_px: error of a pixel coordinate [px]; along the boresight the assumed range is taken for ``depth`` [m].
        depth: see there; 0 takes the error of the other two.
        sigma_gps, sigma_gyro, sigma_css, sigma_mag, sigma_star: [m], [rad/s], [-], [-], [-].
        step: of the numerical derivatives, as written.
    """

    flavour: str = BUG_FIXED
    inertia: F64 = field(default_factory=lambda: np.array([0.04, 0.05, 0.02]))
    focal_px: float = 500e3 / 15.0
    size_px: int = 2048
    altitude: float = 500e3
    dcm_CB: F64 = field(default_factory=lambda: np.eye(3))
    P0: F64 = field(default_factory=_covariance)
    Q: F64 = field(default_factory=_process)
    sigma_px: float = 0.5
    depth: float = 0.0
    sigma_gps: float = 5.0
    sigma_gyro: float = 2.9e-5
    sigma_css: float = 0.05
    sigma_mag: float = 0.01
    sigma_star: float = 5e-5
    step: float = 1e-3

    @property
    def gsd(self) -> float:
        """Ground sampling distance [m/px] (T-55)."""
        return self.altitude / self.focal_px


def printed_matrix(q: F64) -> F64:
    """Equation 3.24 of the source: of a quaternion of any length."""
    s, x, y, z = q
    return np.array(
        [
            [s * s + x * x - y * y - z * z, 2 * (x * y - s * z), 2 * (x * z + s * y)],
            [2 * (x * y + s * z), s * s - x * x + y * y - z * z, 2 * (y * z - s * x)],
            [2 * (x * z - s * y), 2 * (y * z + s * x), s * s - x * x - y * y + z * z],
        ]
    )


def unit(a: F64) -> F64:
    """Of length one."""
    return a / np.linalg.norm(a)


class SeedEkf:
    """One filter. All measurements are at the time of the state; the caller predicts to it first."""

    def __init__(self, x: F64, settings: Settings, t: float = 0.0) -> None:
        """Start from 13 numbers at time t [s]; the quaternion is of the kind that dcm_BO(beta) takes (passive)."""
        self.s, self.t = settings, t
        self.written = settings.flavour == AS_WRITTEN
        self.x, self.P = np.array(x, np.float64), settings.P0.copy()
        if self.written:  # its own orbit frame and its own matrix: the same attitude in the source's terms
            dcm_BN = printed_matrix(x[6:10]).T @ self._right_frame(x[:3], x[3:6])
            a, b, c, s = np.asarray(Rotation.from_matrix(dcm_BN @ self.orbit_frame(x).T).as_quat())
            self.x[6:10] = [s, a, b, c]

    @staticmethod
    def _right_frame(r: F64, v: F64) -> F64:
        z, y = -unit(r), -unit(np.cross(r, v))
        return np.array([np.cross(y, z), y, z])

    def orbit_frame(self, x: F64) -> F64:
        """dcm_ON."""
        if not self.written:
            return self._right_frame(x[:3], x[3:6])
        z, y = -unit(x[:3]), unit(np.cross(x[:3], x[3:6]))
        return np.array([np.cross(y, z), y, z])

    def dcm_BO(self, x: F64) -> F64:
        """Attitude matrix of the state."""
        M = printed_matrix(x[6:10])
        return M if self.written else M.T / float(x[6:10] @ x[6:10])

    def earth_to_inertial(self) -> F64:
        """dcm_NE; both are the same at time zero."""
        c, s = math.cos(SPIN * self.t), math.sin(SPIN * self.t)
        right = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return right.T if self.written else right

    def acceleration(self, r: F64) -> F64:
        """Of gravity at r [m/s^2]."""
        far = float(np.linalg.norm(r))
        z2 = (r[2] / far) ** 2
        bracket = r * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2)
        factor = 1.5 * J2 * MU * RADIUS if self.written else -1.5 * J2 * MU * RADIUS**2
        return -MU * r / far**3 + factor / far**5 * bracket

    def orbit_rate(self, x: F64) -> F64:
        """omega_ON_O."""
        far = float(np.linalg.norm(x[:3]))
        rate = math.sqrt(MU / far**3) if self.written else float(np.linalg.norm(np.cross(x[:3], x[3:6]))) / far**2
        return np.array([0.0, -rate, 0.0])

    def slope(self, x: F64) -> F64:
        """Derivative of the state in time."""
        w, I3 = x[10:], self.s.inertia
        s, a, b, c = x[6:10]
        W = np.array([[-a, -b, -c], [s, -c, b], [c, s, -a], [-b, a, s]])
        if self.written:
            wdot = (
                np.array([(I3[1] - I3[2]) * w[1] * w[2], (I3[2] - I3[0]) * w[2] * w[0], (I3[0] - I3[1]) * w[0] * w[1]])
                / I3
            )
        else:
            far, carried = float(np.linalg.norm(x[:3])), self.dcm_BO(x) @ self.orbit_rate(x)
            full = w + carried
            turning = np.array([0.0, -2.0 * self.orbit_rate(x)[1] * float(x[:3] @ x[3:6]) / far**2, 0.0])
            wdot = -np.cross(full, I3 * full) / I3 + np.cross(w, carried) - self.dcm_BO(x) @ turning
        return np.concatenate([x[3:6], self.acceleration(x[:3]), 0.5 * W @ w, wdot])

    def moved(self, x: F64, dt: float) -> F64:
        """The state after one step, of Euler or of Runge and Kutta."""
        if self.written:
            return x + dt * self.slope(x)
        a = self.slope(x)
        b = self.slope(x + dt / 2 * a)
        c = self.slope(x + dt / 2 * b)
        d = self.slope(x + dt * c)
        return self.normal(x + dt / 6 * (a + 2 * b + 2 * c + d))

    def normal(self, x: F64) -> F64:
        """The state with a unit quaternion, which the source does not make."""
        if self.written:
            return x
        return np.concatenate([x[:6], unit(x[6:10]), x[10:]])

    def jacobian(self, f: Callable[[F64], F64]) -> F64:
        """Midpoint differences."""
        steps = np.full(13, self.s.step) if self.written else np.repeat([10.0, 1e-2, 1e-6, 1e-7], [3, 3, 4, 3])
        columns: list[F64] = []
        for j in range(13):
            e = np.zeros(13)
            e[j] = steps[j]
            columns.append((f(self.x + e) - f(self.x - e)) / (2.0 * steps[j]))
        return np.array(columns).T

    def predict(self, dt: float) -> None:
        """One step of dt [s]."""
        F = self.jacobian(lambda x: self.moved(x, dt))
        self.x, self.t = self.moved(self.x, dt), self.t + dt
        self.P = F @ self.P @ F.T + self.s.Q * dt

    def update(self, z: F64, h: Callable[[F64], F64], R: F64) -> None:
        """Joseph's form (E-4)."""
        H = self.jacobian(h)
        K = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        I_KH = np.eye(13) - K @ H
        self.x = self.normal(self.x + K @ (z - h(self.x)))
        self.P = I_KH @ self.P @ I_KH.T + K @ R @ K.T

    def to_body(self, x: F64, a_N: F64, position: bool) -> F64:
        """A vector of N in B: positions are moved to the satellite, and, as written, directions too (E-17)."""
        moved = a_N - x[:3] if position or self.written else a_N
        return self.dcm_BO(x) @ self.orbit_frame(x) @ moved

    def earth_tracker(self, pixel: F64, r_LE_E: F64) -> None:
        """Features (n, 2) and their places (n, 3), one after the other."""
        s = self.s
        middle = s.size_px / 2 if self.written else (s.size_px - 1) / 2
        R = np.diag([(s.sigma_px * s.gsd) ** 2] * 2 + [max(s.depth, s.sigma_px * s.gsd) ** 2])
        R_B = s.dcm_CB.T @ R @ s.dcm_CB
        for p, L in zip(pixel, r_LE_E, strict=True):
            z = s.dcm_CB.T @ (s.gsd * np.array([p[0] - middle, p[1] - middle, s.focal_px]))
            L_N = self.earth_to_inertial() @ L
            self.update(z, lambda x, L_N=L_N: self.to_body(x, L_N, True), R_B)

    def gps(self, r_AE_E: F64) -> None:
        """Position: latitude, longitude in degrees, height, as written; else Earth-fixed metres."""
        s, back = self.s, self.earth_to_inertial().T
        if self.written:
            degree = math.degrees(s.sigma_gps / RADIUS)
            self.update(geodetic(r_AE_E), lambda x: geodetic(back @ x[:3]), np.diag([degree, degree, s.sigma_gps]) ** 2)
        else:
            self.update(r_AE_E, lambda x: back @ x[:3], s.sigma_gps**2 * np.eye(3))

    def gyro(self, omega_BN_B: F64) -> None:
        """Rate relative to N."""
        self.update(
            omega_BN_B, lambda x: x[10:] + self.dcm_BO(x) @ self.orbit_rate(x), self.s.sigma_gyro**2 * np.eye(3)
        )

    def star_vectors(self, seen_B: F64, known_N: F64) -> None:
        """Unit vectors (n, 3) to stars."""
        for z, star in zip(seen_B, known_N, strict=True):
            self.update(z, lambda x, a=star: self.to_body(x, a, False), self.s.sigma_star**2 * np.eye(3))

    def sun_sensors(self, signal: F64, sun_N: F64) -> None:
        """Six cells on the faces, +x, -x, +y, ...: all of them, as written; else those that are lit."""
        normals = np.kron(np.eye(3), [[1.0], [-1.0]])
        sun = np.array([1.0, 0.0, 0.0]) if self.written else sun_N

        def h(x: F64) -> F64:
            cosine = normals @ self.to_body(x, sun, False)
            return np.maximum(0.0, cosine) if self.written else cosine

        lit = np.ones(6, bool) if self.written else h(self.x) > 0.2
        if np.any(lit):
            R = self.s.sigma_css**2 * np.eye(int(lit.sum()))
            self.update(signal[lit], lambda x: h(x)[lit], R)

    def magnetometer(self, field_B: F64, model_N: Callable[[F64], F64]) -> None:
        """Direction of the field; ``model_N`` gives it at a position in N."""
        z = unit(field_B)
        self.update(z, lambda x: self.to_body(x, unit(model_N(x[:3])), False), self.s.sigma_mag**2 * np.eye(3))

    def dcm_BN(self) -> F64:
        """Attitude that it stands for."""
        return self.dcm_BO(self.x) @ self.orbit_frame(self.x)


def geodetic(r_E: F64) -> F64:
    """Latitude, longitude [deg] and height [m] on WGS84, by the iteration that textbooks give."""
    e2, p = 6.69437999014e-3, math.hypot(r_E[0], r_E[1])
    lat = math.atan2(r_E[2], p * (1.0 - e2))
    for _ in range(6):
        N = RADIUS / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
        lat = math.atan2(r_E[2] + e2 * N * math.sin(lat), p)
    N = RADIUS / math.sqrt(1.0 - e2 * math.sin(lat) ** 2)
    h = p * math.cos(lat) + r_E[2] * math.sin(lat) - RADIUS**2 / N
    return np.array([math.degrees(lat), math.degrees(math.atan2(r_E[1], r_E[0])), h])


def tuned(
    settings: Settings,
    cost: Callable[[Settings], float],
    depths: Sequence[float] = (0.0, 100.0, 1e3, 1e4, 6e4),
    pixels: Sequence[float] = (1.0, 3.0),
    noises: Sequence[float] = (0.1, 1.0, 10.0, 100.0),
) -> Settings:
    """The settings with the least cost of a grid.

    Args:
        settings: repaired ones.
        cost: of settings, such as the RMS position error over training seeds; NaN counts as infinite.
        depths: errors along the boresight [m] to try.
        pixels: factors of sigma_px.
        noises: factors of Q.
    """
    best, least = settings, math.inf
    for depth in depths:
        for pixel in pixels:
            for noise in noises:
                tried = replace(settings, depth=depth, sigma_px=pixel * settings.sigma_px, Q=noise * settings.Q)
                value = cost(tried)
                if value < least:
                    best, least = tried, value
    return best
