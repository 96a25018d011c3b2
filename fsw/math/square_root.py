"""Square-root algebra on small matrices: orthogonal and triangular factors, their up- and downdates, and solves.

All functions write into arrays that the caller gives and return a code: `OK`, or why there is no result. A caller that
goes on without looking at the code works on numbers that mean nothing. Lower factors L have A = L L'.

Sources: Bjorck, "Numerical Methods for Least Squares Problems" (1996), sec. 2.4 (modified Gram-Schmidt, whose R is as
good as Householder's); Gill, Golub, Murray and Saunders (1974), "Methods for modifying matrix factorizations", Math.
Comp. 28:505, method C1 (rank one); Press et al., "Numerical Recipes", sec. 2.3 (LU with implicit scaling).
"""

from __future__ import annotations

import math

from fsw.math.compiled import compiled
from messages.base import F64, I64

OK = 0
NOT_POSITIVE = -1
"""The matrix is not positive definite, or a downdate takes away more than there is."""
SINGULAR = -2
"""A pivot or a column is zero. Factors are still right, with a zero on the diagonal; solving is refused."""
NOT_FINITE = -3
"""NaN or infinity in the result."""


@compiled
def qr_triangle(A: F64, R: F64) -> int:
    """Upper R (n, n), A'A = R'R, with a diagonal that is not negative; A (m, n) is overwritten by the orthogonal part.

    A column that depends on those before it may leave a diagonal element of rounding size and not exactly zero. Zeros
    below a triangle of rows at the end cost nothing.
    """
    rows, n = A.shape
    m, code = 0, OK
    for k in range(n):
        last = rows
        while last > m and A[last - 1, k] == 0.0:
            last -= 1
        m = last  # below it this column and those before are zero
        for j in range(n):
            R[k, j] = 0.0
        total = 0.0
        for i in range(m):
            total += A[i, k] * A[i, k]
        length = math.sqrt(total)
        R[k, k] = length
        if length == 0.0:
            code = SINGULAR
            continue
        part = 1.0 / length
        for i in range(m):
            A[i, k] *= part
        j = k + 1
        while j + 4 <= n:  # four columns at a time: their sums do not wait for each other
            s0 = s1 = s2 = s3 = 0.0
            for i in range(m):
                q = A[i, k]
                s0 += q * A[i, j]
                s1 += q * A[i, j + 1]
                s2 += q * A[i, j + 2]
                s3 += q * A[i, j + 3]
            for i in range(m):
                q = A[i, k]
                A[i, j] -= s0 * q
                A[i, j + 1] -= s1 * q
                A[i, j + 2] -= s2 * q
                A[i, j + 3] -= s3 * q
            R[k, j], R[k, j + 1], R[k, j + 2], R[k, j + 3] = s0, s1, s2, s3
            j += 4
        while j < n:
            s0 = 0.0
            for i in range(m):
                s0 += A[i, k] * A[i, j]
            for i in range(m):
                A[i, j] -= s0 * A[i, k]
            R[k, j] = s0
            j += 1
    return code if finite_triangle(R, False) else NOT_FINITE


@compiled
def finite_triangle(T: F64, lower: bool) -> bool:
    """Whether one triangle of T (n, n) has neither NaN nor infinity."""
    n = T.shape[0]
    total = 0.0
    for i in range(n):
        for j in range(0 if lower else i, i + 1 if lower else n):
            total += T[i, j] * 0.0
    return total == 0.0


