"""InertialPoint against Basilisk, and the shadow set against scipy."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from messages.attitude import AttRefMsg
from modules.guidance.inertial_point import InertialPoint

Criterion = Callable[[str, float], None]


def reference(sigma: Any) -> AttRefMsg:
    module = InertialPoint("hold", InertialPoint.Params(sigma_RN=np.array(sigma)))
    module.step(0)
    message = module.out_ref.latest()
    assert message is not None
    return message


def test_against_basilisk(criterion: Criterion) -> None:
    path = Path(__file__).parents[2] / "data" / "basilisk_inertial3d.json"
    worst = 0.0
    for case in json.loads(path.read_text())["cases"]:
        mine = reference(case["sigma_R0N"])
        for name in ("sigma_RN", "omega_RN_N", "domega_RN_N"):
            worst = max(worst, float(np.max(np.abs(getattr(mine, name) - case[name]))))
    criterion("INERTIAL-1", worst)


def test_either_set_is_the_same_attitude(criterion: Criterion) -> None:
    rng, worst = np.random.default_rng(4), 0.0
    for sigma in rng.normal(size=(200, 3)):
        mine = reference(sigma).sigma_RN.copy()
        assert np.linalg.norm(mine) <= 1.0
        worst = max(worst, float((Rotation.from_mrp(mine).inv() * Rotation.from_mrp(sigma)).magnitude()))
    criterion("INERTIAL-2", worst)


def test_no_attitude_is_refused() -> None:
    with pytest.raises(ValueError, match="sigma_RN"):
        InertialPoint.Params(sigma_RN=np.array([0.0, np.nan, 0.0]))
