"""Truth for the pose filter, without its code: SciPy's DOP853 for orbit and quaternion, ray casting, projection."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp as _solve_ivp  # pyright: ignore[reportUnknownVariableType]
from scipy.spatial.transform import Rotation

from benchmarks.scenarios.feed import fed
from fsw import OutPort
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.filters import PoseFilterMsg
from messages.opnav import MAX_LANDMARKS, CameraConfigMsg, LandmarksMsg
from messages.sensors import GPSSensorMsg, IMUSensorMsg, STAttMsg
from modules.estimation.analysis.bound import Bound
from modules.estimation.pose_mekf import PoseMekf, PoseMekfParams

solve_ivp: Any = _solve_ivp  # pyright: ignore[reportUnknownVariableType]
MU, RE, J2, WE = 3.986004415e14, 6378136.3, 1.0826261738522e-3, 7.292115e-5
ARCSEC = np.pi / 648000.0
WGS84 = np.array([6378137.0, 6378137.0, 6356752.314245])
SIGMA0 = np.repeat([2e3, 3.0, np.radians(0.3), 5.0 * ARCSEC], 3)
"""Initial standard deviations of position, velocity, attitude, gyro bias."""
ARW, RRW = np.radians(0.1) / 60.0, 2e-8
STAR_SIGMA = np.array([10.0, 10.0, 60.0]) * ARCSEC


State = tuple[F64, F64, F64, F64]


def skew(a: F64) -> F64:
    """Matrix of the cross product [a x]."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def turn(phi: F64) -> F64:
    """dcm_BN of a B turned by phi from N."""
    rotation: Any = Rotation.from_rotvec(phi)
    return np.asarray(rotation.as_matrix(), float).T


def rotvec(dcm: F64) -> F64:
    """Rotation vector of a matrix."""
    rotation: Any = Rotation.from_matrix(dcm.T)
    return np.asarray(rotation.as_rotvec(), float)


def gravity(r: F64) -> F64:
    """Acceleration with J2 [m/s^2]."""
    far, z2 = np.linalg.norm(r), (r[2] / np.linalg.norm(r)) ** 2
    q = 1.5 * J2 * (RE / far) ** 2
    return -MU / far**3 * r * (1.0 + q * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2))


def dcm_EN(t: float) -> F64:
    """The Earth turns about z."""
    c, s = np.cos(WE * t), np.sin(WE * t)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def orientation(t: float) -> PlanetOrientationMsg:
    """As a message."""
    return PlanetOrientationMsg(dcm_EN=dcm_EN(t), omega_EN_N=np.array([0.0, 0.0, WE]))


class Truth:
    """A spacecraft at 500 km, 97.4 degrees, nearly fixed to the local vertical, with a slow wobble.

    Attributes:
        tilt: roll of the body from nadir [rad].
    """

    def __init__(self, duration: float, tilt: float = 0.0, wobble: float = 1e-4) -> None:
        a, i = 6878137.0, np.radians(97.4)
        speed = np.sqrt(MU / a)
        r, v = np.array([a, 0.0, 0.0]), speed * np.array([0.0, np.cos(i), np.sin(i)])
        y = -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        z = -r / a
        dcm_BN = turn(np.array([tilt, 0.0, 0.0])) @ np.array([np.cross(y, z), y, z])
        self._base = turn(np.array([tilt, 0.0, 0.0])) @ np.array([0.0, -speed / a, 0.0])
        self._wobble, self._rate = wobble * np.array([1.0, -0.7, 0.5]), np.array([0.021, 0.017, 0.013])
        q: Any = Rotation.from_matrix(dcm_BN.T)
        start = np.concatenate([r, v, q.as_quat(scalar_first=True)])
        self._solution: Any = solve_ivp(
            self._slope, (0.0, duration + 1.0), start, "DOP853", dense_output=True, rtol=1e-11, atol=1e-9, max_step=60.0
        ).sol

    def omega(self, t: float) -> F64:
        """Angular rate, B [rad/s]."""
        return self._base + self._wobble * np.sin(self._rate * t)

    def mean_omega(self, t0: float, t1: float) -> F64:
        """Its mean over an interval."""
        return self._base - self._wobble * (np.cos(self._rate * t1) - np.cos(self._rate * t0)) / self._rate / (t1 - t0)

    def _slope(self, t: float, y: F64) -> F64:
        w, b = self.omega(t), y[6:]
        dq = 0.5 * np.array([-b[1:] @ w, *(b[0] * w + np.cross(b[1:], w))])
        return np.concatenate([y[3:6], gravity(y[:3]), dq])

    def whole(self, t: float) -> State:
        """r_BN_N, v_BN_N, dcm_BN, quaternion of the body's axes in N, scalar first (its components are beta_BN)."""
        y = self._solution(t)
        q: Any = Rotation.from_quat(y[6:], scalar_first=True)
        return y[:3], y[3:6], np.asarray(q.as_matrix(), float).T, y[6:] / np.linalg.norm(y[6:])

    def at(self, t: float) -> tuple[F64, F64, F64]:
        """r_BN_N, v_BN_N, dcm_BN."""
        return self.whole(t)[:3]


