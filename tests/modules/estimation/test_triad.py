"""Triad against scipy, statistics, and the numbers of Shuster and Oh; refusals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fsw import OutPort
from messages.filters import DirectionsMsg
from modules.estimation.q_method import status
from modules.estimation.triad import Triad
from tests.modules.estimation.test_q_method import PAIR, REASONS, attitude_of, directions, solved, spread, whitened
from tests.modules.opnav.disk_truth import sources

Criterion = Callable[[str, float], None]


def made(**params: Any) -> tuple[Triad, OutPort[DirectionsMsg]]:
    module = Triad("triad", Triad.Params(**params))
    return module, sources(module)["in_directions"]


def test_exact_directions(criterion: Criterion) -> None:
    rng, (module, port) = np.random.default_rng(1), made()
    for _ in range(200):
        truth, r = Rotation.random(rng=rng), rng.normal(size=(2, 3))
        message = solved(port, module, directions(2.0 * truth.apply(r), r, [1e-3, 2e-3]))
        assert message.valid
        criterion("TRIAD-1", float((attitude_of(message) * truth.inv()).magnitude()))


@pytest.mark.parametrize("angle", [90.0, 40.0, 160.0])
@pytest.mark.parametrize("sigma", [(1e-3, 3e-3), (3e-3, 1e-3)])
def test_covariance(criterion: Criterion, angle: float, sigma: tuple[float, float]) -> None:
    """The better one is the anchor, whichever comes first."""
    t, (module, port) = np.radians(angle), made(gate=0.0)
    b = Rotation.from_rotvec([0.3, 0.2, 1.0]).apply([[1.0, 0.0, 0.0], [np.cos(t), np.sin(t), 0.0]])
    errors, P, _ = spread(module, port, b, np.array(sigma), 4000)
    criterion("TRIAD-2", whitened(errors, P))


def test_numbers_of_the_audit(criterion: Criterion) -> None:
    """Sun of 3 degrees and field of 1 degree at right angles: 3.34 degrees; with the Sun as anchor it would be 4.37."""
    module, port = made(gate=0.0)
    errors, P, _ = spread(module, port, np.eye(3)[:2], np.radians([3.0, 1.0]), 4000)
    criterion("TRIAD-3", float(np.degrees(np.sqrt(np.mean(np.sum(errors**2, axis=1))))) - 3.34)
    criterion("TRIAD-4", float(np.degrees(np.sqrt(np.trace(P)))) - np.sqrt(11.0))


@pytest.mark.parametrize("kind", REASONS)
def test_refusals(kind: str) -> None:
    expected, message = REASONS[kind]
    module, port = made()
    refused = solved(port, module, message)
    assert (refused.valid, refused.status) == (False, expected)
    assert np.all(np.isnan(refused.beta_BN))
    assert np.all(np.isnan(refused.P_att))
    assert solved(port, module, directions(PAIR, PAIR, 1e-3)).status == status.VALID
    seq = module.out_attitude.seq
    module.step(8)
    assert module.out_attitude.seq == seq
