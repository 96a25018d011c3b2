"""Square-root algebra against numpy, scipy, mpmath and Basilisk; the unscented transform against integrals."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import scipy.linalg

from fsw.math.square_root import (
    NOT_FINITE,
    NOT_POSITIVE,
    OK,
    SINGULAR,
    cholesky,
    covariance_of,
    invert_lower,
    invert_upper,
    lu,
    lu_inverse,
    lu_solve,
    qr_triangle,
    rank_one,
    semidefinite_factor,
    solve_lower,
    solve_lower_transposed,
    transpose_in_place,
)
from messages.base import F64

VECTORS: dict[str, Any] = json.loads(
    (Path(__file__).parents[2] / "data" / "basilisk_ukf_utilities.json").read_text(encoding="utf-8")
)
SIZES = (1, 3, 6, 9, 15)


def away(found: Any, expected: Any) -> float:
    """Largest difference relative to the largest element expected."""
    wanted = np.asarray(expected, np.float64)
    return float(np.max(np.abs(np.asarray(found, np.float64) - wanted)) / max(np.max(np.abs(wanted)), 1e-300))


def array(values: Any) -> F64:
    return np.array(values, np.float64)


def factored(A: F64) -> tuple[int, F64, Any]:
    work, swap = A.copy(), np.zeros(len(A), np.int64)
    return lu(work, swap, np.zeros(len(A))), work, swap


def random_factor(n: int, seed: int) -> F64:
    rng = np.random.default_rng(seed)
    return np.tril(rng.normal(size=(n, n)), -1) + np.diag(rng.uniform(0.5, 2.0, n))


def test_basilisk_triangles() -> None:
    for case in VECTORS["qr"]:
        A, expected = array(case["A"]), array(case["R"])
        R = np.zeros((A.shape[1], A.shape[1]))
        code = qr_triangle(A, R)
        if np.any(np.isnan(expected)):  # a zero column, after which Basilisk has NaN
            assert code == SINGULAR
            original = array(case["A"])
            np.testing.assert_allclose(R.T @ R, original.T @ original, rtol=0, atol=1e-14)
        else:
            assert code == OK
            assert away(R, expected) < 1e-14
    for name, invert in (("l_inv", invert_lower), ("u_inv", invert_upper)):
        for case in VECTORS[name]:
            A = array(case["A"])
            out = np.zeros_like(A)
            assert (invert(A, out) < 0) == (case["ret"] < 0)
            assert away(out, case["out"]) < 1e-14


def test_basilisk_lu() -> None:
    wrong = list[str]()
    for case in VECTORS["lu"]:
        code, factors, swap = factored(array(case["A"]))
        assert (code < 0) == (case["ret"] < 0)
        if code == OK:
            assert away(factors, case["lu"]) < 1e-14
            assert list(swap) == case["indx"]
    for case in VECTORS["solve"]:
        code, factors, swap = factored(array(case["A"]))
        x = array(case["b"])
        assert code == lu_solve(factors, swap, x) == OK
        assert away(x, case["x_exact"]) < 1e-14
        if away(x, case["x"]) > 1e-3:
            wrong.append(case["label"])
    assert len(wrong) == 1  # Basilisk cuts the right-hand side to an integer when it looks for its first element
    assert "all |b| < 1" in wrong[0]
    for case in VECTORS["inv"]:
        _, factors, swap = factored(array(case["A"]))
        out = np.zeros_like(factors)
        assert lu_inverse(factors, swap, out) == OK
        assert away(out, case["out"]) < 1e-14


def test_basilisk_factors() -> None:
    for case in VECTORS["chol"]:
        A = array(case["A"])
        L = np.zeros_like(A)
        code = cholesky(A, L)
        assert (code < 0) == (case["ret"] < 0)
        if code == OK:
            assert away(L, case["out"]) < 1e-14
    for case in VECTORS["downdate"]:
        S = array(case["S"])
        out = np.zeros_like(S)
        code = rank_one(S, array(case["x"]), case["beta"], out)
        assert (code < 0) == (case["ret"] < 0)
        if code == OK:
            assert away(out, case["out"]) < 1e-14


@pytest.mark.parametrize("n", SIZES)
def test_factors_against_numpy(n: int) -> None:
    rng = np.random.default_rng(n)
    A = rng.normal(size=(3 * n, n)) * 10.0 ** rng.uniform(-3, 3, n)
    R = np.zeros((n, n))
    work = A.copy()
    assert qr_triangle(work, R) == OK
    expected = np.linalg.qr(A, mode="r")
    expected *= np.sign(np.diag(expected))[:, None]
    assert np.max(np.abs(R - expected) / np.linalg.norm(A, axis=0)) < 1e-14
    assert np.all(np.tril(R, -1) == 0.0)
    np.testing.assert_allclose(work @ R, A, rtol=1e-13, atol=0)
    P = A.T @ A
    L = np.zeros((n, n))
    for factor in (cholesky, semidefinite_factor):
        assert factor(P, L) == OK
        assert np.max(np.abs(L - np.linalg.cholesky(P)) / np.sqrt(np.diag(P))[:, None]) < 1e-11
    L, X = random_factor(n, n), np.zeros((n, n))
    covariance_of(L, X)
    np.testing.assert_allclose(X, L @ L.T, rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(X, X.T)


@pytest.mark.parametrize("n", SIZES)
def test_solves_against_scipy(n: int) -> None:
    rng = np.random.default_rng(n)
    L, b, out = random_factor(n, n + 1), rng.normal(size=n), np.zeros((n, n))
    for solve, transposed in ((solve_lower, False), (solve_lower_transposed, True)):
        x = b.copy()
        assert solve(L, x) == OK
        assert away(x, scipy.linalg.solve_triangular(L, b, lower=True, trans=int(transposed))) < 1e-12
    assert invert_lower(L, out) == OK
    assert away(out @ L, np.eye(n)) < 1e-9
    assert invert_upper(np.ascontiguousarray(L.T), out) == OK
    assert away(out @ L.T, np.eye(n)) < 1e-9
    A = rng.normal(size=(n, n))
    code, factors, swap = factored(A)
    x = b.copy()
    assert code == lu_solve(factors, swap, x) == OK
    assert away(x, np.linalg.solve(A, b)) < 1e-11
    assert lu_inverse(factors, swap, out) == OK
    assert away(out, np.linalg.inv(A)) < 1e-11
    transposed_A = A.copy()
    transpose_in_place(transposed_A)
    np.testing.assert_array_equal(transposed_A, A.T)


def exact_factor(S: F64, x: F64, beta: float) -> F64:
    """Lower factor of S S' + beta x x' with 60 digits."""
    with mpmath.workdps(60):
        matrix, column = mpmath.matrix(S.tolist()), mpmath.matrix(x.tolist())
        L = mpmath.cholesky(matrix * matrix.T + beta * column * column.T)
        return np.array([[float(L[i, j]) for j in range(len(x))] for i in range(len(x))])


@pytest.mark.parametrize("beta", [1.0, 3.5, -1.0])
def test_rank_one_against_mpmath(beta: float) -> None:
    """Downdates that leave a millionth of the variance keep half of the digits that remain at least."""
    for n in SIZES:
        S = random_factor(n, n)
        x = S @ np.random.default_rng(n).normal(size=n)
        for left, tolerance in ((0.5, 1e-13), (1e-6, 1e-9)):
            size = np.sqrt((1.0 - left) / abs(beta)) / np.linalg.norm(np.linalg.solve(S, x))
            out = np.zeros((n, n))
            assert rank_one(S, size * x, beta, out) == OK
            assert away(out, exact_factor(S, size * x, beta)) < tolerance
            same = S.copy()
            assert rank_one(same, size * x, beta, same) == OK
            np.testing.assert_array_equal(same, out)


BAD: dict[str, tuple[Callable[[], int], int]] = {
    "cholesky, indefinite": (lambda: cholesky(array([[1.0, 2.0], [2.0, 1.0]]), np.zeros((2, 2))), NOT_POSITIVE),
    "cholesky, semidefinite": (lambda: cholesky(array([[1.0, 1.0], [1.0, 1.0]]), np.zeros((2, 2))), SINGULAR),
    "cholesky, NaN": (lambda: cholesky(array([[1.0, 0.0], [np.nan, 1.0]]), np.zeros((2, 2))), NOT_FINITE),
    "semidefinite, indefinite": (
        lambda: semidefinite_factor(array([[1.0, 2.0], [2.0, 1.0]]), np.zeros((2, 2))),
        NOT_POSITIVE,
    ),
    "qr, zero column": (lambda: qr_triangle(array([[0.0, 1.0], [0.0, 2.0]]), np.zeros((2, 2))), SINGULAR),
    "qr, NaN": (lambda: qr_triangle(array([[np.nan, 1.0], [0.0, 2.0]]), np.zeros((2, 2))), NOT_FINITE),
    "qr, infinity": (lambda: qr_triangle(array([[np.inf, 1.0], [0.0, 2.0]]), np.zeros((2, 2))), NOT_FINITE),
    "downdate, too much": (lambda: rank_one(np.eye(2), array([1.0, 1.0]), -1.0, np.zeros((2, 2))), SINGULAR),
    "downdate, far too much": (lambda: rank_one(np.eye(2), array([2.0, 1.0]), -1.0, np.zeros((2, 2))), NOT_POSITIVE),
    "update of zero": (lambda: rank_one(np.zeros((2, 2)), array([1.0, 1.0]), 1.0, np.zeros((2, 2))), SINGULAR),
    "update, NaN": (lambda: rank_one(np.eye(2), array([np.nan, 1.0]), 1.0, np.zeros((2, 2))), NOT_FINITE),
    "solve": (lambda: solve_lower(array([[1.0, 0.0], [1.0, 0.0]]), np.ones(2)), SINGULAR),
    "solve transposed": (lambda: solve_lower_transposed(array([[1.0, 0.0], [1.0, 0.0]]), np.ones(2)), SINGULAR),
    "invert lower": (lambda: invert_lower(np.zeros((2, 2)), np.zeros((2, 2))), SINGULAR),
    "invert upper": (lambda: invert_upper(np.zeros((2, 2)), np.zeros((2, 2))), SINGULAR),
    "lu, zero row": (lambda: factored(array([[1.0, 2.0], [0.0, 0.0]]))[0], SINGULAR),
    "lu, dependent": (lambda: factored(array([[1.0, 2.0], [2.0, 4.0]]))[0], SINGULAR),
    "lu, NaN": (lambda: factored(array([[1.0, np.nan], [2.0, 4.0]]))[0], NOT_FINITE),
    "lu solve": (lambda: lu_solve(np.zeros((2, 2)), np.zeros(2, np.int64), np.ones(2)), SINGULAR),
    "lu inverse": (lambda: lu_inverse(np.zeros((2, 2)), np.zeros(2, np.int64), np.zeros((2, 2))), SINGULAR),
}


@pytest.mark.parametrize("name", BAD)
def test_failures_have_a_code(name: str) -> None:
    run, code = BAD[name]
    assert run() == code


def test_semidefinite_matrices() -> None:
    """Rank 2 of 4, and a state without noise: the factor is one, though pivots are of the size of rounding."""
    B = np.random.default_rng(2).normal(size=(4, 2))
    for A in (B @ B.T, np.diag([1.0, 0.0, 4.0, 0.0]), np.zeros((4, 4))):
        L = np.zeros((4, 4))
        assert semidefinite_factor(A, L) == OK
        np.testing.assert_allclose(L @ L.T, A, rtol=0, atol=1e-12)
    known = np.diag([2.0, 0.0, 1.0])
    assert rank_one(known, array([1.0, 0.0, 0.5]), -1.0, known) == OK
    x = array([1.0, 0.0, 0.5])
    np.testing.assert_allclose(known @ known.T, np.diag([4.0, 0.0, 1.0]) - np.outer(x, x), rtol=0, atol=1e-15)
