"""GroundTargetPoint against ERFA's ellipsoid, differences along an orbit, and scipy's alignment of two vectors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
import rasterio
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from fsw import Module, ModuleError, Out, Simulation, Task, ms, s
from fsw.imaging.maps import MapError
from messages.attitude import AttRefMsg, TargetViewMsg
from messages.base import F64
from messages.environment import PlanetOrientationMsg
from messages.states import NavTransMsg
from modules.guidance.ground_target_point import GroundTargetPoint
from modules.guidance.ground_target_point.heights import ground_height

Criterion = Callable[[str, float], None]
MU = 3.986004415e14
TURN = 7.292115e-5
PARIS: dict[str, Any] = {"lat": 0.8527, "lon": 0.04105, "height": 80.0}


def earth(t: float) -> F64:
    """dcm_EN, turned about a pole that is a little off the z axis of N."""
    tilt = Rotation.from_rotvec([0.002, -0.001, 0.0]).as_matrix()
    return Rotation.from_rotvec([0.0, 0.0, 0.3 + TURN * t]).as_matrix().T @ tilt


OMEGA = TURN * earth(0.0)[2]


def place_N(t: float, **place: float) -> F64:
    r_E = np.asarray(erfa.gd2gc(1, place["lon"], place["lat"], place["height"]), np.float64)
    return np.asarray(earth(t).T @ r_E, np.float64)


def orbit(t: float) -> tuple[F64, F64]:
    """A pass over Paris at 500 km, the time 0 being 120 s before its highest point; two-body motion by DOP853."""
    up = place_N(120.0, **PARIS)
    up = up / np.linalg.norm(up)
    along = np.cross(np.cross(up, [0.3, -0.2, 1.0]), up)
    along /= np.linalg.norm(along)
    side = np.cross(up, along)
    r = 6.878e6 * (np.cos(0.03) * up + np.sin(0.03) * side)
    v = np.sqrt(MU / 6.878e6) * along

    def slope(_: float, y: F64) -> F64:
        return np.concatenate([y[3:], -MU * y[:3] / np.linalg.norm(y[:3]) ** 3])

    end = solve_ivp(slope, (0.0, t - 120.0), np.concatenate([r, v]), "DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    return end[:3], end[3:]


class Feed(Module):
    """Position and orientation at chosen times."""

    out_trans = Out(NavTransMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def step(self, t_ns: int) -> None:
        r, v = orbit(t_ns * 1e-9)
        self.out_trans.write(NavTransMsg(r_BN_N=r, v_BN_N=v), t_ns)
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=earth(t_ns * 1e-9), omega_EN_N=OMEGA), t_ns)


def wired(**params: Any) -> tuple[Feed, GroundTargetPoint]:
    feed, point = Feed("feed"), GroundTargetPoint("point", GroundTargetPoint.Params(**{**PARIS, **params}))
    feed.out_trans.connect(point.in_trans)
    feed.out_orientation.connect(point.in_orientation)
    return feed, point


def look(t_s: float, old_s: float = 0.0, **params: Any) -> tuple[AttRefMsg, TargetViewMsg]:
    """The reference at a time, from messages that are so old."""
    feed, point = wired(**params)
    feed.step(s(t_s - old_s))
    point.step(s(t_s))
    ref, view = point.out_ref.latest(), point.out_view.latest()
    assert ref is not None
    assert view is not None
    return ref, view


def attitude(ref: AttRefMsg) -> Rotation:
    """Maps R to N components."""
    return Rotation.from_mrp(ref.sigma_RN.copy())


def test_axis_meets_the_place(criterion: Criterion) -> None:
    """Angle between the axis and the line to ERFA's place, rad; and the second axis is where scipy's is."""
    rng = np.random.default_rng(4)
    worst = 0.0
    for t in (0.0, 60.0, 120.0, 200.0):
        axis, beside = rng.normal(size=3), rng.normal(size=3)
        ref, _ = look(t, axis_B=axis, beside_B=beside)
        r, v = orbit(t)
        sight = place_N(t, **PARIS) - r
        sight /= np.linalg.norm(sight)
        looks = attitude(ref).apply(axis / np.linalg.norm(axis))
        worst = max(worst, float(np.linalg.norm(looks - sight)))
        normal = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
        best = Rotation.align_vectors([sight, normal], [axis / np.linalg.norm(axis), beside], [np.inf, 1.0])[0]
        assert (attitude(ref).inv() * best).magnitude() < 1e-7
    criterion("GROUND-1", worst)


def test_rate_and_acceleration(criterion: Criterion) -> None:
    """Central differences over 0.1 s in the middle of a pass, relative; the rate is some 0.7 deg/s there."""
    worst_rate, worst_acceleration = 0.0, 0.0
    for t in (30.0, 100.0, 120.0, 170.0):
        here, before, after = look(t)[0], look(t - 0.05)[0], look(t + 0.05)[0]
        omega = (attitude(after) * attitude(before).inv()).as_rotvec() / 0.1
        domega = (after.omega_RN_N - before.omega_RN_N) / 0.1
        size = float(np.linalg.norm(omega))
        worst_rate = max(worst_rate, float(np.linalg.norm(omega - here.omega_RN_N)) / size)
        largest = float(np.linalg.norm(look(60.0)[0].domega_RN_N))
        worst_acceleration = max(worst_acceleration, float(np.linalg.norm(domega - here.domega_RN_N)) / largest)
    assert np.linalg.norm(look(120.0)[0].omega_RN_N) > 0.01
    criterion("GROUND-2", worst_rate)
    criterion("GROUND-3", worst_acceleration)


def test_old_messages_are_moved_on(criterion: Criterion) -> None:
    """Reference from messages 1 s old against that from new ones, rad."""
    turn = attitude(look(100.0)[0]) * attitude(look(100.0, 1.0)[0]).inv()
    criterion("GROUND-4", float(turn.magnitude()))


def test_view(criterion: Criterion) -> None:
    """Elevation, range and angle to the centre, against east, north, up of the place by numpy and ERFA."""
    worst = 0.0
    for t in (0.0, 90.0, 240.0):
        _, view = look(t)
        r, _ = orbit(t)
        away = earth(t) @ (r - place_N(t, **PARIS))
        lat, lon = PARIS["lat"], PARIS["lon"]
        up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
        elevation = np.arcsin(away @ up / np.linalg.norm(away))
        worst = max(worst, abs(view.elevation - float(elevation)), abs(view.range / float(np.linalg.norm(away)) - 1.0))
        cosine = (earth(t) @ r) @ away / np.linalg.norm(r) / np.linalg.norm(away)
        worst = max(worst, abs(view.off_nadir - float(np.arccos(cosine))))
    criterion("GROUND-5", worst)


def test_below_the_horizon() -> None:
    feed, point = wired()
    with pytest.raises(ModuleError, match=r"point.*below the horizon"):
        Simulation([Task("flight", s(200), [feed, point], phase=s(600))]).run_until(s(600))
    assert point.out_ref.latest() is None
    _, view = look(600.0, stop_below=False)
    assert not view.visible
    assert view.elevation < 0.0
    _, view = look(120.0, stop_below=False, least_elevation=1.5)
    assert not view.visible
    _, view = look(120.0)
    assert view.visible


def test_height_of_a_place(tmp_path: Path) -> None:
    """Bilinear between pixel centres of a file of one degree; nothing beyond it."""
    heights = np.array([[100.0, 200.0, 300.0], [400.0, 500.0, 600.0], [700.0, 800.0, 900.0]], np.float32)
    place = rasterio.Affine(1.0, 0.0, 10.0, 0.0, -1.0, 50.0)
    form: dict[str, Any] = {"driver": "GTiff", "width": 3, "height": 3, "count": 1, "dtype": "float32"}
    with rasterio.open(tmp_path / "dem.tif", "w", crs="EPSG:4326", transform=place, **form) as file:
        file.write(heights, 1)
    at = np.radians([49.25, 11.0])
    assert ground_height(tmp_path / "dem.tif", *at.tolist()) == pytest.approx(0.75 * 150.0 + 0.25 * 450.0, rel=1e-6)
    with pytest.raises(MapError, match=r"no height at latitude 20.0"):
        ground_height(tmp_path / "dem.tif", *np.radians([20.0, 11.0]).tolist())


def test_old_and_bad_messages() -> None:
    feed, point = wired(max_age=10.0)
    feed.step(0)
    point.step(s(11))
    assert point.out_ref.latest() is None
    point.step(ms(9500))
    assert point.out_ref.seq == 1
    feed.out_orientation.row["dcm_EN"] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        point.step(s(10))
    feed.out_trans.row["r_BN_N"] = np.nan
    with pytest.raises(ValueError, match="no orbital plane"):
        point.step(s(10))
    assert point.out_ref.seq == 1


def test_wrong_parameters() -> None:
    with pytest.raises(ValueError, match="beside_B: expected an axis that is not along"):
        wired(beside_B=np.array([0.0, 0.0, 2.0]))
    with pytest.raises(ValueError, match=r"<= 1\.5708"):
        wired(lat=48.0)
