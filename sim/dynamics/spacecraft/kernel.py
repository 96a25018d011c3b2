"""Equations of motion of a rigid body in orbit, and their integration, classical or adaptive."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

from fsw.math.attitude import mrp_inner, mrp_rate, mrp_to_dcm
from fsw.math.compiled import compiled, inlined
from fsw.math.forces import gravity, surface_acceleration
from fsw.math.gravity import gravity_gradient_torque
from fsw.math.integrators import dop853_dense, dop853_error, dop853_factor, dop853_step, dop853_value
from fsw.math.vectors import V3, add, axpy, cross, mat3, mat_t_vec, matvec, norm, scale, store3, sub, vec3
from messages.base import F64
from sim.dynamics.spacecraft.scene import World, require_outside

Motion: TypeAlias = tuple[V3, V3, V3, V3, V3]
"""r_BN_N (m), v_BN_N (m/s), sigma_BN, omega_BN_B (rad/s), dv_BN_N (m/s), or their derivatives."""
Row: TypeAlias = Any

LONGEST_STEP = 600.0
"""Longest step of the adaptive method, s: over it the Sun, the Moon and the planet's rotation are extrapolated."""
SHORTEST_STEP = 1e-6
"""Below it, s, the adaptive method gives up."""


@compiled
def disturbance(r: V3, sigma: V3, world: World) -> V3:
    """Torque, N m, B components, by the residual dipole and the gradient of gravity."""
    craft = world.forces.craft
    dcm_BN = mrp_to_dcm(sigma)
    torque = (0.0, 0.0, 0.0)
    if world.field.seq > 0:
        torque = cross(vec3(craft.dipole_B), matvec(dcm_BN, vec3(world.field.B_N)))
    if craft.gravity_gradient:
        torque = add(torque, gravity_gradient_torque(matvec(dcm_BN, r), craft.mu, mat3(craft.inertia_B)))
    return torque


@inlined
def angular_acceleration(r: V3, sigma: V3, omega: V3, world: World) -> V3:
    """Time derivative of omega_BN_B, rad/s^2: Euler's equation (Eq. 3 of the spec)."""
    craft = world.forces.craft
    torque = (0.0, 0.0, 0.0)
    if world.torque.seq > 0:
        torque = vec3(world.torque.torque_B)
    dipole = craft.dipole_B
    if craft.gravity_gradient or dipole[0] != 0.0 or dipole[1] != 0.0 or dipole[2] != 0.0:
        torque = add(torque, disturbance(r, sigma, world))
    return matvec(world.inverse, sub(torque, cross(omega, matvec(mat3(craft.inertia_B), omega))))


@compiled
def felt(y: Motion, t: float, world: World) -> V3:
    """Acceleration, m/s^2, N components, by all but gravity: commanded force, air, light."""
    accel = surface_acceleration(y[0], y[1], t, world.forces)
    if world.force.seq > 0:
        push = scale(1.0 / world.forces.craft.mass, vec3(world.force.force_B))
        accel = add(accel, mat_t_vec(mrp_to_dcm(y[2]), push))
    return accel


@inlined
def derivative(y: Motion, t: float, world: World) -> Motion:
    """Time derivative of a motion (Eq. 1 to 4), ``t`` seconds after the time of the world."""
    accel, push = gravity(y[0], t, world.forces), (0.0, 0.0, 0.0)
    if world.pushed:
        push = felt(y, t, world)
        accel = add(accel, push)
    return y[1], accel, mrp_rate(y[2], y[3]), angular_acceleration(y[0], y[2], y[3], world), push


@compiled
def advance(y: Motion, h: float, rate: Motion) -> Motion:
    """y + h rate."""
    r, v, sigma = axpy(h, rate[0], y[0]), axpy(h, rate[1], y[1]), axpy(h, rate[2], y[2])
    return r, v, sigma, axpy(h, rate[3], y[3]), axpy(h, rate[4], y[4])


@compiled
def rk4(y: Motion, t: float, h: float, world: World) -> Motion:
    """One step of ``h`` seconds from ``t`` by the classical fourth-order Runge-Kutta method."""
    rate = total = derivative(y, t, world)
    for part, weight in ((0.5, 2.0), (0.5, 2.0), (1.0, 1.0)):
        rate = derivative(advance(y, part * h, rate), t + part * h, world)
        total = advance(total, weight, rate)
    return advance(y, h / 6.0, total)


@compiled
def _motion(y: F64) -> Motion:
    return vec3(y[0:3]), vec3(y[3:6]), vec3(y[6:9]), vec3(y[9:12]), vec3(y[12:15])


@compiled
def _store(out: F64, y: Motion) -> None:
    store3(out[0:3], y[0])
    store3(out[3:6], y[1])
    store3(out[6:9], y[2])
    store3(out[9:12], y[3])
    store3(out[12:15], y[4])


