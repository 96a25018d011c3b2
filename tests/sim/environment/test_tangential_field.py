"""TangentialField against its definition in north, east and down, and the rotation of the thesis it comes from."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages.base import F64
from sim.environment.tangential_field import TangentialField
from tests.sim.environment.environment_rig import Criterion, Sky, north_east_down


def sky_of(**change: float) -> Sky:
    sky = Sky(TangentialField("field", TangentialField.Params(**change)))
    sky.turn()
    return sky


def field(sky: Sky, r: Any) -> F64:
    sky.place(r)
    return sky.answer().B_N


def test_north_and_dip(criterion: Criterion) -> None:
    """Also next to a pole, and on both sides of the equator, where a positive dip points down alike."""
    rng, worst = np.random.default_rng(9), 0.0
    for dip in (0.0, 1.1, -0.4, math.pi / 2):
        sky = sky_of(strength=5e-5, dip=dip)
        for lat, lon in [*rng.uniform([-1.5, -3.1], [1.5, 3.1], (24, 2)), (1.57, 0.3)]:
            turn = Rotation.random(rng=rng).as_matrix()
            r_E = 7e6 * -north_east_down(lat, lon)[2]
            sky.turn(turn)
            found = north_east_down(lat, lon) @ turn @ field(sky, turn.T @ r_E)
            known = 5e-5 * np.array([math.cos(dip), 0.0, math.sin(dip)])
            # next to a pole north turns by the rounding of the position
            worst = max(worst, float(np.linalg.norm(found - known)) / 5e-5 * min(1.0, math.cos(lat)))
    criterion("TANGENTIAL-1", worst)


def test_rotation_of_the_thesis(criterion: Criterion) -> None:
    """It turns north about u x k, which is West, by the dip."""
    worst, dip, sky = 0.0, 0.9, sky_of(strength=3e-5, dip=0.9)
    for lat in (-1.2, -0.3, 0.4, 1.3):
        u = -north_east_down(lat, 2.0)[2]
        west = np.cross(u, [0.0, 0.0, 1.0])
        west /= np.linalg.norm(west)
        assert west @ north_east_down(lat, 2.0)[1] == pytest.approx(-1.0)
        known = 3e-5 * Rotation.from_rotvec(dip * west).apply(np.cross(west, u))
        worst = max(worst, float(np.linalg.norm(field(sky, 7e6 * u) - known)) / 3e-5)
    criterion("TANGENTIAL-2", worst)


@pytest.mark.parametrize("r", [[0.0, 0.0, 7e6], [1.0, 0.0, -7e6], [0.0, 0.0, 0.0]])
def test_no_north_at_the_poles(r: list[float]) -> None:
    sky = sky_of()
    with pytest.raises(ValueError, match=r"in_state\.r_BN_N.*not above a pole"):
        field(sky, r)
    assert sky.reader.out_field.latest() is None


def test_nan_stops_the_run() -> None:
    sky = sky_of()
    sky.place([7e6, 0.0, 0.0])
    sky.out_orientation.row["dcm_EN"][:] = np.nan
    with pytest.raises(ValueError, match=r"in_orientation\.dcm_EN: expected finite"):
        sky.answer()


@pytest.mark.parametrize("missing", ["in_state", "in_orientation"])
def test_nothing_without_an_input(missing: str) -> None:
    sky = Sky(TangentialField("field"))
    if missing == "in_state":
        sky.turn()
    else:
        sky.place([7e6, 0.0, 0.0])
    assert sky.answer() is None


@pytest.mark.parametrize("wrong", [{"strength": 0.0}, {"dip": 1.6}, {"dip": np.nan}])
def test_wrong_parameters(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        TangentialField.Params(**wrong)
