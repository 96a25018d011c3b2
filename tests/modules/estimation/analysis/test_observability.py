"""Known cases: what cameras, ranges and drifts cannot tell, in words and numbers."""

from __future__ import annotations

import numpy as np
import pytest

from messages.base import F64
from modules.estimation.analysis import observability

AXES = "xyz"


def cross(v: F64) -> F64:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def camera_steps(with_tracker: bool) -> list[tuple[F64, F64, list[tuple[F64, F64]]]]:
    """Attitude and misalignment (3 + 3), camera axes those of the body; landmarks known, so is the position."""
    rng, rows = np.random.default_rng(1), list[F64]()
    for x, y in rng.uniform(-0.3, 0.3, (12, 2)):
        p = 5e5 * np.array([x, y, 1.0])
        D = 2000.0 / p[2] * np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]])
        rows.append(np.hstack([D @ cross(p), D @ cross(p)]))
    H = np.vstack(rows)
    seen = [(H, 0.25 * np.eye(24))]
    if with_tracker:
        seen.append((np.hstack([np.eye(3), np.zeros((3, 3))]), 1e-9 * np.eye(3)))
    return [(np.eye(6), np.zeros((6, 6)), seen)] * 3


NAMES = [f"attitude_{a}" for a in AXES] + [f"misalignment_{a}" for a in AXES]


def test_camera_sees_the_sum_of_misalignment_and_attitude() -> None:
    found = observability(camera_steps(False), NAMES, ["rad"] * 6, np.full(6, 1e-3))
    assert found.rank == 3
    assert len(found.hidden) == 3
    text = str(found)
    for a in AXES:
        assert f"Not observable: 0.71 attitude_{a} - 0.71 misalignment_{a}." in text
        assert f"only this is seen: 0.71 attitude_{a} + 0.71 misalignment_{a}." in text
    # the weights refer to the scales: ten times less misalignment is one tenth of the attitude
    uneven = observability(camera_steps(False), NAMES, ["rad"] * 6, np.array([1e-3] * 3 + [1e-4] * 3))
    w = uneven.hidden[0].weights
    np.testing.assert_allclose(np.abs(w[[0, 3]]), np.array([0.1, 1.0]) / np.sqrt(1.01), atol=1e-9)


def test_a_star_tracker_tells_them_apart() -> None:
    found = observability(camera_steps(True), NAMES, ["rad"] * 6, np.full(6, 1e-3))
    assert found.rank == 6 and not found.hidden and not found.weak
    assert "6 of 6 combinations of states are observable" in str(found)
    # and a prior does, which is said by giving it
    assert observability(camera_steps(False), NAMES, ["rad"] * 6, np.full(6, 1e-3), 1e-6 * np.eye(6)).rank == 6


def test_the_gramian() -> None:
    """Sum of Phi^-T H' R^-1 H Phi^-1, by hand, and its singular values."""
    rng, n = np.random.default_rng(2), 4
    scale, J, steps = np.array([1e3, 1.0, 1e-3, 10.0]), np.zeros((4, 4)), list[tuple[F64, F64, list[tuple[F64, F64]]]]()
    for _ in range(6):
        Phi, H = np.eye(n) + 0.1 * rng.normal(size=(n, n)), rng.normal(size=(1, n))
        back = np.linalg.inv(Phi)
        J = back.T @ J @ back + H.T @ H / 0.3
        steps.append((Phi, np.zeros((n, n)), [(H, np.array([[0.3]]))]))
    found = observability(steps, "abcd", ["m", "m/s", "rad", "s"], scale)
    np.testing.assert_allclose(found.information, J * np.outer(scale, scale), rtol=1e-8)
    np.testing.assert_allclose(
        found.singular_values**2, np.linalg.svd(J * np.outer(scale, scale), compute_uv=False), rtol=1e-6
    )
    assert "a 1e+03 m" in str(found)


def test_weak_is_told_from_hidden() -> None:
    """Velocity from two positions 1e-6 s apart: seen, but worse than any prior. Acceleration of it: not at all."""
    Phi = np.array([[1.0, 1e-6, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    steps = [(Phi, np.zeros((3, 3)), [(np.array([[1.0, 0.0, 0.0]]), np.array([[1e-4]]))])] * 2
    found = observability(steps, ["position", "velocity", "drift"], ["m", "m/s", "m"], np.ones(3))
    assert (found.rank, len(found.weak), len(found.hidden)) == (2, 1, 1)
    assert found.hidden[0].text == "1.00 drift"
    assert found.weak[0].text == "1.00 velocity"
    assert found.weak[0].sigma == pytest.approx(1e-2 * np.sqrt(2) / 1e-6, rel=1e-6)


def test_process_noise_forgets() -> None:
    """Without noise two epochs give the velocity; with much of it between them they do not."""
    Phi, H, R = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]]), np.array([[1e-4]])
    calm = observability([(Phi, np.zeros((2, 2)), [(H, R)])] * 2, ["r", "v"], ["m", "m/s"], np.ones(2))
    rough = observability([(Phi, 1e4 * np.eye(2), [(H, R)])] * 2, ["r", "v"], ["m", "m/s"], np.ones(2))
    assert not calm.weak
    assert len(rough.weak) == 1 and rough.weak[0].sigma > 100.0


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match="2 names, 1 units"):
        observability([], ["a", "b"], ["m"], np.ones(2))
