"""A camera for disks with its sources, for its tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from fsw import Module, Out
from fsw.math.attitude import dcm_to_mrp
from fsw.math.compiled import COMPILE, plain
from fsw.math.vectors import mat3
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.opnav import CameraConfigMsg
from messages.states import SCStatesMsg
from sim.camera.disk_camera import DiskBody, DiskCamera, disk_body

SIZE = 160 if COMPILE else 40


def config(size: int = SIZE, focal: float = 500.0, **changes: Any) -> CameraConfigMsg:
    middle = (size - 1) / 2.0
    given: dict[str, Any] = {"width_px": size, "height_px": size, "focal_px": [focal, focal]}
    given |= {"center_px": [middle, middle], **changes}
    return CameraConfigMsg(**given)


class Source(Module):
    """Feeds the camera with what the test says."""

    out_state = Out(SCStatesMsg)
    out_sun = Out(EphemerisMsg)
    out_orientation = Out(PlanetOrientationMsg)
    out_moon = Out(EphemerisMsg)

    def step(self, t_ns: int) -> None:
        """What the test wrote stays."""


def ephemeris(body_id: int, r: Any, v: Any = (0.0, 0.0, 0.0)) -> EphemerisMsg:
    return EphemerisMsg(body_id=body_id, mu=1.0, radius=1.0, r_PN_N=np.array(r, float), v_PN_N=np.array(v, float))


def state(r: Any, dcm_BN: F64 | None = None) -> SCStatesMsg:
    matrix = plain(mat3)(np.eye(3) if dcm_BN is None else dcm_BN)
    given = {"r_BN_N": np.array(r, float), "sigma_BN": np.array(plain(dcm_to_mrp)(matrix))}
    return SCStatesMsg(v_BN_N=np.zeros(3), omega_BN_B=np.zeros(3), omegaDot_BN_B=np.zeros(3), **given)


MARS = 3396.19e3


class Rig:
    """A camera with its sources; 20,000 km from Mars on the negative z axis, which looks at it with the identity."""

    def __init__(
        self, bodies: list[DiskBody] | None = None, stars: Any = None, moon: bool = False, **params: Any
    ) -> None:
        camera = params.pop("camera", None) or config(size=64, focal=100.0)
        self.source = Source("source")
        given = [disk_body("Mars")] if bodies is None else bodies
        self.camera = DiskCamera("eye", DiskCamera.Params(center_id=499, **params), camera, given, stars)
        self.source.out_state.connect(self.camera.in_state)
        self.source.out_sun.connect(self.camera.in_sun)
        if moon:
            self.source.out_moon.connect(self.camera.in_body_1)

    def picture(self, t_ns: int = 0, r: Any = (0.0, 0.0, -20e6), sun: Any = (0.0, 0.0, -2e11), **more: Any) -> Any:
        self.source.out_state.write(state(r, more.get("dcm_BN")), t_ns)
        self.source.out_sun.write(ephemeris(10, sun), t_ns)
        if "moon" in more:
            self.source.out_moon.write(more["moon"], t_ns)
        self.camera.step(t_ns)
        return self.camera.out_image.latest()
