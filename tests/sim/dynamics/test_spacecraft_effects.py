"""Every force and torque of the spacecraft against scipy's DOP853 on formulas written here in another form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from fsw.math.harmonics import read_icgem
from messages.base import F64
from messages.control import CmdForceBodyMsg, CmdTorqueBodyMsg
from messages.environment import AtmosphereMsg, EclipseMsg, EphemerisMsg, MagneticFieldMsg, PlanetOrientationMsg
from sim.dynamics.initial_state import field_params
from sim.dynamics.spacecraft import Spacecraft

Criterion = Callable[[str, float], None]
FIELD = read_icgem(Path(__file__).parents[3] / "sim" / "data" / "gravity" / "EGM2008_50.gfc", 6)
INERTIA = np.array([[90.0, 1.2, -0.7], [1.2, 80.0, 2.0], [-0.7, 2.0, 60.0]])
R0 = np.array([-5279847.803778674, -495460.6925269417, 4343152.422495919])
V0 = np.array([-2434.75356433673, -6523.03346391219, -3530.267927077208])
SIGMA0, OMEGA0, MASS = np.array([0.1, 0.2, -0.3]), np.array([0.0005, -0.0013, 0.002]), 250.0
THETA0, SPIN = 1.234, np.array([2e-6, -3e-6, 7.292115e-5])
SUN, V_SUN, MU_SUN = np.array([1.0e11, -0.9e11, 0.5e11]), np.array([2e4, 2.2e4, 1e4]), 1.32712440018e20
MOON, V_MOON, MU_MOON = np.array([-2.6e8, 2.4e8, 1.1e8]), np.array([-700.0, -650.0, -250.0]), 4.9028e12
DENSITY, WIND, LIGHT = 3e-11, np.array([40.0, -380.0, 15.0]), 0.6
B_N, DIPOLE = np.array([2e-5, -1e-5, 4e-5]), np.array([3.0, -2.0, 5.0])
FORCE, TORQUE = np.array([0.02, -0.01, 0.05]), np.array([2e-4, -1e-4, 3e-4])
DRAG = {"drag_coefficient": 2.3, "drag_area": 4.0}
LIT = {"light_coefficient": 1.4, "light_area": 7.0}


class Around(Module):
    """What surrounds the spacecraft: bodies that move evenly, a planet that turns evenly, the rest constant."""

    out_orientation = Out(PlanetOrientationMsg)
    out_sun = Out(EphemerisMsg)
    out_moon = Out(EphemerisMsg)
    out_atmosphere = Out(AtmosphereMsg)
    out_eclipse = Out(EclipseMsg)
    out_field = Out(MagneticFieldMsg)
    out_force = Out(CmdForceBodyMsg)
    out_torque = Out(CmdTorqueBodyMsg)

    def step(self, t_ns: int) -> None:
        """Write all of it."""
        t = t_ns / 1e9
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=dcm_EN(t), omega_EN_N=SPIN), t_ns)
        for port, naif, mu, r, v in (
            (self.out_sun, 10, MU_SUN, SUN, V_SUN),
            (self.out_moon, 301, MU_MOON, MOON, V_MOON),
        ):
            port.write(EphemerisMsg(body_id=naif, mu=mu, radius=1.7e6, r_PN_N=r + v * t, v_PN_N=v), t_ns)
        self.out_atmosphere.write(AtmosphereMsg(density=DENSITY, v_AN_N=WIND), t_ns)
        self.out_eclipse.write(EclipseMsg(illumination=LIGHT), t_ns)
        self.out_field.write(MagneticFieldMsg(B_N=B_N), t_ns)
        self.out_force.write(CmdForceBodyMsg(force_B=FORCE), t_ns)
        self.out_torque.write(CmdTorqueBodyMsg(torque_B=torque(t - 1e-9)), t_ns)


def torque(t: float) -> F64:
    """It changes every 20 s; the message at the end of an interval tells what acted in it."""
    return TORQUE * np.cos([0.7 * (t // 20.0), 1.1 * (t // 20.0), 1.9 * (t // 20.0)])


def dcm_EN(t: float) -> F64:
    return (Rotation.from_rotvec(SPIN * t) * Rotation.from_euler("z", THETA0)).as_matrix().T


def potential(r: Any) -> Any:
    """Of degree 6 by Cunningham's solid harmonics (Montenbruck and Gill, eq. 3.29 to 3.31), also of complex numbers."""
    r2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    a = FIELD.radius
    x, y, z = a * r[0] / r2, a * r[1] / r2, a * r[2] / r2
    v, w = {(0, 0): a / np.sqrt(r2)}, {(0, 0): 0.0 * r2}
    total = v[0, 0]
    for m in range(7):
        if m > 0:
            v[m, m] = (2 * m - 1) * (x * v[m - 1, m - 1] - y * w[m - 1, m - 1])
            w[m, m] = (2 * m - 1) * (x * w[m - 1, m - 1] + y * v[m - 1, m - 1])
        for n in range(m + 1, 7):
            for f in (v, w):
                f[n, m] = ((2 * n - 1) * z * f[n - 1, m] - (n + m - 1) * a * a / r2 * f.get((n - 2, m), 0.0)) / (n - m)
        for n in range(max(m, 2), 7):
            k = np.sqrt((1 if m == 0 else 2) * (2 * n + 1) / np.prod(np.arange(n - m + 1.0, n + m + 1.0)))
            total = total + k * (FIELD.C[n, m] * v[n, m] + FIELD.S[n, m] * w[n, m])
    return FIELD.mu / a * total


