"""HeadingUkf against Basilisk, rotations by scipy, and statistics; bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import OutPort, s
from fsw.math.compiled import plain
from messages.base import F64
from messages.filters import HeadingFilterMsg
from messages.opnav import OpNavMsg
from modules.estimation.heading_ukf import HeadingUkf
from modules.estimation.heading_ukf.kernel import frame_of, reframed, turning
from modules.estimation.relative_od_ukf import status
from tests.modules.estimation.filter_truth import (
    Criterion,
    normalised,
    outside_band,
    position_message,
    relative_error,
    triangle,
    vectors,
)
from tests.modules.opnav.disk_truth import camera, sources

P0 = np.diag([0.1, 0.1, 0.1, 0.01, 0.01])
U0 = np.array([0.0, 0.0, 1.0])
Wired = tuple[HeadingUkf, dict[str, OutPort[Any]]]


def wired(**params: Any) -> Wired:
    start: dict[str, Any] = {
        "body_id": 499,
        "u_PC_B": U0,
        "rate_S": np.zeros(2),
        "P": P0,
        "process_noise": np.zeros((5, 5)),
    }
    ukf = HeadingUkf("ukf", HeadingUkf.Params(**{**start, **params}))
    return ukf, sources(ukf)


def position(r: F64, P: F64, t_ns: int, **more: Any) -> OpNavMsg:
    nav: dict[str, Any] = {"r_BN_N": r, "covar_N": P, "planetID": 2, "valid": 1}
    return position_message(nav, **{"r_CP_B": r, "P_rr_B": P, "exposure_ns": t_ns, **more})


def step(ukf: HeadingUkf, t_ns: int) -> HeadingFilterMsg:
    ukf.step(t_ns)
    message = ukf.out_filter.latest()
    assert message is not None
    return message


@pytest.mark.parametrize("number", range(3))
def test_basilisk(criterion: Criterion, number: int) -> None:
    """Full covariances, noiseSF, and a direction that comes near to the helping vector."""
    case = vectors("heading_ukf")["histories"][number]
    Q = np.diag([1e-4] * 3 + [1e-6] * 2)
    ukf, feed = wired(
        basilisk=True, u_PC_B=np.array(case["d0"]), process_noise=Q, alpha=0.02, noise_scale=case["noiseSF"]
    )
    for now in case["steps"]:
        P = np.array(now["covar"]).reshape(3, 3)
        feed["in_position"].write(position(np.array(now["r"]), P, now["t"], valid=bool(now["valid"])), now["t"])
        message = step(ukf, now["t"])
        criterion("HEADING-1", relative_error(ukf.state.x, now["state"]))
        criterion("HEADING-1", relative_error(triangle(ukf.state.S), now["sBar"]))
        assert ukf.state.helper == now["helper"]
        np.testing.assert_array_equal(message.x[3:], -ukf.state.x[3:])
    assert (number == 1) == (ukf.state.helper == 1)


def test_motion_and_frames(criterion: Criterion) -> None:
    """A constant rate across the direction turns it as scipy does; in the other frame it is the same rate."""
    rng = np.random.default_rng(1)
    for helper in (0, 1):
        d = rng.normal(size=3)
        omega = np.cross(d, rng.normal(size=3)) * 0.1
        axes = np.array(plain(frame_of)(tuple(d), tuple(np.eye(3)[helper])))
        state = np.concatenate([d, axes[1:] @ omega])
        plain(turning)(state, 7.0, helper)
        turned = Rotation.from_rotvec(-7.0 * omega).apply(d)
        later = np.array(plain(frame_of)(tuple(turned), tuple(np.eye(3)[helper])))
        criterion("HEADING-2", float(np.max(np.abs(state[:3] - turned))))
        criterion("HEADING-2", float(np.max(np.abs(later[1:].T @ state[3:] - omega))))
        plain(reframed)(state, 0.0, helper)
        other = np.array(plain(frame_of)(tuple(turned), tuple(np.eye(3)[1 - helper])))
        criterion("HEADING-2", float(np.max(np.abs(other[1:].T @ state[3:] - omega))))


def test_consistency(criterion: Criterion) -> None:
    """Sixty runs that turn through the change of frames; rates and direction across it, four numbers."""
    rng, nees, turned = np.random.default_rng(3), list[float](), 0
    for _ in range(60):
        first = U0 + rng.normal(size=3) * 0.03
        first /= np.linalg.norm(first)
        side = np.cross(first, [0.1, -1.0, 0.2])
        omega = np.cross(first, side / np.linalg.norm(side)) * (0.02 + 0.003 * rng.normal())
        axes = np.array(plain(frame_of)(tuple(U0), (1.0, 0.0, 0.0)))
        guess = axes[1:] @ omega + 0.003 * rng.normal(size=2)
        ukf, feed = wired(P=np.diag([9e-4] * 3 + [9e-6] * 2), rate_S=guess)
        for k in range(1, 61):
            u = Rotation.from_rotvec(-omega * k).apply(first)
            A = rng.normal(size=(3, 3))
            P = 1e8 * (A @ A.T + np.eye(3))
            r = -1.2e7 * u + np.linalg.cholesky(P) @ rng.normal(size=3)
            feed["in_position"].write(position(r, P, s(k)), s(k))
            step(ukf, s(k))
        message, u = step(ukf, s(60)), Rotation.from_rotvec(-60.0 * omega).apply(first)
        axes = np.array(plain(frame_of)(tuple(message.x[:3]), tuple(np.eye(3)[ukf.state.helper])))
        d = message.x[:3] / np.linalg.norm(message.x[:3])
        true_axes = np.array(plain(frame_of)(tuple(u), tuple(np.eye(3)[ukf.state.helper])))
        error = np.concatenate([axes[1:] @ (d - u), message.x[3:] - true_axes[1:] @ omega])
        T = np.zeros((4, 5))
        T[:2, :3], T[2:, 3:] = axes[1:] / np.linalg.norm(message.x[:3]), np.eye(2)
        nees.append(normalised(error, T @ message.P @ T.T))
        turned += int(ukf.state.helper == 1)
    assert turned > 40
    criterion("HEADING-3", outside_band(nees, 4))


def test_output_frames() -> None:
    dcm_CB = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix()
    ukf, feed = wired(u_PC_B=np.array([0.2, -0.3, 0.8]))
    assert step(ukf, 0).status == status.NO_MEASUREMENT
    first = ukf.out_direction.latest()
    assert first is not None
    assert np.all(np.isnan(first.u_PC_C))
    plain_camera = camera(500.0)
    fields = {f: getattr(plain_camera, f) for f in plain_camera.__struct_fields__}
    feed["in_camera"].write(type(plain_camera)(**{**fields, "dcm_CB": dcm_CB}), 0)
    step(ukf, 0)
    out = ukf.out_direction.latest()
    assert out is not None
    np.testing.assert_allclose(out.u_PC_B, np.array([0.2, -0.3, 0.8]) / np.sqrt(0.77), rtol=1e-14)
    np.testing.assert_allclose(out.u_PC_C, dcm_CB @ out.u_PC_B, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out.P_uu_C, dcm_CB @ out.P_uu_B @ dcm_CB.T, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out.P_uu_B, 0.1 * (np.eye(3) - np.outer(out.u_PC_B, out.u_PC_B)), rtol=0, atol=1e-14)


GOOD = np.array([1e5, -2e5, -1.2e7])
BAD: dict[str, tuple[int, dict[str, Any]]] = {
    "invalid": (status.INVALID, {"valid": False}),
    "NaN": (status.BAD_NUMBERS, {"r_CP_B": np.full(3, np.nan)}),
    "zero": (status.BAD_NUMBERS, {"r_CP_B": np.zeros(3)}),
    "zero covariance": (status.BAD_NUMBERS, {"P_rr_B": np.zeros((3, 3))}),
    "NaN covariance": (status.BAD_NUMBERS, {"P_rr_B": np.full((3, 3), np.nan)}),
    "future": (status.FROM_FUTURE, {"exposure_ns": s(11)}),
    "before the start": (status.TOO_LATE, {"exposure_ns": -1}),
    "far off": (status.GATED, {"r_CP_B": -3.0 * GOOD}),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_measurements_leave_the_prediction(kind: str) -> None:
    expected, changed = BAD[kind]
    (ukf, feed), (free, _) = wired(P=0.01 * P0), wired(P=0.01 * P0)
    feed["in_position"].write(position(GOOD, 1e8 * np.eye(3), s(10), **changed), s(10))
    refused = step(ukf, s(10))
    assert (refused.status, refused.refused, refused.used) == (expected, 1, 0)
    np.testing.assert_array_equal(refused.x, step(free, s(10)).x)
    np.testing.assert_array_equal(refused.P, step(free, s(10)).P)
    feed["in_position"].write(position(GOOD, 1e8 * np.eye(3), s(10)), s(10))
    assert step(ukf, s(10)).status == status.UPDATED
    assert step(ukf, s(10)).status == status.NO_MEASUREMENT
    feed["in_position"].write(position(GOOD, 1e8 * np.eye(3), s(10)), s(10))
    assert step(ukf, s(10)).status == status.TOO_LATE


@pytest.mark.parametrize(
    ("text", "changed"),
    [
        ("positive definite", {"P": np.zeros((5, 5))}),
        ("positive semidefinite", {"process_noise": -np.eye(5)}),
        ("alpha", {"alpha": 0.0}),
        ("u_PC_B", {"u_PC_B": np.zeros(3)}),
    ],
)
def test_wrong_parameters_are_refused(text: str, changed: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=text):
        wired(**changed)
