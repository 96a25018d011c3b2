"""Predicts where the camera is when a photo is taken."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fsw import Bound, In, Module, Out, Record
from messages.opnav import CameraConfigMsg, PosePriorMsg
from messages.orbit import CameraAccuracyMsg, OrbitClockMsg, PhotoTimeMsg
from modules.estimation.orbit_pose_prior.kernel import corrected_time_s, prior_covariance
from modules.estimation.orbit_pose_prior.orbit import TleOrbit
from modules.estimation.rotations import beta_from_dcm

_WIDE_H_M = np.array([8e3, 15e3, 15e3])
_WIDE_RAD = np.full(3, 0.012)
_LOST_H_M = np.full(3, 30e3)
_LOST_RAD = np.array([0.3, 0.3, np.pi])


class OrbitPosePrior(Module):
    """Approximate orbit, shutter clock and mounting give the predicted pose of the camera. See SPEC.md."""

    class Params(Record):
        """Additions to what orbit and calibration say of their own accuracy."""

        sigma_attitude: Annotated[float, "rad", "standard deviation of the station's attitude", Bound(gt=0)] = 2e-3
        sigma_shift: Annotated[float, "m", "standard deviation of a suspected shift of the orbit", Bound(ge=0)] = 0.0

    shared = ("orbit", "camera", "accuracy")
    in_time = In(PhotoTimeMsg)
    in_camera = In(CameraConfigMsg, optional=True)
    in_accuracy = In(CameraAccuracyMsg, optional=True)
    in_clock = In(OrbitClockMsg, optional=True)
    out_prior = Out(PosePriorMsg)
    out_camera = Out(CameraConfigMsg)

    def __init__(
        self,
        name: str,
        orbit: TleOrbit,
        camera: CameraConfigMsg,
        accuracy: CameraAccuracyMsg | None = None,
        params: OrbitPosePrior.Params | None = None,
    ) -> None:
        """Take the approximate orbit, and the camera to begin with.

        Args:
            name: unique name. orbit: the approximate orbit. camera: lens and mounting until better ones arrive.
            accuracy: of that camera; None says that its mounting is unknown. params: see Params.
        """
        super().__init__(name, params)
        self.orbit, self.camera, self.accuracy = orbit, camera, accuracy

    def step(self, t_ns: int) -> None:
        """Write prior and camera for a new photo."""
        time = self.in_time.take()
        if time is None:
            return
        camera = self.in_camera.latest() or self.camera
        accuracy = self.in_accuracy.latest() or self.accuracy
        t_s = corrected_time_s(time.exposure_ns, self.in_clock.latest())
        r_CE_E, dcm_OE, dcm_HE = self.orbit.frames(t_s)
        sigma_H = np.hypot(self.orbit.sigma_H(t_s), self.params.sigma_shift)
        sigma_H[1] = np.hypot(sigma_H[1], np.linalg.norm(self.orbit.velocity_earth(t_s)) * time.sigma_s)
        if accuracy is None:
            dcm_CO, sigma_H, sigma_C = np.eye(3), np.maximum(sigma_H, _LOST_H_M), _LOST_RAD
        else:
            dcm_CO = camera.dcm_CB
            sigma_C = np.hypot(accuracy.sigma_mounting, self.params.sigma_attitude)
            if time.attempt:
                sigma_H, sigma_C = np.maximum(sigma_H, _WIDE_H_M), np.maximum(sigma_C, _WIDE_RAD)
        prior = PosePriorMsg(
            exposure_ns=time.exposure_ns,
            r_CE_E=r_CE_E,
            beta_CE=beta_from_dcm(dcm_CO @ dcm_OE),
            P_pose=prior_covariance(dcm_HE, sigma_H, sigma_C),
        )
        self.out_prior.write(prior, t_ns)
        self.out_camera.write(camera, t_ns)
