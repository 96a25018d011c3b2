"""Many runs of a filter: are its errors as large as it says, do its innovations forget, does its covariance last?"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.stats import norm as _norm

from messages.base import F64
from modules.estimation.analysis.bound import Bound
from modules.estimation.analysis.consistency import band, definite_factors, nees, nis
from modules.estimation.analysis.filters import FilterFactory
from modules.estimation.analysis.mistakes import Finding
from modules.estimation.analysis.problems import Problem
from modules.estimation.analysis.steps import ProtocolError, shape_faults, snapshot
from modules.estimation.analysis.whiteness import whiteness

norm: Any = _norm
LAGS = 5


def _root(P: F64) -> F64:
    """A factor of a covariance that may be singular, in units of its diagonal."""
    d = np.sqrt(np.diag(P))
    used = np.where(d > 0.0, d, 1.0)
    values, vectors = np.linalg.eigh(P / np.outer(used, used))
    return used[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def simulate(factory: FilterFactory, problem: Problem, runs: int, epochs: int, seed: int) -> tuple[F64, F64, F64, F64]:
    """Errors (M, K, n) after the updates, their covariances, innovations (M, K, m) and theirs."""
    n, m = len(problem.x0), len(problem.R)
    errors, P = np.empty((runs, epochs, n)), np.empty((runs, epochs, n, n))
    innovations, S = np.empty((runs, epochs, m)), np.empty((runs, epochs, m, m))
    prior, noise = np.linalg.cholesky(problem.P0), np.linalg.cholesky(problem.R)
    push, dt = _root(problem.noise(problem.dt)), problem.dt
    for i in range(runs):
        rng = np.random.default_rng([seed, i])
        truth, made = problem.x0 + prior @ rng.normal(size=n), factory(problem)
        for k in range(epochs):
            truth = problem.motion(truth, dt) + push @ rng.normal(size=n)
            z = problem.measure(truth) + noise @ rng.normal(size=m)
            made.predict(dt)
            x, before = snapshot(made, problem)
            H = problem.H(x)
            innovations[i, k], S[i, k] = z - problem.measure(x), H @ before @ H.T + problem.R
            made.update(z.copy(), problem.R.copy())
            x, P[i, k] = snapshot(made, problem)
            errors[i, k] = x - truth
    return errors, P, innovations, S


def many_runs(
    factory: FilterFactory, problem: Problem, runs: int, epochs: int, seed: int, false_alarm: float
) -> list[Finding]:
    """Consistency, bias and whiteness over runs.

    Args:
        factory: makes the filter, anew for each run.
        problem: what it is for.
        runs: independent ones.
        epochs: of each run.
        seed: of all of them.
        false_alarm: probability that a right filter on a linear problem is called wrong here.
    """
    name = problem.name
    try:
        errors, P, innovations, S = simulate(factory, problem, runs, epochs, seed)
        if not (np.all(np.isfinite(errors)) and np.all(np.isfinite(P))):
            lost = int(np.count_nonzero(~np.all(np.isfinite(errors), axis=(1, 2))))
            return [Finding("not finite", "runs", name, f"{lost} of {runs} runs end in NaN or infinity")]
    except ProtocolError:
        raise
    except Exception as error:
        return [Finding("raises", "runs", name, f"{type(error).__name__}: {error}")]
    try:
        definite_factors(P, "after updates")
        definite_factors(S, "innovations")
    except ValueError as error:
        return [Finding("covariance not positive", "runs", name, str(error))]
    level = 1.0 - false_alarm / 5.0  # five tests
    out = list[Finding]()
    squares, half = nees(errors, P, level), epochs // 2
    low, high = band(squares.degrees, runs, level)
    for k in (half, epochs - 1):
        mean = float(squares.mean[k])
        if not low <= mean <= high:
            word = "overconfident" if mean > high else "cautious"
            text = f"NEES {mean:.4g} at epoch {k + 1}, expected {squares.degrees} within {low:.4g} to {high:.4g}"
            out.append(Finding(word, "runs", name, text))
            break
    seen = nis(innovations, S, level)
    if not seen.consistent:
        word = "overconfident" if seen.total_mean > seen.degrees else "cautious"
        text = (
            f"NIS {seen.total_mean:.4g}, expected {seen.degrees} within {seen.total_low:.4g} to {seen.total_high:.4g}"
        )
        out.append(Finding(word, "runs", name, text))
    white = whiteness(innovations, S, LAGS, level)
    if not white.white:
        text = f"correlation {white.correlation[0]:+.3f} at lag 1 (band {white.bound[0]:.3f}), p = {white.p_value:.1e}"
        out.append(Finding("innovations not white", "runs", name, text))
    scaled = np.sqrt(np.diagonal(S, axis1=2, axis2=3))
    mean = np.sum(innovations / scaled, axis=(0, 1)) / np.sqrt(runs * epochs)
    limit = float(norm.isf(0.5 * (1.0 - level) / len(mean)))
    if np.max(np.abs(mean)) > limit:
        text = f"mean innovation {np.max(np.abs(mean)):.3g} of its standard deviation, at most {limit:.3g} expected"
        out.append(Finding("biased", "runs", name, text))
    if not out:
        text = f"NEES {squares.total_mean:.3f} of {squares.degrees}, NIS {seen.total_mean:.3f} of {seen.degrees}, "
        text += f"correlation {white.correlation[0]:+.3f} at lag 1, {runs} runs of {epochs} epochs"
        out.append(Finding("", "runs", name, text))
    return out


def endurance(factory: FilterFactory, problem: Problem, steps: int, seed: int) -> list[Finding]:
    """Whether the covariance stays symmetric and positive over many steps, and, on a linear problem, right to 1 %."""
    name, n = problem.name, len(problem.x0)
    exact, dt = Bound(problem.P0), problem.dt
    rng, truth = np.random.default_rng(seed), problem.x0.copy()
    noise = np.linalg.cholesky(problem.R)
    F, H, Q = problem.F(truth, dt), problem.H(truth), problem.noise(dt)
    off = 0.0
    try:
        made = factory(problem)
        for k in range(steps):
            truth = problem.motion(truth, dt)
            made.predict(dt)
            faults, text = shape_faults(snapshot(made, problem)[1])
            if not faults:
                made.update(problem.measure(truth) + noise @ rng.normal(size=len(noise)), problem.R.copy())
                faults, text = shape_faults(snapshot(made, problem)[1])
            if faults:
                return [Finding(faults[0], "endurance", name, f"at step {k + 1}: {text}")]
            if problem.linear:
                exact.predict(F, Q)
                exact.measure(H, problem.R)
                if k < 5 or k == steps - 1:
                    P, wanted = snapshot(made, problem)[1], exact.covariance()
                    off = max(
                        off, float(np.max(np.abs(P - wanted) / np.sqrt(np.outer(np.diag(wanted), np.diag(wanted)))))
                    )
    except ProtocolError:
        raise
    except Exception as error:
        return [Finding("raises", "endurance", name, f"{type(error).__name__}: {error}")]
    if off > 0.01:
        return [Finding("digits lost", "endurance", name, f"the covariance is wrong by {off:.2g} of its diagonal")]
    text = f"covariance of {n} states symmetric and positive for {steps} steps"
    return [Finding("", "endurance", name, f"{text}, exact to {off:.1e}" if problem.linear else text)]
