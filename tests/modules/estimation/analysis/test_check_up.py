"""Each usual mistake, planted into a small Kalman filter and around the unscented core, is caught and named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

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
from tests.modules.estimation.analysis.planted_filters import (
    CORE,
    KALMAN,
    Kalman,
    NoiseTwice,
    NoProcessNoise,
    OnlyCovariance,
    SigmaAsVariance,
    Unscented,
    VarianceAsSigma,
    WrongSign,
)

SHORT: dict[str, Any] = {"runs": 3, "epochs": 7, "steps": 10}
"""The single steps are what names mistakes; statistics are looked at elsewhere."""


@pytest.mark.parametrize("planted", KALMAN, ids=lambda c: c.__name__)
def test_mistakes_in_a_kalman_filter_are_named(planted: type[Kalman]) -> None:
    report = check_up(planted, **SHORT)
    assert report.causes[:1] == (KALMAN[planted],), str(report)


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
