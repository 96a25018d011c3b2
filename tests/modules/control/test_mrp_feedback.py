"""MrpFeedback against Basilisk, and the closed-loop equation that the law promises."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fsw import Module, Out
from messages.attitude import AttGuidMsg
from messages.base import F64
from messages.control import RWSpeedMsg
from modules.control.mrp_feedback import MrpFeedback

Criterion = Callable[[str, float], None]
INERTIA = np.array([[900.0, 12.0, -7.0], [12.0, 800.0, 20.0], [-7.0, 20.0, 600.0]])
GUID = {
    "sigma_BR": np.array([0.1, -0.2, 0.3]),
    "omega_BR_B": np.array([0.01, 0.02, -0.03]),
    "omega_RN_B": np.array([-0.002, 0.001, 0.004]),
    "domega_RN_B": np.array([1e-4, -2e-4, 3e-4]),
}


class Feed(Module):
    """Holds what a test writes."""

    out_guid = Out(AttGuidMsg)
    out_wheels = Out(RWSpeedMsg)

    def step(self, t_ns: int) -> None:
        """Write nothing."""


def wired(params: MrpFeedback.Params) -> tuple[Feed, MrpFeedback]:
    feed, law = Feed("feed"), MrpFeedback("law", params)
    feed.out_guid.connect(law.in_guid)
    feed.out_wheels.connect(law.in_wheels)
    return feed, law


def torque(feed: Feed, law: MrpFeedback, guid: dict[str, Any], t_ns: int) -> F64:
    feed.out_guid.write(AttGuidMsg(**{k: np.array(v) for k, v in guid.items()}), t_ns)
    law.step(t_ns)
    message = law.out_torque.latest()
    assert message is not None
    return message.torque_B


def wheels(case: dict[str, Any]) -> tuple[F64, F64, F64]:
    """Axes, inertia and speeds of a case; those not available have no inertia."""
    axes, inertia, speeds = np.zeros((8, 3)), np.zeros(8), np.zeros(8)
    if "rw" in case:
        given, n = case["rw"], case["rw"]["numRW"]
        axes[:n] = np.array(given["GsMatrix_B"]).reshape(-1, 3)[:n]
        axes[:n] /= np.linalg.norm(axes[:n], axis=1)[:, None]
        available = np.array(given["wheelAvailability_0_is_available"][:n]) == 0
        inertia[:n], speeds[:n] = np.where(available, given["JsList"][:n], 0.0), given["wheelSpeeds"][:n]
    return axes, inertia, speeds


def test_against_basilisk(criterion: Criterion) -> None:
    """Six calls each, with and without integral, relative to the torque.

    Basilisk's integral counts from its second call on, because a first call at time 0 leaves its clock at 0.
    """
    path = Path(__file__).parents[2] / "data" / "basilisk_mrp_feedback.json"
    cases: list[dict[str, Any]] = json.loads(path.read_text())["cases"]
    worst = 0.0
    for case in cases:
        axes, inertia, speeds = wheels(case)
        params = MrpFeedback.Params(
            inertia_B=np.array(case["ISCPntB_B"]).reshape(3, 3),
            K=case["K"],
            P=case["P"],
            Ki=max(case["Ki"], 0.0),
            integral_limit=case["integralLimit"],
            known_torque_B=np.array(case["knownTorquePntB_B"], float),
            wheel_axes_B=axes,
            wheel_inertia=inertia,
        )
        start, law = wired(params)
        start.out_wheels.write(RWSpeedMsg(omega=speeds), 0)
        first = torque(start, law, case["steps"][0]["guid"], 0)
        feed, law = wired(params)
        feed.out_wheels.write(RWSpeedMsg(omega=speeds), 0)
        rest = [torque(feed, law, step["guid"], step["t"]) for step in case["steps"][1:]]
        for mine, step in zip([first, *rest], case["steps"], strict=True):
            theirs = np.array(step["torqueRequestBody"])
            worst = max(worst, float(np.linalg.norm(mine - theirs) / np.linalg.norm(theirs)))
    assert min(c["Ki"] for c in cases) < 0.0 < max(c["Ki"] for c in cases)
    assert any("rw" in c for c in cases)
    criterion("FEEDBACK-1", worst)


def test_closed_loop_equation(criterion: Criterion) -> None:
    """With the law, I domega_BR/dt = -K sigma - P omega_BR for any motion, if the whole rate carries the momentum.

    domega_BR/dt in B is domega_BN/dt - (domega_RN - omega_BN x omega_RN), and Euler gives domega_BN/dt.
    """
    feed, law = wired(MrpFeedback.Params(inertia_B=INERTIA, K=3.5, P=30.0, whole_rate=True))
    u = torque(feed, law, GUID, 0)
    w = GUID["omega_BR_B"] + GUID["omega_RN_B"]
    domega_BN = np.linalg.solve(INERTIA, u - np.cross(w, INERTIA @ w))
    left = INERTIA @ (domega_BN - (GUID["domega_RN_B"] - np.cross(w, GUID["omega_RN_B"])))
    right = -3.5 * GUID["sigma_BR"] - 30.0 * GUID["omega_BR_B"]
    criterion("FEEDBACK-2", float(np.max(np.abs(left - right))))


def test_wheels_do_not_disturb_the_closed_loop() -> None:
    """As above with the momentum of wheels in Euler's equation: I dw/dt = u - w x (I w + h)."""
    axes, inertia, speeds = np.zeros((8, 3)), np.zeros(8), np.zeros(8)
    axes[:3], inertia[:3], speeds[:3] = np.eye(3), [0.1, 0.2, 0.3], [150.0, -80.0, 60.0]
    params = MrpFeedback.Params(
        inertia_B=INERTIA, K=3.5, P=30.0, whole_rate=True, wheel_axes_B=axes, wheel_inertia=inertia
    )
    feed, law = wired(params)
    feed.out_wheels.write(RWSpeedMsg(omega=speeds), 0)
    u = torque(feed, law, GUID, 0)
    w = GUID["omega_BR_B"] + GUID["omega_RN_B"]
    h = inertia[:3] * (speeds[:3] + w)
    domega_BN = np.linalg.solve(INERTIA, u - np.cross(w, INERTIA @ w + h))
    left = INERTIA @ (domega_BN - (GUID["domega_RN_B"] - np.cross(w, GUID["omega_RN_B"])))
    np.testing.assert_allclose(left, -3.5 * GUID["sigma_BR"] - 30.0 * GUID["omega_BR_B"], atol=1e-14)