def ground(r_E: F64, ray_E: F64, height: float) -> F64:
    """Where a ray meets the ellipsoid grown by a height."""
    axes = WGS84 + height
    p, d = r_E / axes, ray_E / axes
    a, b, c = d @ d, p @ d, p @ p - 1.0
    return r_E + (-b - np.sqrt(b * b - a * c)) / a * ray_E


@dataclass
class Optics:
    """A square camera along the body's z axis, and what is wrong with it."""

    focal: float
    size: int = 2048
    k1: float = 0.0
    mount: F64 = field(default_factory=lambda: np.zeros(3))
    d_focal: float = 0.0
    d_center: F64 = field(default_factory=lambda: np.zeros(2))
    d_k1: float = 0.0
    row_time: float = 0.0

    @property
    def message(self) -> CameraConfigMsg:
        """What a filter is told of it."""
        center = np.full(2, (self.size - 1) / 2)
        distortion = np.array([self.k1, 0.0, 0.0, 0.0, 0.0])
        focal = np.full(2, self.focal)
        return CameraConfigMsg(
            width_px=self.size, height_px=self.size, focal_px=focal, center_px=center, distortion=distortion
        )

    def pixel(self, p_C: F64) -> F64:
        """True pixel of a point in components of the nominal camera."""
        x, y, z = turn(self.mount) @ p_C
        s = (x * x + y * y) / (z * z)
        grown = self.focal * (1.0 + self.d_focal) * (1.0 + (self.k1 + self.d_k1) * s)
        return grown * np.array([x / z, y / z]) + (self.size - 1) / 2 + self.d_center


NARROW, WIDE = 33400.0, 1773.0
"""Focal lengths [px] of 2048 px over 3.5 and 60 degrees."""


@dataclass
class Scene:
    """A truth, a camera, and landmarks fixed on the ground for each image."""

    truth: Truth
    focal: float
    images: F64
    count: int = 30
    relief: float = 0.0
    seed: int = 1

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        self.places: list[F64] = []
        for t in self.images:
            r, _, dcm_BN = self.truth.at(t)
            rays = np.column_stack([rng.uniform(-1022, 1022, (self.count, 2)) / self.focal, np.ones(self.count)])
            E = dcm_EN(t)
            heights = self.relief * rng.standard_normal(self.count)
            seen = [ground(E @ r, E @ dcm_BN.T @ ray, h) for ray, h in zip(rays, heights, strict=True)]
            self.places.append(np.array(seen))

    def pixels(self, k: int, optics: Optics, late: float = 0.0) -> F64:
        """True pixels of the places of image k, (count, 2); each row of a rolling shutter at its own time."""
        out = np.empty((self.count, 2))
        for i, place in enumerate(self.places[k]):
            after = 0.0
            for _ in range(3 if optics.row_time else 1):
                t = self.images[k] + late + after
                r, _, dcm_BN = self.truth.at(t)
                out[i] = optics.pixel(dcm_BN @ (dcm_EN(t).T @ place - r))
                after = optics.row_time * (out[i, 1] - 0.5 * (optics.size - 1))
        return out