def field_gradient(r: F64) -> F64:
    """By complex steps, which lose no digits."""
    return np.array([potential(r + 1e-20j * np.eye(3)[i]).imag / 1e-20 for i in range(3)])


def attraction(r: F64, body: F64, mu: float) -> F64:
    d = body - r
    return np.asarray(mu * (d / (d @ d) ** 1.5 - body / (body @ body) ** 1.5), np.float64)


def slope(t: float, y: F64, effects: set[str]) -> F64:
    """Derivative of r, v, Euler parameters (scalar last), momentum in B, velocity gained."""
    r, v, q, h = y[:3], y[3:6], y[6:10] / np.linalg.norm(y[6:10]), y[10:13]
    dcm_NB, w = Rotation.from_quat(q).as_matrix(), np.linalg.solve(INERTIA, h)
    if "harmonics" in effects:
        turn = dcm_EN(t)
        accel = turn.T @ field_gradient(turn @ r)
    else:
        accel = -FIELD.mu * r / (r @ r) ** 1.5
    if "sun" in effects:
        accel = accel + attraction(r, SUN + V_SUN * t, MU_SUN)
    if "moon" in effects:
        accel = accel + attraction(r, MOON + V_MOON * t, MU_MOON)
    push = np.zeros(3)
    if "drag" in effects:
        u = v - WIND
        push = push - 0.5 * DENSITY * np.sqrt(u @ u) * u * 2.3 * 4.0 / MASS
    if "light" in effects:
        d = r - SUN - V_SUN * t
        flux = 1361.0 * (149597870700.0**2 / (d @ d))  # W/m^2
        push = push + LIGHT * flux / 299792458.0 * 1.4 * 7.0 / MASS * d / np.sqrt(d @ d)
    if "force" in effects:
        push = push + dcm_NB @ FORCE / MASS
    twist = torque(t) if "torque" in effects else np.zeros(3)
    if "gradient" in effects:  # gravity that pulls at the second moments of mass, by its gradient
        r_B, moments = dcm_NB.T @ r, 0.5 * np.trace(INERTIA) * np.eye(3) - INERTIA
        g = FIELD.mu / (r @ r) ** 1.5 * (3.0 * np.outer(r_B, r_B) / (r @ r) - np.eye(3))
        k = moments @ g
        twist = twist + np.array([k[1, 2] - k[2, 1], k[2, 0] - k[0, 2], k[0, 1] - k[1, 0]])
    if "dipole" in effects:
        twist = twist + np.cross(DIPOLE, dcm_NB.T @ B_N)
    q_dot = 0.5 * np.array([*(q[3] * w + np.cross(q[:3], w)), -q[:3] @ w])
    return np.concatenate([v, accel + push, q_dot, twist - np.cross(w, h), push])


