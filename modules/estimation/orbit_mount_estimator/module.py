"""Estimates lens, mounting, shutter clock and track from the landmarks of many photos."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from fsw import Bound, In, Module, Out, Record
from fsw.math.camera import lens_vector
from messages.base import F64
from messages.opnav import CameraConfigMsg, LandmarksMsg, PoseFixMsg
from messages.orbit import CameraAccuracyMsg, OrbitClockMsg, PhotoTimeMsg
from modules.estimation.orbit_mount_estimator.adjust import CLOCK, Adjustment, PhotoData, adjust, start
from modules.estimation.orbit_mount_estimator.solve import (
    Weights,
    accuracy_message,
    arc_priors,
    camera_message,
    clock_line,
    clock_message,
    held_priors,
    within_stamps,
)
from modules.estimation.orbit_pose_prior.orbit import TleOrbit
from modules.estimation.rotations import dcm_from_beta, mean_dcm


class Seen(msgspec.Struct, frozen=True, kw_only=True):
    """The newest look at one photo that gave a valid fix."""

    time: PhotoTimeMsg
    data: PhotoData
    dcm_CE: F64


class OrbitMountEstimator(Module):
    """Calibrates lens, mounting and shutter with positions held to the orbit, then fits the track. See SPEC.md."""

    class Params(Record):
        """What is known before, and how much of it is estimated."""

        sigma_focal: Annotated[float, "-", "of the focal length at the start, relative", Bound(gt=0)] = 0.05
        sigma_center: Annotated[float, "px", "of the principal point at the start", Bound(gt=0)] = 30.0
        sigma_radial: Annotated[float, "-", "of k1 and k2 at the start", Bound(gt=0)] = 0.3
        sigma_tangential: Annotated[float, "-", "of p1 and p2", Bound(gt=0)] = 2e-3
        sigma_attitude: Annotated[float, "rad", "of a photo's attitude about the mounting", Bound(gt=0)] = 9e-4
        sigma_rate: Annotated[float, "m/s", "of the rate of the along-track offset", Bound(gt=0)] = 1.0
        sigma_shutter: Annotated[float, "s", "of one exposure about an even cadence", Bound(gt=0)] = 0.01
        inflation: Annotated[float, "-", "factor on the landmarks' sigma: neighbours share errors", Bound(ge=1)] = 4.0

    shared = ("orbit", "camera", "accuracy")
    in_time = In(PhotoTimeMsg)
    in_landmarks = In(LandmarksMsg)
    in_fix = In(PoseFixMsg)
    out_camera = Out(CameraConfigMsg)
    out_accuracy = Out(CameraAccuracyMsg)
    out_clock = Out(OrbitClockMsg)

    def __init__(
        self,
        name: str,
        orbit: TleOrbit,
        camera: CameraConfigMsg,
        accuracy: CameraAccuracyMsg | None = None,
        params: OrbitMountEstimator.Params | None = None,
    ) -> None:
        """Take the approximate orbit and the camera to begin with.

        Args:
            name: unique name. orbit: the approximate orbit, to which positions are held in the calibration.
            camera: the lens at the start, and the mounting if it is known. accuracy: of an earlier calibration.
                Until there is one, or one is made, tracks are not estimated.
            params: see Params.
        """
        super().__init__(name, params)
        self.orbit, self.camera, self.accuracy = orbit, camera, accuracy
        self._seen: dict[int, Seen] = {}
        self._calibrated = accuracy is not None
        self._lens = lens_vector(camera)
        self._dcm_CO: F64 = np.array(camera.dcm_CB)
        self._clock_P = np.zeros((2, 2))

    def step(self, t_ns: int) -> None:
        """Keep the newest landmarks of a photo; at the end of a round, estimate."""
        time, landmarks, fix = self.in_time.take(), self.in_landmarks.take(), self.in_fix.take()
        if time is None:
            return
        if landmarks is not None and fix is not None:
            same = time.exposure_ns == landmarks.exposure_ns == fix.exposure_ns
            if same and fix.valid:
                self._keep(time, landmarks, fix)
        if time.last and self._seen and (time.calibrate or self._calibrated):
            self._estimate(t_ns, time.calibrate)

    def _keep(self, time: PhotoTimeMsg, landmarks: LandmarksMsg, fix: PoseFixMsg) -> None:
        n = landmarks.count
        data = PhotoData(
            exposure_s=time.exposure_ns * 1e-9,
            r_LE_E=np.array(landmarks.r_LE_E[:n]),
            pixel_px=np.array(landmarks.pixel_px[:n]),
            sigma_px=np.array(landmarks.sigma_px[:n]),
        )
        self._seen[time.exposure_ns] = Seen(time=time, data=data, dcm_CE=dcm_from_beta(fix.beta_CE))

    def _estimate(self, t_ns: int, calibrate: bool) -> None:
        seen = [self._seen[key] for key in sorted(self._seen)]
        times, photos = [s.time for s in seen], [s.data for s in seen]
        reference_ns = (times[0].exposure_ns + times[-1].exposure_ns) // 2
        weights = Weights.of(self.params, self.orbit, reference_ns * 1e-9, float(self.camera.focal_px[0]))
        if calibrate:
            self._dcm_CO = mean_dcm([x.dcm_CE @ self.orbit.frames(x.data.exposure_s)[1].T for x in seen])
            state = self._calibrate(times, photos, reference_ns, weights)
            self._lens, self._dcm_CO, self._calibrated = state.lens, state.dcm_CO, True
            self.out_camera.write(camera_message(state, self.camera), t_ns)
            self.out_accuracy.write(accuracy_message(state, weights), t_ns)
            self._clock_P = state.P[CLOCK, CLOCK]
            self.out_clock.write(clock_message(state, weights, reference_ns, self._clock_P), t_ns)
            return
        clock = self._clock_at(reference_ns)
        state = start(self._lens, self._dcm_CO, len(photos), clock)
        state = adjust(state, photos, self.orbit, reference_ns * 1e-9, arc_priors(weights, times, clock))
        self.out_clock.write(clock_message(state, weights, reference_ns, self._clock_P), t_ns)

    def _calibrate(
        self, times: list[PhotoTimeMsg], photos: list[PhotoData], reference_ns: int, weights: Weights
    ) -> Adjustment:
        """Adjust with positions held; if the clock leaves the stamps, once more with it held at their edge."""
        line = clock_line(times, reference_ns)
        state = self._adjusted(times, photos, reference_ns, weights, line)
        clock = within_stamps(times, reference_ns, line[0], state.common[CLOCK])
        if np.array_equal(clock, state.common[CLOCK]):
            return state
        return self._adjusted(times, photos, reference_ns, weights, (clock, np.zeros((2, 2))))

    def _adjusted(
        self,
        times: list[PhotoTimeMsg],
        photos: list[PhotoData],
        reference_ns: int,
        weights: Weights,
        line: tuple[F64, F64],
    ) -> Adjustment:
        state = start(lens_vector(self.camera), self._dcm_CO, len(photos), line[0])
        return adjust(state, photos, self.orbit, reference_ns * 1e-9, held_priors(weights, times, line))

    def _clock_at(self, reference_ns: int) -> F64:
        """The clock's correction and rate as estimated before, at another reference."""
        known = self.out_clock.latest()
        if known is None:
            return np.zeros(2)
        since = (reference_ns - known.reference_ns) * 1e-9
        return np.array([known.clock_s + known.clock_rate * since, known.clock_rate])
