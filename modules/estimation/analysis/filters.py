"""Filters to be judged: the protocol, and the cores of this framework behind it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np

from fsw.math.compiled import plain
from fsw.math.extended import covariance_time, kalman_update
from fsw.math.square_root import OK, cholesky, semidefinite_factor
from fsw.math.unscented import measurement_update, time_update, unscented_weights
from messages.base import F64
from modules.estimation.analysis.problems import Problem


class Filter(Protocol):
    """What a filter needs for a check-up.

    Attributes:
        x: (n,) estimate.
        P: (n, n) its covariance.
    """

    @property
    def x(self) -> F64:
        """Estimate (n,)."""
        ...

    @property
    def P(self) -> F64:
        """Its covariance (n, n), not its factor."""
        ...

    def predict(self, dt: float) -> Any:
        """Move on by dt [s]."""

    def update(self, z: F64, R: F64) -> Any:
        """Use a measurement z (m,) of covariance R (m, m), made at the time of the last prediction."""


FilterFactory: TypeAlias = Callable[[Problem], Filter]
"""Makes a filter that starts from ``problem.x0`` and ``problem.P0``."""


class FunctionFilter:
    """Two functions as a filter, ``predict(x, P, dt)`` and ``update(x, P, z, R)``, each of which returns x and P.

    Attributes:
        x, P: estimate and covariance.
    """

    def __init__(
        self,
        x: F64,
        P: F64,
        predict: Callable[[F64, F64, float], tuple[F64, F64]],
        update: Callable[[F64, F64, F64, F64], tuple[F64, F64]],
    ) -> None:
        self.x, self.P = x.copy(), P.copy()
        self._predict, self._update = predict, update

    def predict(self, dt: float) -> None:
        """Call the first function."""
        self.x, self.P = self._predict(self.x, self.P, dt)

    def update(self, z: F64, R: F64) -> None:
        """Call the second function."""
        self.x, self.P = self._update(self.x, self.P, z, R)


class ExtendedFilter:
    """The extended core, `fsw.math.extended`, on a problem; on linear ones it is the Kalman filter.

    Attributes:
        x, P: estimate and covariance.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.x, self.P = problem.x0.copy(), problem.P0.copy()
        self._all = np.ones(len(self.x), np.bool_)

    def predict(self, dt: float) -> None:
        """Move on by dt [s]."""
        F, Q = self.problem.F(self.x, dt), self.problem.noise(dt)
        _check(covariance_time(F, Q, self.P), "the time update")
        self.x = self.problem.motion(self.x, dt)

    def update(self, z: F64, R: F64) -> None:
        """Use a measurement."""
        dx = np.empty(len(self.x))
        H, residual = self.problem.H(self.x), z - self.problem.measure(self.x)
        _check(kalman_update(self.P, H, R, residual, math.inf, self._all, dx)[0], "the measurement update")
        self.x = self.x + dx


class UnscentedFilter:
    """The square-root unscented core, `fsw.math.unscented`, on a problem with compiled functions.

    Attributes:
        x: estimate.
        S: lower factor of its covariance.
    """

    def __init__(self, problem: Problem, alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> None:
        if problem.kernels is None:
            raise ValueError(f"UnscentedFilter: the problem {problem.name} has no compiled functions; give kernels")
        self.problem = problem
        self.motion, self.motion_args, self.measure, self.measure_args = problem.kernels
        self.weights = plain(unscented_weights)(len(problem.x0), alpha, beta, kappa)
        self.x, self.S = problem.x0.copy(), np.zeros_like(problem.P0)
        _check(plain(cholesky)(problem.P0, self.S), "the factor of P0")

    @property
    def P(self) -> F64:
        """Covariance."""
        return self.S @ self.S.T

    def noise_factor(self, covariance: F64) -> F64:
        """Transposed lower factor of a covariance."""
        L = np.zeros_like(covariance)
        _check(plain(semidefinite_factor)(covariance, L), "the factor of a noise")
        return np.ascontiguousarray(L.T)

    def predict(self, dt: float) -> None:
        """Move on by dt [s]."""
        noise = self.noise_factor(self.problem.noise(dt))
        _check(time_update(self.motion, dt, self.motion_args, self.weights, noise, self.x, self.S), "the time update")

    def update(self, z: F64, R: F64) -> None:
        """Use a measurement."""
        innovation, factor, noise = np.empty(len(z)), np.empty(R.shape), self.noise_factor(R)
        code, _ = measurement_update(
            self.measure, self.measure_args, self.weights, noise, z, math.inf, self.x, self.S, innovation, factor
        )
        _check(code, "the measurement update")


def _check(code: int, what: str) -> None:
    if code != OK:
        raise ArithmeticError(f"{what} returned {code}; see fsw.math.square_root for its codes")