def reference(duration: float, effects: set[str], piece: float) -> F64:
    """Final state by DOP853 near the rounding error, begun anew where a torque changes."""
    y = np.concatenate([R0, V0, Rotation.from_mrp(SIGMA0).as_quat(), INERTIA @ OMEGA0, np.zeros(3)])
    limits = np.repeat([1e-8, 1e-11, 1e-15, 1e-15, 1e-13], [3, 3, 4, 3, 3])
    for k in range(round(duration / piece)):
        ends = (k * piece, (k + 1) * piece)
        # the torque is that of the piece, also at its end
        held: Any = lambda t, x, last=ends[1]: slope(min(t, last - 1e-9) if "torque" in effects else t, x, effects)  # noqa: E731
        y = solve_ivp(held, ends, y, method="DOP853", rtol=1e-13, atol=limits).y[:, -1]
    return y


INPUTS = {
    "harmonics": ["orientation"],
    "sun": ["sun"],
    "moon": ["moon"],
    "drag": ["atmosphere"],
    "light": ["sun", "eclipse"],
    "force": ["force"],
    "torque": ["torque"],
    "gradient": [],
    "dipole": ["field"],
}


def spacecraft(effects: set[str], **more: Any) -> Spacecraft:
    params: dict[str, Any] = {"mu": FIELD.mu, "radius": FIELD.radius, "j2": 0.0, "inertia_B": INERTIA, "mass": MASS}
    params |= field_params(FIELD, 6) if "harmonics" in effects else {}
    params |= DRAG if "drag" in effects else {}
    params |= LIT if "light" in effects else {}
    params |= {"dipole_B": DIPOLE} if "dipole" in effects else {}
    params |= {"gravity_gradient": "gradient" in effects} | more
    start = Spacecraft.State(r_BN_N=R0, v_BN_N=V0, sigma_BN=SIGMA0, omega_BN_B=OMEGA0)
    return Spacecraft("craft", Spacecraft.Params(**params), start)


def scene(effects: set[str], period: float, **more: Any) -> tuple[Simulation, Spacecraft]:
    """The spacecraft with the inputs that the effects need; the surroundings are written once a period, before it."""
    craft, around = spacecraft(effects, **more), Around("around")
    for name in sorted({n for effect in effects for n in INPUTS[effect]}):
        wire: Any = getattr(around, f"out_{name}")
        wire.connect(getattr(craft, f"in_{name}"))
    return Simulation([Task("truth", s(period), [around, craft])]), craft


def end(sim: Simulation, craft: Spacecraft, duration: float) -> F64:
    """Final r, v, Euler parameters, momentum in B, velocity gained."""
    sim.run_until(s(duration))
    x: Any = craft.state
    q = Rotation.from_mrp(x.sigma_BN.copy()).as_quat()
    return np.concatenate([x.r_BN_N, x.v_BN_N, q, INERTIA @ x.omega_BN_B, x.dv_BN_N])


def position_error(mine: F64, theirs: F64) -> float:
    return float(np.linalg.norm(mine[:3] - theirs[:3]))


def attitude_error(mine: F64, theirs: F64) -> float:
    return float((Rotation.from_quat(mine[6:10]).inv() * Rotation.from_quat(theirs[6:10])).magnitude())


def gained_error(mine: F64, theirs: F64) -> float:
    return float(np.linalg.norm(mine[13:] - theirs[13:]) / np.linalg.norm(theirs[13:]))


@pytest.mark.parametrize("effect", ["harmonics", "sun", "moon", "drag", "light", "force"])
def test_each_force_against_dop853(effect: str, criterion: Criterion) -> None:
    base: set[str] = {"sun"} if effect == "light" else set()  # a Sun that shines attracts too
    expected = reference(3000.0, base | {effect}, 3000.0)
    got = end(*scene(base | {effect}, 10.0, max_step=0.5), 3000.0)
    criterion("SPACECRAFT-13", position_error(got, expected))
    assert position_error(expected, reference(3000.0, base, 3000.0)) > 0.1  # the effect is there


