"""A Kalman filter and calls of the unscented core, right ones and copies with one mistake each."""

from __future__ import annotations

import numpy as np

from fsw.math.compiled import plain
from fsw.math.unscented import draw, factor_about, gain_columns, look, mean_of, move, take_away
from messages.base import F64
from modules.estimation.analysis import Problem, UnscentedFilter


class Kalman:
    """The Kalman filter by the book, with places for mistakes."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.x, self.P = problem, problem.x0.copy(), self.begin(problem.P0)
        self.last: F64 | None = None

    def begin(self, P: F64) -> F64:
        return P.copy()

    def Q(self, dt: float) -> F64:
        return self.problem.noise(dt)

    def R(self, R: F64) -> F64:
        return R

    def predict(self, dt: float) -> None:
        self.x_before, self.P_before, self.dt, F = self.x, self.P, dt, self.problem.F(self.x, dt)
        self.x, self.P = self.problem.motion(self.x, dt), F @ self.P @ F.T + self.Q(dt)

    def innovation(self, z: F64) -> F64:
        return z - self.problem.measure(self.x)

    def update(self, z: F64, R: F64) -> None:
        H, R = self.problem.H(self.x), self.R(R)
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        left = np.eye(len(self.x)) - K @ H
        self.x = self.x + K @ self.innovation(z)
        self.P = left @ self.P @ left.T + K @ R @ K.T


def lower(P: F64) -> F64:
    return np.asarray(np.linalg.cholesky(P), np.float64)


class VarianceAsSigma(Kalman):
    def R(self, R: F64) -> F64:
        return R @ R.T


class StandardDeviationsSquaredAgain(Kalman):
    def Q(self, dt: float) -> F64:
        return np.diag(np.diag(self.problem.noise(dt)) ** 2)


class PriorSquared(Kalman):
    def begin(self, P: F64) -> F64:
        return P @ P


class SigmaAsVariance(Kalman):
    def R(self, R: F64) -> F64:
        return np.diag(np.sqrt(np.diag(R)))


class FactorAsCovariance(Kalman):
    def Q(self, dt: float) -> F64:
        return lower(self.problem.noise(dt)) + lower(self.problem.noise(dt)).T - np.diag(np.diag(lower(self.Q0(dt))))

    def Q0(self, dt: float) -> F64:
        return self.problem.noise(dt)


class SigmaPrior(Kalman):
    def begin(self, P: F64) -> F64:
        return np.diag(np.sqrt(np.diag(P)))


class ProcessFactorTransposed(Kalman):
    def Q(self, dt: float) -> F64:
        L = lower(self.problem.noise(dt))
        return L.T @ L


class MeasurementFactorTransposed(Kalman):
    def R(self, R: F64) -> F64:
        return lower(R).T @ lower(R)


class PriorOfWrongTriangle(Kalman):
    def begin(self, P: F64) -> F64:
        return lower(P).T @ lower(P)


class InnovationOfWrongTriangle(Kalman):
    """The factor of S is upper and solved as if it were lower."""

    def update(self, z: F64, R: F64) -> None:
        H = self.problem.H(self.x)
        U = lower(H @ self.P @ H.T + R).T
        K = self.P @ H.T @ np.linalg.inv(U @ U.T)
        self.x, self.P = self.x + K @ self.innovation(z), self.P - K @ H @ self.P
        self.P = 0.5 * (self.P + self.P.T)


class PointsOfWrongTriangle(Kalman):
    def predict(self, dt: float) -> None:
        self.P = lower(self.P).T @ lower(self.P)
        super().predict(dt)


class NotRedrawn(Kalman):
    """Gain and innovation's covariance from what the time update's points know."""

    def update(self, z: F64, R: F64) -> None:
        H, P = self.problem.H(self.x), self.P - self.Q(self.dt)
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        self.x, self.P = self.x + K @ self.innovation(z), self.P - K @ S @ K.T


class WrongSign(Kalman):
    def innovation(self, z: F64) -> F64:
        return -super().innovation(z)


class WrongSignOfModel(Kalman):
    def update(self, z: F64, R: F64) -> None:
        super().update(-z, R)


class Twice(Kalman):
    def update(self, z: F64, R: F64) -> None:
        super().update(z, R)
        super().update(z, R)


class HalfNoise(Kalman):
    def R(self, R: F64) -> F64:
        return R / 2.0


class Stale(Kalman):
    """The measurement before is still in the buffer."""

    def update(self, z: F64, R: F64) -> None:
        if self.last is not None:
            super().update(self.last, R)
        super().update(z, R)
        self.last = z


class LateBuffer(Kalman):
    """One measurement too late."""

    def update(self, z: F64, R: F64) -> None:
        if self.last is not None:
            super().update(self.last, R)
        self.last = z


class BeforeMotion(Kalman):
    """The update is made at the time before, and moved."""

    def update(self, z: F64, R: F64) -> None:
        self.x, self.P = self.x_before, self.P_before
        super().update(z, R)
        self.predict(self.dt)


class OldInnovation(Kalman):
    def innovation(self, z: F64) -> F64:
        return z - self.problem.measure(self.x_before)


class OneStepFurther(Kalman):
    def update(self, z: F64, R: F64) -> None:
        self.predict(self.dt)
        super().update(z, R)


class NoProcessNoise(Kalman):
    def Q(self, dt: float) -> F64:
        return np.zeros_like(self.P)


class FixedProcessNoise(Kalman):
    def Q(self, dt: float) -> F64:
        return self.problem.noise(self.problem.dt)


class DensityForCovariance(Kalman):
    def Q(self, dt: float) -> F64:
        return self.problem.noise(1e-6) / 1e-6


class ScaledTwice(Kalman):
    def Q(self, dt: float) -> F64:
        return dt * self.problem.noise(dt)


class NoiseTwice(Kalman):
    def Q(self, dt: float) -> F64:
        return 2.0 * self.problem.noise(dt)


class NoiseFirst(Kalman):
    def predict(self, dt: float) -> None:
        F = self.problem.F(self.x, dt)
        self.x, self.P = self.problem.motion(self.x, dt), F @ (self.P + self.Q(dt)) @ F.T


class OneTriangle(Kalman):
    def update(self, z: F64, R: F64) -> None:
        super().update(z, R)
        self.P = np.tril(self.P)


class Negative(Kalman):
    """P - K S K' with a gain that is too large."""

    def update(self, z: F64, R: F64) -> None:
        H = self.problem.H(self.x)
        S = H @ self.P @ H.T + R
        K = 1.5 * self.P @ H.T @ np.linalg.inv(S)
        self.x, self.P = self.x + K @ self.innovation(z), self.P - K @ S @ K.T


