"""StarVectors against a search with numpy over the whole sky, and its noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages.base import F64
from sim.sensors.star_vectors import CAPACITY, StarVectors, catalogue
from sim.sensors.starlight import C_LIGHT
from tests.sim.sensors.sensor_rig import AVERAGES, Criterion, allan_deviation, measure, series

RNG = np.random.default_rng(11)
SKY = RNG.normal(size=(5000, 3))
MAGNITUDE = RNG.uniform(-1.0, 6.5, 5000)
MOUNTING = Rotation.from_euler("xyz", [30.0, -50.0, 110.0], degrees=True).as_matrix()
R = np.array([0.0, 7e6, 0.0])


def expected(dcm_SN: F64, fov: float, limit: float, beta: F64) -> tuple[list[int], F64]:
    """Rows of the catalogue and directions in S, brightest first; stars behind the planet are left out."""
    sky = SKY / np.linalg.norm(SKY, axis=1)[:, None]
    free = np.arccos(sky @ -R / 7e6) > np.arcsin(6378137.0 / 7e6)
    seen = sky + beta
    seen = (seen / np.linalg.norm(seen, axis=1)[:, None]) @ dcm_SN.T
    rows = np.flatnonzero((np.arccos(seen[:, 2]) < fov) & (limit >= MAGNITUDE) & free)
    rows = rows[np.argsort(MAGNITUDE[rows])][:16]
    return rows.tolist(), seen[rows]


def test_against_a_search_over_the_sky(criterion: Criterion) -> None:
    """Same stars in 60 attitudes, with and without aberration (of first order here, so good to 5e-9)."""
    worst, most, least = 0.0, 0, 16
    for k in range(60):
        body = Rotation.random(rng=RNG)
        fov, limit, moving = (0.1, 6.0, False) if k < 30 else (0.2, 4.0, True)
        params = StarVectors.Params(
            **catalogue(SKY, MAGNITUDE), fov=fov, limit=limit, sigma=0.0, dcm_SB=MOUNTING, aberration=moving
        )
        v_sun = np.array([30e3, 0.0, 0.0])
        truth: dict[str, Any] = {"r_BN_N": R, "v_BN_N": np.zeros(3), "sigma_BN": body.as_mrp(), "v_sun": v_sun}
        message = measure(StarVectors("stars", params), **truth)
        rows, s_S = expected(MOUNTING @ body.as_matrix().T, fov, limit, -v_sun / C_LIGHT * moving)
        assert message.valid
        assert message.count == len(rows)
        assert message.star.tolist() == rows + [-1] * (16 - len(rows))
        assert np.isnan(message.s_S[len(rows) :]).all()
        if rows and not moving:
            worst = max(worst, float(np.max(np.abs(message.s_S[: len(rows)] - s_S))))
        elif rows:
            np.testing.assert_allclose(message.s_S[: len(rows)], s_S, atol=2e-8)
        most, least = max(most, len(rows)), min(least, len(rows))
    assert most == 16
    assert least == 0  # the planet was in view
    criterion("STARS-1", worst)


def test_noise(criterion: Criterion) -> None:
    """Standard deviation and correlation of the image coordinates x/z, y/z of the two brightest stars."""
    near = np.array([[0.02, 0.01, 1.0], [-0.03, 0.05, 1.0]])
    params = StarVectors.Params(**catalogue(near, np.array([1.0, 2.0])), sigma=3e-5)
    s_S = series([StarVectors("stars", params)], "s_S", 0.25, 10_000, r_BN_N=R).reshape(-1, 16, 3)[:, :2]
    np.testing.assert_allclose(np.linalg.norm(s_S, axis=2), 1.0, atol=1e-15)
    error = ((s_S[..., :2] / s_S[..., 2:] - near[:, :2]) / 3e-5).reshape(-1, 4)
    assert np.max(np.abs(error.mean(axis=0))) < 4 / np.sqrt(len(error))
    criterion("STARS-2", float(np.max(np.abs(error.T @ error / len(error) - np.eye(4)))))


@pytest.mark.parametrize("dt", [1.0, 0.5])
def test_allan_deviation(criterion: Criterion, dt: float) -> None:
    """White, whatever the interval: the image coordinates of 12 stars in one field."""
    near = np.column_stack([np.linspace(-0.05, 0.05, 12), np.linspace(0.05, -0.02, 12), np.ones(12)])
    params = StarVectors.Params(**catalogue(near, np.arange(12.0) / 10.0), sigma=3e-5)
    s_S = series([StarVectors("stars", params)], "s_S", dt, 40_000, r_BN_N=R).reshape(-1, 16, 3)[:, :12]
    image = (s_S[..., :2] / s_S[..., 2:]).reshape(-1, 24)
    criterion("STARS-3", max(abs(allan_deviation(image, m) * np.sqrt(m) / 3e-5 - 1.0) for m in AVERAGES))


def test_misalignment_and_steps() -> None:
    """The case turned by a rotation vector, and image coordinates that are multiples of a step."""
    turn = np.array([0.01, -0.02, 0.05])
    params = StarVectors.Params(**catalogue(SKY, MAGNITUDE), fov=0.3, sigma=0.0, resolution=1e-3, misalignment_S=turn)
    message = measure(StarVectors("stars", params), r_BN_N=R)
    rows, s_S = expected(Rotation.from_rotvec(turn).as_matrix().T, 0.3, 6.0, np.zeros(3))
    assert message.star.tolist() == rows
    image = message.s_S[:, :2] / message.s_S[:, 2:]
    assert np.max(np.abs(image / 1e-3 - np.round(image / 1e-3))) < 1e-9
    assert np.max(np.abs(image - s_S[:, :2] / s_S[:, 2:])) < 0.5001e-3


def test_blinded_and_turning() -> None:
    """No stars at all, and it says so."""
    sky = catalogue(SKY, MAGNITUDE)
    cases: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({"sun_exclusion": 0.5}, {"sun": np.array([0.0, 1e9, 1.5e11])}),
        ({"max_rate": 0.01}, {"omega_BN_B": np.array([0.0, 0.011, 0.0])}),
    ]
    for change, truth in cases:
        chosen: Any = {**sky, **change}
        message = measure(StarVectors("stars", StarVectors.Params(**chosen)), r_BN_N=R, **truth)
        assert (message.valid, message.count) == (False, 0)
        assert np.isnan(message.s_S).all()
        assert np.isnan(message.sigma)


def test_a_catalogue_in_any_order() -> None:
    made = catalogue(3.0 * SKY, MAGNITUDE, faintest=4.0)
    n = made["stars"]
    assert n == np.sum(MAGNITUDE <= 4.0)
    assert np.array_equal(MAGNITUDE[made["star"][:n]], made["magnitude"][:n])
    np.testing.assert_allclose(
        made["s_N"][:n], SKY[made["star"][:n]] / np.linalg.norm(SKY[made["star"][:n]], axis=1)[:, None], atol=1e-15
    )
    assert np.all(np.diff(made["magnitude"][:n]) >= 0)


def test_wrong_catalogues() -> None:
    with pytest.raises(ValueError, match="directions"):
        catalogue(np.zeros((3, 3)), np.zeros(3))
    with pytest.raises(ValueError, match="choose a lower faintest"):
        catalogue(np.ones((CAPACITY + 1, 3)), np.zeros(CAPACITY + 1))
    made = catalogue(SKY, MAGNITUDE)
    made["magnitude"] = made["magnitude"][::-1].copy()
    with pytest.raises(ValueError, match="ascending"):
        StarVectors.Params(**made)