def landmarks(exposure_ns: int, places: F64, pixels: F64, sigma: float) -> LandmarksMsg:
    """As a message."""
    n = len(places)
    r, px, s = np.full((MAX_LANDMARKS, 3), np.nan), np.full((MAX_LANDMARKS, 2), np.nan), np.full(MAX_LANDMARKS, np.nan)
    r[:n], px[:n], s[:n] = places, pixels, sigma
    score = np.where(np.isfinite(s), 1.0, np.nan)
    return LandmarksMsg(
        exposure_ns=exposure_ns, count=n, candidates=n, cells=24, r_LE_E=r, pixel_px=px, sigma_px=s, score=score
    )


@dataclass
class Setup:
    """What a study varies.

    Attributes:
        star, gps: periods of their measurements [s], 0 for none. sigma_px: noise. sigma_map: random error of places.
        outliers: share, anywhere in the image, or by a normal error of wrong_px. outage, silence: times between which
        GPS and gyro say nothing. delay: of images [s]. row_time: of a rolling shutter. draw_pixels: add
        noise to pixels. nuisance: names of the nuisance
        states whose errors are drawn. params: of the filter.
    """

    star: int = 0
    gps: int = 0
    sigma_px: float = 0.5
    sigma_map: float = 0.0
    outliers: float = 0.0
    wrong_px: float = 0.0
    outage: tuple[float, float] = (np.inf, np.inf)
    silence: tuple[float, float] = (np.inf, np.inf)
    delay: int = 0
    row_time: float = 0.0
    draw_pixels: bool = True
    nuisance: tuple[str, ...] = ()
    params: dict[str, Any] = field(default_factory=dict[str, Any])


NUISANCE = {
    "mount": 60.0 * ARCSEC,
    "focal": 1e-3,
    "center": 1.0,
    "k1": 1e-3,
    "map": 5.0,
    "gps": 3.0,
    "time": 1e-3,
}


@dataclass
class Draw:
    """The random numbers of one run."""

    x0: F64
    optics: Optics
    map_bias: F64
    late: float
    rng: np.random.Generator


def draw(setup: Setup, focal: float, seed: int) -> Draw:
    """All that is wrong in one run."""
    rng = np.random.default_rng([seed, 77])
    size = {name: (NUISANCE[name] if name in setup.nuisance else 0.0) for name in NUISANCE}
    x0 = SIGMA0 * rng.standard_normal(12)
    optics = Optics(
        focal,
        mount=size["mount"] * rng.standard_normal(3),
        d_focal=size["focal"] * rng.standard_normal(),
        d_center=size["center"] * rng.standard_normal(2),
        d_k1=size["k1"] * rng.standard_normal(),
        row_time=setup.row_time,
    )
    map_bias = size["map"] * rng.standard_normal(3)
    return Draw(x0, optics, map_bias, size["time"] * rng.standard_normal(), rng)


def make_filter(truth: Truth, made: Draw, **params: Any) -> tuple[PoseMekf, dict[str, OutPort[Any]]]:
    """A filter whose start is wrong by the draw."""
    r, v, dcm_BN = truth.at(0.0)
    estimate = turn(-made.x0[6:9]) @ dcm_BN  # true = (I - [theta x]) estimate
    mrp: Any = Rotation.from_matrix(estimate.T)
    start: dict[str, Any] = {
        "r_BN_N": r - made.x0[:3],
        "v_BN_N": v - made.x0[3:6],
        "sigma_BN": mrp.as_mrp(),
        "omega_BN_B": truth.omega(0.0),
        "P": np.diag(SIGMA0**2),
        "gyro_white": ARW,
        "gyro_walk": RRW,
        "star_sigma": STAR_SIGMA,
    }
    mekf = PoseMekf("mekf", PoseMekfParams(**{**start, **params}))
    return mekf, fed(mekf)


