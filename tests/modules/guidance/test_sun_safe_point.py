"""SunSafePoint against Basilisk, and the Sun's direction from cells against least squares by numpy."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw import Module, Out
from messages.attitude import AttGuidMsg, SunDirectionMsg
from messages.base import F64
from messages.sensors import CSSArraySensorMsg, IMUSensorMsg
from modules.guidance.sun_safe_point import SunSafePoint
from modules.guidance.sun_safe_point.module import NORMALS_B

Criterion = Callable[[str, float], None]


class Feed(Module):
    """Holds what a test writes."""

    out_css = Out(CSSArraySensorMsg)
    out_imu = Out(IMUSensorMsg)


def wired(**params: Any) -> tuple[Feed, SunSafePoint]:
    feed, point = Feed("feed"), SunSafePoint("point", SunSafePoint.Params(**params))
    feed.out_css.connect(point.in_css)
    feed.out_imu.connect(point.in_imu)
    return feed, point


def errors(feed: Feed, point: SunSafePoint, signal: Any, omega: Any) -> tuple[AttGuidMsg, SunDirectionMsg]:
    feed.out_css.write(CSSArraySensorMsg(signal=np.array(signal)), 0)
    feed.out_imu.write(IMUSensorMsg(omega_PN_P=np.array(omega), accel_P=np.full(3, np.nan)), 0)
    point.step(0)
    guid, sun = point.out_guid.latest(), point.out_sun.latest()
    assert guid is not None
    assert sun is not None
    return guid, sun


def cells(sun: Any, normals: F64 = NORMALS_B) -> F64:
    """Ideal currents."""
    return np.maximum(normals @ np.array(sun), 0.0)


def test_against_basilisk(criterion: Criterion) -> None:
    """Random, opposite, equal and no Sun. At half a turn Basilisk chooses another way about, which is as short."""
    path = Path(__file__).parents[2] / "data" / "basilisk_sun_safe_point.json"
    worst = 0.0
    for case in json.loads(path.read_text())["cases"]:
        feed, point = wired(
            axis_B=np.array(case["axis_B"]),
            threshold=0.0,
            search_rate_B=np.array(case["search_B"]),
            spin_rate=case["spin_rate"],
        )
        mine, _ = errors(feed, point, cells(case["sun_B"]), case["omega_BN_B"])
        if np.linalg.norm(case["sigma_BR"]) < 0.999:
            worst = max(worst, float(np.max(np.abs(mine.sigma_BR - case["sigma_BR"]))))
        else:
            np.testing.assert_allclose(np.linalg.norm(mine.sigma_BR), 1.0, rtol=1e-12)
        worst = max(worst, float(np.max(np.abs(mine.omega_BR_B - case["omega_BR_B"]))))
        worst = max(worst, float(np.max(np.abs(mine.omega_RN_B - case["omega_RN_B"]))))
    criterion("SUNSAFE-1", worst)


def test_direction_by_least_squares(criterion: Criterion) -> None:
    """Cells on a pyramid with noise, one to five of them lit; numpy's shortest solution."""
    rng = np.random.default_rng(2)
    worst, lit_counts = 0.0, set[int]()
    for k in range(60):
        normals = rng.normal(size=(6, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        sun = rng.normal(size=3)
        signal = cells(sun / np.linalg.norm(sun), normals) + 0.02 * rng.normal(size=6)
        signal[rng.permutation(6)[: k % 5]] = 0.0
        lit = signal > 0.1
        if not lit.any() or (lit.sum() > 1 and np.linalg.svd(normals[lit], compute_uv=False)[-1] < 0.1):
            continue
        weight = np.sqrt(signal[lit])
        expected = np.linalg.lstsq(weight[:, None] * normals[lit], weight * signal[lit])[0]
        feed, point = wired(normals_B=normals, least_light=0.05)
        _, found = errors(feed, point, signal, np.zeros(3))
        assert found.valid == (np.linalg.norm(expected) >= 0.05)
        if found.valid:
            lit_counts.add(int(lit.sum()))
            worst = max(worst, float(np.linalg.norm(found.u_SB_B - expected / np.linalg.norm(expected))))
    assert lit_counts >= {1, 2, 3, 4}
    criterion("SUNSAFE-2", worst)


def test_dark_and_earthshine() -> None:
    """What the planet throws back is too weak to be the Sun; then the body is to turn at the search rate."""
    search = np.array([0.0, 0.01, 0.0])
    for signal in (np.zeros(6), 0.2 * cells([0.6, 0.0, 0.8])):
        guid, sun = errors(*wired(search_rate_B=search), signal, [0.0, 0.03, 0.0])
        assert not sun.valid
        assert np.all(np.isnan(sun.u_SB_B))
        np.testing.assert_array_equal(guid.sigma_BR, 0.0)
        np.testing.assert_allclose(guid.omega_BR_B, [0.0, 0.02, 0.0], rtol=1e-15)


def test_mounting_of_the_gyro() -> None:
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    omega = np.array([0.1, 0.2, 0.3])
    guid, _ = errors(*wired(dcm_PB=turn), cells([0.0, 0.0, 1.0]), turn @ omega)
    np.testing.assert_allclose(guid.omega_BR_B, omega, rtol=1e-15)


def test_bad_gyro_publishes_nothing_and_bad_cells_are_dark() -> None:
    feed, point = wired()
    point.step(0)
    assert point.out_guid.latest() is None
    errors(feed, point, cells([0.0, 0.0, 1.0]), np.zeros(3))
    feed.out_imu.row["omega_PN_P"][0, 1] = np.nan
    point.step(1)
    assert point.out_guid.seq == 1
    feed.out_imu.row["omega_PN_P"] = 0.0
    feed.out_css.row["signal"][0, 1] = np.nan
    point.step(2)
    sun = point.out_sun.latest()
    assert sun is not None
    assert not sun.valid


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"axis_B": np.zeros(3)}, "axis_B: expected a vector longer"),
        ({"normals_B": 2.0 * NORMALS_B}, "normals_B: expected unit vectors"),
        ({"dcm_PB": np.ones((3, 3))}, "rotation matrix"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        SunSafePoint.Params(**change)
