"""Spacecraft against scipy's DOP853 on other variables, conservation laws, an analytic motion, and Basilisk."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

from fsw import Module, ModuleError, Out, Simulation, Task, s
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from messages.base import F64
from messages.control import CmdForceBodyMsg, CmdTorqueBodyMsg
from sim.dynamics.spacecraft import Spacecraft

Criterion = Callable[[str, float], None]
INERTIA = np.array([[900.0, 12.0, -7.0], [12.0, 800.0, 20.0], [-7.0, 20.0, 600.0]])
R0 = np.array([-5279847.803778674, -495460.6925269417, 4343152.422495919])
V0 = np.array([-2434.75356433673, -6523.03346391219, -3530.267927077208])
SIGMA0, OMEGA0 = np.array([0.1, 0.2, -0.3]), np.array([0.005, -0.013, 0.02])
TORQUE, FORCE, MASS = np.array([0.02, -0.03, 0.05]), np.array([1.0, 2.0, -0.5]), 750.0
ORBIT = 5800.0


class Push(Module):
    """A constant torque and force."""

    out_torque = Out(CmdTorqueBodyMsg)
    out_force = Out(CmdForceBodyMsg)
    torque = TORQUE

    def step(self, t_ns: int) -> None:
        self.out_torque.write(CmdTorqueBodyMsg(torque_B=self.torque), t_ns)
        self.out_force.write(CmdForceBodyMsg(force_B=FORCE), t_ns)


def spacecraft(omega: F64 = OMEGA0, inertia: F64 = INERTIA, **params: Any) -> Spacecraft:
    start = Spacecraft.State(r_BN_N=R0, v_BN_N=V0, sigma_BN=SIGMA0, omega_BN_B=omega)
    return Spacecraft("craft", Spacecraft.Params(inertia_B=inertia, mass=MASS, **params), start)


def run(craft: Spacecraft, until: float, period: float, push: Push | None = None) -> Any:
    modules: list[Module] = [craft]
    if push is not None:
        push.out_torque.connect(craft.in_torque)
        push.out_force.connect(craft.in_force)
        modules.insert(0, push)
    state = craft.out_state.record(every=s(until / 20))
    conserved = craft.out_conserved.record(every=s(until / 20))
    Simulation([Task("truth", s(period), modules)]).run_until(s(until))
    return state, conserved


def gradient_of_j2(r: F64) -> F64:
    """Acceleration as the gradient of a sum of two potentials, each differentiated by hand in another form."""
    x, z = float(np.linalg.norm(r)), float(r[2])
    k = 0.5 * MU_EARTH * J2_EARTH * RADIUS_EARTH**2
    pole = np.array([0.0, 0.0, 1.0])
    zonal: F64 = k * (6 * z * pole / x**5 - 15 * z**2 * r / x**7 + 3 * r / x**5)
    return -MU_EARTH / x**3 * r - zonal


def turned_back(q: F64, a: F64) -> F64:
    """B components to N components by Euler parameters: a + 2 q x (q x a + q0 a)."""
    return np.asarray(a + 2.0 * np.cross(q[1:], np.cross(q[1:], a) + q[0] * a), np.float64)


@functools.cache
def reference_orbit() -> F64:
    """Final r, v after one orbit, by DOP853 with a tolerance near the rounding error."""

    def slope(_: float, y: F64) -> F64:
        return np.concatenate([y[3:], gradient_of_j2(y[:3])])

    tolerance = np.repeat([1e-7, 1e-10], 3)
    solved = solve_ivp(slope, (0, ORBIT), np.concatenate([R0, V0]), method="DOP853", rtol=1e-13, atol=tolerance)
    return solved.y[:, -1]


@functools.cache
def reference(pushed: bool) -> F64:
    """r, v, Euler parameters, angular momentum in B after 600 s, by DOP853."""
    inverse = np.linalg.inv(INERTIA)
    torque, force = (TORQUE, FORCE) if pushed else (np.zeros(3), np.zeros(3))

    def slope(_: float, y: F64) -> F64:
        q, h = y[6:10] / np.linalg.norm(y[6:10]), y[10:]
        w = inverse @ h
        accel = gradient_of_j2(y[:3]) + turned_back(q, force) / MASS
        q_dot = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + np.cross(q[1:], w))])
        return np.concatenate([y[3:6], accel, q_dot, torque - np.cross(w, h)])

    q0 = Rotation.from_mrp(SIGMA0).as_quat(scalar_first=True)
    start = np.concatenate([R0, V0, q0, INERTIA @ OMEGA0])
    tolerance = np.repeat([1e-7, 1e-10, 1e-15, 1e-13], [3, 3, 4, 3])
    solved = solve_ivp(slope, (0, 600.0), start, method="DOP853", rtol=1e-13, atol=tolerance)
    return solved.y[:, -1]


def attitude_error(sigma: F64, q: F64) -> float:
    return float((Rotation.from_mrp(sigma).inv() * Rotation.from_quat(q, scalar_first=True)).magnitude())


def test_orbit_against_dop853(criterion: Criterion) -> None:
    state, _ = run(spacecraft(), ORBIT, 10.0)
    criterion("SPACECRAFT-1", float(np.linalg.norm(state["r_BN_N"][-1] - reference_orbit()[:3])))


def test_attitude_against_dop853(criterion: Criterion) -> None:
    state, _ = run(spacecraft(), 600.0, 10.0)
    criterion("SPACECRAFT-2", attitude_error(state["sigma_BN"][-1], reference(pushed=False)[6:10]))


def test_torque_and_force_against_dop853(criterion: Criterion) -> None:
    state, _ = run(spacecraft(), 600.0, 1.0, Push("push"))
    expected = reference(pushed=True)
    r_error = np.linalg.norm(state["r_BN_N"][-1] - expected[:3]) / np.linalg.norm(expected[:3])
    omega = np.linalg.solve(INERTIA, expected[10:])
    w_error = np.linalg.norm(state["omega_BN_B"][-1] - omega) / np.linalg.norm(omega)
    criterion("SPACECRAFT-3", float(max(r_error, w_error)))


def test_conserved_quantities(criterion: Criterion) -> None:
    """Energy and, about the pole, orbital momentum with J2; energy and momentum of the rotation; over an orbit."""
    _, rec = run(spacecraft(), ORBIT, 10.0)
    worst = 0.0
    for values in (rec["energy_orbit"], rec["momentum_orbit_N"][:, 2], rec["energy_rotation"]):
        worst = max(worst, float(np.max(np.abs(values / values[0] - 1.0))))
    momentum = rec["momentum_rotation_N"]
    drift = np.linalg.norm(momentum - momentum[0], axis=1) / np.linalg.norm(momentum[0])
    criterion("SPACECRAFT-4", max(worst, float(drift.max())))


def test_order_of_convergence(criterion: Criterion) -> None:
    """Halving the step divides the error by 16."""
    expected = reference(pushed=True)
    errors: list[float] = []
    for step in (20.0, 10.0):
        state, _ = run(spacecraft(max_step=step), 600.0, 20.0, Push("push"))
        errors.append(float(np.linalg.norm(state["r_BN_N"][-1] - expected[:3])))
    criterion("SPACECRAFT-5", float(np.log2(errors[0] / errors[1])) - 4.0)


def test_against_basilisk(criterion: Criterion) -> None:
    path = Path(__file__).parents[2] / "data" / "basilisk_spacecraft.json"
    case: dict[str, Any] = json.loads(path.read_text())["case"]
    start = Spacecraft.State(
        r_BN_N=np.array(case["r"]),
        v_BN_N=np.array(case["v"]),
        sigma_BN=np.array(case["sigma"]),
        omega_BN_B=np.array(case["omega"]),
    )
    params = Spacecraft.Params(
        inertia_B=np.array(case["hub"]["IHubPntBc_B"]), mass=750.0, mu=case["mu"], j2=0.0, max_step=case["dt"]
    )
    craft = Spacecraft("craft", params, start)
    rec, conserved = craft.out_state.record(), craft.out_conserved.record()
    out = {k: np.array(v) for k, v in case["out"].items()}
    Simulation([Task("truth", s(case["dt"]), [craft])]).run_until(int(out["t_ns"][-1]))
    at = np.searchsorted(rec.t_ns, out["t_ns"])
    assert np.array_equal(rec.t_ns[at], out["t_ns"])

    def error(mine: F64, theirs: F64) -> float:
        return float(np.max(np.linalg.norm(mine[at] - theirs, axis=1)) / np.max(np.linalg.norm(theirs, axis=1)))

    pairs = [(rec[name], out[name]) for name in ("r_BN_N", "v_BN_N", "omega_BN_B")]
    pairs.append((conserved["momentum_rotation_N"], out["totRotAngMomPntC_N"]))
    pairs.append((conserved["momentum_orbit_N"] * 750.0, out["totOrbAngMomPntN_N"]))
    pairs.append((conserved["energy_rotation"][:, None], out["totRotEnergy"].reshape(-1, 1)))
    pairs.append((conserved["energy_orbit"][:, None] * 750.0, out["totOrbEnergy"].reshape(-1, 1)))
    turn = Rotation.from_mrp(rec["sigma_BN"][at]).inv() * Rotation.from_mrp(out["sigma_BN"])
    criterion("SPACECRAFT-6", max(float(turn.magnitude().max()), *(error(a, b) for a, b in pairs)))


def test_free_precession_of_a_symmetric_body(criterion: Criterion) -> None:
    """Analytic: the transverse rate turns in the body at (C - A)/A times the axial rate (Goldstein, sec. 5.6)."""
    inertia = np.diag([800.0, 800.0, 600.0])
    state, _ = run(spacecraft(omega=np.array([0.02, 0.0, 0.05]), inertia=inertia, max_step=0.05), 400.0, 1.0)
    angle = (600.0 - 800.0) / 800.0 * 0.05 * state.t_s
    expected = np.stack([0.02 * np.cos(angle), 0.02 * np.sin(angle), np.full(len(angle), 0.05)], axis=1)
    criterion("SPACECRAFT-7", float(np.max(np.abs(state["omega_BN_B"] - expected))))


@pytest.mark.parametrize("method", [{"max_step": 0.1}, {"tolerance": 1e-13}])
def test_flips_about_the_intermediate_axis(method: dict[str, float]) -> None:
    """Jacobi's elliptic functions (Landau and Lifshitz, "Mechanics", sec. 37), with energy and momentum conserved."""
    a, b, c = 2.0, 3.0, 4.0
    w1, w3 = 0.0707, 0.05
    twice_energy, square = a * w1**2 + c * w3**2, (a * w1) ** 2 + (c * w3) ** 2
    rate = np.sqrt((c - b) * (square - twice_energy * a) / (a * b * c))
    m = (b - a) * (twice_energy * c - square) / ((c - b) * (square - twice_energy * a))
    start = np.array([w1, 0.0, w3])
    state, conserved = run(spacecraft(omega=start, inertia=np.diag([a, b, c]), **method), 900.0, 1.0)
    sn, cn, dn, _ = ellipj(rate * state.t_s, m)
    top = np.sqrt((twice_energy * c - square) / (b * (c - b)))
    expected = np.stack([w1 * cn, top * sn, w3 * dn], axis=1)
    assert expected[:, 1].min() < -0.9 * top and expected[:, 1].max() > 0.9 * top
    np.testing.assert_allclose(state["omega_BN_B"], expected, rtol=0, atol=1e-8)
    np.testing.assert_allclose(conserved["energy_rotation"], twice_energy / 2.0, rtol=1e-11)
    turned = np.linalg.norm(conserved["momentum_rotation_N"] - conserved["momentum_rotation_N"][0], axis=1)
    assert turned.max() < 1e-8 * np.sqrt(square)