@pytest.mark.parametrize("effect", ["gradient", "dipole"])
def test_each_torque_against_dop853(effect: str, criterion: Criterion) -> None:
    expected = reference(1000.0, {effect}, 1000.0)
    criterion("SPACECRAFT-14", attitude_error(end(*scene({effect}, 10.0), 1000.0), expected))
    assert attitude_error(expected, reference(1000.0, set(), 1000.0)) > 0.01


@pytest.mark.parametrize("tolerance", [0.0, 1e-12])
def test_specific_force_against_dop853(tolerance: float, criterion: Criterion) -> None:
    """What accelerometers feel, of air, light and a thruster together, and nothing of gravity."""
    effects = {"harmonics", "sun", "drag", "light", "force", "gradient"}
    sim, craft = scene(effects, 10.0, max_step=0.5, tolerance=tolerance)
    got, expected = end(sim, craft, 600.0), reference(600.0, effects, 600.0)
    criterion("SPACECRAFT-15", gained_error(got, expected))
    felt, dcm_NB = craft.out_force.latest(), Rotation.from_quat(expected[6:10]).as_matrix()
    assert felt is not None
    np.testing.assert_allclose(dcm_NB @ felt.accel_BN_B, slope(600.0, expected, effects)[13:], rtol=1e-9)
    assert np.array_equal(felt.dv_BN_N, got[13:])


def test_free_fall_feels_nothing() -> None:
    sim, craft = scene({"harmonics", "sun", "moon", "gradient", "torque"}, 10.0)
    end(sim, craft, 100.0)
    felt = craft.out_force.latest()
    assert felt is not None and not felt.accel_BN_B.any() and not felt.dv_BN_N.any()


ALL = set(INPUTS)


def test_adaptive_with_changing_torque_against_dop853(criterion: Criterion) -> None:
    """All effects; the torque changes every 20 s, the state is read each second from the dense output."""
    got = end(*scene(ALL, 1.0, tolerance=1e-12), 200.0)
    expected = reference(200.0, ALL, 20.0)
    relative = position_error(got, expected) / np.linalg.norm(R0)
    momentum = np.linalg.norm(got[10:13] - expected[10:13]) / np.linalg.norm(expected[10:13])
    criterion("SPACECRAFT-16", max(float(relative), float(momentum), attitude_error(got, expected)))
    small = end(*scene(ALL, 1.0, max_step=0.1), 200.0)  # RK4
    assert position_error(small, expected) < 1e-5 and attitude_error(small, expected) < 1e-10


def test_adaptive_keeps_its_tolerance(criterion: Criterion) -> None:
    """Error of an orbit, every 50 s, read from the dense output, in units of the tolerance."""
    times = np.arange(0.0, 6001.0, 50.0)
    start = np.concatenate([R0, V0, Rotation.from_mrp(SIGMA0).as_quat(), INERTIA @ OMEGA0, np.zeros(3)])
    solved = solve_ivp(
        lambda t, y: slope(t, y, {"sun", "moon"}), (0.0, 6000.0), start, "DOP853", times, rtol=1e-13, atol=1e-12
    )
    worst = 0.0
    for tolerance in (1e-6, 1e-8, 1e-10):
        sim, craft = scene({"sun", "moon"}, 10.0, tolerance=tolerance)
        rec = craft.out_state.record(every=s(50))
        sim.run_until(s(6000))
        error = np.linalg.norm(rec["r_BN_N"] - solved.y[:3].T, axis=1).max() / np.linalg.norm(R0)
        worst = max(worst, float(error) / tolerance)
    criterion("SPACECRAFT-17", worst)