@compiled
def cholesky(A: F64, L: F64) -> int:
    """Lower L (n, n) with A = L L'; reads the lower triangle of A (n, n) only.

    `SINGULAR`: A is semidefinite, and L has a zero column where a pivot is exactly zero; it is still a factor.
    """
    n = A.shape[0]
    code = OK
    for i in range(n):
        for j in range(n):
            L[i, j] = 0.0
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if pivot < 0.0:
            return NOT_POSITIVE
        L[j, j] = math.sqrt(pivot)
        for i in range(j + 1, n):
            rest = A[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            if pivot != 0.0:
                L[i, j] = rest / L[j, j]
            elif rest != 0.0:
                return NOT_POSITIVE
        if pivot == 0.0:
            code = SINGULAR
    return code if finite_triangle(L, True) else NOT_FINITE


@compiled
def semidefinite_factor(A: F64, L: F64) -> int:
    """Lower L (n, n) with A = L L' for A that may be semidefinite: pivots below 1e-13 of their element count as zero.

    `OK` with zero columns where A has no part of its own; `NOT_POSITIVE` if a pivot is below -1e-9 of its element.
    """
    n = A.shape[0]
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if A[j, j] < 0.0 or pivot < -1e-9 * A[j, j]:
            return NOT_POSITIVE
        none = pivot <= 1e-13 * A[j, j]
        root = 0.0 if none else math.sqrt(pivot)
        for i in range(n):
            L[i, j] = 0.0
        L[j, j] = root
        for i in range(j + 1, n):
            if not none:
                rest = A[i, j]
                for k in range(j):
                    rest -= L[i, k] * L[j, k]
                L[i, j] = rest / root
    return OK if finite_triangle(L, True) else NOT_FINITE


@compiled
def transpose_in_place(A: F64) -> None:
    """A <- A', (n, n)."""
    for i in range(A.shape[0]):
        for j in range(i):
            A[i, j], A[j, i] = A[j, i], A[i, j]


@compiled
def rank_one(S: F64, x: F64, beta: float, out: F64) -> int:
    """Lower factor ``out`` (n, n) of S S' + beta x x', S lower; beta of either sign. x (n,) is overwritten.

    ``out`` may be S itself, which is then lost on failure.
    """
    n = S.shape[0]
    b = 1.0
    for i in range(n):
        w = x[i]
        s = S[i, i]
        s2 = s * s
        if s == 0.0 and w == 0.0:  # known exactly, and stays so
            for j in range(n):
                out[j, i] = S[j, i] if j > i else 0.0
            continue
        new = s2 + beta / b * w * w
        if new < 0.0:
            return NOT_POSITIVE
        if new == 0.0 or s == 0.0:
            return SINGULAR
        root = math.sqrt(new)
        part, g = 1.0 / s, beta * w / (s2 * b + beta * w * w)
        for j in range(i + 1, n):
            ratio = S[j, i] * part
            x[j] -= w * ratio
            out[j, i] = root * (ratio + g * x[j])
        b += beta * w * w / s2
        out[i, i] = root
        for j in range(i + 1, n):
            out[i, j] = 0.0
    return OK if finite_triangle(out, True) else NOT_FINITE


@compiled
def solve_lower(L: F64, b: F64) -> int:
    """b <- L^-1 b, L (n, n) lower, b (n,); unchanged if a pivot is zero."""
    n = L.shape[0]
    for i in range(n):
        if L[i, i] == 0.0:
            return SINGULAR
    for i in range(n):
        total = b[i]
        for j in range(i):
            total -= L[i, j] * b[j]
        b[i] = total / L[i, i]
    return OK


@compiled
def solve_lower_transposed(L: F64, b: F64) -> int:
    """b <- L'^-1 b, L (n, n) lower, b (n,); unchanged if a pivot is zero."""
    n = L.shape[0]
    for i in range(n):
        if L[i, i] == 0.0:
            return SINGULAR
    for i in range(n - 1, -1, -1):
        total = b[i]
        for j in range(i + 1, n):
            total -= L[j, i] * b[j]
        b[i] = total / L[i, i]
    return OK


@compiled
def invert_lower(L: F64, out: F64) -> int:
    """out = L^-1, both (n, n) lower; reads the lower triangle of L only."""
    n = L.shape[0]
    for i in range(n):
        if L[i, i] == 0.0:
            return SINGULAR
    for j in range(n):
        for i in range(n):
            out[i, j] = 0.0
        out[j, j] = 1.0 / L[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= L[i, k] * out[k, j]
            out[i, j] = total / L[i, i]
    return OK if finite_triangle(out, True) else NOT_FINITE


@compiled
def invert_upper(U: F64, out: F64) -> int:
    """out = U^-1, both (n, n) upper; reads the upper triangle of U only."""
    n = U.shape[0]
    for i in range(n):
        if U[i, i] == 0.0:
            return SINGULAR
    for j in range(n):
        for i in range(n):
            out[i, j] = 0.0
        out[j, j] = 1.0 / U[j, j]
        for i in range(j - 1, -1, -1):
            total = 0.0
            for k in range(i + 1, j + 1):
                total -= U[i, k] * out[k, j]
            out[i, j] = total / U[i, i]
    return OK if finite_triangle(out, False) else NOT_FINITE


@compiled
def lu(A: F64, swap: I64, scale: F64) -> int:
    """A <- L and U in one matrix, L with a unit diagonal, of A with rows interchanged; all (n, n).

    Args:
        A: in: matrix; out: factors.
        swap: out (n,): the row that was interchanged with row j at step j.
        scale: work (n,).
    """
    n = A.shape[0]
    for i in range(n):
        largest = 0.0
        for j in range(n):
            largest = max(largest, math.fabs(A[i, j]))
        if not largest > 0.0:
            return SINGULAR if largest == 0.0 else NOT_FINITE
        scale[i] = 1.0 / largest
    for j in range(n):
        for i in range(n):
            total = A[i, j]
            for k in range(min(i, j)):
                total -= A[i, k] * A[k, j]
            A[i, j] = total
        best, row = 0.0, j
        for i in range(j, n):
            size = scale[i] * math.fabs(A[i, j])
            if size >= best:
                best, row = size, i
        swap[j] = row
        if row != j:
            for k in range(n):
                A[row, k], A[j, k] = A[j, k], A[row, k]
            scale[row] = scale[j]
        if not math.fabs(A[j, j]) > 0.0:
            return SINGULAR if A[j, j] == 0.0 else NOT_FINITE
        for i in range(j + 1, n):
            A[i, j] /= A[j, j]
    return OK


@compiled
def lu_solve(A: F64, swap: I64, b: F64) -> int:
    """b <- solution of the equations whose matrix `lu` has factored into A (n, n), ``swap`` (n,); b (n,)."""
    n = A.shape[0]
    for i in range(n):
        if A[i, i] == 0.0:
            return SINGULAR
    for i in range(n):
        b[i], b[swap[i]] = b[swap[i]], b[i]
    for i in range(n):
        for j in range(i):
            b[i] -= A[i, j] * b[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]
    return OK


@compiled
def lu_inverse(A: F64, swap: I64, out: F64) -> int:
    """out = inverse (n, n) of the matrix that `lu` has factored into A (n, n), ``swap`` (n,)."""
    n = A.shape[0]
    for k in range(n):
        for i in range(n):
            out[k, i] = 1.0 if i == k else 0.0
        code = lu_solve(A, swap, out[k])
        if code != OK:
            return code
    transpose_in_place(out)
    return OK


@compiled
def covariance_of(S: F64, P: F64) -> None:
    """P = S S', S (n, n) lower, P (n, n) symmetric to the bit."""
    n = S.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(j + 1):
                total += S[i, k] * S[j, k]
            P[i, j] = P[j, i] = total
