"""What filters of an orbit share: prediction, the estimate to start from for a late measurement, parameters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from fsw.math import unscented
from fsw.math.bodies import body
from fsw.math.compiled import compiled
from fsw.math.square_root import OK, cholesky, covariance_of, semidefinite_factor, transpose_in_place
from fsw.math.two_body import noise_of_interval
from fsw.math.unscented import Motion, Weights, time_update
from fsw.module import Row
from messages.base import F64, Record
from modules.estimation.relative_od_ukf import status


@compiled
def copy_into(x: F64, S: F64, x_out: F64, S_out: F64) -> None:
    """Copy an estimate, (n,) and (n, n)."""
    for i in range(x.shape[0]):
        x_out[i] = x[i]
        for j in range(x.shape[0]):
            S_out[i, j] = S[i, j]


@compiled
def begin(state: Row, P: F64, start_ns: int) -> None:
    """First estimate: ``state.x`` is set, P (n, n) is its covariance at ``start_ns``."""
    cholesky(P, state.S)
    copy_into(state.x, state.S, state.anchor_x, state.anchor_S)
    state.time_ns = state.anchor_ns = start_ns
    state.started = True


@compiled
def predict(
    motion: Motion, args: Any, Q: F64, weights: Weights, max_step: float, from_ns: int, to_ns: int, x: F64, S: F64
) -> int:
    """Move an estimate (n,), (n, n) on in equal steps of ``max_step`` [s] at most; unchanged on failure.

    Args:
        motion: of the state.
        args: what the motion needs.
        Q: density of the process noise (n, n), per second.
        weights: of `unscented_weights`.
        max_step: longest step [s].
        from_ns: time of the estimate.
        to_ns: time that is wanted; nothing is done if it is not later.
        x: mean.
        S: lower factor.
    """
    dt = (to_ns - from_ns) * 1e-9
    if not dt > 0.0:
        return OK
    n = x.shape[0]
    count = max(1, math.ceil(dt / max_step - 1e-9))
    work = np.empty((3, n, n))
    noise, before = work[0], np.empty(n)
    noise_of_interval(Q, dt / count, work[1])
    code = semidefinite_factor(work[1], noise)
    transpose_in_place(noise)
    copy_into(x, S, before, work[2])
    for _ in range(count):
        if code == OK:
            code = time_update(motion, dt / count, args, weights, noise, x, S)
    if code != OK:
        copy_into(before, work[2], x, S)
    return code


@compiled
def estimate_before(state: Row, exposure_ns: int, t_ns: int, x: F64, S: F64) -> tuple[int, int]:
    """The estimate to start from for a measurement, into x (n,) and S (n, n).

    It is the newest one, or, for an exposure before that, the one after the last measurement used.

    Returns:
        `status.UPDATED`, or why there is none, and the time of the estimate.
    """
    if exposure_ns > t_ns:
        return status.FROM_FUTURE, 0
    if exposure_ns < state.anchor_ns or (state.used > 0 and exposure_ns == state.anchor_ns):
        return status.TOO_LATE, 0
    if exposure_ns >= state.time_ns:
        copy_into(state.x, state.S, x, S)
        return status.UPDATED, state.time_ns
    copy_into(state.anchor_x, state.anchor_S, x, S)
    return status.UPDATED, state.anchor_ns


@compiled
def outcome(code: int) -> int:
    """Status for a code of `measurement_update`; codes above `unscented.GATED` are already one."""
    if code == OK:
        return status.UPDATED
    if code == unscented.GATED:
        return status.GATED
    return status.FAILED_UPDATE if code < 0 else code


@compiled
def keep(state: Row, exposure_ns: int, x: F64, S: F64) -> None:
    """Take over an estimate (n,), (n, n) that a measurement has updated."""
    copy_into(x, S, state.anchor_x, state.anchor_S)
    copy_into(x, S, state.x, state.S)
    state.time_ns = state.anchor_ns = exposure_ns


@compiled
def blank_measurement(out: Row) -> None:
    """NaN where a filter's message tells of a measurement."""
    out.nis = math.nan
    for i in range(3):
        out.innovation[i] = out.residual[i] = math.nan
        for j in range(3):
            out.P_innovation[i, j] = math.nan


@compiled
def write_innovation(out: Row, innovation: F64, factor: F64, nis: float) -> None:
    """Innovation (3,), its covariance from a lower factor (3, 3), and its normalised square."""
    out.nis = nis
    covariance_of(factor, out.P_innovation)
    for i in range(3):
        out.innovation[i] = innovation[i]


@compiled
def write_estimate(out: Row, state: Row, what: int) -> None:
    """The newest estimate, the status and the counts."""
    if what == status.UPDATED:
        state.used += 1
    elif what != status.NO_MEASUREMENT:
        state.refused += 1
    out.estimate_ns, out.status, out.used, out.refused = state.time_ns, what, state.used, state.refused
    for i in range(state.x.shape[0]):
        out.x[i] = state.x[i]
    covariance_of(state.S, out.P)


def require_covariance(record: Record, field: str, definite: bool) -> None:
    """Check that a matrix field is a covariance: symmetric to 1e-9, positive definite or, if not so, semidefinite.

    Raises:
        ValueError: if it is not; the text names record and field.
    """
    P = np.asarray(getattr(record, field))
    where = f"{type(record).__qualname__}.{field}: expected a covariance"
    scale = np.sqrt(np.abs(np.outer(np.diag(P), np.diag(P))))
    if np.max(np.abs(P - P.T)) > 1e-9 * np.max(np.abs(P)):
        raise ValueError(f"{where}, got a matrix that is not symmetric; make it (P + P') / 2")
    good = np.all(np.diag(P) > 0.0) if definite else np.all((np.diag(P) > 0.0) | ~np.any(P, axis=1))
    part = P / np.where(scale > 0.0, scale, 1.0)
    least = float(np.linalg.eigvalsh(part)[0])
    if not good or least < (1e-14 if definite else -1e-9):
        word = "positive definite" if definite else "positive semidefinite"
        raise ValueError(
            f"{where} that is {word}, got the diagonal {np.diag(P).tolist()} and a least eigenvalue of {least:.3g} "
            f"(in units of the diagonal); give variances, not standard deviations, and correlations below 1"
        )


def require_gravity(record: Record) -> None:
    """Check that ``mu`` is given or that ``body_id`` is in the table of bodies.

    Raises:
        ValueError: if neither is so.
    """
    given: float = getattr(record, "mu")  # noqa: B009 (any record that has these two fields)
    which: int = getattr(record, "body_id")  # noqa: B009
    if not given > 0.0:
        try:
            body(which)
        except ValueError as error:
            raise ValueError(f"{type(record).__qualname__}.body_id: {error}, or give mu") from None
