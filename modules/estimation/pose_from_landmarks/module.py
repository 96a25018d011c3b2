"""The module: one fix per set of landmarks."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import Bound, In, Module, Out, Record
from fsw.math.camera import lens_vector
from fsw.math.resection import Resection, attitude_from_rays, fit_pose, shared_covariance
from messages.base import F64
from messages.opnav import CameraConfigMsg, LandmarksMsg, PoseFixMsg, PosePriorMsg
from modules.estimation.pose_from_landmarks.kernel import (
    Limits,
    Quality,
    check,
    height_of,
    largest_sigma,
    prior_distance,
    rms_length,
)
from modules.estimation.pose_from_landmarks.status import FixStatus
from modules.estimation.rotations import beta_from_dcm, dcm_from_beta
from modules.opnav.cells import cell_of

Solved = tuple[FixStatus, Resection | None, Quality | None, F64 | None]


class PoseFromLandmarks(Module):
    """Position and attitude of a camera from landmarks, or a reason why there is none. See SPEC.md."""

    class Params(Record):
        """Limits of the checks, and what widens the covariance."""

        reject: Annotated[float, "-", "landmarks beyond this many robust sigma do not count", Bound(gt=1)] = 3.0
        shared_px: Annotated[float, "px", "sigma of the error that neighbouring landmarks share", Bound(ge=0)] = 0.6
        min_inliers: Annotated[int, "-", "fewest landmarks used", Bound(ge=6)] = 100
        min_share: Annotated[float, "-", "least share of the candidates used", Bound(ge=0, le=1)] = 0.5
        min_cells: Annotated[int, "-", "fewest of the 24 cells of the image in use", Bound(ge=1, le=24)] = 10
        max_rms_px: Annotated[float, "px", "greatest rms residual, two-dimensional", Bound(gt=0)] = 2.5
        min_altitude: Annotated[float, "m", "least height above the ellipsoid"] = 150e3
        max_altitude: Annotated[float, "m", "greatest height above the ellipsoid"] = 2000e3
        max_sigma: Annotated[float, "m", "greatest sigma of the position, any direction", Bound(gt=0)] = 5000.0
        prior_gate_sigma: Annotated[float, "-", "greatest distance from the prior, 0 for any", Bound(ge=0)] = 6.0

    params: Params
    in_landmarks = In(LandmarksMsg)
    in_camera = In(CameraConfigMsg)
    in_prior = In(PosePriorMsg)
    out_fix = Out(PoseFixMsg)

    def step(self, t_ns: int) -> None:
        """Write one fix for each new set of landmarks."""
        marks = self.in_landmarks.take()
        if marks is not None:
            self.out_fix.write(self._message(marks, *self._solve(marks)), t_ns)

    def _solve(self, marks: LandmarksMsg) -> Solved:
        camera, prior = self.in_camera.latest(), self.in_prior.latest()
        if marks.count == 0:
            return FixStatus.NO_LANDMARKS, None, None, None
        if camera is None or prior is None or prior.exposure_ns != marks.exposure_ns:
            return FixStatus.NO_PRIOR, None, None, None
        n, lens = marks.count, lens_vector(camera)
        ground, pixel, sigma = marks.r_LE_E[:n], marks.pixel_px[:n], marks.sigma_px[:n]
        # Only the prior's position is used as a start: its attitude may be as good as unknown
        start = attitude_from_rays(lens, ground, pixel, prior.r_CE_E)
        fit = fit_pose(lens, ground, pixel, sigma, prior.r_CE_E, start, self.params.reject)
        if fit is None:
            return FixStatus.NO_SOLUTION, None, None, None
        used, size = fit.inlier, (camera.height_px, camera.width_px)
        group = cell_of(pixel[used], size)
        shared = shared_covariance(lens, ground[used], sigma[used], group, fit.r_CE_E, fit.dcm_CE)
        P_pose = fit.P_pose + self.params.shared_px**2 * shared
        quality = Quality(
            inliers=int(used.sum()),
            candidates=marks.candidates,
            cells=len(np.unique(group)),
            rms_px=rms_length(fit.residual_px[used]),
            altitude=height_of(fit.r_CE_E),
            sigma=largest_sigma(P_pose[:3, :3]),
            distance=prior_distance(
                fit.r_CE_E, fit.dcm_CE, P_pose, prior.r_CE_E, dcm_from_beta(prior.beta_CE), prior.P_pose
            ),
        )
        limits = Limits(*(getattr(self.params, name) for name in Limits._fields))
        return check(quality, limits), fit, quality, P_pose

    @staticmethod
    def _message(
        marks: LandmarksMsg, status: FixStatus, fit: Resection | None, quality: Quality | None, P_pose: F64 | None
    ) -> PoseFixMsg:
        if fit is None or quality is None or P_pose is None:
            nan = np.full(3, np.nan)
            return PoseFixMsg(
                exposure_ns=marks.exposure_ns,
                valid=False,
                status=int(status),
                inliers=0,
                candidates=marks.candidates,
                cells=0,
                rms_px=np.nan,
                r_CE_E=nan,
                beta_CE=np.full(4, np.nan),
                P_pose=np.full((6, 6), np.nan),
            )
        return PoseFixMsg(
            exposure_ns=marks.exposure_ns,
            valid=status is FixStatus.VALID,
            status=int(status),
            inliers=quality.inliers,
            candidates=marks.candidates,
            cells=quality.cells,
            rms_px=quality.rms_px,
            r_CE_E=fit.r_CE_E,
            beta_CE=beta_from_dcm(fit.dcm_CE),
            P_pose=P_pose,
        )
