"""S15: the tests of Basilisk's own filters, on both unscented filters: propagation, energy, velocity kick."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks.scenarios.feed import fed
from benchmarks.scenarios.result import Scenario
from fsw import s
from fsw.math.kepler import elements_to_rv, mean_motion, mean_to_true
from messages.base import F64
from messages.opnav import OpNavMsg
from modules.estimation.pixel_line_bias_ukf import PixelLineBiasUkf
from modules.estimation.relative_od_ukf import RelativeOdUkf
from modules.estimation.relative_od_ukf.basilisk import gravity_km

MU = gravity_km(499) * 1e9
"""That of Basilisk's tests [m^3/s^2]."""
A, E, TILT, NODE, PERIAPSIS, ANOMALY = 4000e3, 0.2, math.radians(10), math.radians(0.001), math.radians(0.01), 0.3
"""The orbit of Basilisk's tests about Mars."""
KICK = np.array([-100.0, 100.0, 200.0])
SIGMA_M = math.sqrt(0.05)


def orbit(t: float) -> F64:
    """State (6,) by Kepler's equation."""
    mean = ANOMALY + mean_motion(A, E, MU) * t
    r, v = elements_to_rv((A, E, TILT, NODE, PERIAPSIS, mean_to_true(mean, E)), MU)
    return np.array([*r, *v])


def energy(x: F64) -> float:
    """Of a unit of mass [J/kg]."""
    return float(0.5 * x[3:6] @ x[3:6] - MU / np.linalg.norm(x[:3]))


def propagated(n: int, basilisk: bool) -> tuple[float, float, float]:
    """Relative errors after an hour in steps of ten seconds: from the same Runge-Kutta, from Kepler, of the energy."""
    start = orbit(0.0)
    compat: dict[str, Any] = {"basilisk": True, "alpha": 0.02} if basilisk else {"max_step": 10.0}
    P = np.diag([1e-6] * 3 + [1e-12] * 3 + [1.0] * (n - 6))  # a wide one would move the mean, as it should
    given: dict[str, Any] = {
        "body_id": 499,
        "mu": MU,
        "r_CP_N": start[:3],
        "v_CP_N": start[3:],
        "P": P,
        "process_noise": np.zeros((n, n)),
        **compat,
    }
    ukf: Any = (
        RelativeOdUkf("ukf", RelativeOdUkf.Params(**given))
        if n == 6
        else PixelLineBiasUkf("ukf", PixelLineBiasUkf.Params(**given))
    )
    fed(ukf)
    for k in range(361):
        ukf.step(s(10 * k))
    x = ukf.out_filter.latest().x
    same = start
    for _ in range(360):
        same = _step(same, 10.0)
    return distance(x[:6], same), distance(x[:6], orbit(3600.0)), abs(energy(x) / energy(start) - 1.0)


def distance(x: F64, truth: F64) -> float:
    """Larger relative error of position and velocity."""
    parts = slice(0, 3), slice(3, 6)
    return float(max(np.linalg.norm(x[p] - truth[p]) / np.linalg.norm(truth[p]) for p in parts))


def kicked(basilisk: bool) -> tuple[float, float]:
    """Largest ratio of final to first variance, and the relative error of the final state, after a velocity kick."""
    rng = np.random.default_rng(15)
    start = orbit(0.0)
    P = np.diag([1e8] * 3 + [1e4] * 3)
    compat: dict[str, Any] = (
        {"basilisk": True, "alpha": 0.02, "process_noise": np.diag([1e-11] * 3 + [1e-7] * 3)}
        if basilisk
        else {"process_noise": np.diag([0.0] * 3 + [1.0] * 3), "gate": 0.0}
    )
    params: dict[str, Any] = {"body_id": 499, "mu": MU, "r_CP_N": start[:3], "v_CP_N": start[3:], "P": P, **compat}
    ukf = RelativeOdUkf("ukf", RelativeOdUkf.Params(**params))
    port, truth = fed(ukf)["in_position"], start.copy()
    zero = {f"r_CP_{f}": np.zeros(3) for f in "BC"} | {f"P_rr_{f}": np.zeros((3, 3)) for f in "BC"}
    for t in range(2001):
        if t == 250:
            truth[3:] += KICK
        if t % 50 == 0:
            seen = truth[:3] + SIGMA_M * rng.normal(size=3)
            message = OpNavMsg(
                exposure_ns=s(t),
                valid=True,
                status=0,
                fault_detected=False,
                body_id=499,
                r_CP_N=seen,
                P_rr_N=0.05 * np.eye(3),
                **zero,
            )
            port.write(message, s(t))
        ukf.step(s(t))
        if t < 2000:
            truth = _step(truth, 1.0)
    answer = ukf.out_filter.latest()
    assert answer is not None
    ratio = float(np.max(np.diag(answer.P) / np.diag(P)))
    return ratio, float(np.linalg.norm(answer.x - truth) / np.linalg.norm(truth))


def _step(x: F64, dt: float) -> F64:
    def slope(y: F64) -> F64:
        return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    a = slope(x)
    b = slope(x + 0.5 * dt * a)
    c = slope(x + 0.5 * dt * b)
    return x + dt / 6.0 * (a + 2.0 * b + 2.0 * c + slope(x + dt * c))


def study() -> list[Scenario]:
    """The table."""
    columns = (
        "1 h: to Runge-Kutta (1e-10)",
        "to Kepler",
        "energy (1e-10)",
        "kick: variance, last over first (0.01)",
        "kick: state (0.1)",
    )
    lines = ["| filter | " + " | ".join(columns) + " |", "|---" * 6 + "|"]
    for name, n, basilisk in (
        ("relativeODuKF, reproduced", 6, True),
        ("RelativeOdUkf", 6, False),
        ("pixelLineBiasUKF, reproduced", 9, True),
        ("PixelLineBiasUkf", 9, False),
    ):
        same, exact, power = propagated(n, basilisk)
        kick = "- | -"
        if n == 6:
            ratio, error = kicked(basilisk)
            kick = f"{ratio:.1e} | {error:.1e}"
        lines.append(f"| {name} | {same:.1e} | {exact:.1e} | {power:.1e} | {kick} |")
    text = (
        "Mars orbit of a = 4,000 km and e = 0.2. An hour of prediction in steps of 10 s, and a velocity kick of "
        "(-100, 100, 200) m/s at 250 s of 2,000 s with a position of 0.22 m every 50 s. Relative errors; the "
        "criteria of Basilisk's tests are in brackets. Each method to 1e-15 is a test: tests/modules/estimation."
    )
    return [Scenario("S15", "the tests of Basilisk's filters", text, (), lines)]
