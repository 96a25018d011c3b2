"""Messages of motion: the true state, navigation solutions, conserved quantities."""

from __future__ import annotations

from typing import Annotated

from messages.base import Message, Vec3


class SCStatesMsg(Message):
    """True state of a spacecraft; point B is its centre of mass."""

    r_BN_N: Annotated[Vec3, "m", "position of B relative to the centre of the planet, N components"]
    v_BN_N: Annotated[Vec3, "m/s", "inertial velocity of B, N components"]
    sigma_BN: Annotated[Vec3, "-", "attitude of B relative to N, MRP of the inner set"]
    omega_BN_B: Annotated[Vec3, "rad/s", "angular velocity of B relative to N, B components"]
    omegaDot_BN_B: Annotated[Vec3, "rad/s^2", "angular acceleration of B relative to N, B components"]


class ConservedMsg(Message):
    """Quantities that stay constant without force and torque; with J2 only the z component of the orbital momentum."""

    energy_orbit: Annotated[float, "J/kg", "kinetic and potential energy of the orbit, of unit mass"]
    momentum_orbit_N: Annotated[Vec3, "m^2/s", "orbital angular momentum of unit mass, N components"]
    energy_rotation: Annotated[float, "J", "kinetic energy of the rotation about B"]
    momentum_rotation_N: Annotated[Vec3, "N*m*s", "angular momentum about B, N components"]


class NavTransMsg(Message):
    """Estimated translational state."""

    r_BN_N: Annotated[Vec3, "m", "position of B relative to the centre of the planet, N components"]
    v_BN_N: Annotated[Vec3, "m/s", "inertial velocity of B, N components"]


class NavAttMsg(Message):
    """Estimated attitude and rate."""

    sigma_BN: Annotated[Vec3, "-", "attitude of B relative to N, MRP of the inner set"]
    omega_BN_B: Annotated[Vec3, "rad/s", "angular velocity of B relative to N, B components"]
