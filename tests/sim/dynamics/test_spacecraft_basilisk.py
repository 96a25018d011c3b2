"""Spacecraft against runs of Basilisk: what it can express as a module, and the rest with its equations of motion.

Basilisk moves a point B that need not be the centre of mass, turns the planet by a matrix that it extrapolates without
making it orthonormal again, and has other integrators. These are written here, round the equations of the kernel.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from fsw.math.attitude import mrp_inner
from fsw.math.compiled import plain
from fsw.math.forces import Scene
from fsw.math.harmonics import harmonic_acceleration
from fsw.math.vectors import inverse, mat3
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from sim.dynamics.spacecraft import Spacecraft
from sim.dynamics.spacecraft.kernel import derivative
from sim.dynamics.spacecraft.scene import World

Criterion = Callable[[str, float], None]
Slope = Callable[[float, F64], F64]
DATA = Path(__file__).parents[2] / "data"
GRAVITY: dict[str, Any] = json.loads((DATA / "basilisk_spacecraft_gravity.json").read_text())["cases"]
FORCES: dict[str, Any] = json.loads((DATA / "basilisk_spacecraft_forces.json").read_text())["cases"]


class Surroundings(Module):
    """The planet's orientation and the Sun of a case."""

    out_orientation = Out(PlanetOrientationMsg)
    out_sun = Out(EphemerisMsg)
    case: dict[str, Any]

    def step(self, t_ns: int) -> None:
        """Write what the case has."""
        case, t = self.case, t_ns / 1e9
        if "dcm_EN" in case and t_ns == 0:
            message = PlanetOrientationMsg(dcm_EN=np.array(case["dcm_EN"]), omega_EN_N=np.zeros(3))
            self.out_orientation.write(message, t_ns)
        if "spin" in case:
            rate = np.array([0.0, 0.0, case["spin"]["w"]])
            dcm_EN = spin(case, t)
            self.out_orientation.write(PlanetOrientationMsg(dcm_EN=dcm_EN, omega_EN_N=rate), t_ns)
        if "planet_r" in case:
            v = -np.array(case["planet_v"])
            r = -np.array(case["planet_r"]) + v * t
            self.out_sun.write(EphemerisMsg(body_id=10, mu=case["mu_sun"], radius=7e8, r_PN_N=r, v_PN_N=v), t_ns)


def spin(case: dict[str, Any], t: float) -> F64:
    return Rotation.from_euler("z", case["spin"]["theta0"] + case["spin"]["w"] * t).as_matrix().T


def field(case: dict[str, Any]) -> dict[str, Any]:
    c, s_ = np.zeros((51, 51)), np.zeros((51, 51))
    for n, m, cosine, sine in case.get("field", []):
        c[int(n), int(m)], s_[int(n), int(m)] = cosine, sine
    return {"mu": case["mu"], "radius": case["radius"], "j2": 0.0, "degree": 4 if c.any() else 0, "C": c, "S": s_}


def flown(case: dict[str, Any]) -> tuple[F64, F64]:
    """Position and velocity at the times of a case."""
    start = Spacecraft.State(
        r_BN_N=np.array(case["r"]), v_BN_N=np.array(case["v"]), sigma_BN=np.zeros(3), omega_BN_B=np.zeros(3)
    )
    params = Spacecraft.Params(inertia_B=np.eye(3), max_step=case["dt"], **field(case))
    craft, around = Spacecraft("craft", params, start), Surroundings("around")
    around.case = case
    if "planet_r" in case:
        around.out_sun.connect(craft.in_sun)
    else:
        around.out_orientation.connect(craft.in_orientation)
    rec = craft.out_state.record()
    Simulation([Task("truth", s(case["dt"]), [around, craft])]).run_until(case["t_ns"][-1])
    at = np.searchsorted(rec.t_ns, case["t_ns"])
    return rec["r_BN_N"][at], rec["v_BN_N"][at]


def relative(mine: F64, theirs: Any) -> float:
    """Largest error in units of the largest vector."""
    expected = np.array(theirs)
    return float(np.max(np.linalg.norm(mine - expected, axis=1)) / np.max(np.linalg.norm(expected, axis=1)))


def classical(slope: Slope, y: F64, h: float, steps: int) -> list[F64]:
    """All states of the classical Runge-Kutta method."""
    states = [y]
    for k in range(steps):
        t = k * h
        k1 = slope(t, y)
        k2 = slope(t + h / 2, y + h / 2 * k1)
        k3 = slope(t + h / 2, y + h / 2 * k2)
        k4 = slope(t + h, y + h * k3)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if y.size > 6:
            y[6:9] = mrp_inner((y[6], y[7], y[8]))
        states.append(y)
    return states


