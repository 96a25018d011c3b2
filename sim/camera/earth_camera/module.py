"""EarthCamera: a camera in orbit that takes pictures of the Earth."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fsw import In, Module, Out
from fsw.imaging.maps import GeoMap
from fsw.math.attitude import mrp_to_dcm
from fsw.math.vectors import vec3
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, CameraImageMsg
from messages.states import SCStatesMsg
from sim.camera.detector import expose
from sim.camera.earth_camera.params import EarthCameraParams
from sim.camera.earth_camera.pose import Motion, Pose, turned
from sim.camera.earth_camera.renderer import EarthRenderer

SMEAR_PX = 0.7
"""Motion between sub-exposures."""
MAX_EXPOSURES = 16
"""Most sub-exposures of a picture."""


class EarthCamera(Module):
    """Draws the Earth from maps, as a detector sees it. See SPEC.md."""

    Params = EarthCameraParams
    shared = ("renderer", "camera")
    in_state = In(SCStatesMsg)
    in_orientation = In(PlanetOrientationMsg)
    in_sun = In(EphemerisMsg)
    out_image = Out(CameraImageMsg)
    out_camera = Out(CameraConfigMsg)

    def __init__(
        self, name: str, camera: CameraConfigMsg, maps: GeoMap, params: EarthCameraParams | None = None
    ) -> None:
        """Make a camera.

        Args:
            name: of the module.
            camera: size, lens and mounting.
            maps: pictures of the ground and heights, from `GeoMap.open`.
            params: see SPEC.md.
        """
        super().__init__(name, params)
        self.camera = camera
        self.renderer = EarthRenderer(camera, maps, self.params)
        self._stream = np.arange(1, 5, dtype=np.uint64)

    def seed(self, stream: Callable[[str], NDArray[np.uint64]]) -> None:
        """Noise of the detector has its own stream."""
        self._stream = stream("noise").copy()

    def step(self, t_ns: int) -> None:
        """Take a picture; its middle row is exposed around this time.

        Raises:
            ValueError: if the camera is inside the Earth.
            MapError: if a map file cannot be read.
        """
        state, orientation, sun = self.in_state.latest(), self.in_orientation.latest(), self.in_sun.latest()
        if state is None or orientation is None or sun is None:
            return
        since = [(t_ns - (port.t_ns or 0)) / 1e9 for port in (self.in_state, self.in_orientation)]
        motion = motion_at(state, orientation, since[0], since[1])
        sun_E = motion.dcm_EN @ (sun.r_PN_N - motion.r_BN_N)
        radiance = self.renderer.render(self.exposures(motion), sun_E).radiance
        if not self.params.colour:
            radiance = radiance @ np.array([0.299, 0.587, 0.114], np.float32)  # luma of ITU-R BT.601
        image = expose(radiance, self.params, self._stream)
        self.out_image.write(CameraImageMsg(image=image, exposure_ns=t_ns, label=self.name), t_ns)
        self.out_camera.write(self.camera, t_ns)

    def exposures(self, motion: Motion) -> list[Pose]:
        """The poses of a picture: one, or several that share the exposure time evenly if the picture moves."""
        rows, p = self.camera.height_px, self.params
        shutter = (np.arange(rows) - 0.5 * (rows - 1)) * p.row_time if p.row_time > 0.0 else np.zeros(1)
        mounting = self.camera.dcm_CB, p.r_CB_B
        if p.smear_time == 0.0:
            return [motion.after(shutter, *mounting)]
        ends = [motion.after(np.array([t]), *mounting) for t in (-0.5 * p.smear_time, 0.5 * p.smear_time)]
        moved = self.renderer.motion_px(ends[0], ends[1])
        count = min(max(math.ceil(moved / SMEAR_PX), 1), MAX_EXPOSURES)
        times = ((np.arange(count) + 0.5) / count - 0.5) * p.smear_time
        return [motion.after(shutter + t, *mounting) for t in times]


def motion_at(state: SCStatesMsg, orientation: PlanetOrientationMsg, age_s: float, turned_s: float) -> Motion:
    """The motion at an instant, from messages that are older by these times [s]."""
    one = np.zeros(1)
    dcm_BN = np.array(mrp_to_dcm(vec3(state.sigma_BN)))
    then = Motion(state.r_BN_N, state.v_BN_N, dcm_BN, state.omega_BN_B, orientation.dcm_EN, orientation.omega_EN_N)
    if age_s == 0.0 and turned_s == 0.0:
        return then
    return then._replace(
        r_BN_N=state.r_BN_N + age_s * state.v_BN_N,
        dcm_BN=(turned(state.omega_BN_B, one + age_s) @ dcm_BN)[0],
        dcm_EN=(orientation.dcm_EN @ turned(orientation.omega_EN_N, one + turned_s))[0],
    )
