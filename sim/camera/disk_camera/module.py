"""DiskCamera: pictures of planets, moons and stars."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from fsw import Bound, In, Module, Out
from fsw.math.attitude import mrp_to_dcm, rotvec_to_dcm
from fsw.math.camera import channel_lens, lens_vector
from fsw.math.compiled import plain
from fsw.math.stars import StarCatalogue
from fsw.streams import stream_words
from messages.base import F64, U64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, CameraImageMsg
from messages.states import SCStatesMsg
from sim.camera.detector import DetectorParams, expose
from sim.camera.disk_camera.scene import NO_EDGES, DiskBody, DiskTruth, Seen, Sight, Textures, behind_optics, truth


class DiskCamera(Module):
    """A camera that sees whole disks. See SPEC.md."""

    class Params(DetectorParams):
        """Parameters."""

        center_id: Annotated[int, "-", "NAIF identifier of the central body, the origin of N"]
        colour: Annotated[bool, "-", "colour image, each colour with its own lens; else grey"] = False
        star_light: Annotated[float, "px^2", "light of a star of magnitude 0; 0 for no stars", Bound(ge=0)] = 0.0
        faintest: Annotated[float, "-", "magnitude of the faintest star drawn"] = 6.0

    params: Params
    shared = ("camera", "bodies", "_stars", "_sights", "_textures")
    in_state = In(SCStatesMsg)
    in_sun = In(EphemerisMsg)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    in_body_1 = In(EphemerisMsg, optional=True)
    in_body_2 = In(EphemerisMsg, optional=True)
    in_body_3 = In(EphemerisMsg, optional=True)
    out_image = Out(CameraImageMsg)
    out_camera = Out(CameraConfigMsg)

    def __init__(
        self,
        name: str,
        params: Params,
        camera: CameraConfigMsg,
        bodies: Sequence[DiskBody],
        stars: StarCatalogue | None = None,
    ) -> None:
        """Make a camera; the directions of its pixels are computed here, once.

        Args:
            name: unique name.
            params: see `Params`.
            camera: lens, size of the image, mounting.
            bodies: the central body, and every body that a port brings.
            stars: a catalogue, if stars are wanted.

        Raises:
            ValueError: if a body is there twice, the central one is missing, or stars are wanted without a catalogue.
        """
        super().__init__(name, params)
        self.camera, self.bodies = camera, {b.body_id: b for b in bodies}
        if len(self.bodies) != len(bodies):
            raise ValueError(f"DiskCamera {name!r}: bodies: expected each body once, got {[b.body_id for b in bodies]}")
        self._body(params.center_id, "center_id")
        if params.star_light > 0.0 and stars is None:
            raise ValueError(f"DiskCamera {name!r}: star_light is {params.star_light}, but no catalogue is given")
        self._stars = None if stars is None or params.star_light == 0.0 else stars.brighter_than(params.faintest)
        lenses = [channel_lens(camera, k) for k in range(3)] if params.colour else [lens_vector(camera)]
        self._sights = [Sight(lens, camera.height_px, camera.width_px) for lens in lenses]
        self._textures = Textures(bodies)
        self._noise: U64 = stream_words(0, name, "noise")
        self._seen: list[Seen] = []

    def seed(self, stream: Callable[[str], NDArray[np.uint64]]) -> None:
        """Start the noise of the detector."""
        self._noise = stream("noise").copy()

    def step(self, t_ns: int) -> None:
        """Take a picture of the newest state; none before the first state and the first Sun."""
        state, sun, source = self.in_state.latest(), self.in_sun.latest(), self.in_state.source
        if state is None or sun is None or source is None:
            return
        exposure_ns = source.t_ns
        dcm_CN = self.camera.dcm_CB @ np.array(plain(mrp_to_dcm)(tuple(state.sigma_BN.tolist())))
        self._seen = self._scene(exposure_ns, state.r_BN_N, dcm_CN, sun.r_PN_N)
        planes = [self._plane(k, sight, dcm_CN) for k, sight in enumerate(self._sights)]
        radiance = np.stack(planes, axis=-1) if self.params.colour else planes[0]
        image = expose(radiance, self.params, self._noise, blurred_already=True)
        self.out_image.write(CameraImageMsg(image=image, exposure_ns=exposure_ns, label=self.name), t_ns)
        self.out_camera.write(self.camera, t_ns)

    def truths(self, points: int = 360) -> list[DiskTruth]:
        """Where the bodies really are in the newest picture, the farthest first; of green, if it is in colour."""
        sight = self._sights[len(self._sights) // 2]
        return [truth(sight.lens, seen, points) for seen in self._seen]

    def _body(self, body_id: int, where: str) -> DiskBody:
        if body_id not in self.bodies:
            known = ", ".join(str(i) for i in self.bodies) or "none"
            text = f"body {body_id} is none of those given ({known}); add a DiskBody for it"
            raise ValueError(f"DiskCamera {self.name!r}: {where}: {text}")
        return self.bodies[body_id]

    def _scene(self, t_ns: int, r_BN_N: F64, dcm_CN: F64, r_SN_N: F64) -> list[Seen]:
        """All bodies in the camera's frame, the farthest first."""
        center = self._body(self.params.center_id, "center_id")
        where = [(center, np.zeros(3), self._attitude(center, t_ns))]
        for port in (self.in_body_1, self.in_body_2, self.in_body_3):
            if (message := port.latest()) is not None and port.source is not None:
                body, age = self._body(message.body_id, port.name), (t_ns - port.source.t_ns) / 1e9
                where.append((body, message.r_PN_N + age * message.v_PN_N, body.attitude(t_ns)))
        seen: list[Seen] = []
        for body, r_PN_N, dcm_PN in where:
            sun = dcm_CN @ (r_SN_N - r_PN_N)
            r_PC_C = dcm_CN @ (r_PN_N - r_BN_N)
            seen.append(Seen(body, r_PC_C, dcm_CN @ dcm_PN.T, sun / np.linalg.norm(sun)))
        return sorted(seen, key=lambda s: -float(np.linalg.norm(s.r_PC_C)))

    def _attitude(self, center: DiskBody, t_ns: int) -> F64:
        """dcm_PN of the central body: from the port if it is fed, turned on to ``t_ns``."""
        turn, source = self.in_orientation.latest(), self.in_orientation.source
        if turn is None or source is None:
            return center.attitude(t_ns)
        age = (t_ns - source.t_ns) / 1e9
        x, y, z = (age * (turn.dcm_EN @ turn.omega_EN_N)).tolist()
        return np.array(plain(rotvec_to_dcm)((x, y, z))) @ turn.dcm_EN

    def _plane(self, channel: int, sight: Sight, dcm_CN: F64) -> NDArray[np.float32]:
        """Radiance of one colour, or of grey, behind the optics."""
        blur = self.params.psf_sigma_px
        edges = sight.edges() if blur > 0.0 else NO_EDGES
        out = np.zeros((self.camera.height_px, self.camera.width_px), np.float32)
        if self._stars is not None:
            light = self.params.star_light * 10.0 ** (-0.4 * self._stars.magnitude)
            sight.draw_stars(self._stars.u_N @ dcm_CN.T, light, out)
        for seen in self._seen:
            factor = seen.body.colour[channel] if self.params.colour else 1.0
            sight.draw(seen, seen.body.albedo * factor, self._textures, out, edges)
        return behind_optics(out, edges, blur) if blur > 0.0 else out
