"""FaultDetection against Basilisk's vectors, chi-square statistics and scipy's merge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from fsw import s
from messages.base import F64
from messages.opnav import OpNavMsg
from modules.opnav import relative
from modules.opnav.basilisk import body_of
from modules.opnav.fault_detection import FaultDetection
from modules.opnav.fault_detection.module import ALONE, FAULT, OTHER_BODY
from tests.modules.opnav.disk_truth import FRAMES, Criterion, attitude, basilisk_camera, camera, sources, vectors, worst

P1 = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 9.0]]) * 1e6
P2 = np.array([[2.0, -0.4, 0.1], [-0.4, 5.0, 1.0], [0.1, 1.0, 6.0]]) * 1e6
TRUTH = np.array([1e6, -2e6, -2e7])


def position(r: F64, P: F64, when: int = 0, body_id: int = 499, **more: Any) -> OpNavMsg:
    """With C, B and N the same."""
    fields: dict[str, Any] = {f"r_CP_{f}": r for f in FRAMES} | {f"P_rr_{f}": P for f in FRAMES}
    fields |= {"exposure_ns": when, "valid": True, "status": 0, "fault_detected": False, "body_id": body_id}
    return OpNavMsg(**{**fields, **more})


def judged(first: OpNavMsg | None, second: OpNavMsg | None, **params: Any) -> OpNavMsg:
    module = FaultDetection("judge", FaultDetection.Params(**params))
    feed = sources(module)
    feed["in_camera"].write(camera(800.0), 0)
    feed["in_attitude"].write(attitude(), 0)
    if first is not None:
        feed["in_primary"].write(first, 0)
    if second is not None:
        feed["in_secondary"].write(second, 0)
    module.step(0)
    message = module.out_position.latest()
    assert message is not None
    return message


def test_basilisk_vectors(criterion: Criterion) -> None:
    """All modes, each of the two valid or not, faults and merges."""
    for case in vectors("fault_detection"):
        params: dict[str, Any] = {"mode": int(case["faultMode"]), "sigma_fault": case["sigmaFault"]}
        module = FaultDetection("judge", FaultDetection.Params(basilisk=True, **params))
        feed = sources(module)
        feed["in_camera"].write(basilisk_camera(case), 0)
        feed["in_attitude"].write(attitude(case["sigma_BN"]), 0)
        for name in ("primary", "secondary"):
            given = case[name]
            arrays = {f"r_CP_{f}": np.array(given[f"r_BN_{f}"]) for f in FRAMES}
            arrays |= {f"P_rr_{f}": np.array(given[f"covar_{f}"]).reshape(3, 3) for f in FRAMES}
            when, body = int(given["timeTag"] * 1e9), body_of(given["planetID"])
            feed[f"in_{name}"].write(position(TRUTH, P1, when, body, valid=bool(given["valid"]), **arrays), 0)
        module.step(0)
        message, expected = module.out_position.latest(), case["out"]
        assert message is not None
        assert (message.valid, message.fault_detected) == (bool(expected["valid"]), bool(expected["faultDetected"]))
        if message.valid:
            assert (message.body_id, message.exposure_ns) == (body_of(expected["planetID"]), expected["timeTag"] * 1e9)
        criterion("FAULT-1", worst(message, expected))


def test_false_alarms_and_merge(criterion: Criterion) -> None:
    """3,000 sound pairs: alarms as often as the gate says; errors of the merge fit its covariance."""
    rng, alarms, nees, gate = np.random.default_rng(1), 0, list[float](), float(chi2.ppf(0.95, 3))
    roots, draws = (np.linalg.cholesky(P1), np.linalg.cholesky(P2)), 3000
    best = np.linalg.inv(np.linalg.inv(P1) + np.linalg.inv(P2))
    for _ in range(draws):
        r1, r2 = (TRUTH + root @ rng.normal(size=3) for root in roots)
        message = judged(position(r1, P1), position(r2, P2), gate=gate)
        alarms += message.fault_detected
        merge = judged(position(r1, P1), position(r2, P2), gate=1e9) if message.fault_detected else message
        expected = best @ (np.linalg.solve(P1, r1) + np.linalg.solve(P2, r2))
        for f in FRAMES:
            np.testing.assert_allclose(getattr(merge, f"r_CP_{f}"), expected, rtol=1e-12)
            np.testing.assert_allclose(getattr(merge, f"P_rr_{f}"), best, rtol=1e-10, atol=1e-4)
        error = merge.r_CP_C - TRUTH
        nees.append(float(error @ np.linalg.solve(merge.P_rr_C, error)))
    criterion("FAULT-2", alarms / draws - 0.05)
    criterion("FAULT-3", float(np.mean(nees)) - 3.0)


def test_faults_are_found_along_the_sure_axis() -> None:
    """4 km off where 1.4 km is known is a fault for the Mahalanobis distance, not for Basilisk's norms."""
    narrow, wide = np.diag([1e6, 1e6, 1e10]), np.diag([1e6, 1e6, 1e10])
    pair = position(TRUTH, narrow), position(TRUTH + np.array([8e3, 0.0, 0.0]), wide)
    assert judged(*pair).fault_detected
    assert not judged(*pair, basilisk=True).fault_detected


