"""Filters side by side: both unscented filters of orbits with Basilisk's, and the Earth tracker's with 50 landmarks.

Each is fed with a new measurement at every tick: here by a kernel that reads a table, there by Python that writes
messages between single steps. Many filters are fed at once, and a run with one of them, timed in turns, is taken away.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.timing import Figure, Line, interleaved, slope_figure, timed
from fsw import F64, KernelModule, Module, Out, Record, Row, Shape, Simulation, Task, publish, s
from fsw.math.camera import lens_vector
from fsw.math.compiled import plain
from fsw.math.kepler import elements_to_rv
from fsw.math.vectors import vec3
from messages.environment import PlanetOrientationMsg
from messages.opnav import CameraConfigMsg, LandmarksMsg, OpNavCirclesMsg, OpNavMsg
from messages.states import NavAttMsg
from modules.estimation.earth_tracker_ekf import EarthTrackerEkf
from modules.estimation.pixel_line_bias_ukf import PixelLineBiasUkf
from modules.estimation.pixel_line_bias_ukf.limb import POINTS, WORK, limb_circle
from modules.estimation.relative_od_ukf import RelativeOdUkf

ROWS, LANDMARKS, MANY = 400, 50, 11
STEP_S = 50
MU, RADIUS = 4.2828314e13, 3396.19e3
SIZE, FIELD = 512, math.radians(60.0)
SPREAD = np.array([3e4] * 3 + [2.0] * 3 + [1.4] * 3)
"""Standard deviation of the first guess: m, m/s, px."""
DENSITY = np.diag([1e-2] * 3 + [1e-4] * 3 + [1e-12] * 3)
UKF_BAR, EKF_BAR_US = 0.5, 60.0
PIXEL_FILTER, ORBIT_FILTER = "PixelLineBiasUkf", "RelativeOdUkf"


class Course(Record):
    """What a camera at Mars, turned to it, measures at each tick."""

    start: Annotated[F64, Shape(6), "m, m/s", "the first state"]
    table: Annotated[F64, Shape(ROWS, 9), "-, px, m", "sigma_BN; column, row, radius; position"]


def camera(distorted: bool = False) -> CameraConfigMsg:
    """Of 60 degrees and 512 pixels."""
    return CameraConfigMsg(
        width_px=SIZE,
        height_px=SIZE,
        focal_px=np.full(2, SIZE / 2 / math.tan(FIELD / 2)),
        center_px=np.full(2, (SIZE - 1) / 2),
        distortion=np.array([-0.1, 0.02, 1e-3, -5e-4, 0.0]) if distorted else np.zeros(5),
    )


def course(seed: int = 1) -> Course:
    """An ellipse about Mars; the boresight points at the planet, where both sides expect the same circle."""
    rng, lens = np.random.default_rng(seed), lens_vector(camera())
    elements = (18e6, 0.4, math.radians(10), 0.001, 0.01, 0.1)
    start = np.array(plain(elements_to_rv)(elements, MU)).ravel()
    x, table, h = start.copy(), np.empty((ROWS, 9)), 0.1 * STEP_S
    limb = np.empty((WORK, POINTS))
    for k in range(ROWS):
        for _ in range(10):
            x[3:] -= 0.5 * h * MU * x[:3] / np.linalg.norm(x[:3]) ** 3
            x[:3] += h * x[3:]
            x[3:] -= 0.5 * h * MU * x[:3] / np.linalg.norm(x[:3]) ** 3
        z = -x[:3] / np.linalg.norm(x[:3])
        side = np.cross(z, [0.3, 0.2, 0.9])
        side /= np.linalg.norm(side)
        dcm = np.array([side, np.cross(z, side), z])
        one = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        _, circle = plain(limb_circle)(lens, (RADIUS, RADIUS, RADIUS), one, plain(vec3)(dcm @ x[:3]), limb, np.zeros(2))
        noise = rng.normal(size=6)
        table[k] = [
            *np.asarray(Rotation.from_matrix(dcm.T).as_mrp()),
            *(np.array(circle) + 0.5 * noise[:3]),
            *(x[:3] + 1e4 * noise[3:]),
        ]
    return Course(start=start, table=table)


class Feed(KernelModule):
    """Writes a row of a course at each step."""

    Params = Course

    class State(Record):
        """Which row is next."""

        row: Annotated[int, "-", "row"] = 0

    out_circles = Out(OpNavCirclesMsg)
    out_position = Out(OpNavMsg)
    out_attitude = Out(NavAttMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_circles: Row, out_position: Row, out_attitude: Row) -> None:
        """Write the row."""
        row = params.table[state.row]
        state.row = (state.row + 1) % ROWS
        out_circles.exposure_ns = out_position.exposure_ns = t_ns
        out_circles.valid = out_position.valid = True
        out_circles.body_id, out_position.body_id, out_circles.count = 499, 499, 1
        out_circles.center_px[0, 0], out_circles.center_px[0, 1], out_circles.radius_px[0] = row[3], row[4], row[5]
        for i in range(3):
            out_attitude.sigma_BN[i], out_attitude.omega_BN_B[i] = row[i], 0.0
            out_position.r_CP_N[i] = row[6 + i]
            for j in range(3):
                out_circles.P_px[0, i, j] = 0.25 if i == j else 0.0
                out_position.P_rr_N[i, j] = 1e8 if i == j else 0.0
        publish(out_circles, t_ns)
        publish(out_position, t_ns)
        publish(out_attitude, t_ns)


class Fixed(Module):
    """Camera and orientation, written once before the run."""

    out_camera = Out(CameraConfigMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def step(self, t_ns: int) -> None:
        """Nothing more."""


class Orbits:
    """A graph with unscented filters of one kind."""

    def __init__(self, given: Course, kind: str, count: int, distorted: bool = False) -> None:
        feed, fixed = Feed("feed", given), Fixed("fixed")
        fixed.out_camera.write(camera(distorted), 0)
        start: dict[str, Any] = {"body_id": 499, "mu": MU, "r_CP_N": given.start[:3], "v_CP_N": given.start[3:]}
        self.filters: list[PixelLineBiasUkf | RelativeOdUkf] = []
        for i in range(count):
            if kind == PIXEL_FILTER:
                noise: dict[str, Any] = {"P": np.diag(SPREAD**2), "process_noise": DENSITY}
                params = PixelLineBiasUkf.Params(**start, **noise, axes=np.full(3, RADIUS))
                pixel = PixelLineBiasUkf(f"ukf_{i}", params)
                feed.out_circles.connect(pixel.in_circles)
                feed.out_attitude.connect(pixel.in_attitude)
                fixed.out_camera.connect(pixel.in_camera)
                self.filters.append(pixel)
            else:
                noise = {"P": np.diag(SPREAD[:6] ** 2), "process_noise": DENSITY[:6, :6]}
                orbit = RelativeOdUkf(f"ukf_{i}", RelativeOdUkf.Params(**start, **noise))
                feed.out_position.connect(orbit.in_position)
                self.filters.append(orbit)
        modules: list[Module] = [feed, *self.filters]
        once = Task("once", period=s(10**8), modules=[fixed])
        self.sim = Simulation([once, Task("t", period=s(STEP_S), phase=s(STEP_S), modules=modules)], seed=1)

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods."""
        self.sim.run_for(ticks * s(STEP_S))


