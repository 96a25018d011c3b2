"""S12: orbit about Mars from its disk, by every chain there is, with the camera pointed beside the planet."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import msgspec
import numpy as np
from scipy.integrate import solve_ivp as _solve_ivp  # pyright: ignore[reportUnknownVariableType]
from scipy.spatial.transform import Rotation

from benchmarks.scenarios.result import Result, Scenario
from fsw import Module, Simulation, Task, minutes, s
from fsw.math.attitude import mrp_to_dcm
from fsw.math.bodies import body
from fsw.math.compiled import plain
from fsw.math.epoch import epoch
from messages.base import F64
from modules.estimation.analysis import Bound, band, efficiency
from modules.estimation.pixel_line_bias_ukf import PixelLineBiasUkf
from modules.estimation.relative_od_ukf import RelativeOdUkf
from modules.opnav.circle_finder import CircleFinder
from modules.opnav.horizon_nav import HorizonNav
from modules.opnav.limb_finder import LimbFinder
from modules.opnav.pixel_line_converter import PixelLineConverter
from sim.camera.disk_camera import DiskCamera, DiskTruth, disk_body
from sim.environment.ephemeris import Ephemeris
from sim.scenarios.mars_disk.graph import EPOCH, camera_config, mars_attitude
from sim.scenarios.mars_disk.orbit import PointedOrbit
from sim.sensors.simple_nav import SimpleNav

solve_ivp: Any = _solve_ivp  # pyright: ignore[reportUnknownVariableType]
MARS = body("Mars")
A, E = 18000e3, 0.2
EVERY_S = 300
IMAGES = 16
OFFSETS_DEG = 0.0, 5.0, 10.0, 20.0
SIGMA_R, SIGMA_V = 50e3, 20.0
"""Of the initial state, for each axis [m, m/s]."""
EDGE_PX = 0.1
"""Error of an edge for each pixel of the lit limb, for the bound."""
HORN = math.radians(82.0)
CAMERA = DiskCamera.Params(
    center_id=499, psf_sigma_px=0.7, shot_noise=True, full_well=1000.0, read_noise=20.0, bits=12, black_level=0.01
)
P0 = np.diag([SIGMA_R**2] * 3 + [SIGMA_V**2] * 3)
DENSITY = np.diag([0.0] * 3 + [1e-10] * 3)


class Chain(NamedTuple):
    """Modules from the image to the orbit, the first finds and the last is the filter."""

    name: str
    ours: bool
    modules: list[Module]
    note: str = ""


class Flight(NamedTuple):
    """Errors of one run."""

    errors: dict[str, F64]
    """(K, 6) of each chain."""
    P: dict[str, F64]
    bound: F64
    """(K, 6, 6)."""
    ms: dict[str, float]


def chains(r: F64, v: F64, pole_N: F64) -> list[Chain]:
    """Every way from an image to the orbit, from an initial state [m, m/s]."""
    start: dict[str, Any] = {"body_id": 499, "r_CP_N": r, "v_CP_N": v}
    od: dict[str, Any] = {**start, "P": P0, "process_noise": DENSITY}
    nine = np.diag([*np.diag(P0), 4.0, 4.0, 4.0])
    bias: dict[str, Any] = {**start, "P": nine, "process_noise": np.diag([*np.diag(DENSITY), 0.0, 0.0, 0.0])}
    # Basilisk's process noise is that of a call, in km
    per_call = 1e-6 * EVERY_S
    compat: dict[str, Any] = {"basilisk": True, "alpha": 0.02, "kappa": 0.0}
    od_compat: dict[str, Any] = {**od, **compat, "process_noise": DENSITY * per_call}
    return [
        Chain(
            "Basilisk: circle, relativeODuKF",
            False,
            [
                CircleFinder("a_finder", CircleFinder.Params(basilisk=True)),
                PixelLineConverter("a_converter", PixelLineConverter.Params(basilisk=True)),
                RelativeOdUkf("a_filter", RelativeOdUkf.Params(**od_compat)),
            ],
        ),
        Chain(
            "Basilisk: circle, pixelLineBiasUKF",
            False,
            [
                CircleFinder("b_finder", CircleFinder.Params(basilisk=True)),
                PixelLineBiasUkf(
                    "b_filter",
                    PixelLineBiasUkf.Params(**{**bias, **compat, "process_noise": bias["process_noise"] * per_call}),
                ),
            ],
        ),
        Chain(
            "Basilisk: limb, horizonOpNav, relativeODuKF",
            False,
            [
                LimbFinder("c_finder", LimbFinder.Params(basilisk=True)),
                HorizonNav("c_converter", HorizonNav.Params(basilisk=True)),
                RelativeOdUkf("c_filter", RelativeOdUkf.Params(**od_compat)),
            ],
        ),
        Chain(
            "Canny edges, Christian-Robinson",
            False,
            [
                LimbFinder("d_finder", LimbFinder.Params(basilisk=True)),
                HorizonNav("d_converter", HorizonNav.Params(pole_N=pole_N)),
                RelativeOdUkf("d_filter", RelativeOdUkf.Params(**od)),
            ],
            "whole-pixel edges into the published non-iterative solution, as a simple ellipse matching does",
        ),
        Chain(
            "ours: circle, pixel and line filter",
            True,
            [
                CircleFinder("e_finder"),
                PixelLineBiasUkf("e_filter", PixelLineBiasUkf.Params(**bias, pole_N=pole_N)),
            ],
        ),
        Chain(
            "ours: limb, horizon, orbit filter",
            True,
            [
                LimbFinder("f_finder"),
                HorizonNav("f_converter", HorizonNav.Params(pole_N=pole_N)),
                RelativeOdUkf("f_filter", RelativeOdUkf.Params(**od)),
            ],
        ),
    ]


def _connect(sources: dict[str, Any], chain: Chain) -> None:
    """Wire a chain by the names of its ports, the filter last."""
    previous: dict[str, Any] = {}
    for module in chain.modules:
        for name in module.ports:
            port = vars(module)[name]
            if name.startswith("out_"):
                continue
            # Basilisk's filter reads the converter, whose port has another name than the finder's
            source = previous.get(name.removeprefix("in_")) or sources.get(name)
            if source is not None:
                source.connect(port)
        for name in module.ports:
            if name.startswith("out_"):
                previous[name.removeprefix("out_")] = vars(module)[name]


def _gradient(r: F64) -> F64:
    far = float(np.linalg.norm(r))
    return -MARS.mu / far**3 * (np.eye(3) - 3.0 * np.outer(r, r) / far**2)


def transition(r: F64, v: F64, dt: float) -> F64:
    """Derivative (6, 6) of the state after dt [s] by the state now, two bodies."""

    def slope(_: float, y: F64) -> F64:
        Phi = y[6:].reshape(6, 6)
        F = np.zeros((6, 6))
        F[:3, 3:], F[3:, :3] = np.eye(3), _gradient(y[:3])
        return np.concatenate([y[3:6], -MARS.mu * y[:3] / np.linalg.norm(y[:3]) ** 3, (F @ Phi).ravel()])

    start = np.concatenate([r, v, np.eye(6).ravel()])
    done = solve_ivp(slope, (0.0, dt), start, method="DOP853", rtol=1e-10, atol=1e-6)
    return np.asarray(done.y[6:, -1], np.float64).reshape(6, 6)


def limb_information(truth: DiskTruth, focal_px: float) -> F64:
    """Information (3, 3) of a camera's position, C components [1/m^2], from the lit limb of a sphere.

    Each pixel of the limb gives one edge: H = (f / r) (cos phi, sin phi, tan rho), section B2 of the audit: a shift
    across the line of sight moves an edge by its part along the edge's normal, and a shift along it by tan rho.
    """
    far = float(np.linalg.norm(truth.r_PC_C))
    sight = truth.r_PC_C / far
    rho = math.asin(MARS.radius / far)
    limb = truth.limb_px[np.all(np.isfinite(truth.limb_px), axis=1)]
    limb = limb[np.all((limb > 0.0) & (limb < 511.0), axis=1)]
    way = limb - truth.ellipse.center_px
    toward = way @ truth.sun_px / np.linalg.norm(way, axis=1)
    lit = limb[toward > math.cos(HORN)]
    rays = np.column_stack([(lit - 255.5) / focal_px, np.ones(len(lit))])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    across = rays - (rays @ sight)[:, None] * sight
    across /= np.linalg.norm(across, axis=1)[:, None]
    H = focal_px / far * (across - math.tan(rho) * sight)
    perimeter = 2.0 * math.pi * truth.ellipse.semi_major_px
    share = perimeter / len(truth.limb_px)  # pixels of the limb for each point of it
    return H.T @ H * share / EDGE_PX**2


class Graph(NamedTuple):
    """A run ready to go."""

    sim: Simulation
    camera: DiskCamera
    orbit: PointedOrbit
    dcm_CB: F64
    chains: list[Chain]


def build(offset_deg: float, seed: int) -> Graph:
    """One orbit with random plane, place on it, side of the offset, and error of the initial state."""
    rng = np.random.default_rng([seed, round(10.0 * offset_deg)])
    start = epoch(EPOCH)
    angles = rng.uniform(0.0, 2.0 * math.pi, 4)
    orbit = PointedOrbit(
        "orbit",
        PointedOrbit.Params(
            mu=MARS.mu,
            a=A,
            e=E,
            inclination=float(rng.uniform(0.3, 2.8)),
            node=float(angles[0]),
            periapsis=float(angles[1]),
            anomaly=float(angles[2]),
        ),
    )
    sun = Ephemeris("sun", Ephemeris.Params(body_id=10, center_id=499, epoch_tai_ns=start))
    axis = np.array([math.cos(angles[3]), math.sin(angles[3]), 0.0])
    dcm_CB = Rotation.from_rotvec(math.radians(offset_deg) * axis).as_matrix().T
    camera = DiskCamera(
        "camera",
        CAMERA,
        msgspec.structs.replace(camera_config(), dcm_CB=dcm_CB),
        [disk_body("Mars", dcm_PN=mars_attitude(start), albedo=0.55, law="lommel_seeliger")],
    )
    attitude = SimpleNav("attitude")
    orbit.step(0)
    true = orbit.out_state.latest()
    assert true is not None
    error = rng.normal(size=6)
    made = chains(true.r_BN_N + SIGMA_R * error[:3], true.v_BN_N + SIGMA_V * error[3:], mars_attitude(start)[2])
    orbit.out_state.connect(camera.in_state)
    orbit.out_state.connect(attitude.in_state)
    sun.out_ephemeris.connect(camera.in_sun)
    sources = {
        "in_image": camera.out_image,
        "in_camera": camera.out_camera,
        "in_attitude": attitude.out_att,
        "in_sun": sun.out_ephemeris,
    }
    for chain in made:
        _connect(sources, chain)
    flight = [m for chain in made for m in chain.modules]
    tasks = [
        Task("truth", period=minutes(1), modules=[orbit, sun, attitude]),
        Task("camera", period=s(EVERY_S), modules=[camera, *flight]),
    ]
    simulation = Simulation(tasks, seed=seed)
    simulation.timed = True
    return Graph(simulation, camera, orbit, dcm_CB, made)


def fly(offset_deg: float, seed: int) -> Flight:
    """One run: errors, covariances and bound at each image."""
    graph = build(offset_deg, seed)
    errors: dict[str, list[F64]] = {c.name: [] for c in graph.chains}
    P: dict[str, list[F64]] = {c.name: [] for c in graph.chains}
    bound, bounds = Bound(P0), list[F64]()
    before: tuple[F64, F64] | None = None
    focal = float(camera_config().focal_px[0])
    for k in range(IMAGES):
        graph.sim.run_until(s(EVERY_S * k))
        state = graph.orbit.out_state.latest()
        assert state is not None
        if before is not None:
            bound.predict(transition(*before, EVERY_S), np.zeros((6, 6)))
        before = state.r_BN_N, state.v_BN_N
        (disk,) = graph.camera.truths()
        dcm_CN = graph.dcm_CB @ np.array(plain(mrp_to_dcm)(tuple(state.sigma_BN.tolist())))
        values, vectors = np.linalg.eigh(limb_information(disk, focal))
        seen = values > 1e-12 * values[-1]
        H = (vectors[:, seen].T @ np.hstack([dcm_CN, np.zeros((3, 3))])) * np.sqrt(values[seen])[:, None]
        bound.measure(H, np.eye(len(H)))
        bounds.append(bound.covariance())
        truth = np.concatenate(before)
        for chain in graph.chains:
            message = vars(chain.modules[-1])["out_filter"].latest()
            errors[chain.name].append(message.x[:6] - truth if message else np.full(6, np.nan))
            P[chain.name].append(message.P[:6, :6] if message else np.full((6, 6), np.nan))
    spent = {t.module: t.wall_ns / max(t.calls, 1) / 1e6 for t in graph.sim.timing() if t.module}
    return Flight(
        {name: np.array(e) for name, e in errors.items()},
        {name: np.array(p) for name, p in P.items()},
        np.array(bounds),
        {c.name: sum(spent[m.name] for m in c.modules) for c in graph.chains},
    )


def results(flights: list[Flight], scenario: str, chains_made: list[Chain]) -> list[Result]:
    """Figures of every chain over all runs."""
    bound = np.array([f.bound for f in flights])
    sigma: F64 = np.sqrt(np.trace(bound[..., :3, :3], axis1=-2, axis2=-1))
    found: list[Result] = []
    for chain in chains_made:
        e = np.array([f.errors[chain.name] for f in flights])
        P = np.array([f.P[chain.name] for f in flights])
        size = np.linalg.norm(e[..., :3], axis=-1)
        lost = ~(size[:, -1] < 5e5)
        whole = {"rmse": math.nan, "eta": math.nan, "spread": math.nan, "nees": math.nan}
        limits = (math.nan, math.nan)
        kept = ~lost
        if kept.sum() >= 2:
            score = efficiency(e[kept][..., :3], bound[kept][..., :3, :3])
            whole = {"rmse": score.rmse, "eta": score.eta, "spread": 0.5 * (score.high - score.low), "nees": math.nan}
            judged = _nees(e[kept][:, -1], P[kept][:, -1])
            whole["nees"], limits = judged, band(6, int(kept.sum()))
        bar, met = "", None
        if chain.ours and "limb" in chain.name:
            bar = "ratio at most 1.2, NEES in band"
            met = bool(whole["eta"] <= 1.2 and limits[0] <= whole["nees"] <= limits[1] and not lost.any())
        found.append(
            Result(
                scenario,
                chain.name,
                chain.ours,
                len(flights),
                position_m=whole["rmse"],
                bound_m=float(np.sqrt(np.mean(np.square(sigma[:, IMAGES // 2 :])))),
                eta_position=whole["eta"],
                spread=whole["spread"],
                nees=whole["nees"],
                band=limits,
                diverged=int(lost.sum()),
                ms=float(np.median([f.ms[chain.name] for f in flights])),
                bar=bar,
                met=met,
                note=chain.note,
            )
        )
    return found


def _nees(e: F64, P: F64) -> float:
    """Mean normalised square of errors (M, 6); NaN where a covariance is none (Basilisk's may be)."""
    try:
        white = np.asarray(np.linalg.solve(P, e[..., None]), np.float64)
        return float(np.vdot(e, white[..., 0])) / len(e)
    except np.linalg.LinAlgError:
        return math.nan


TEXT = f"""Mars from an orbit of 18,000 km and e = 0.2: {IMAGES} images of 512 x 512 pixels over 55 degrees,
{EVERY_S} s apart, the boresight 0, 5, 10 or 20 degrees beside the centre. Initial error {SIGMA_R / 1e3:.0f} km
and {SIGMA_V:.0f} m/s for each axis. All chains see the same images (lunar-like surface, 1000 electrons full well);
a run with more than 500 km at the end is lost and not in the RMSE. Bound: section B2 with {EDGE_PX} px for each
pixel of the lit limb, in the bound of the orbit."""


def study(offset_deg: float, runs: int) -> list[Scenario]:
    """S12 for one pointing offset."""
    flights = [fly(offset_deg, seed) for seed in range(runs)]
    title = f"orbit about Mars from its disk, {offset_deg:.0f} degrees off the axis"
    text = TEXT if offset_deg == OFFSETS_DEG[0] else ""
    return [Scenario("S12", title, text, results(flights, "S12", build(offset_deg, 0).chains))]
