"""The track filter: the landmarks of all photos through one filter of pose, lens, mounting and clock, in order of time.

The photos are independent fixes elsewhere; here they are one pass. The station has no gyro for us: it keeps its
attitude to the local vertical, so its rate is that of the orbit and drifts slowly. The filter starts at the first fix,
with a wide standard deviation, and with the velocity of the approximate orbit.

Lens and mounting were calibrated with positions held to that orbit, so its error is in them and comes back in every
position, as if the whole map were displaced. Photos cannot tell: it is considered, as an error that all places share,
and not estimated. So the orbit's position is used once, and its error is in the stated standard deviation. What else
is unknown of focal length, principal point, k1 and clock is considered too; the mounting is estimated.
"""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from fsw import Module, Out, Simulation, Task, s
from fsw.math.orbit_frames import OMEGA_EARTH
from messages.base import F64, fields_of
from messages.environment import PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, LandmarksMsg
from messages.orbit import CameraAccuracyMsg
from modules.estimation.orbit_pose_prior import TleOrbit
from modules.estimation.pose_mekf import PoseMekf, PoseMekfParams
from modules.estimation.rotations import beta_from_dcm

CONSIDER, ESTIMATE = 1, 2
_RATE_H = np.array([0.3, 1.0, 0.3])
"""Standard deviation of the velocity of the approximate orbit beyond what follows from its position, H [m/s]."""
_POSITION, _ATTITUDE, _MOUNT = 2e4, 2e-3, 0.02
"""Standard deviations at the start: position [m], attitude to the local vertical [rad], mounting [rad]."""


class TrackPoint(msgspec.Struct, frozen=True, kw_only=True):
    """The filter's estimate at one second.

    Attributes:
        t_s: simulation time of the photos [s]. r_BE_E: position (3,) [m]. error_H: minus approximate orbit (3,) [m].
        P_H: covariance of the position (3, 3) [m^2], H. images: photos used until then.
    """

    t_s: float
    r_BE_E: F64
    error_H: F64
    P_H: F64
    images: int

    @property
    def sigma_H(self) -> F64:
        """Standard deviations, (3,) m."""
        return np.sqrt(np.diag(self.P_H))

    @property
    def distance(self) -> float:
        """Normalised square of the difference from the orbit, by the filter's covariance alone; 3 is expected."""
        return float(self.error_H @ np.linalg.solve(self.P_H, self.error_H))


class Track(msgspec.Struct, frozen=True, kw_only=True):
    """What the filter made of the pass.

    Attributes:
        points: second by second, from the first photo used. photos: exposures of the photos [s]; used: how many.
        nuisance: name, estimate and standard deviation of lens, mounting and clock, at the end.
    """

    points: list[TrackPoint]
    photos: list[float]
    used: int
    nuisance: dict[str, tuple[F64, F64]]

    def at(self, t_s: float) -> TrackPoint:
        """The first estimate at or after a time, so that it knows a photo of that time."""
        return next((p for p in self.points if p.t_s >= t_s), self.points[-1])


class _Replay(Module):
    """Writes landmarks when their exposure has come, with the camera and the turning Earth."""

    out_landmarks = Out(LandmarksMsg)
    out_camera = Out(CameraConfigMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def __init__(self, name: str, landmarks: list[LandmarksMsg], camera: CameraConfigMsg) -> None:
        super().__init__(name)
        self.waiting, self.camera = list(landmarks), camera

    def step(self, t_ns: int) -> None:
        spin = np.array([0.0, 0.0, OMEGA_EARTH])
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=_spin(t_ns), omega_EN_N=spin), t_ns)
        self.out_camera.write(self.camera, t_ns)
        if self.waiting and self.waiting[0].exposure_ns <= t_ns:
            self.out_landmarks.write(self.waiting.pop(0), t_ns)


def _spin(t_ns: int) -> F64:
    """dcm_EN (3, 3); N is E at time zero of the filter's clock."""
    c, sine = np.cos(OMEGA_EARTH * t_ns * 1e-9), np.sin(OMEGA_EARTH * t_ns * 1e-9)
    return np.array([[c, sine, 0.0], [-sine, c, 0.0], [0.0, 0.0, 1.0]])


def landmarks_at(row: Any, exposure_ns: int) -> LandmarksMsg:
    """The message of a recorded row, with another time of exposure."""
    values: dict[str, Any] = {
        f.name: (np.array(row[f.name]) if f.shape else row[f.name].item()) for f in fields_of(LandmarksMsg)
    }
    values["exposure_ns"] = exposure_ns
    return LandmarksMsg(**values)


def _velocity_covariance(orbit: TleOrbit, t_s: float, rate: float, dcm_HE: F64) -> F64:
    """Covariance (3, 3) of the orbit's velocity, E: an error that stays the same in the turning H moves in N."""
    swept = rate * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    P_H = swept @ np.diag(orbit.sigma_H(t_s) ** 2) @ swept.T + np.diag(_RATE_H**2)
    return dcm_HE.T @ P_H @ dcm_HE