class Ground(Record):
    """Landmarks in a fixed view of the ground."""

    r_LE_E: Annotated[F64, Shape(LANDMARKS, 3), "m", "landmarks"]
    pixel_px: Annotated[F64, Shape(LANDMARKS, 2), "px", "where they are seen"]


class GroundFeed(KernelModule):
    """Writes the same landmarks at each step."""

    Params = Ground
    out_landmarks = Out(LandmarksMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_landmarks: Row) -> None:
        """Write them."""
        out_landmarks.exposure_ns, out_landmarks.count, out_landmarks.status = t_ns, LANDMARKS, 0
        for k in range(LANDMARKS):
            out_landmarks.sigma_px[k] = 0.5
            for i in range(3):
                out_landmarks.r_LE_E[k, i] = params.r_LE_E[k, i]
                if i < 2:
                    out_landmarks.pixel_px[k, i] = params.pixel_px[k, i]
        publish(out_landmarks, t_ns)


class Ground50:
    """A graph with Earth tracker filters that hover over landmarks and take all of them at each tick."""

    def __init__(self, count: int) -> None:
        rng, far, focal = np.random.default_rng(3), 6878e3, 2000.0
        pixel = rng.uniform(100.0, 1948.0, (LANDMARKS, 2))
        tangent = (pixel - 1023.5) / focal
        # the camera at far on the x axis looks to nadir, x of C along y of N
        ray = np.column_stack([-np.ones(LANDMARKS), tangent[:, 0], -tangent[:, 1]])
        place = np.array([far, 0.0, 0.0]) + 507e3 * ray
        feed, fixed = GroundFeed("feed", Ground(r_LE_E=place, pixel_px=pixel)), Fixed("fixed")
        fixed.out_camera.write(
            CameraConfigMsg(width_px=2048, height_px=2048, focal_px=np.full(2, focal), center_px=np.full(2, 1023.5)), 0
        )
        speed = math.sqrt(3.986004415e14 / far)
        # the ground goes along with the satellite, so that one table of landmarks is right for ever
        spin = np.array([0.0, 0.0, speed / far])
        fixed.out_orientation.write(PlanetOrientationMsg(dcm_EN=np.eye(3), omega_EN_N=spin), 0)
        params = EarthTrackerEkf.Params(
            r_BN_N=np.array([far, 0.0, 0.0]),
            v_BN_N=np.array([0.0, speed, 0.0]),
            beta_BO=np.array([1.0, 0.0, 0.0, 0.0]),
            P=np.diag(np.repeat([30.0, 0.3, 3e-4, 1e-5], 3) ** 2),
            inertia_B=np.diag([0.04, 0.05, 0.02]),
            j2=0.0,
        )
        self.filters = [EarthTrackerEkf(f"ekf_{i}", params) for i in range(count)]
        for ekf in self.filters:
            feed.out_landmarks.connect(ekf.in_landmarks)
            fixed.out_camera.connect(ekf.in_camera)
            fixed.out_orientation.connect(ekf.in_orientation)
        modules: list[Module] = [feed, *self.filters]
        once = Task("once", period=s(10**8), modules=[fixed])
        self.sim = Simulation([once, Task("t", period=s(1), phase=s(1), modules=modules)], seed=1)

    def run(self, ticks: int) -> None:
        """Run ``ticks`` more periods."""
        self.sim.run_for(ticks * s(1))