@compiled
def _slope(t: float, y: F64, out: F64, world: World) -> None:
    _store(out, derivative(_motion(y), t, world))


@compiled
def _unchanged(kept: F64, new: V3) -> bool:
    same = kept[0] == new[0] and kept[1] == new[1] and kept[2] == new[2]
    store3(kept, new)
    return same


@compiled
def _same_load(kept: F64, world: World) -> bool:
    """Whether what is held over a step is what ``kept`` (2, 15) says; if not, it is written there."""
    zero = (0.0, 0.0, 0.0)
    air, eclipse = world.forces.air, world.forces.eclipse
    a = _unchanged(kept[0, 0:3], vec3(world.torque.torque_B) if world.torque.seq > 0 else zero)
    b = _unchanged(kept[0, 3:6], vec3(world.force.force_B) if world.force.seq > 0 else zero)
    c = _unchanged(kept[0, 6:9], vec3(world.field.B_N) if world.field.seq > 0 else zero)
    d = _unchanged(kept[0, 9:12], vec3(air.v_AN_N) if air.seq > 0 else zero)
    density = air.density if air.seq > 0 else 0.0
    light = eclipse.illumination if eclipse.seq > 0 else 1.0
    known = 1.0 * (world.forces.sun.seq > 0) + 2.0 * (world.forces.moon.seq > 0)
    known += 4.0 * (world.forces.orientation.seq > 0)
    e = _unchanged(kept[1, 0:3], (density, light, known))
    return a and b and c and d and e


@compiled
def _require_outside_arc(last_ns: int, state: Row, dense: F64, at: F64, world: World) -> None:
    """Check points of the adaptive step between the time of the state and ``last_ns``; ``at`` (15,) is overwritten."""
    length = state.arc_end_ns - state.arc_start_ns
    for i in range(1, 16):
        t_ns = state.arc_start_ns + i * length // 16
        if state.time_ns < t_ns < last_ns:
            dop853_value(dense, (t_ns - state.arc_start_ns) / length, at)
            require_outside(vec3(at[0:3]), (t_ns - state.time_ns) / 1e9, world.forces)


@compiled
def adaptive(y: Motion, t_ns: int, state: Row, tolerance: float, world: World) -> Motion:
    """The motion at ``t_ns`` from ``y`` at ``state.time_ns``, by steps that end where the error allows.

    The last step is kept in ``state`` and reaches beyond ``t_ns``; later calls read it until something held changes.
    """
    work = state.work
    dense, k, start, end, limits = work[0:8], work[8:24], work[24], work[25], work[26]
    same = _same_load(work[27:29], world)
    if not same or state.arc_end_ns <= state.time_ns:
        state.arc_start_ns = state.arc_end_ns = state.time_ns
        _store(start, y)
    elif state.arc_end_ns < t_ns:
        _require_outside_arc(state.arc_end_ns, state, dense, end, world)
        dop853_value(dense, 1.0, start)
    while state.arc_end_ns < t_ns:
        t = (state.arc_end_ns - state.time_ns) / 1e9
        store3(start[6:9], mrp_inner(vec3(start[6:9])))
        _slope(t, start, k[0], world)
        size_r, size_v = max(norm(vec3(start[0:3])), 1.0), max(norm(vec3(start[3:6])), 1e-3)
        size_w = max(norm(vec3(start[9:12])), 1e-3)
        for i in range(3):
            limits[i], limits[3 + i] = tolerance * size_r, tolerance * size_v
            limits[6 + i], limits[9 + i], limits[12 + i] = tolerance, tolerance * size_w, tolerance * size_v
        h = state.next_step if state.next_step > 0.0 else 0.02 / (size_w + size_v / size_r)
        rest = (t_ns - state.arc_end_ns) / 1e9
        cut = not same and h > rest  # what changes every time is not worth a long step
        h = rest if cut else min(h, LONGEST_STEP)
        error, step_ns = math.inf, 0
        while error > 1.0:
            if not h >= SHORTEST_STEP:
                raise ValueError("the adaptive method cannot meet Params.tolerance; the motion meets a singularity")
            step_ns = round(h * 1e9)
            h = step_ns / 1e9
            dop853_step(_slope, t, h, start, k, end, world)
            error = dop853_error(h, k, limits)
            if not error <= 1.0:
                h *= min(dop853_factor(error), 0.9)
                cut = False
                error = math.inf
        if not cut:
            state.next_step = h * dop853_factor(error)
        dop853_dense(_slope, t, h, start, k, end, dense, world)
        state.arc_start_ns = state.arc_end_ns
        state.arc_end_ns += step_ns
        _store(start, _motion(end))
        _require_outside_arc(t_ns, state, dense, limits, world)
    dop853_value(dense, (t_ns - state.arc_start_ns) / (state.arc_end_ns - state.arc_start_ns), end)
    return _motion(end)