class NoCovarianceUpdate(Kalman):
    def update(self, z: F64, R: F64) -> None:
        P = self.P
        super().update(z, R)
        self.P = P


class Deaf(Kalman):
    def update(self, z: F64, R: F64) -> None:
        pass


class OnlyCovariance(Kalman):
    def innovation(self, z: F64) -> F64:
        return 0.0 * z


class FixedInterval(Kalman):
    def predict(self, dt: float) -> None:
        super().predict(self.problem.dt)


class TransitionTransposed(Kalman):
    def predict(self, dt: float) -> None:
        F = self.problem.F(self.x, dt)
        self.x, self.P = self.problem.motion(self.x, dt), F.T @ self.P @ F + self.Q(dt)


class CovarianceStays(Kalman):
    def predict(self, dt: float) -> None:
        self.x, self.P = self.problem.motion(self.x, dt), self.P + self.Q(dt)


class Diagonal(Kalman):
    def R(self, R: F64) -> F64:
        return np.diag(np.diag(R))


class FromZero(Kalman):
    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.x = np.zeros(len(self.x))


class Fails(Kalman):
    def update(self, z: F64, R: F64) -> None:
        raise ArithmeticError("it overflows")


class Overflows(Kalman):
    def update(self, z: F64, R: F64) -> None:
        self.P = np.full_like(self.P, np.nan)


