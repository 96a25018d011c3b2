"""Messages of the environment: where bodies are, how the Earth is turned, light, field and air at the spacecraft."""

from __future__ import annotations

from typing import Annotated

from messages.base import Bound, Mat3, Message, Vec3


class EphemerisMsg(Message):
    """Position and velocity of a planet, moon or the Sun relative to the central body, the origin of N."""

    body_id: Annotated[int, "-", "NAIF identifier: 10 Sun, 301 Moon, 399 Earth, 499 Mars"]
    mu: Annotated[float, "m^3/s^2", "gravitational parameter", Bound(gt=0)]
    radius: Annotated[float, "m", "radius of the sphere, or of the equator", Bound(gt=0)]
    r_PN_N: Annotated[Vec3, "m", "position of the body P relative to the central body, N components"]
    v_PN_N: Annotated[Vec3, "m/s", "velocity of the body P relative to the central body, N components"]


class PlanetOrientationMsg(Message):
    """How the central body is turned; E is fixed to it."""

    dcm_EN: Annotated[Mat3, "-", "maps N to E components"]
    omega_EN_N: Annotated[Vec3, "rad/s", "angular velocity of E relative to N, N components"]


class EclipseMsg(Message):
    """How much of the Sun a spacecraft sees."""

    illumination: Annotated[float, "-", "visible part of the Sun's disk: 1 full light, 0 umbra", Bound(ge=0, le=1)]


class MagneticFieldMsg(Message):
    """Magnetic flux density at the spacecraft."""

    B_N: Annotated[Vec3, "T", "flux density, N components"]


class AtmosphereMsg(Message):
    """Air at the spacecraft; it turns with the planet."""

    density: Annotated[float, "kg/m^3", "density", Bound(ge=0)]
    v_AN_N: Annotated[Vec3, "m/s", "velocity of the air relative to N, N components"]