def test_angular_acceleration_and_first_output() -> None:
    craft = spacecraft()
    state, _ = run(craft, 1.0, 1.0, Push("push"))
    assert np.array_equal(state["r_BN_N"][0], R0)
    expected = np.linalg.solve(INERTIA, TORQUE - np.cross(OMEGA0, INERTIA @ OMEGA0))
    np.testing.assert_allclose(state["omegaDot_BN_B"][0], expected, rtol=1e-14)


def test_outer_set_is_mapped_inwards() -> None:
    start = Spacecraft.State(r_BN_N=R0, v_BN_N=V0, sigma_BN=np.array([0.0, 2.0, 0.0]), omega_BN_B=OMEGA0)
    craft = Spacecraft("craft", Spacecraft.Params(inertia_B=INERTIA), start)
    craft.step(0)
    message = craft.out_state.latest()
    assert message is not None
    np.testing.assert_allclose(message.sigma_BN, [0.0, -0.5, 0.0], rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"inertia_B": np.diag([900.0, 800.0, -1.0])}, "principal axis"),
        ({"inertia_B": np.diag([100.0, 100.0, 900.0])}, "cannot exceed"),
        ({"inertia_B": INERTIA + np.triu(np.ones((3, 3)), 1)}, "not symmetric"),
        ({"inertia_B": np.ones(3)}, "shape"),
        ({"mass": 0.0}, "> 0"),
        ({"max_step": np.nan}, "NaN"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    given: dict[str, Any] = {"inertia_B": INERTIA, **change}
    with pytest.raises(ValueError, match=text):
        Spacecraft.Params(**given)


def test_nan_torque_stops_the_run_and_leaves_the_state() -> None:
    push, craft = Push("push"), spacecraft()
    push.out_torque.connect(craft.in_torque, delayed=True)
    push.out_torque.row["torque_B"], push.out_torque.row["seq"] = np.nan, 1
    with pytest.raises(ModuleError, match="torque_B: expected finite"):
        Simulation([Task("truth", s(1), [craft, push])]).run_until(0)
    assert np.array_equal(craft.state.r_BN_N, R0)
    assert craft.out_state.latest() is None


def test_start_later_than_the_first_step() -> None:
    start = Spacecraft.State(r_BN_N=R0, v_BN_N=V0, sigma_BN=SIGMA0, omega_BN_B=OMEGA0, time_ns=s(5))
    craft = Spacecraft("craft", Spacecraft.Params(inertia_B=INERTIA), start)
    with pytest.raises(ModuleError, match="time_ns"):
        Simulation([Task("truth", s(1), [craft])]).run_until(0)
