"""What the equations of motion read, and the checks of it: that it was written, is finite, and leaves the planet."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, TypeAlias

from fsw.math.compiled import compiled
from fsw.math.forces import Scene, position_E
from fsw.math.vectors import M3, V3

Row: TypeAlias = Any


class World(NamedTuple):
    """All that a derivative reads.

    Attributes:
        forces: rows of the forces. torque: CmdTorqueBodyMsg. force: CmdForceBodyMsg. field: MagneticFieldMsg.
        inverse: inverse of the inertia about B. pushed: whether anything but gravity moves B.
    """

    forces: Scene
    torque: Row
    force: Row
    field: Row
    inverse: M3
    pushed: bool


@compiled
def finite(a: V3) -> bool:
    """Whether all three are neither NaN nor infinite."""
    return math.isfinite(a[0] + a[1] + a[2])


@compiled
def require_loads(world: World, moving: bool) -> None:
    """Check what turns the body and what is commanded; if the spacecraft is ``moving``, that nothing is missing."""
    if world.torque.seq > 0 and not finite(world.torque.torque_B):
        raise ValueError("in_torque.torque_B: expected finite numbers (N m), got NaN or infinity; look at its writer")
    if world.force.seq > 0 and not finite(world.force.force_B):
        raise ValueError("in_force.force_B: expected finite numbers (N), got NaN or infinity; look at its writer")
    dipole = world.forces.craft.dipole_B
    if dipole[0] != 0.0 or dipole[1] != 0.0 or dipole[2] != 0.0:
        if world.field.seq > 0 and not finite(world.field.B_N):
            raise ValueError("in_field.B_N: expected finite numbers (T), got NaN or infinity; look at its writer")
        if world.field.seq == 0 and moving:
            raise ValueError("in_field: expected a message, because Params.dipole_B is not 0, and none was written")


@compiled
def require_forces(scene: Scene, moving: bool) -> None:
    """Check what moves the spacecraft, and, if it is ``moving``, that nothing is missing."""
    craft, turn, sun, moon, air, eclipse = (
        scene.craft,
        scene.orientation,
        scene.sun,
        scene.moon,
        scene.air,
        scene.eclipse,
    )
    if turn.seq > 0:
        rows = finite(turn.dcm_EN[0]) and finite(turn.dcm_EN[1]) and finite(turn.dcm_EN[2])
        if not (rows and finite(turn.omega_EN_N)):
            raise ValueError("in_orientation: expected finite numbers, got NaN or infinity; look at its writer")
    elif craft.degree > 0:
        raise ValueError(
            "in_orientation: expected a message, because Params.degree > 0, and none was written; run the module that"
            " turns the planet before the spacecraft"
        )
    if sun.seq > 0 and not (math.isfinite(sun.mu) and finite(sun.r_PN_N) and finite(sun.v_PN_N)):
        raise ValueError("in_sun: expected finite numbers, got NaN or infinity; look at its writer")
    if moon.seq > 0 and not (math.isfinite(moon.mu) and finite(moon.r_PN_N) and finite(moon.v_PN_N)):
        raise ValueError("in_moon: expected finite numbers, got NaN or infinity; look at its writer")
    if craft.drag_area > 0.0:
        if air.seq > 0 and not (math.isfinite(air.density) and finite(air.v_AN_N)):
            raise ValueError("in_atmosphere: expected finite numbers, got NaN or infinity; look at its writer")
        if air.seq == 0 and moving:
            raise ValueError("in_atmosphere: expected a message, because Params.drag_area > 0, and none was written")
    if craft.light_area > 0.0:
        if eclipse.seq > 0 and not math.isfinite(eclipse.illumination):
            raise ValueError("in_eclipse.illumination: expected a number, got NaN or infinity; look at its writer")
        if sun.seq == 0 and moving:
            raise ValueError("in_sun: expected a message, because Params.light_area > 0, and none was written")


@compiled
def require_outside(r: V3, t: float, scene: Scene) -> None:
    """Stop a spacecraft that is inside the planet at ``r`` (m, N components), ``t`` s after the time of the scene."""
    craft = scene.craft
    r_E = position_E(r, t, scene)
    z = r_E[2] / (1.0 - craft.flattening)
    square = r_E[0] * r_E[0] + r_E[1] * r_E[1] + z * z
    if craft.mu > 0.0 and square < craft.surface_radius * craft.surface_radius:
        raise ValueError(
            "r_BN_N: the spacecraft is below the planet's surface (Params.surface_radius): it has come down, or it"
            " began there; end the run earlier or choose a higher orbit"
        )