def hamilton(p: F64, q: F64) -> F64:
    """Product of quaternions, scalar first."""
    return np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def small(phi: F64) -> F64:
    """Quaternion of a small rotation vector."""
    return np.concatenate([[np.sqrt(1.0 - 0.25 * phi @ phi)], 0.5 * phi])


def error_of(message: PoseFilterMsg, state: State, bias: F64) -> F64:
    """True minus estimated core states (12,): true = (I - [theta x]) estimate, so q = q_estimate q(theta)."""
    r, v, _, q = state
    between = hamilton(message.beta_BN * [1.0, -1.0, -1.0, -1.0], q)
    theta = 2.0 * np.arcsin(np.linalg.norm(between[1:])) / np.linalg.norm(between[1:]) * between[1:]
    return np.concatenate([r - message.r_BN_N, v - message.v_BN_N, theta * np.sign(between[0]), bias - message.bias_B])


class Cached:
    """Truth at whole seconds and pixels of landmarks, computed once for all runs."""

    def __init__(self, scene: Scene, duration: int) -> None:
        self.scene, self.duration = scene, duration
        self.states: list[State] = [scene.truth.whole(float(t)) for t in range(duration + 1)]
        self.planet = [orientation(float(t)) for t in range(duration + 1)]
        self.rates = [scene.truth.mean_omega(t - 1.0, float(t)) for t in range(1, duration + 1)]
        self.seen = [scene.pixels(k, Optics(scene.focal)) for k in range(len(scene.images))]


class Instant(NamedTuple):
    """What the sensors say at one second, and the true bias of the gyro."""

    t: int
    rate: F64
    star: F64 | None
    """Quaternion of the star tracker."""
    gps: tuple[F64, F64] | None
    """Position and velocity, Earth-fixed."""
    image: tuple[int, F64, F64] | None
    """Time of exposure [ns], places and pixels of landmarks."""
    bias: F64


def sensed(cached: Cached, setup: Setup, made: Draw, seed: int) -> Iterator[Instant]:
    """One run, second by second, as every filter sees it."""
    scene = cached.scene
    rng, optics, false = made.rng, made.optics, np.random.default_rng([seed, 78])
    bias, gps_bias = made.x0[9:], NUISANCE["gps"] * rng.standard_normal(3) * ("gps" in setup.nuisance)
    ideal = not (set(setup.nuisance) - {"map", "gps"}) and not setup.row_time
    at = {round(float(t)): k for k, t in enumerate(scene.images)}
    for t in range(1, cached.duration + 1):
        new_bias = bias + RRW * rng.standard_normal(3)
        noise = np.sqrt(ARW**2 + RRW**2 / 12.0) * rng.standard_normal(3)
        rate = cached.rates[t - 1] + 0.5 * (bias + new_bias) + noise
        bias = new_bias
        keep = np.exp(-1.0 / 300.0)
        fresh = NUISANCE["gps"] * np.sqrt(1.0 - keep**2) * ("gps" in setup.nuisance)
        gps_bias = keep * gps_bias + fresh * rng.standard_normal(3)
        r, v, _, q = cached.states[t]
        star = gps = image = None
        if setup.star and t % setup.star == 0:
            star = hamilton(q, small(STAR_SIGMA * rng.standard_normal(3)))
        if setup.gps and t % setup.gps == 0 and not setup.outage[0] < t < setup.outage[1]:
            E = dcm_EN(float(t))
            r_E = E @ r + gps_bias + 5.0 * rng.standard_normal(3)
            gps = r_E, E @ (v - np.cross([0.0, 0.0, WE], r)) + 0.1 * rng.standard_normal(3)
        k = at.get(t - setup.delay)
        if k is not None:
            seen = cached.seen[k] if ideal else scene.pixels(k, optics, made.late)
            seen = seen + setup.sigma_px * rng.standard_normal(seen.shape) if setup.draw_pixels else seen
            wrong = false.random(len(seen)) < setup.outliers
            place = scene.places[k] - made.map_bias + setup.sigma_map * false.standard_normal((len(seen), 3))
            if setup.wrong_px:
                seen[wrong] += setup.wrong_px * false.standard_normal((int(wrong.sum()), 2))
            else:
                seen[wrong] = false.uniform(0.0, 2047.0, (int(wrong.sum()), 2))
            image = (t - setup.delay) * 10**9, place, seen
        yield Instant(t, rate, star, gps, image, bias)