def _params(
    r_E: F64,
    t_s: float,
    start_ns: int,
    orbit: TleOrbit,
    camera: CameraConfigMsg,
    accuracy: CameraAccuracyMsg,
    sigma_time: float,
) -> PoseMekfParams:
    """The filter's parameters for a first position r_E (3,) at t_s, which is ``start_ns`` of the filter's clock."""
    v_E, (r_orbit, dcm_OE, dcm_HE) = orbit.at(t_s)[1][0], orbit.frames(t_s)
    rate = float(np.linalg.norm(np.cross(r_orbit, v_E)) / (r_orbit @ r_orbit))
    dcm_EN = _spin(start_ns)
    P = np.diag(np.repeat([_POSITION, 1.0, _ATTITUDE, 1e-5], 3) ** 2)
    P_vv = dcm_EN.T @ _velocity_covariance(orbit, t_s, rate, dcm_HE) @ dcm_EN
    P[3:6, 3:6] = 0.5 * (P_vv + P_vv.T)
    common = dcm_HE.T @ np.diag(accuracy.sigma_common_H**2) @ dcm_HE
    beta = beta_from_dcm(dcm_OE @ dcm_EN)
    return PoseMekfParams(
        start_ns=start_ns,
        r_BN_N=dcm_EN.T @ r_E,
        v_BN_N=dcm_EN.T @ v_E,
        sigma_BN=beta[1:] / (1.0 + beta[0]),
        omega_BN_B=np.array([0.0, -rate, 0.0]),
        P=P,
        accel_noise=1e-6,
        gyro_timeout=0.0,
        rate_sigma=2e-5,
        rate_noise=2e-6,
        noise_scale=4.0,
        mount_mode=ESTIMATE,
        mount_sigma=_MOUNT,
        focal_mode=CONSIDER,
        focal_sigma=accuracy.sigma_focal_px / float(camera.focal_px[0]),
        center_mode=CONSIDER,
        center_sigma=accuracy.sigma_center_px,
        k1_mode=CONSIDER,
        k1_sigma=max(float(accuracy.sigma_distortion[0]), 1e-6),
        map_mode=CONSIDER,
        map_bias_P=0.5 * (common + common.T),
        time_mode=CONSIDER,
        time_sigma=max(sigma_time, 1e-3),
    )


def filter_track(
    landmarks: list[LandmarksMsg],
    first_E: F64,
    orbit: TleOrbit,
    camera: CameraConfigMsg,
    accuracy: CameraAccuracyMsg,
    sigma_time: float,
) -> Track:
    """Play landmarks through the filter in order of time.

    Args:
        landmarks: of the photos, exposures in simulation time of ``orbit`` with the clock's correction.
        first_E: fix of the first of them (3,) [m].
        orbit: the approximate orbit: velocity and rate at the start, and for comparison.
        camera: lens and mounting.
        accuracy: of them.
        sigma_time: standard deviation of an error that all times share [s].
    """
    marks = sorted(landmarks, key=lambda m: m.exposure_ns)
    zero_ns = (marks[0].exposure_ns // 10**9) * 10**9
    first_ns = marks[0].exposure_ns - zero_ns
    params = _params(first_E, marks[0].exposure_ns * 1e-9, first_ns, orbit, camera, accuracy, sigma_time)
    shifted = [msgspec.structs.replace(m, exposure_ns=m.exposure_ns - zero_ns) for m in marks]
    replay, mekf = _Replay("replay", shifted, camera), PoseMekf("pose_mekf", params)
    replay.out_landmarks.connect(mekf.in_landmarks)
    replay.out_camera.connect(mekf.in_camera)
    replay.out_orientation.connect(mekf.in_orientation)
    simulation = Simulation([Task("track", period=s(1), modules=[replay, mekf])])
    estimates, nuisance = mekf.out_filter.record(), mekf.out_nuisance.record()
    simulation.run_until((shifted[-1].exposure_ns // 10**9 + 2) * 10**9)
    return _collect(estimates.rows(), nuisance.rows(), orbit, zero_ns, [m.exposure_ns * 1e-9 for m in marks])


def _collect(rows: Any, nuisance: Any, orbit: TleOrbit, zero_ns: int, photos: list[float]) -> Track:
    points: list[TrackPoint] = []
    for row in rows:
        if row["images"] == 0:
            continue
        t_ns = int(row["estimate_ns"])
        t_s, dcm_EN = (t_ns + zero_ns) * 1e-9, _spin(t_ns)
        r_orbit, _, dcm_HE = orbit.frames(t_s)
        r, to_H = dcm_EN @ row["r_BN_N"], dcm_HE @ dcm_EN
        P_H = to_H @ row["P"][:3, :3] @ to_H.T
        points.append(TrackPoint(t_s=t_s, r_BE_E=r, error_H=dcm_HE @ (r - r_orbit), P_H=P_H, images=int(row["images"])))
    last = nuisance[-1]
    pairs = ("mount_C", "mount"), ("focal", "focal"), ("center_px", "center_px"), ("k1", "k1"), ("time_s", "time")
    found = {name: (np.array(last[name]), np.array(last[f"sigma_{short}"])) for name, short in pairs}
    return Track(points=points, photos=photos, used=int(rows[-1]["images"]), nuisance=found)