def test_adaptive_goes_on_from_a_snapshot() -> None:
    """In the middle of a step of the method, to the bit."""
    sim, craft = scene(ALL - {"torque", "force"}, 7.0, tolerance=1e-10)
    sim.run_until(s(70))
    kept = sim.snapshot()
    sim.run_until(s(700))
    first = np.concatenate([craft.state.r_BN_N, craft.state.sigma_BN, craft.state.dv_BN_N])
    sim.restore(kept)
    sim.run_until(s(700))
    assert np.array_equal(first, np.concatenate([craft.state.r_BN_N, craft.state.sigma_BN, craft.state.dv_BN_N]))


@pytest.mark.parametrize("tolerance", [0.0, 1e-12])
def test_jacobi_integral(tolerance: float, criterion: Criterion) -> None:
    """A field that turns evenly conserves E - SPIN . h, though neither E nor h."""
    sim, craft = scene({"harmonics"}, 10.0, max_step=1.0, tolerance=tolerance)
    rec = craft.out_conserved.record()
    sim.run_until(s(6000))
    energy = rec["energy_orbit"]
    jacobi = energy - rec["momentum_orbit_N"] @ SPIN
    assert np.ptp(energy) > 1e-6 * abs(energy[0])
    criterion("SPACECRAFT-18", float(np.max(np.abs(jacobi / jacobi[0] - 1.0))))


def test_rate_relative_to_the_orbit_frame(criterion: Criterion) -> None:
    """Torque free: Euler's equation for the inertial rate, and its exact form for the rate relative to O, are one.

    w_BO' = I^-1 (-w_BI x I w_BI) + w_BO x (C_BO w_OI) - C_BO w_OI', w_BI = w_BO + C_BO w_OI, on a circular orbit.
    Leaving out the terms of the frame (as a source of this model does) turns the body 0.2 degrees away in 300 s.
    """
    inertia, r = np.diag([0.04, 0.05, 0.02]), 6878e3
    n = np.sqrt(FIELD.mu / r**3)
    w_OI = np.array([0.0, -n, 0.0])

    def relative(_: float, y: F64, exact: bool) -> F64:
        q, w_BO = y[:4] / np.linalg.norm(y[:4]), y[4:]
        dcm_BO = Rotation.from_quat(q).as_matrix().T
        w_BI = w_BO + dcm_BO @ w_OI if exact else w_BO
        change = np.linalg.solve(inertia, -np.cross(w_BI, inertia @ w_BI))
        if exact:
            change = change + np.cross(w_BO, dcm_BO @ w_OI)
        turning = np.array([*(q[3] * w_BO + np.cross(q[:3], w_BO)), -q[:3] @ w_BO])
        return np.concatenate([0.5 * turning, np.asarray(change, np.float64)])

    roll = Rotation.from_euler("x", 5.0, degrees=True)
    y0 = np.concatenate([roll.as_quat(), np.zeros(3)])
    exact, wrong = (
        solve_ivp(relative, (0.0, 300.0), y0, "DOP853", rtol=1e-13, atol=1e-15, args=(kind,)).y[:, -1]
        for kind in (True, False)
    )
    # O at the start: x along y of N (the track), y along -z of N, z along -x of N (nadir)
    start_NO = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    body = Rotation.from_matrix(start_NO) * roll
    omega = roll.as_matrix().T @ w_OI
    start = Spacecraft.State(
        r_BN_N=np.array([r, 0.0, 0.0]), v_BN_N=np.array([0.0, n * r, 0.0]), sigma_BN=body.as_mrp(), omega_BN_B=omega
    )
    craft = Spacecraft("craft", Spacecraft.Params(inertia_B=inertia, mu=FIELD.mu, j2=0.0), start)
    Simulation([Task("truth", s(1), [craft])]).run_until(s(300))
    now_NO = Rotation.from_rotvec([0.0, 0.0, n * 300.0]) * Rotation.from_matrix(start_NO)
    got = now_NO.inv() * Rotation.from_mrp(craft.state.sigma_BN.copy())
    criterion("SPACECRAFT-19", float((got.inv() * Rotation.from_quat(exact[:4])).magnitude()))
    off = np.degrees((got.inv() * Rotation.from_quat(wrong[:4])).magnitude())
    assert off > 0.1
