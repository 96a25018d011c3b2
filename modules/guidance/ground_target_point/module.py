"""GroundTargetPoint: reference attitude that looks at a place on the ground."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import Bound, In, KernelModule, Out, Record, Row, Vec3, publish
from fsw.math.attitude import dcm_to_mrp
from fsw.math.geodesy import ecef_from_geodetic
from fsw.math.gravity import MU_EARTH
from fsw.math.vectors import angle_between, cross, mat3, matmul, norm, scale, store3, transpose, vec3
from messages.attitude import AttRefMsg, TargetViewMsg
from messages.environment import PlanetOrientationMsg
from messages.states import NavTransMsg
from modules.guidance.ground_target_point.kernel import ahead, axes_of_body, difference, looking_frame, turned, up

X_B = np.array([1.0, 0.0, 0.0])
Z_B = np.array([0.0, 0.0, 1.0])
for _a in (X_B, Z_B):
    _a.setflags(write=False)


class GroundTargetPoint(KernelModule):
    """Points an axis of the body at a place on the WGS84 ellipsoid. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        lat: Annotated[
            float, "rad", "geodetic latitude of the place", Bound(ge=-1.5707963267948968, le=1.5707963267948968)
        ]
        lon: Annotated[float, "rad", "longitude of the place, east positive"]
        height: Annotated[float, "m", "height of the place above the ellipsoid", Bound(ge=-1e4, le=1e5)] = 0.0
        axis_B: Annotated[Vec3, "-", "axis to point, such as the boresight, any length, B components"] = Z_B
        beside_B: Annotated[Vec3, "-", "axis to hold along the orbit normal as near as can be, B components"] = X_B
        least_elevation: Annotated[
            float, "rad", "elevation from which the place counts as visible", Bound(ge=-1.5, lt=1.5707963267948966)
        ] = 0.0
        stop_below: Annotated[bool, "-", "stop the run while the place is not visible; else point nevertheless"] = True
        mu: Annotated[float, "m^3/s^2", "gravitational parameter of the planet", Bound(gt=0)] = MU_EARTH
        max_age: Annotated[float, "s", "largest age of position and orientation", Bound(gt=0)] = 60.0

        def __post_init__(self) -> None:
            """Check the axes too."""
            super().__post_init__()
            lengths = np.linalg.norm(self.axis_B), np.linalg.norm(self.beside_B)
            if not np.linalg.norm(np.cross(self.axis_B, self.beside_B)) > 0.01 * lengths[0] * lengths[1]:
                text = f"expected an axis that is not along axis_B, got {self.beside_B.tolist()}"
                raise ValueError(f"GroundTargetPoint.Params.beside_B: {text}")

    in_trans = In(NavTransMsg)
    in_orientation = In(PlanetOrientationMsg)
    out_ref = Out(AttRefMsg)
    out_view = Out(TargetViewMsg)

    @staticmethod
    def kernel(
        t_ns: int, params: Row, state: Row, in_trans: Row, in_orientation: Row, out_ref: Row, out_view: Row
    ) -> None:
        """Compute the reference now, from the newest position and orientation."""
        if in_trans.seq == 0 or in_orientation.seq == 0:
            return
        age, old = (t_ns - in_trans.t_ns) / 1e9, (t_ns - in_orientation.t_ns) / 1e9
        if age > params.max_age or old > params.max_age:
            return
        r, v = vec3(in_trans.r_BN_N), vec3(in_trans.v_BN_N)
        if not norm(cross(r, v)) > 1e-9 * norm(r) * norm(v):
            raise ValueError("in_trans: position and velocity are parallel, zero or NaN: there is no orbital plane")
        r, v = ahead(r, v, params.mu, age)
        place_E = ecef_from_geodetic(params.lat, params.lon, params.height)
        dcm_EN = mat3(in_orientation.dcm_EN)
        place = turned(place_E, dcm_EN, vec3(in_orientation.omega_EN_N), old)
        craft = (r, v, scale(-params.mu / norm(r) ** 3, r))
        sight = difference(place, craft)
        distance = norm(sight[0])
        normal = cross(r, v)
        if not norm(cross(sight[0], normal)) > 1e-9 * distance * norm(normal):
            raise ValueError(
                "in_orientation or in_trans: the place is where the spacecraft is, or along the orbit normal, or a"
                " number is NaN: there is no attitude that looks at it"
            )
        up_N = turned(up(params.lat, params.lon), dcm_EN, vec3(in_orientation.omega_EN_N), old)[0]
        elevation = 0.5 * math.pi - angle_between(scale(-1.0, sight[0]), up_N)
        out_view.visible = elevation >= params.least_elevation
        if params.stop_below and not out_view.visible:
            raise ValueError(
                "Params.lat, lon: the place is below the horizon of the spacecraft, or below Params.least_elevation;"
                " start when it has risen, or set stop_below=False and look at out_view.visible"
            )
        frame, omega, domega = looking_frame(sight, normal)
        body = axes_of_body(vec3(params.axis_B), vec3(params.beside_B))
        store3(out_ref.sigma_RN, dcm_to_mrp(matmul(transpose(body), frame)))
        store3(out_ref.omega_RN_N, omega)
        store3(out_ref.domega_RN_N, domega)
        out_view.elevation, out_view.range = elevation, distance
        out_view.off_nadir = angle_between(sight[0], scale(-1.0, r))
        publish(out_ref, t_ns)
        publish(out_view, t_ns)