def measure(repeats: int, scale: float = 1.0, *, basilisk: bool = True) -> list[Line]:
    """Time one step of each filter.

    Args:
        repeats: how often each is measured.
        scale: of the number of ticks.
        basilisk: whether Basilisk is installed.
    """
    given, ticks = course(), max(20, int(0.9 * ROWS * min(scale, 1.0)))
    cases: dict[str, Callable[[], float]] = {}

    def add(name: str, make: Callable[[], Any], n: int) -> None:
        def once() -> float:
            side = make()
            side.run(20)
            return timed(side.run, n)

        cases[name] = once

    for count in (1, MANY):
        for name, kind, bent in (
            ("pixel", PIXEL_FILTER, False),
            ("bent", PIXEL_FILTER, True),
            ("orbit", ORBIT_FILTER, False),
        ):
            add(f"{name} {count}", lambda k=kind, n=count, b=bent: Orbits(given, k, n, b), ticks)
        add(f"ekf {count}", lambda n=count: Ground50(n), ticks)
        if basilisk:
            from benchmarks import basilisk_filters

            for name, kind in (("bsk pixel", PIXEL_FILTER), ("bsk orbit", ORBIT_FILTER)):
                add(f"{name} {count}", lambda k=kind, n=count: basilisk_filters.Orbits(given, k, n), ticks)
    found = {k: [1e-3 * x for x in v] for k, v in interleaved(cases, repeats).items()}

    def cost(name: str) -> Figure:
        return slope_figure(found[f"{name} {MANY}"], found[f"{name} 1"], MANY - 1)

    lines: list[Line] = []
    for name, own in ((PIXEL_FILTER, "pixel"), (f"{PIXEL_FILTER}, bent lens", "bent"), (ORBIT_FILTER, "orbit")):
        ours, theirs = cost(own), None
        other = "bsk orbit" if own == "orbit" else "bsk pixel"
        if basilisk:
            theirs = cost(other)
        judged = None if theirs is None else ours.least / theirs.least
        lines.append(Line(f"{name}, one step", "µs", ours, theirs, "at least 2 times as fast", judged, UKF_BAR))
    ekf = cost("ekf")
    text = f"EarthTrackerEkf, {LANDMARKS} landmarks"
    lines.append(Line(text, "µs", ekf, None, f"at most {EKF_BAR_US:g} µs", ekf.least, EKF_BAR_US))
    return lines