def equations(case: dict[str, Any]) -> tuple[Slope, F64]:
    """The kernel's equations with forces that act at B of Basilisk, c from the centre of mass; and the start.

    The motion is that of B: r_B = r - dcm_BN' c. Force and torque in the rows of the kernel are those about the
    centre of mass.
    """
    hub, ext = case["hub"], case.get("ext")
    c = np.array(hub["r_BcB_B"])
    r, v, sigma, omega = (np.array(case[name]) for name in ("r", "v", "sigma", "omega"))
    params = Spacecraft.Params(inertia_B=np.array(hub["IHubPntBc_B"]), mass=hub["mass"], mu=case.get("mu", 0.0), j2=0.0)
    craft = Spacecraft("craft", params, Spacecraft.State(r_BN_N=r, v_BN_N=v, sigma_BN=sigma, omega_BN_B=omega))
    views = [row.view(np.recarray)[0] for row in craft.kernel_rows()]
    row: dict[str, Any] = dict(zip(("params", "state", *craft.kernel_ports), views, strict=True))
    names = ("in_orientation", "in_sun", "in_moon", "in_atmosphere", "in_eclipse")
    scene = Scene(0, row["params"], *(row[n] for n in names))
    turn = inverse(mat3(row["params"].inertia_B))
    world = World(scene, row["in_torque"], row["in_force"], row["in_field"], turn, ext is not None)
    if ext is not None:
        row["in_torque"]["seq"] = row["in_force"]["seq"] = 1

    def slope(t: float, y: F64) -> F64:
        dcm_NB, w = Rotation.from_mrp(y[6:9]).as_matrix(), y[9:12]
        if ext is not None:
            force = np.array(ext["force_B"]) + dcm_NB.T @ np.array(ext["force_N"])
            row["in_force"].force_B[:] = force
            row["in_torque"].torque_B[:] = np.array(ext["torque_B"]) - np.cross(c, force)
        r_C, v_C = y[:3] + dcm_NB @ c, y[3:6] + dcm_NB @ np.cross(w, c)
        motion: Any = (tuple(r_C), tuple(v_C), tuple(y[6:9]), tuple(w), (0.0, 0.0, 0.0))
        rate = [np.array(x) for x in plain(derivative)(motion, 0.0, world)]
        accel = rate[1] - dcm_NB @ (np.cross(rate[3], c) + np.cross(w, np.cross(w, c)))
        return np.concatenate([y[3:6], accel, rate[2], rate[3]])

    dcm_NB = Rotation.from_mrp(sigma).as_matrix()
    return slope, np.concatenate([r - dcm_NB @ c, v - dcm_NB @ np.cross(omega, c), sigma, omega])


def largest_error(case: dict[str, Any], states: list[F64], rows: slice) -> float:
    """Relative of position, velocity, rate, and the angle between attitudes, at some rows of a case."""
    out = {name: np.array(value)[rows] for name, value in case["out"].items()}
    y = np.array([states[round(t / 1e9 / case["dt"])] for t in out["t_ns"]])
    turn = Rotation.from_mrp(y[:, 6:9]).inv() * Rotation.from_mrp(out["sigma_BN"])
    columns = (("r_BN_N", slice(0, 3)), ("v_BN_N", slice(3, 6)), ("omega_BN_B", slice(9, 12)))
    return max(float(turn.magnitude().max()), *(relative(y[:, where], out[name]) for name, where in columns))


def test_harmonics_of_a_planet_that_stands_still(criterion: Criterion) -> None:
    r, v = flown(GRAVITY["fixed"])
    criterion("SPACECRAFT-8", max(relative(r, GRAVITY["fixed"]["r_BN_N"]), relative(v, GRAVITY["fixed"]["v_BN_N"])))


def test_the_sun(criterion: Criterion) -> None:
    """Positions of the message count from the Sun; Basilisk loses the digits that 1e11 m have no room for."""
    case = GRAVITY["sun"]
    r, v = flown(case)
    t = np.array(case["t_ns"])[:, None] / 1e9
    moved = r + np.array(case["planet_r"]) + np.array(case["planet_v"]) * t
    criterion(
        "SPACECRAFT-9", max(relative(moved, case["r_BN_N"]), relative(v + np.array(case["planet_v"]), case["v_BN_N"]))
    )


def test_a_turning_planet(criterion: Criterion) -> None:
    """With Basilisk's matrix, M + M' (t - t_message), the same orbit; the module turns the planet rigidly."""
    case = GRAVITY["turning"]
    given = field(case)
    w, h = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]) * case["spin"]["w"], case["dt"]

    def step(stamp: float, y: F64) -> F64:
        """The message of a step has the time of its end."""

        def slope(t: float, y: F64) -> F64:
            m = spin(case, stamp) + w @ spin(case, stamp) * (t - h)
            r_E: Any = tuple(m @ y[:3])
            g = harmonic_acceleration(r_E, given["mu"], given["radius"], 4, given["C"], given["S"])
            return np.concatenate([y[3:], m.T @ np.array(g)])

        return classical(slope, y, h, 1)[1]

    states = [np.array([*case["r"], *case["v"]])]
    for k in range(1000):
        states.append(step((k + 1) * h, states[-1]))
    y = np.array([states[round(t / 1e9 / h)] for t in case["t_ns"]])
    criterion("SPACECRAFT-10", max(relative(y[:, :3], case["r_BN_N"]), relative(y[:, 3:], case["v_BN_N"])))
    r, _ = flown(case)
    assert relative(r, case["r_BN_N"]) < 1e-8  # (w h)^2 / 2 of a step makes their planet larger


def test_forces_away_from_the_centre_of_mass(criterion: Criterion) -> None:
    case = FORCES["forces"]
    slope, start = equations(case)
    states = classical(slope, start, case["dt"], 1000)
    assert largest_error(case, states, slice(0, 1)) < 1e-15
    criterion("SPACECRAFT-11", largest_error(case, states, slice(None)))


def test_one_evaluation_a_step(criterion: Criterion) -> None:
    """Euler's method: nothing but the equations of motion."""
    case = FORCES["euler"]
    slope, y = equations(case)
    states = [y]
    for k in range(200):
        y = y + case["dt"] * slope(k * case["dt"], y)
        y[6:9] = mrp_inner((y[6], y[7], y[8]))
        states.append(y)
    assert largest_error(case, states, slice(0, 1)) < 1e-15
    criterion("SPACECRAFT-12", largest_error(case, states, slice(None)))