def test_integral_is_limited_and_forgets_bad_errors() -> None:
    feed, law = wired(MrpFeedback.Params(inertia_B=INERTIA, K=2.0, Ki=0.01, integral_limit=0.7))
    torque(feed, law, GUID, 0)
    torque(feed, law, GUID, 10**9)
    np.testing.assert_allclose(law.state.integral, 2.0 * GUID["sigma_BR"], rtol=1e-15)
    torque(feed, law, GUID, 10**10)
    np.testing.assert_array_equal(law.state.integral, [0.7, -0.7, 0.7])
    feed.out_guid.row["sigma_BR"], feed.out_guid.row["seq"] = np.nan, 9
    law.step(11 * 10**9)
    np.testing.assert_array_equal(law.state.integral, [0.7, -0.7, 0.7])
    with pytest.raises(ValueError, match="NaN"):
        law.out_torque.latest()


def test_nothing_before_the_first_error() -> None:
    _, law = wired(MrpFeedback.Params(inertia_B=INERTIA))
    law.step(0)
    assert law.out_torque.latest() is None


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"K": -1.0}, "> 0"),
        ({"Ki": -1.0}, ">= 0"),
        ({"inertia_B": -INERTIA}, "principal axis"),
        ({"wheel_inertia": np.ones(8)}, "wheel_axes_B: expected unit vectors"),
    ],
)
def test_wrong_parameters(change: dict[str, Any], text: str) -> None:
    given: dict[str, Any] = {"inertia_B": INERTIA, **change}
    with pytest.raises(ValueError, match=text):
        MrpFeedback.Params(**given)
