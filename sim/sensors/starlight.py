"""What star sensors share: parameters, what blinds them, and stellar aberration."""

from __future__ import annotations

import math
from typing import Annotated

from fsw import Bound, Mat3, Row, Vec3, eye, zeros
from fsw.math.attitude import dcm_to_ep, ep_compose, mrp_to_ep, rotvec_to_ep
from fsw.math.checks import require_rotation
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, V4, add, angle_between, dot, mat3, norm, scale, sub, vec3
from sim.sensors.faults import FaultParams

C_LIGHT = 299792458.0
"""Speed of light (m/s), exact."""


class StarParams(FaultParams):
    """Parameters of every sensor that looks at stars along the z axis of its case S."""

    dcm_SB: Annotated[Mat3, "-", "nominal mounting: maps body to case components"] = eye(3)
    misalignment_S: Annotated[Vec3, "rad", "turn of the case from its nominal mounting, rotation vector"] = zeros(3)
    max_rate: Annotated[float, "rad/s", "fastest body rate at which stars are still found", Bound(gt=0)] = 0.05
    sun_exclusion: Annotated[float, "rad", "smallest angle from boresight to Sun; 0 for any", Bound(ge=0)] = 0.0
    moon_exclusion: Annotated[float, "rad", "smallest angle from boresight to Moon; 0 for any", Bound(ge=0)] = 0.0
    limb_exclusion: Annotated[
        float, "rad", "smallest angle from boresight to planet's limb; 0 for any", Bound(ge=0)
    ] = 0.0
    radius: Annotated[float, "m", "radius of the planet", Bound(gt=0)] = 6378137.0
    aberration: Annotated[bool, "-", "stellar aberration is left in the measurement"] = False

    def __post_init__(self) -> None:
        """Check the mounting too."""
        super().__post_init__()
        require_rotation(self, "dcm_SB")


@compiled
def true_attitude(params: Row, in_state: Row) -> V4:
    """Attitude beta_SN of the case, misalignment included."""
    beta_SB = ep_compose(rotvec_to_ep(vec3(params.misalignment_S)), dcm_to_ep(mat3(params.dcm_SB)))
    return ep_compose(beta_SB, mrp_to_ep(vec3(in_state.sigma_BN)))


@compiled
def usable(z_N: V3, params: Row, in_state: Row, in_sun: Row, in_moon: Row) -> bool:
    """Whether the body turns slowly enough and nothing bright is near the boresight ``z_N`` (unit vector).

    What is unknown (NaN, or a body that is to be avoided and was never heard of) counts as blinding.
    """
    r_BN_N = vec3(in_state.r_BN_N)
    if not norm(vec3(in_state.omega_BN_B)) <= params.max_rate:
        return False
    if params.limb_exclusion > 0.0:
        r = norm(r_BN_N)
        if not r > params.radius:
            return False
        if not angle_between(z_N, scale(-1.0, r_BN_N)) - math.asin(params.radius / r) >= params.limb_exclusion:
            return False
    if params.sun_exclusion > 0.0 and not angle_between(z_N, sub(vec3(in_sun.r_PN_N), r_BN_N)) >= params.sun_exclusion:
        return False
    return (
        params.moon_exclusion == 0.0 or angle_between(z_N, sub(vec3(in_moon.r_PN_N), r_BN_N)) >= params.moon_exclusion
    )


@compiled
def velocity_over_c(in_state: Row, in_sun: Row) -> V3:
    """Velocity of the spacecraft relative to the Sun over that of light, N components; see `aberrated`.

    Without a Sun only the motion about the planet counts.
    """
    v_N = vec3(in_state.v_BN_N)
    if in_sun.seq > 0:
        v_N = sub(v_N, vec3(in_sun.v_PN_N))
    return scale(1.0 / C_LIGHT, v_N)


@compiled
def aberrated(u: V3, beta: V3) -> V3:
    """Direction in which an observer who moves with ``beta`` (velocity over c) sees a star at the unit vector ``u``.

    Exact special relativity: Urban and Seidelmann (2013), "Explanatory Supplement", eq. 7.40. The Sun's own motion
    about the barycentre (0.01 arc seconds) is left out by `velocity_over_c`.
    """
    root = math.sqrt(1.0 - dot(beta, beta))
    along = dot(u, beta)
    seen = add(scale(root, u), scale(1.0 + along / (1.0 + root), beta))
    return scale(1.0 / (1.0 + along), seen)
