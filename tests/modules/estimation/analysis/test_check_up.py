"""Each usual mistake, planted into a small Kalman filter and around the unscented core, is caught and named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from fsw.math.compiled import plain
from fsw.math.unscented import draw, factor_about, gain_columns, look, mean_of, move, take_away
from messages.base import F64
from modules.estimation.analysis import (
    MISTAKES,
    ExtendedFilter,
    FunctionFilter,
    Problem,
    UnscentedFilter,
    check_up,
    linear_problem,
    nonlinear_problem,
)

SHORT: dict[str, Any] = {"runs": 3, "epochs": 7, "steps": 10}
"""The single steps are what names mistakes; statistics are looked at elsewhere."""


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
    return np.linalg.cholesky(P)


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


@pytest.mark.parametrize("planted", KALMAN, ids=lambda c: c.__name__)
def test_mistakes_in_a_kalman_filter_are_named(planted: type[Kalman]) -> None:
    report = check_up(planted, **SHORT)
    assert report.causes[:1] == (KALMAN[planted],), str(report)


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
        self.x, self.S = with_points(self, self.S.T, z, R)


class CoreNotRedrawn(UnscentedFilter):
    """The measurement looks at the points of the time update."""

    def predict(self, dt: float) -> None:
        points = np.empty((2 * len(self.x) + 1, len(self.x)))
        plain(draw)(self.x, self.S, self.weights[0], points)
        plain(move)(self.motion, dt, self.motion_args, points)
        self.points = points
        super().predict(dt)

    def update(self, z: F64, R: F64) -> None:
        self.x, self.S = with_points(self, None, z, R, self.points)


def with_points(made: UnscentedFilter, root: F64 | None, z: F64, R: F64, points: F64 | None = None) -> tuple[F64, F64]:
    """A measurement update by the parts of the core, with points of our own."""
    n, m = len(made.x), len(z)
    if points is None:
        points = np.empty((2 * n + 1, n))
        plain(draw)(made.x, root, made.weights[0], points)
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


@pytest.mark.parametrize("planted", CORE, ids=lambda c: c.__name__)
def test_mistakes_around_the_unscented_core_are_named(planted: type[UnscentedFilter]) -> None:
    report = check_up(planted, **SHORT)
    assert report.causes[:1] == (CORE[planted],), str(report)


@pytest.mark.parametrize("right", [Kalman, ExtendedFilter, Unscented])
def test_right_filters_pass(right: Any) -> None:
    report = check_up(right)
    assert report.passed, str(report)


@pytest.mark.slow
@pytest.mark.parametrize("right", [Kalman, Unscented])
def test_no_false_alarm_in_200_seeds(right: Any) -> None:
    """At a stated probability of 1e-4 for one check-up."""
    assert [seed for seed in range(200) if not check_up(right, seed=seed).passed] == []


def test_the_level_is_what_is_stated() -> None:
    """At a false alarm of 30 %, the linear problem gives about so many in 120: the tests are not merely blunt."""
    alarms = [
        not check_up(Kalman, [linear_problem()], seed=seed, runs=8, epochs=7, steps=1, false_alarm=0.3).passed
        for seed in range(120)
    ]
    # five tests, correlated, so at most the sum of their parts; a whole one would be 0.27 if independent
    assert 0.15 < np.mean(alarms) < 0.36


def test_two_mistakes_are_told_apart() -> None:
    class Both(VarianceAsSigma, NoProcessNoise):
        pass

    class OnePlace(WrongSign, SigmaAsVariance):
        pass

    assert set(check_up(Both, **SHORT).causes) == {"variance given as sigma", "missing process noise"}
    assert set(check_up(OnePlace, **SHORT).causes) == {"wrong measurement sign", "sigma given as variance"}


def test_a_wrong_derivative_is_seen() -> None:
    """None of the known mistakes: it says so, and what is nearest."""

    class WrongDerivative(Kalman):
        def update(self, z: F64, R: F64) -> None:
            H = self.problem.H(self.x)
            H[0, 1] *= 1.1
            K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
            left = np.eye(len(self.x)) - K @ H
            self.x, self.P = self.x + K @ self.innovation(z), left @ self.P @ left.T + K @ R @ K.T

    report = check_up(WrongDerivative, [nonlinear_problem()], **SHORT)
    assert report.causes == ("unexplained difference",)
    assert "nearest known mistake" in str(report)


def test_statistics_alone_call_a_wrong_filter_wrong() -> None:
    """What the runs show if the single steps were not looked at: too small, too large, biased, not white."""
    for planted, effect in (
        (NoProcessNoise, "overconfident"),
        (NoiseTwice, "cautious"),
        (OnlyCovariance, "innovations not white"),
    ):
        report = check_up(planted, [linear_problem()], steps=1)
        assert effect in report.mistakes, str(report)
        assert effect not in report.causes

    class Biased(Kalman):
        def innovation(self, z: F64) -> F64:
            return super().innovation(z) + 0.5

    assert "biased" in check_up(Biased, [linear_problem()], steps=1).mistakes


def test_lost_digits_are_seen() -> None:
    """P - K H P at 1e7 m and 1e-9 rad, in single precision."""

    class Short(Kalman):
        def update(self, z: F64, R: F64) -> None:
            H, P = self.problem.H(self.x).astype(np.float32), self.P.astype(np.float32)
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R.astype(np.float32))
            self.x = self.x + K @ self.innovation(z)
            self.P = (P - K @ (H @ P)).astype(np.float64)
            self.P = 0.5 * (self.P + self.P.T)

    report = check_up(Short, runs=3, epochs=7, steps=300, tolerance=1e-4)
    assert report.causes and report.causes[0] in ("covariance not symmetric", "covariance not positive", "digits lost")
    assert "endurance" in str(report)


def test_functions_as_a_filter() -> None:
    problem = linear_problem()

    def predict(x: F64, P: F64, dt: float) -> tuple[F64, F64]:
        F = problem.F(x, dt)
        return F @ x, F @ P @ F.T + problem.noise(dt)

    def update(x: F64, P: F64, z: F64, R: F64) -> tuple[F64, F64]:
        H = problem.H(x)
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        return x + K @ (z - H @ x), P - K @ H @ P

    assert check_up(lambda p: FunctionFilter(p.x0, p.P0, predict, update), [problem], **SHORT).passed


def test_the_report_gives_reason_and_figure() -> None:
    text = str(check_up(VarianceAsSigma, **SHORT))
    assert text.startswith("Filter check-up: variance given as sigma.")
    for part in (
        "MISTAKE  variance given as sigma",
        "reason: ",
        MISTAKES["variance given as sigma"],
        "figure: an update is",
    ):
        assert part in text
    assert "equals that of variance given as sigma to" in text
    assert "well     prediction" in text
    assert "no mistake found" in str(check_up(Kalman, **SHORT))


def test_bad_requests_are_refused() -> None:
    class NoUpdate:
        x, P = np.zeros(4), np.eye(4)

        def __init__(self, problem: Problem) -> None:
            pass

        def predict(self, dt: float) -> None:
            pass

    class WrongShape(Kalman):
        def begin(self, P: F64) -> F64:
            return np.diag(P)

    for action, text in (
        (lambda: check_up(Kalman, []), "no problem"),
        (lambda: check_up(Kalman, runs=1), "runs >= 2"),
        (lambda: check_up(NoUpdate, **SHORT), r"has no update; it needs x, P, predict\(dt\)"),  # type: ignore[arg-type]
        (
            lambda: check_up(WrongShape, **SHORT),
            r"expected a filter with x \(4,\) and P \(4, 4\), got \(4,\) and \(4,\)",
        ),
    ):
        with pytest.raises(ValueError, match=text):
            action()
