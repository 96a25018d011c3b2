"""QMethod against scipy, the bound of Shuster and Oh, and statistics; refusals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import OutPort
from messages.base import F64
from messages.filters import MAX_DIRECTIONS, AttitudeFixMsg, DirectionsMsg
from modules.estimation.q_method import QMethod, status
from tests.modules.opnav.disk_truth import sources

Criterion = Callable[[str, float], None]


def directions(b: F64, r: F64, sigma: Any, **more: Any) -> DirectionsMsg:
    n = len(b)
    fields: dict[str, Any] = {"exposure_ns": 5, "valid": True, "count": n}
    for name, rows in (("measured_B", b), ("known_N", r)):
        fields[name] = np.full((MAX_DIRECTIONS, 3), np.nan)
        fields[name][:n] = rows
    fields["sigma"] = np.full(MAX_DIRECTIONS, np.nan)
    fields["sigma"][:n] = sigma
    return DirectionsMsg(**{**fields, **more})


def solved(port: OutPort[DirectionsMsg], module: Any, message: DirectionsMsg) -> AttitudeFixMsg:
    port.write(message, 7)
    module.step(7)
    found = module.out_attitude.latest()
    assert found is not None
    return found


def made(**params: Any) -> tuple[QMethod, OutPort[DirectionsMsg]]:
    module = QMethod("q", QMethod.Params(**params))
    return module, sources(module)["in_directions"]


def noisy(b: F64, sigma: F64, rng: np.random.Generator) -> F64:
    """Unit vectors with errors of sigma rad about each axis across them."""
    return b + np.cross(rng.normal(size=b.shape) * sigma[:, None], b)


def attitude_of(message: AttitudeFixMsg) -> Rotation:
    """The rotation whose matrix maps N to B."""
    return Rotation.from_quat(message.beta_BN, scalar_first=True).inv()


def test_against_scipy(criterion: Criterion) -> None:
    """Wahba's problem with 2 to 16 directions, of any attitude, half turns too."""
    rng, (module, port) = np.random.default_rng(1), made(gate=0.0)
    for k in range(200):
        n = 2 + k % 15
        truth = Rotation.random(rng=rng) if k % 5 else Rotation.from_rotvec(np.pi * np.eye(3)[k % 3])
        r, sigma = rng.normal(size=(n, 3)), rng.uniform(1e-4, 1e-2, n)
        r /= np.linalg.norm(r, axis=1)[:, None]
        b = noisy(truth.apply(r), sigma, rng)
        unit = b / np.linalg.norm(b, axis=1)[:, None]
        expected = Rotation.align_vectors(unit, r, weights=sigma**-2)[0]
        message = solved(port, module, directions(3.0 * b, 0.5 * r, sigma))
        assert message.valid
        assert message.beta_BN[0] >= 0.0
        criterion("QMETHOD-1", float((attitude_of(message) * expected.inv()).magnitude()))
        left = unit - expected.apply(r)
        loss = np.sum(left**2 / sigma[:, None] ** 2) / (2 * n - 3)
        criterion("QMETHOD-2", message.loss / float(loss) - 1.0)


def spread(module: Any, port: OutPort[DirectionsMsg], b: F64, sigma: F64, runs: int) -> tuple[F64, F64, float]:
    """Attitude errors (runs, 3) in B, the covariance that the module states, and the mean loss."""
    rng, truth = np.random.default_rng(2), Rotation.from_rotvec([0.4, -1.2, 2.0])
    r, errors, losses = truth.inv().apply(b), np.empty((runs, 3)), list[float]()
    for k in range(runs):
        message = solved(port, module, directions(noisy(b, sigma, rng), r, sigma))
        errors[k] = (attitude_of(message) * truth.inv()).as_rotvec()
        losses.append(message.loss)
    return errors, solved(port, module, directions(b, r, sigma)).P_att, float(np.mean(losses))


def whitened(errors: F64, P: F64) -> float:
    white = np.linalg.solve(np.linalg.cholesky(P), errors.T)
    return float(np.max(np.abs(white @ white.T / len(errors) - np.eye(3))))


def test_covariance(criterion: Criterion) -> None:
    module, port = made(gate=0.0)
    b = np.array([[1.0, 0.0, 0.0], [0.3, 0.9, 0.2], [0.1, -0.4, 0.8], [-0.5, 0.5, 0.6]])
    b /= np.linalg.norm(b, axis=1)[:, None]
    errors, P, loss = spread(module, port, b, np.array([1e-3, 2e-3, 5e-4, 3e-3]), 4000)
    criterion("QMETHOD-3", whitened(errors, P))
    criterion("QMETHOD-4", loss - 1.0)


def test_numbers_of_the_audit(criterion: Criterion) -> None:
    """Sun of 3 degrees and field of 1 degree at right angles: 3.30 degrees in all."""
    module, port = made(gate=0.0)
    errors, P, _ = spread(module, port, np.eye(3)[:2], np.radians([3.0, 1.0]), 4000)
    criterion("QMETHOD-5", float(np.degrees(np.sqrt(np.trace(P)))) - 3.30)
    criterion("QMETHOD-6", float(np.degrees(np.sqrt(np.mean(np.sum(errors**2, axis=1))))) - 3.30)


PAIR = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
REASONS: dict[str, tuple[int, DirectionsMsg]] = {
    "invalid": (status.INVALID, directions(PAIR, PAIR, 1e-3, valid=False)),
    "one": (status.TOO_FEW, directions(PAIR[:1], PAIR[:1], 1e-3)),
    "NaN": (status.BAD_NUMBERS, directions(np.nan * PAIR, PAIR, 1e-3)),
    "zero": (status.BAD_NUMBERS, directions(0.0 * PAIR, PAIR, 1e-3)),
    "no sigma": (status.BAD_NUMBERS, directions(PAIR, PAIR, np.nan)),
    "negative sigma": (status.BAD_NUMBERS, directions(PAIR, PAIR, -1e-3)),
    "parallel": (status.PARALLEL, directions(PAIR[[0, 0]] + [[0, 0, 0], [0, 5e-4, 0]], PAIR[[0, 0]], 1e-3)),
    "opposite": (status.PARALLEL, directions(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), PAIR, 1e-3)),
    "angles": (status.DISAGREE, directions(PAIR, np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0]]), 1e-3)),
}


@pytest.mark.parametrize("kind", REASONS)
def test_refusals(kind: str) -> None:
    expected, message = REASONS[kind]
    module, port = made()
    refused = solved(port, module, message)
    assert (refused.valid, refused.status) == (False, expected)
    assert np.all(np.isnan(refused.beta_BN))
    assert np.all(np.isnan(refused.P_att))
    good = solved(port, module, directions(PAIR, PAIR, 1e-3))
    assert (good.valid, good.exposure_ns) == (True, 5)
    seq = module.out_attitude.seq
    module.step(8)
    assert module.out_attitude.seq == seq