@pytest.mark.parametrize(("policy", "expected"), [(0, None), (1, 0), (2, 1)])
def test_policy_on_a_fault(policy: int, expected: int | None) -> None:
    pair = position(TRUTH, P1), position(TRUTH + 1e5, P2)
    message = judged(*pair, on_fault=policy)
    assert message.fault_detected
    if expected is None:
        assert (message.valid, message.status) == (False, FAULT)
        assert np.all(np.isnan(message.r_CP_N))
    else:
        assert message.valid
        np.testing.assert_array_equal(message.r_CP_N, pair[expected].r_CP_N)


def test_modes() -> None:
    """What counts when one is missing, and what is given when both agree."""
    one, two, no = position(TRUTH, P1), position(TRUTH + 10.0, P2), position(TRUTH, P1, valid=False)
    assert [judged(one, no, mode=k).valid for k in range(3)] == [True, True, False]
    assert [judged(no, two, mode=k).valid for k in range(3)] == [True, False, False]
    assert [judged(one, None, mode=k).valid for k in range(3)] == [True, True, False]
    assert judged(no, two, mode=1).status == ALONE
    assert judged(no, no).status == relative.NOTHING_FOUND
    for mode in (1, 2):
        np.testing.assert_array_equal(judged(one, two, mode=mode).r_CP_C, one.r_CP_C)
    doubled, plain = judged(one, two, independent=False), judged(one, two)
    np.testing.assert_allclose(doubled.P_rr_N, 2.0 * plain.P_rr_N, rtol=1e-14)


def test_what_cannot_be_compared() -> None:
    """Another body, another time, a covariance that is none, NaN."""
    one = position(TRUTH, P1)
    assert judged(one, position(TRUTH, P2, body_id=301)).status == OTHER_BODY
    newer = judged(one, position(TRUTH + 1e6, P2, when=s(1)))
    assert (newer.valid, newer.exposure_ns, newer.fault_detected) == (True, s(1), False)
    assert judged(one, position(TRUTH + 1e6, P2, when=s(1)), mode=1).status == ALONE
    bad = position(TRUTH, -P2)
    np.testing.assert_array_equal(judged(one, bad).r_CP_C, TRUTH)
    assert judged(bad, bad).status == relative.BAD_NUMBERS
    lost = position(np.full(3, np.nan), P2)
    assert judged(lost, lost).status == relative.BAD_NUMBERS
    assert judged(position(TRUTH, P1, when=s(20)), position(TRUTH, P2, when=s(20))).status == relative.OLD_ATTITUDE


def test_merge_in_three_frames_once() -> None:
    """A merge is turned by mounting and attitude, the attitude's error goes to N, and a pair is judged once."""
    dcm_CB, body = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix(), Rotation.from_mrp([0.2, 0.6, -1.1])
    module = FaultDetection("judge", FaultDetection.Params(sigma_att=1e-4))
    feed = sources(module)
    module.step(0)
    assert module.out_position.latest() is None
    pair = position(TRUTH, P1), position(TRUTH + 500.0, P2)
    feed["in_primary"].write(pair[0], 0)
    feed["in_secondary"].write(pair[1], 0)
    module.step(0)
    message = module.out_position.latest()
    assert message is not None
    assert message.status == relative.NO_INPUT
    feed["in_camera"].write(camera(800.0, dcm_CB=dcm_CB), 0)
    feed["in_attitude"].write(attitude([0.2, 0.6, -1.1]), 0)
    feed["in_primary"].write(pair[0], 0)
    module.step(0)
    message, seq = module.out_position.latest(), module.out_position.seq
    assert message is not None
    plain, dcm_NC = judged(*pair), body.as_matrix() @ dcm_CB.T
    np.testing.assert_allclose(message.r_CP_B, dcm_CB.T @ plain.r_CP_C, rtol=1e-12)
    np.testing.assert_allclose(message.r_CP_N, dcm_NC @ plain.r_CP_C, rtol=1e-12)
    across = float(plain.r_CP_C @ plain.r_CP_C) * np.eye(3) - np.outer(message.r_CP_N, message.r_CP_N)
    np.testing.assert_allclose(message.P_rr_N, dcm_NC @ plain.P_rr_C @ dcm_NC.T + 1e-8 * across, rtol=1e-9)
    module.step(s(1))
    assert module.out_position.seq == seq
