"""From recordings to results: one line for each photo, and what all of them say together."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from messages.base import F64
from messages.opnav import CameraConfigMsg
from messages.orbit import CameraAccuracyMsg, OrbitClockMsg
from modules.estimation.orbit_pose_prior import TleOrbit, corrected_time_s
from modules.estimation.pose_from_landmarks import STATUS_TEXT, FixStatus
from modules.estimation.rotations import beta_from_dcm, dcm_from_beta, mean_dcm, rotation_vector
from sim.camera.photo_player import Cadence
from sim.scenarios.iss_photos.graph import Run
from sim.scenarios.iss_photos.inputs import Inputs
from sim.scenarios.iss_photos.track import Track, filter_track, landmarks_at


class Fix(msgspec.Struct, kw_only=True):
    """The result of one photo; what is None is unknown because the photo gave no valid fix.

    Attributes:
        path, utc: of the photo. t_s: simulation time. valid, reason: whether it can be used, and why not.
        inliers: landmarks used. r_CE_E: position, (3,) m. dcm_CE, dcm_CO: attitude.
        error_H: fix minus orbit, (3,) m: radial, along, normal. sigma_H: (3,) of the photo alone; sigma_all_H with the
        part that all fixes share. landmarks: their pixels, (n, 2).
    """

    path: Path
    utc: datetime | None
    t_s: float | None = None
    valid: bool = False
    reason: str = ""
    inliers: int = 0
    r_CE_E: F64 | None = None
    dcm_CE: F64 | None = None
    dcm_CO: F64 | None = None
    error_H: F64 | None = None
    sigma_H: F64 | None = None
    sigma_all_H: F64 | None = None
    landmarks: F64 | None = None

    @property
    def sigma_pos_m(self) -> float | None:
        """Standard deviation of the position, three-dimensional, common part included, m."""
        return None if self.sigma_all_H is None else float(np.linalg.norm(self.sigma_all_H))

    @property
    def beta_CO(self) -> F64 | None:
        """Attitude of the camera relative to the orbit frame, Euler parameters, scalar first."""
        return None if self.dcm_CO is None else beta_from_dcm(self.dcm_CO)


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """All valid fixes together, relative to the approximate orbit; m and rad.

    Attributes:
        valid, photos: counts. mean_H, scatter_H, rms_H: (3,) radial, along track, normal. median, largest: 3-D.
        attitude: (3,) scatter about the camera's axes. wrong: fixes above 6 km and above 3 of their sigma.
    """

    valid: int
    photos: int
    mean_H: F64
    scatter_H: F64
    rms_H: F64
    median: float
    largest: float
    attitude: F64
    wrong: int


class Results(msgspec.Struct, frozen=True, kw_only=True):
    """Everything a run found out; ``track`` is of the filter of the whole pass."""

    fixes: list[Fix]
    summary: Summary | None
    track: Track | None
    camera: CameraConfigMsg
    accuracy: CameraAccuracyMsg | None
    clock: OrbitClockMsg | None
    calibrated_here: bool


def _newest(rows: Any) -> dict[int, Any]:
    """The last row of each photo."""
    return {int(row["exposure_ns"]): row for row in rows}


def _fill(fix: Fix, row: Any, seen: Any, orbit: TleOrbit, accuracy: CameraAccuracyMsg) -> None:
    """Take over a valid fix and compare it with the orbit."""
    assert fix.t_s is not None
    r_BE_E, dcm_OE, dcm_HE = orbit.frames(fix.t_s)
    fix.valid, fix.r_CE_E = True, np.array(row["r_CE_E"])
    fix.dcm_CE = dcm_from_beta(row["beta_CE"])
    fix.dcm_CO = fix.dcm_CE @ dcm_OE.T
    fix.error_H = dcm_HE @ (fix.r_CE_E - r_BE_E)
    fix.sigma_H = np.sqrt(np.diag(dcm_HE @ row["P_pose"][:3, :3] @ dcm_HE.T))
    fix.sigma_all_H = np.hypot(fix.sigma_H, accuracy.sigma_common_H)
    fix.landmarks = np.array(seen["pixel_px"][: int(seen["count"])])


def summarise(fixes: list[Fix]) -> Summary | None:
    """Mean, scatter and extremes of the valid fixes, or None if there is none."""
    good = [f for f in fixes if f.valid]
    if not good:
        return None
    error = np.array([f.error_H for f in good])
    length = np.linalg.norm(error, axis=1)
    middle = mean_dcm([f.dcm_CO for f in good if f.dcm_CO is not None])
    turns = np.array([rotation_vector(f.dcm_CO @ middle.T) for f in good if f.dcm_CO is not None])
    several = len(good) > 1
    sigma = np.array([f.sigma_pos_m for f in good])
    return Summary(
        valid=len(good),
        photos=len(fixes),
        mean_H=error.mean(axis=0),
        scatter_H=error.std(axis=0, ddof=1) if several else np.full(3, np.nan),
        rms_H=np.sqrt((error**2).mean(axis=0)),
        median=float(np.median(length)),
        largest=float(length.max()),
        attitude=turns.std(axis=0, ddof=1) if several else np.full(3, np.nan),
        wrong=int(np.sum((length > 6e3) & (length > 3.0 * sigma))),
    )


def _track(inputs: Inputs, run: Run, fixes: list[Fix], seen: dict[int, Any]) -> Track | None:
    """The landmarks of the valid fixes through the track filter, or None if there are none."""
    pairs = [(f, seen[p.exposure_ns]) for f, p in zip(fixes, inputs.played, strict=False) if f.valid]
    accuracy, clock = run.estimator.out_accuracy.latest() or inputs.accuracy, run.estimator.out_clock.latest()
    marks = [landmarks_at(row, round(f.t_s * 1e9)) for f, row in pairs if f.t_s is not None]
    first = min((f for f, _ in pairs if f.t_s is not None), key=lambda f: f.t_s or 0.0, default=None)
    if first is None or first.r_CE_E is None or accuracy is None:
        return None
    sigma_time = 0.0 if clock is None else float(np.sqrt(clock.P[4, 4]))
    camera = run.estimator.out_camera.latest() or inputs.camera
    return filter_track(marks, first.r_CE_E, run.prior.orbit, camera, accuracy, sigma_time)


def collect(inputs: Inputs, run: Run) -> Results:
    """Results of a finished run; ``accuracy`` is None if no photo gave a valid fix and nothing was known before."""
    camera = run.estimator.out_camera.latest() or inputs.camera
    accuracy = run.estimator.out_accuracy.latest() or inputs.accuracy
    clock = run.estimator.out_clock.latest()
    rows, seen = _newest(run.fixes.rows()), _newest(run.landmarks.rows())
    fixes: list[Fix] = []
    for played in inputs.played:
        t_s = corrected_time_s(played.exposure_ns, clock)
        fix = Fix(path=Path(played.path), utc=inputs.epoch + timedelta(seconds=t_s), t_s=t_s)
        row = rows.get(played.exposure_ns)
        if row is not None:
            fix.inliers = int(row["inliers"])
        if row is not None and row["valid"] and accuracy is not None:
            _fill(fix, row, seen[played.exposure_ns], run.prior.orbit, accuracy)
        else:
            fix.reason = "was not looked at" if row is None else STATUS_TEXT[FixStatus(int(row["status"]))]
        fixes.append(fix)
    track = _track(inputs, run, fixes, seen)
    fixes += [Fix(path=Path(path), utc=None, reason=reason) for path, reason in inputs.refused.items()]
    return Results(
        fixes=fixes,
        summary=summarise(fixes),
        track=track,
        camera=camera,
        accuracy=accuracy,
        clock=clock,
        calibrated_here=inputs.accuracy is None,
    )


def tuned_cadence(cadence: Cadence | None, clock: OrbitClockMsg | None) -> Cadence | None:
    """The shutter's cadence with the correction that the landmarks gave to it."""
    if cadence is None or clock is None or not clock.P[5, 5] > 0.0:
        return cadence
    return Cadence(cadence.period_s * (1.0 + clock.clock_rate), cadence.period_s * float(np.sqrt(clock.P[5, 5])))
