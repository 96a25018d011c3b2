"""SimpleNav against Basilisk without errors, and its errors against the theory of Gauss-Markov processes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fsw import Module, Out, Simulation, Task, s
from messages.base import F64
from messages.states import SCStatesMsg
from sim.sensors.simple_nav import SimpleNav
from tests.sim.sensors.sensor_rig import AVERAGES, allan_deviation, allan_of, series

Criterion = Callable[[str, float], None]
R, V = np.array([7e6, -1e6, 2e6]), np.array([1e3, 7e3, -2e3])
SIGMA, OMEGA = np.array([0.1, -0.4, 0.5]), np.array([0.01, 0.02, -0.03])


class Truth(Module):
    """A constant state."""

    out_state = Out(SCStatesMsg)
    state = SCStatesMsg(r_BN_N=R, v_BN_N=V, sigma_BN=SIGMA, omega_BN_B=OMEGA, omegaDot_BN_B=np.zeros(3))

    def step(self, t_ns: int) -> None:
        self.out_state.write(self.state, t_ns)


def test_against_basilisk(criterion: Criterion) -> None:
    path = Path(__file__).parents[2] / "data" / "basilisk_simple_nav.json"
    cases: list[dict[str, Any]] = json.loads(path.read_text())["cases"]
    worst = 0.0
    for case in cases:
        truth, nav = Truth("truth"), SimpleNav("nav")
        truth.out_state.connect(nav.in_state)
        names = ("r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B")
        truth.state = SCStatesMsg(**{k: np.array(case["sc"][k]) for k in names}, omegaDot_BN_B=np.zeros(3))
        truth.step(0)
        nav.step(0)
        att, trans = nav.out_att.latest(), nav.out_trans.latest()
        assert att is not None
        assert trans is not None
        for mine, theirs in [
            (trans.r_BN_N, case["trans"]["r_BN_N"]),
            (trans.v_BN_N, case["trans"]["v_BN_N"]),
            (att.sigma_BN, case["att"]["sigma_BN"]),
            (att.omega_BN_B, case["att"]["omega_BN_B"]),
        ]:
            worst = max(worst, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
    criterion("NAV-1", worst)


def test_errors_are_gauss_markov(criterion: Criterion) -> None:
    """Variance from the first sample on, and correlation over three spans of time, of 12 x 40,000 draws."""
    truth = Truth("truth")
    params = SimpleNav.Params(sigma_r=10.0, sigma_v=0.01, sigma_att=1e-4, sigma_rate=1e-5, tau=20.0)
    nav = SimpleNav("nav", params)
    truth.out_state.connect(nav.in_state)
    trans, att = nav.out_trans.record(), nav.out_att.record()
    Simulation([Task("truth", s(5), [truth, nav])], seed=8).run_until(s(5 * 39_999))
    turn = Rotation.from_mrp(SIGMA).inv() * Rotation.from_mrp(att["sigma_BN"])
    error = np.concatenate(
        [
            (trans["r_BN_N"] - R) / 10.0,
            (trans["v_BN_N"] - V) / 0.01,
            turn.as_rotvec() / 1e-4,
            (att["omega_BN_B"] - OMEGA) / 1e-5,
        ],
        axis=1,
    )
    worst = abs(float(np.mean(error**2)) - 1.0)
    for lag, expected in [(1, np.exp(-0.25)), (4, np.exp(-1.0)), (40, 0.0)]:
        worst = max(worst, abs(float(np.mean(error[lag:] * error[:-lag])) - expected))
    correlation = error.T @ error / len(error) - np.eye(12)
    assert np.max(np.abs(correlation)) < 4.5 * np.sqrt(2 * 4 / len(error))  # some 8 samples a correlation time
    criterion("NAV-2", worst)


def test_nothing_before_the_first_state() -> None:
    truth, nav = Truth("truth"), SimpleNav("nav")
    truth.out_state.connect(nav.in_state)
    nav.step(0)
    assert nav.out_att.latest() is None
    assert nav.out_trans.latest() is None


def test_errors_walk(criterion: Criterion) -> None:
    """Allan deviation of the position: a random walk, and a Gauss-Markov error, for averages over 1 to 256 samples."""
    worst = 0.0
    for dt, walk, sigma in [(1.0, 0.2, 0.0), (0.5, 0.2, 0.0), (1.0, 0.0, 3.0), (0.5, 0.0, 3.0)]:
        params = SimpleNav.Params(walk_r=walk, sigma_r=sigma, tau=20.0)
        y = series([SimpleNav(f"nav_{k}", params) for k in range(8)], "r_BN_N", dt, 40_000)

        def covariance(i: F64, j: F64, dt: float = dt, walk: float = walk, sigma: float = sigma) -> F64:
            return walk**2 * dt * np.minimum(i, j) + sigma**2 * np.exp(-np.abs(i - j) * dt / 20.0)

        ratios = [allan_deviation(y, m) / allan_of(covariance, m) for m in AVERAGES]
        worst = max(worst, *(abs(r - 1.0) for r in ratios))
    criterion("NAV-3", worst)


def test_each_walk_has_its_own_density() -> None:
    """After 100 s, 300 random walks of each kind: standard deviation 10 times the density; 4 standard errors."""
    params = SimpleNav.Params(walk_r=0.2, walk_v=1e-3, walk_att=1e-6, walk_rate=1e-7)
    navs = [SimpleNav(f"nav_{k}", params) for k in range(100)]
    truth = Truth("truth")
    for nav in navs:
        truth.out_state.connect(nav.in_state)
    Simulation([Task("truth", s(50), [truth, *navs])], seed=2).run_until(s(100))
    trans, att = zip(*[(n.out_trans.latest(), n.out_att.latest()) for n in navs], strict=True)
    turn = Rotation.from_mrp(SIGMA).inv() * Rotation.from_mrp([a.sigma_BN for a in att if a])
    for error, density in [
        ([t.r_BN_N - R for t in trans if t], 0.2),
        ([t.v_BN_N - V for t in trans if t], 1e-3),
        (turn.as_rotvec(), 1e-6),
        ([a.omega_BN_B - OMEGA for a in att if a], 1e-7),
    ]:
        assert abs(np.sqrt(np.mean(np.square(error))) / (10.0 * density) - 1.0) < 4 / np.sqrt(2 * 300)
