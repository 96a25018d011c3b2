"""DOP853 against scipy's own, an analytic orbit, and the orders that it claims."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853
from scipy.integrate._ivp import dop853_coefficients

from fsw.math import integrators
from fsw.math.compiled import compiled
from fsw.math.integrators import DENSE, STAGES, dop853_dense, dop853_error, dop853_factor, dop853_step, dop853_value
from messages.base import F64

Y0 = np.array([1.0, 0.0, 0.0, 0.0, 1.1, 0.3])


@compiled
def kepler(t: float, y: F64, out: F64, mu: float) -> None:
    """Two bodies."""
    r = math.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
    for i in range(3):
        out[i] = y[3 + i]
        out[3 + i] = -mu * y[i] / (r * r * r)


def one_step(h: float) -> tuple[F64, F64, F64]:
    k, end, dense = np.zeros((STAGES, 6)), np.zeros(6), np.zeros((DENSE, 6))
    kepler(0.0, Y0, k[0], 1.0)
    dop853_step(kepler, 0.0, h, Y0, k, end, 1.0)
    result = end.copy()
    stages = k.copy()
    dop853_dense(kepler, 0.0, h, Y0, k, end, dense, 1.0)
    return result, stages, dense


def test_tables() -> None:
    for ours, theirs in (
        (integrators._C, "C"),
        (integrators._E3, "E3"),
        (integrators._E5, "E5"),
        (integrators._D, "D"),
    ):
        expected = getattr(dop853_coefficients, theirs)
        assert np.array_equal(ours[..., : expected.shape[-1]], expected)
    assert np.array_equal(integrators._A, dop853_coefficients.A)


def test_a_step_and_its_dense_output_are_scipys() -> None:
    h = 0.3
    theirs: Any = DOP853(
        lambda t, y: np.concatenate([y[3:], -y[:3] / np.linalg.norm(y[:3]) ** 3]), 0.0, Y0, 9.0, first_step=h, rtol=1.0
    )
    theirs.step()
    result, _, dense = one_step(h)
    np.testing.assert_allclose(result, theirs.y, rtol=1e-15, atol=1e-15)
    read, out = theirs.dense_output(), np.zeros(6)
    for part in np.linspace(0.0, 1.0, 7):
        dop853_value(dense, part, out)
        np.testing.assert_allclose(out, read(part * h), rtol=0, atol=1e-15)


def test_error_estimate_is_scipys() -> None:
    h, limits = 0.9, np.full(6, 1e-7)
    _, k, _ = one_step(h)
    e5, e3 = (dop853_coefficients.E5 @ k[:13] / limits, dop853_coefficients.E3 @ k[:13] / limits)
    size5, size3 = e5 @ e5, e3 @ e3
    # the weights add up to 0, so that sums in another order differ in the digits that cancel
    assert dop853_error(h, k, limits) == pytest.approx(h * size5 / math.sqrt((size5 + 0.01 * size3) * 6), rel=1e-10)


def test_order_of_step_and_interpolant() -> None:
    """Errors of one step fall with the ninth power of its length, those in between with the eighth."""
    errors = []
    for h in (0.4, 0.2):
        fine, y = np.zeros(6), Y0.copy()
        half = np.zeros(6)
        k = np.zeros((STAGES, 6))
        for i in range(64):
            kepler(0.0, y, k[0], 1.0)
            dop853_step(kepler, 0.0, h / 64, y, k, fine, 1.0)
            y[:] = fine
            if i == 31:
                half[:] = fine
        result, _, dense = one_step(h)
        out = np.zeros(6)
        dop853_value(dense, 0.5, out)
        errors.append((np.linalg.norm(result - y), np.linalg.norm(out - half)))
    assert math.log2(errors[0][0] / errors[1][0]) == pytest.approx(9.0, abs=0.5)
    assert math.log2(errors[0][1] / errors[1][1]) == pytest.approx(8.0, abs=0.7)


@pytest.mark.parametrize(("error", "factor"), [(0.0, 6.0), (1e300, 0.2), (1.0, 0.9), (math.nan, 0.1)])
def test_factor(error: float, factor: float) -> None:
    assert dop853_factor(error) == pytest.approx(factor)