def run(cached: Cached, setup: Setup, seed: int, every: int = 1) -> Iterator[tuple[int, PoseFilterMsg, F64, PoseMekf]]:
    """One run, of which each ``every``-th second is told: time, message, error of the core states, filter."""
    scene, truth = cached.scene, cached.scene.truth
    made = draw(setup, scene.focal, seed)
    mekf, ports = make_filter(truth, made, row_time=setup.row_time, **setup.params)
    ports["in_camera"].write(Optics(scene.focal).message, 0)
    for now in sensed(cached, setup, made, seed):
        t, t_ns = now.t, now.t * 10**9
        ports["in_orientation"].write(cached.planet[t], t_ns)
        if not setup.silence[0] < t < setup.silence[1]:
            ports["in_gyro"].write(IMUSensorMsg(omega_PN_P=now.rate, accel_P=np.full(3, np.nan)), t_ns)
        if now.star is not None:
            ports["in_star_tracker"].write(STAttMsg(exposure_ns=t_ns, valid=True, beta_SN=now.star), t_ns)
        if now.gps is not None:
            r_E, v_E = now.gps
            ports["in_gps"].write(GPSSensorMsg(fix_ns=t_ns, r_AE_E=r_E, v_AE_E=v_E, lat=0.0, lon=0.0, h=0.0), t_ns)
        if now.image is not None:
            ports["in_landmarks"].write(landmarks(*now.image, setup.sigma_px), t_ns)
        mekf.step(t_ns)
        if t % every == 0:
            message = mekf.out_filter.latest()
            assert message is not None
            yield t, message, error_of(message, cached.states[t], now.bias), mekf


