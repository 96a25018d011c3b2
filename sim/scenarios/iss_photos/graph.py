"""The graph of modules, and the rounds in which the photos go through it."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from fsw import Recording, Simulation, Task, s
from messages.opnav import LandmarksMsg, PoseFixMsg
from modules.estimation.orbit_mount_estimator import OrbitMountEstimator
from modules.estimation.orbit_pose_prior import OrbitPosePrior, TleOrbit
from modules.estimation.pose_from_landmarks import FixStatus, PoseFromLandmarks
from modules.opnav.landmark_finder import LandmarkFinder
from sim.camera.photo_player import PhotoPlayer
from sim.scenarios.iss_photos.inputs import Inputs

LOWEST_M, HIGHEST_M = 330e3, 480e3
"""Where the station has been since 2005 (ellipsoidal height), with a margin."""


class Run(msgspec.Struct, kw_only=True):
    """A graph that is ready to play photos: one photo is one step of one second of processing time."""

    player: PhotoPlayer
    prior: OrbitPosePrior
    estimator: OrbitMountEstimator
    simulation: Simulation
    fixes: Recording[PoseFixMsg]
    landmarks: Recording[LandmarksMsg]

    def round(
        self, indices: list[int], tick: Callable[[], None], attempt: int = 0, *, calibrate: bool = False
    ) -> dict[int, FixStatus]:
        """Play photos once.

        Args:
            indices: of the photos. tick: called after each photo.
            attempt: 0 as predicted, 1 with little trust in the orbit.
            calibrate: estimate lens, mounting and clock at the end.

        Returns:
            How each photo did, by index.
        """
        self.player.queue(indices, attempt, calibrate=calibrate)
        done: dict[int, FixStatus] = {}
        for i in indices:
            self.simulation.step()
            tick()
            fix = self.fixes.port.latest()
            known = fix is not None and fix.exposure_ns == self.player.photos[i].exposure_ns
            done[i] = FixStatus(fix.status) if known and fix is not None else FixStatus.NO_LANDMARKS
        return done


def build(inputs: Inputs, orbit: TleOrbit | None = None, sigma_shift_m: float = 0.0) -> Run:
    """Wire player, predictor, finder, pose and estimator.

    Args:
        inputs: checked inputs; with an accuracy, nothing is calibrated.
        orbit: another approximate orbit than that of the inputs.
        sigma_shift_m: standard deviation of a suspected shift of the orbit, m.
    """
    orbit = inputs.orbit if orbit is None else orbit
    player = PhotoPlayer("photo_player", inputs.played)
    prior_params = OrbitPosePrior.Params(sigma_shift=sigma_shift_m)
    prior = OrbitPosePrior("orbit_pose_prior", orbit, inputs.camera, inputs.accuracy, prior_params)
    finder = LandmarkFinder("landmark_finder", geo_map=inputs.geo_map)
    pose_params = PoseFromLandmarks.Params(min_altitude=LOWEST_M, max_altitude=HIGHEST_M)
    pose = PoseFromLandmarks("pose_from_landmarks", pose_params)
    estimator = OrbitMountEstimator("orbit_mount_estimator", orbit, inputs.camera, inputs.accuracy)
    player.out_time.connect(prior.in_time)
    player.out_time.connect(estimator.in_time)
    player.out_image.connect(finder.in_image)
    prior.out_camera.connect(finder.in_camera)
    prior.out_camera.connect(pose.in_camera)
    prior.out_prior.connect(finder.in_prior)
    prior.out_prior.connect(pose.in_prior)
    finder.out_landmarks.connect(pose.in_landmarks)
    finder.out_landmarks.connect(estimator.in_landmarks)
    pose.out_fix.connect(estimator.in_fix)
    estimator.out_camera.connect(prior.in_camera, delayed=True)
    estimator.out_accuracy.connect(prior.in_accuracy, delayed=True)
    estimator.out_clock.connect(prior.in_clock, delayed=True)
    task = Task("photos", period=s(1), modules=[player, prior, finder, pose, estimator])
    return Run(
        player=player,
        prior=prior,
        estimator=estimator,
        simulation=Simulation([task]),
        fixes=pose.out_fix.record(),
        landmarks=finder.out_landmarks.record(),
    )
