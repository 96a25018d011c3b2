"""Vectors and matrices of three against numpy, and against exact rational arithmetic."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from fsw.math import vectors as v

RNG = np.random.default_rng(11)
A, B = RNG.normal(size=3), RNG.normal(size=3)
M, N = RNG.normal(size=(3, 3)), RNG.normal(size=(3, 3))
# each result is a sum of at most three products: its error is a few units in the last place of the largest term
TERMS = 4 * np.finfo(float).eps


def test_loads_and_stores() -> None:
    out, out4, out33 = np.zeros(3), np.zeros(4), np.zeros((3, 3))
    v.store3(out, v.vec3(A))
    v.store4(out4, v.vec4(np.arange(4.0)))
    v.store33(out33, v.mat3(M))
    assert np.array_equal(out, A)
    assert np.array_equal(out4, np.arange(4.0))
    assert np.array_equal(out33, M)


@pytest.mark.parametrize(
    ("got", "expected"),
    [
        (v.add(v.vec3(A), v.vec3(B)), A + B),
        (v.sub(v.vec3(A), v.vec3(B)), A - B),
        (v.scale(3.0, v.vec3(A)), 3.0 * A),
        (v.axpy(3.0, v.vec3(A), v.vec3(B)), 3.0 * A + B),
        (v.dot(v.vec3(A), v.vec3(B)), A @ B),
        (v.cross(v.vec3(A), v.vec3(B)), np.cross(A, B)),
        (v.norm(v.vec3(A)), np.linalg.norm(A)),
        (v.unit(v.vec3(A)), A / np.linalg.norm(A)),
        (v.matvec(v.mat3(M), v.vec3(A)), M @ A),
        (v.mat_t_vec(v.mat3(M), v.vec3(A)), M.T @ A),
        (v.transpose(v.mat3(M)), M.T),
        (v.matmul(v.mat3(M), v.mat3(N)), M @ N),
    ],
)
def test_against_numpy(got: Any, expected: Any) -> None:
    np.testing.assert_allclose(np.array(got), expected, rtol=0, atol=TERMS * 10)


def test_inverse_and_determinant_against_fractions() -> None:
    m = [[9, 1, -2], [1, 8, 3], [-2, 3, 6]]
    f = [[Fraction(x) for x in row] for row in m]
    det = sum(
        f[0][i] * (f[1][(i + 1) % 3] * f[2][(i + 2) % 3] - f[1][(i + 2) % 3] * f[2][(i + 1) % 3]) for i in range(3)
    )
    rows = v.mat3(np.array(m, float))
    assert v.determinant(rows) == float(det)
    for i in range(3):
        for j in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            cofactor = f[a][c] * f[b][d] - f[a][d] * f[b][c]
            assert v.inverse(rows)[i][j] == pytest.approx(float(cofactor / det), rel=4e-16)


def test_singular_gives_nan() -> None:
    assert np.all(np.isnan(v.unit((0.0, 0.0, 0.0))))
    assert np.all(np.isnan(v.inverse(((1.0, 2.0, 3.0), (2.0, 4.0, 6.0), (0.0, 0.0, 1.0)))))


def test_large_products_against_numpy() -> None:
    a, b, x, y = RNG.normal(size=(5, 7)), RNG.normal(size=(7, 4)), RNG.normal(size=7), RNG.normal(size=5)
    out5, out7, out54 = np.full(5, np.nan), np.full(7, np.nan), np.full((5, 4), np.nan)
    v.matvec_into(a, x, out5)
    v.mat_t_vec_into(a, y, out7)
    v.matmul_into(a, b, out54)
    np.testing.assert_allclose(out5, a @ x, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out7, a.T @ y, rtol=0, atol=1e-14)
    np.testing.assert_allclose(out54, a @ b, rtol=0, atol=1e-14)