def monte_carlo(cached: Cached, setup: Setup, runs: int, every: int = 10, first: int = 0) -> tuple[F64, F64]:
    """Errors (runs, K, 12) and covariances (runs, K, 12, 12) at every tenth second."""
    K = cached.duration // every
    errors, P = np.empty((runs, K, 12)), np.empty((runs, K, 12, 12))
    for m in range(runs):
        for t, message, error, _ in run(cached, setup, first + m, every):
            errors[m, t // every - 1], P[m, t // every - 1] = error, message.P[:12, :12]
    return errors, P


def nees(errors: F64, P: F64) -> F64:
    """(runs, K)."""
    s = np.sqrt(np.diagonal(P, axis1=2, axis2=3))
    scaled = errors / s
    white = np.asarray(np.linalg.solve(P / (s[..., :, None] * s[..., None, :]), scaled[..., None]), np.float64)
    return np.asarray(np.sum(white[..., 0] * scaled, axis=-1))


def pcrb(cached: Cached, setup: Setup, everything: bool = False) -> F64:
    """The bound (K, n, n) at every tenth second, by B6 of the audit and `Bound`, at the true trajectory."""
    scene = cached.scene
    wanted = [n for n in ("mount", "focal", "map", "gps") if n in setup.nuisance]
    size = {"mount": 3, "focal": 1, "map": 3, "gps": 3}
    place, b = dict[str, int](), 0
    for n in wanted:
        place[n], b = b, b + size[n]
    prior = np.diag(np.concatenate([np.full(size[n], NUISANCE[n] ** 2) for n in wanted])) if wanted else None
    bound = Bound(np.diag(SIGMA0**2), nuisance=prior)
    at = {round(float(t)): k for k, t in enumerate(scene.images)}
    kept: list[F64] = []
    su, sv, qa = RRW, ARW, 1e-7
    for t in range(1, cached.duration + 1):
        r, _, dcm_BN, _ = cached.states[t]
        w = scene.truth.mean_omega(t - 1.0, float(t))
        far, n = np.linalg.norm(r), r / np.linalg.norm(r)
        G = -MU / far**3 * (np.eye(3) - 3.0 * np.outer(n, n))
        F = np.zeros((12, 12))
        F[:3, 3:6], F[3:6, :3], F[6:9, 6:9], F[6:9, 9:] = np.eye(3), G, -skew(w), -np.eye(3)
        Phi = np.eye(12) + F + F @ F / 2.0 + F @ F @ F / 6.0
        Q = np.zeros((12, 12))
        for i in range(3):
            Q[np.ix_([i, 3 + i], [i, 3 + i])] = qa**2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
            Q[np.ix_([6 + i, 9 + i], [6 + i, 9 + i])] = [[sv**2 + su**2 / 3, -(su**2) / 2], [-(su**2) / 2, su**2]]
        if wanted:
            Pn, Qn = np.eye(b), np.zeros((b, b))
            if "gps" in place:
                j, keep = place["gps"], np.exp(-1.0 / 300.0)
                Pn[j : j + 3, j : j + 3] *= keep
                Qn[j : j + 3, j : j + 3] = NUISANCE["gps"] ** 2 * (1.0 - keep**2) * np.eye(3)
            bound.predict(Phi, Q, (Pn, Qn))
        else:
            bound.predict(Phi, Q)
        if setup.star and t % setup.star == 0:
            H = np.zeros((3, 12))
            H[:, 6:9] = np.eye(3)
            bound.measure(H, np.diag(STAR_SIGMA**2))
        if setup.gps and t % setup.gps == 0 and not setup.outage[0] < t < setup.outage[1]:
            E, H, N = dcm_EN(float(t)), np.zeros((6, 12)), np.zeros((6, b))
            H[:3, :3] = H[3:, 3:6] = E
            H[3:, :3] = -E @ skew(np.array([0.0, 0.0, WE]))
            if "gps" in place:
                N[:3, place["gps"] : place["gps"] + 3] = np.eye(3)
            bound.measure(H, np.diag([25.0] * 3 + [0.01] * 3), nuisance=N if b else None)
        k = at.get(t)
        if k is not None:
            rows, more = list[F64](), list[F64]()
            E = dcm_EN(float(t))
            for L in scene.places[k]:
                p = dcm_BN @ (E.T @ L - r)
                D = scene.focal / p[2] * np.array([[1.0, 0.0, -p[0] / p[2]], [0.0, 1.0, -p[1] / p[2]]])
                H, N = np.zeros((2, 12)), np.zeros((2, b))
                H[:, :3], H[:, 6:9] = -D @ dcm_BN, D @ skew(p)
                if "mount" in place:
                    N[:, place["mount"] : place["mount"] + 3] = D @ skew(p)
                if "focal" in place:
                    N[:, place["focal"]] = scene.focal * p[:2] / p[2]
                if "map" in place:
                    N[:, place["map"] : place["map"] + 3] = D @ dcm_BN @ E.T
                rows.append(H)
                more.append(N)
            share = 1.0 - setup.outliers
            bound.measure(
                np.vstack(rows), setup.sigma_px**2 * np.eye(2 * len(rows)), share, np.vstack(more) if b else None
            )
        if t % 10 == 0:
            kept.append(bound.covariance(everything))
    return np.array(kept)