KALMAN: dict[type[Kalman], str] = {
    VarianceAsSigma: "variance given as sigma",
    StandardDeviationsSquaredAgain: "variance given as sigma",
    PriorSquared: "variance given as sigma",
    SigmaAsVariance: "sigma given as variance",
    SigmaPrior: "sigma given as variance",
    ProcessFactorTransposed: "transposed noise factor",
    MeasurementFactorTransposed: "transposed noise factor",
    PriorOfWrongTriangle: "wrong triangle",
    InnovationOfWrongTriangle: "wrong triangle",
    PointsOfWrongTriangle: "wrong triangle",
    NotRedrawn: "points not redrawn",
    WrongSign: "wrong measurement sign",
    WrongSignOfModel: "wrong measurement sign",
    Twice: "double use of data",
    HalfNoise: "double use of data",
    Stale: "double use of data",
    LateBuffer: "measurement at the wrong time",
    BeforeMotion: "measurement at the wrong time",
    OldInnovation: "measurement at the wrong time",
    OneStepFurther: "measurement at the wrong time",
    NoProcessNoise: "missing process noise",
    FixedProcessNoise: "process noise not scaled with dt",
    DensityForCovariance: "process noise not scaled with dt",
    ScaledTwice: "process noise scaled twice with dt",
    NoiseTwice: "process noise used twice",
    NoiseFirst: "process noise before the motion",
    OneTriangle: "covariance not symmetric",
    Negative: "covariance not positive",
    NoCovarianceUpdate: "covariance not updated",
    Deaf: "measurement ignored",
    OnlyCovariance: "estimate not updated",
    FixedInterval: "interval ignored",
    TransitionTransposed: "transition transposed",
    CovarianceStays: "covariance not moved",
    Diagonal: "correlations dropped",
    FromZero: "first guess not taken",
    Fails: "raises",
    Overflows: "not finite",
}


class Unscented(UnscentedFilter):
    """The unscented core called rightly; copies of this call hold the mistakes."""


class NoiseTransposed(UnscentedFilter):
    def noise_factor(self, covariance: F64) -> F64:
        return lower(covariance)


class NoiseVariance(UnscentedFilter):
    def noise_factor(self, covariance: F64) -> F64:
        return covariance.copy()


class NoiseSigma(UnscentedFilter):
    def noise_factor(self, covariance: F64) -> F64:
        return super().noise_factor(np.diag(np.sqrt(np.diag(covariance))))


class UpperAtFirst(UnscentedFilter):
    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.S = np.ascontiguousarray(self.S.T)


class UpperEveryTime(UnscentedFilter):
    def predict(self, dt: float) -> None:
        self.S = np.ascontiguousarray(self.S.T)
        super().predict(dt)


class UpperInUpdates(UnscentedFilter):
    """An update of another core, which draws points along the rows of its factor."""

    def update(self, z: F64, R: F64) -> None:
        self.x, self.S = with_points(self, drawn(self, self.S.T), z, R)


class CoreNotRedrawn(UnscentedFilter):
    """The measurement looks at the points of the time update."""

    def predict(self, dt: float) -> None:
        self.points = drawn(self, self.S)
        plain(move)(self.motion, dt, self.motion_args, self.points)
        super().predict(dt)

    def update(self, z: F64, R: F64) -> None:
        self.x, self.S = with_points(self, self.points, z, R)


def drawn(made: UnscentedFilter, root: F64) -> F64:
    """Points along the columns of any factor."""
    points = np.empty((2 * len(made.x) + 1, len(made.x)))
    plain(draw)(made.x, root, made.weights[0], points)
    return points


def with_points(made: UnscentedFilter, points: F64, z: F64, R: F64) -> tuple[F64, F64]:
    """A measurement update by the parts of the core, with points of our own."""
    n, m = len(made.x), len(z)
    seen, mean, middle = np.empty((2 * n + 1, m)), np.empty(m), np.empty(n)
    plain(look)(made.measure, made.measure_args, points, seen)
    plain(mean_of)(points, made.weights, middle)
    plain(mean_of)(seen, made.weights, mean)
    factor, U, S = np.empty((m, m)), np.empty((n, m)), made.S.copy()
    rows, triangle = np.empty((2 * n + m, m)), np.empty((m, m))
    plain(factor_about)(seen, mean, made.weights, 1.0, made.noise_factor(R), factor, rows, triangle)
    plain(gain_columns)(points, middle, seen, mean, made.weights, factor, U)
    plain(take_away)(S, U, np.empty(n))
    return made.x + U @ np.linalg.solve(factor, z - mean), S


CORE: dict[type[UnscentedFilter], str] = {
    NoiseTransposed: "transposed noise factor",
    NoiseVariance: "variance given as sigma",
    NoiseSigma: "sigma given as variance",
    UpperAtFirst: "wrong triangle",
    UpperEveryTime: "wrong triangle",
    UpperInUpdates: "wrong triangle",
    CoreNotRedrawn: "points not redrawn",
}
