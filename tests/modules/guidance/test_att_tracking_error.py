"""AttTrackingError against Basilisk and scipy."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fsw import Module, Out
from messages.attitude import AttGuidMsg, AttRefMsg
from messages.states import NavAttMsg
from modules.guidance.att_tracking_error import AttTrackingError

Criterion = Callable[[str, float], None]


class Feed(Module):
    """Holds what a test writes."""

    out_att = Out(NavAttMsg)
    out_ref = Out(AttRefMsg)

    def step(self, t_ns: int) -> None:
        """Write nothing."""


def wired(params: AttTrackingError.Params | None = None) -> tuple[Feed, AttTrackingError]:
    feed, error = Feed("feed"), AttTrackingError("error", params)
    feed.out_att.connect(error.in_att)
    feed.out_ref.connect(error.in_ref)
    return feed, error


def guidance(case: dict[str, Any]) -> AttGuidMsg:
    feed, error = wired(AttTrackingError.Params(sigma_R0R=np.array(case["sigma_R0R"], float)))
    feed.out_att.write(NavAttMsg(**{k: np.array(v) for k, v in case["nav"].items()}), 0)
    feed.out_ref.write(AttRefMsg(**{k: np.array(v) for k, v in case["ref"].items()}), 0)
    error.step(0)
    message = error.out_guid.latest()
    assert message is not None
    return message


def cases() -> list[dict[str, Any]]:
    path = Path(__file__).parents[2] / "data" / "basilisk_att_tracking_error.json"
    return json.loads(path.read_text())["cases"]


def test_against_basilisk(criterion: Criterion) -> None:
    worst = 0.0
    for case in cases():
        mine = guidance(case)
        turn = Rotation.from_mrp(mine.sigma_BR.copy()).inv() * Rotation.from_mrp(case["sigma_BR"])
        worst = max(worst, float(turn.magnitude()))
        for name in ("omega_BR_B", "omega_RN_B", "domega_RN_B"):
            worst = max(worst, float(np.max(np.abs(getattr(mine, name) - case[name]))))
        assert np.linalg.norm(mine.sigma_BR) <= 1.0
    criterion("TRACKING-1", worst)


def test_against_scipy(criterion: Criterion) -> None:
    worst = 0.0
    for case in cases():
        mine = guidance(case)
        body = Rotation.from_mrp(case["nav"]["sigma_BN"])
        frame = Rotation.from_mrp(case["ref"]["sigma_RN"]) * Rotation.from_mrp(case["sigma_R0R"]).inv()
        expected = frame.inv() * body
        worst = max(worst, float((Rotation.from_mrp(mine.sigma_BR.copy()).inv() * expected).magnitude()))
        omega_RN_B = body.inv().apply(case["ref"]["omega_RN_N"])
        worst = max(worst, float(np.max(np.abs(mine.omega_RN_B - omega_RN_B))))
    criterion("TRACKING-2", worst)


def test_nothing_until_both_are_known() -> None:
    feed, error = wired()
    error.step(0)
    feed.out_att.write(NavAttMsg(sigma_BN=np.zeros(3), omega_BN_B=np.zeros(3)), 0)
    error.step(0)
    assert error.out_guid.latest() is None
