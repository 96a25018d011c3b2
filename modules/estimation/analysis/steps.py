"""One step at a time: what a filter does is compared with the right answer and with the answers of known mistakes.

On a linear problem, and on any problem whose uncertainty is small, the right answer of a step follows exactly from
the filter's own state before it (Kalman 1960, J. Basic Eng. 82:35). So does the answer that a certain mistake gives.
The one that agrees to the last digits names the mistake. Mistakes in one step do not disturb the judgement of the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from messages.base import F64
from modules.estimation.analysis.filters import Filter, FilterFactory
from modules.estimation.analysis.mistakes import Finding
from modules.estimation.analysis.problems import Problem

INTERVALS = (1.0, 0.5, 2.0, 1.0)
"""Of the steps, in usual intervals."""
Estimate: TypeAlias = tuple[F64, F64]
"""x (n,) and P (n, n)."""


@dataclass(frozen=True)
class Answer:
    """What a step gives if certain mistakes are made; none: the right answer."""

    mistakes: tuple[str, ...]
    x: F64
    P: F64


def _lower(P: F64) -> F64 | None:
    try:
        return np.asarray(np.linalg.cholesky(P), np.float64)
    except np.linalg.LinAlgError:
        return None


def flipped(P: F64) -> F64 | None:
    """L' L of the lower factor L of P; None if there is no factor."""
    L = _lower(P)
    return None if L is None else L.T @ L


def signed_root(P: F64) -> F64:
    """Square roots of the elements with their signs."""
    return np.sign(P) * np.sqrt(np.abs(P))


def confusions(P: F64) -> Iterator[tuple[str, F64]]:
    """Covariances that are made of P by mistaking variances, standard deviations and factors for each other."""
    yield "variance given as sigma", P @ P.T
    yield "variance given as sigma", P * np.abs(P)
    yield "variance given as sigma", np.diag(np.diag(P) ** 2)
    yield "sigma given as variance", signed_root(P)
    yield "sigma given as variance", np.diag(np.sqrt(np.diag(P)))
    L = _lower(P)
    if L is not None:
        yield "sigma given as variance", L
        yield "sigma given as variance", L.T
        values, vectors = np.linalg.eigh(P)
        yield "sigma given as variance", (vectors * np.sqrt(values)) @ vectors.T
    yield "correlations dropped", np.diag(np.diag(P))


def noises(R: F64) -> Iterator[tuple[str, F64]]:
    """What may stand in the place of a noise covariance, the right one first."""
    yield "", R
    yield from confusions(R)
    turned = flipped(R)
    if turned is not None:
        yield "transposed noise factor", turned


def process_noises(problem: Problem, dt: float) -> Iterator[tuple[str, F64]]:
    """What may stand in the place of the process noise of an interval, the right one first."""
    Q = problem.noise(dt)
    yield from noises(Q)
    yield "missing process noise", np.zeros_like(Q)
    small = 1e-7 * problem.dt
    density = problem.noise(small) / small
    for fixed in (problem.noise(problem.dt), problem.noise(1.0), density):
        yield "process noise not scaled with dt", fixed
        turned = flipped(fixed)
        if turned is not None:
            yield "process noise not scaled with dt", turned
    yield "process noise scaled twice with dt", Q * dt
    yield "process noise scaled twice with dt", Q / dt
    yield "process noise scaled twice with dt", density * dt * dt
    yield "process noise used twice", 2.0 * Q


def predictions(problem: Problem, x: F64, P: F64, dt: float) -> Iterator[Answer]:
    """Answers of a prediction with at most one mistake in motion, covariance and noise each. The right one is first."""
    f, F, Q = problem.motion(x, dt), problem.F(x, dt), problem.noise(dt)
    unit = problem.F(x, 1.0)
    means = [
        ("", f),
        ("interval ignored", problem.motion(x, 1.0)),
        ("interval ignored", problem.motion(x, problem.dt)),
        ("interval ignored", x),
        ("motion twice", problem.motion(f, dt)),
        ("motion backwards", problem.motion(x, -dt)),
        ("transition transposed", F.T @ x),
    ]
    turned = flipped(P)
    carried = [
        ("", F @ P @ F.T),
        ("covariance not moved", P),
        ("transition transposed", F.T @ P @ F),
        ("interval ignored", unit @ P @ unit.T),
        ("interval ignored", problem.F(x, problem.dt) @ P @ problem.F(x, problem.dt).T),
        ("motion twice", F @ F @ P @ F.T @ F.T),
        ("process noise before the motion", F @ (P + Q) @ F.T - Q),
    ]
    if turned is not None:
        carried.append(("wrong triangle", F @ turned @ F.T))
    for first, mean in means:
        for second, moved in carried:
            for third, noise in process_noises(problem, dt):
                yield Answer(tuple(dict.fromkeys(m for m in (first, second, third) if m)), mean, moved + noise)


def corrected(x: F64, P: F64, H: F64, R: F64, residual: F64) -> Estimate:
    """The Kalman update."""
    PHt = P @ H.T
    K = np.linalg.solve((H @ PHt + R).T, PHt.T).T
    return x + K @ residual, P - K @ PHt.T


@dataclass(frozen=True)
class Moment:
    """What is known at an update.

    Attributes:
        before: the filter's estimate before the prediction. after: after it. dt: its interval.
        z: the measurement. last: the one before, if there was one.
    """

    problem: Problem
    before: Estimate
    after: Estimate
    dt: float
    z: F64
    last: F64 | None


def structures(now: Moment) -> list[tuple[str, Callable[[F64], Estimate]]]:
    """Ways in which an update may go, given the covariance of the measurement's noise; the right one is first."""
    p, z, dt = now.problem, now.z, now.dt
    (x0, P0), (x, P) = now.before, now.after
    H, Q, seen = p.H(x), p.noise(dt), p.measure(x)
    F = p.F(x0, dt)
    alone = F @ P0 @ F.T  # what the points of the time update know

    def right(R: F64) -> Estimate:
        return corrected(x, P, H, R, z - seen)

    def again(R: F64, values: tuple[F64, ...]) -> Estimate:
        at, covariance = x, P
        for value in values:
            at, covariance = corrected(at, covariance, p.H(at), R, value - p.measure(at))
        return at, covariance

    def partial(R: F64, points: F64, start: F64) -> Estimate:
        PHt = points @ H.T
        K = np.linalg.solve((H @ PHt + R).T, PHt.T).T
        return x + K @ (z - seen), start - K @ PHt.T

    def of_factor(R: F64) -> Estimate:
        S = flipped(H @ P @ H.T + R)
        if S is None:
            return right(R)
        K = np.linalg.solve(S, H @ P).T
        return x + K @ (z - seen), P - K @ H @ P

    def earlier(R: F64) -> Estimate:
        at, covariance = corrected(x0, P0, p.H(x0), R, z - p.measure(x0))
        G = p.F(at, dt)
        return p.motion(at, dt), G @ covariance @ G.T + Q

    def later(R: F64) -> Estimate:
        G, on = p.F(x, dt), p.motion(x, dt)
        return corrected(on, G @ P @ G.T + Q, p.H(on), R, z - p.measure(on))

    found: list[tuple[str, Callable[[F64], Estimate]]] = [
        ("", right),
        ("wrong measurement sign", lambda R: corrected(x, P, H, R, seen - z)),
        ("wrong measurement sign", lambda R: corrected(x, P, -H, R, z + seen)),
        ("double use of data", lambda R: again(R, (z, z))),
        ("double use of data", lambda R: corrected(x, P, H, R / 2.0, z - seen)),
        ("points not redrawn", lambda R: partial(R, alone, P)),
        ("points not redrawn", lambda R: partial(R, alone, alone)),
        ("wrong triangle", of_factor),
        ("measurement at the wrong time", lambda R: corrected(x, P, H, R, z - p.measure(x0))),
        ("measurement at the wrong time", earlier),
        ("measurement at the wrong time", later),
        ("measurement ignored", lambda _: (x, P)),
        ("covariance not updated", lambda R: (right(R)[0], P)),
        ("estimate not updated", lambda R: (x, right(R)[1])),
    ]
    turned, last = flipped(P), now.last
    if turned is not None:
        found.append(("wrong triangle", lambda R: partial(R, turned, P)))
        found.append(("wrong triangle", lambda R: partial(R, turned, turned)))
    if last is not None:
        found.append(("measurement at the wrong time", lambda R: corrected(x, P, H, R, last - seen)))
        found.append(("double use of data", lambda R: again(R, (last, z))))
        found.append(("double use of data", lambda R: again(R, (z, last))))
    return found


def updates(now: Moment) -> Iterator[Answer]:
    """Answers of an update with at most one mistake of order and one of the noise. The right one is first."""
    for first, action in structures(now):
        for second, R in noises(now.problem.R):
            try:
                x, P = action(R)
            except np.linalg.LinAlgError:
                continue
            yield Answer(tuple(dict.fromkeys(m for m in (first, second) if m)), x, P)


def starts(problem: Problem) -> Iterator[Answer]:
    """What the filter may start from. The right one is first."""
    x, P = problem.x0, problem.P0
    turned = flipped(P)
    covariances = [("", P), *confusions(P), ("wrong triangle", P if turned is None else turned)]
    for first, mean in (("", x), ("first guess not taken", np.zeros_like(x))):
        for second, covariance in covariances:
            yield Answer(tuple(m for m in (first, second) if m), mean, covariance)


def distances(found: Estimate, answer: Answer, sigma: F64) -> tuple[float, float]:
    """Largest difference of estimates in standard deviations, and of covariances in products of these."""
    P = np.abs(found[1] - answer.P) / np.outer(sigma, sigma)
    return float(np.max(np.abs(found[0] - answer.x) / sigma)), float(np.max(P))


def judge(
    found: Estimate, answers: Iterator[Answer], sizes: F64, tolerance: float, where: str
) -> tuple[str, list[str]]:
    """Names of the mistakes whose answer is the filter's, and the figure behind it.

    An answer that agrees in estimate and covariance comes first, then one that agrees in one of the two where the right
    answer does not: a failed downdate spoils a covariance, but the estimate still tells the gain.

    Args:
        found: estimate and covariance after the step.
        answers: the right one first.
        sizes: (n,) standard deviations before the step, below a thousandth of which no difference is measured.
        tolerance: largest distance of equal answers.
        where: the stage, for the figure.

    Returns:
        Figure, and names; none if the step is right.
    """
    right = next(answers)
    sigma = np.sqrt(np.maximum(np.abs(np.diag(right.P)), 1e-6 * sizes**2))
    off = distances(found, right, sigma)
    if max(off) <= tolerance:
        return f"{where} agrees with the exact one to {max(off):.1e} sigma", []
    known = [(answer, distances(found, answer, sigma)) for answer in answers if answer.mistakes]
    known.sort(key=lambda k: len(k[0].mistakes))  # the fewest mistakes that explain it
    text = f"{where} is {max(off):.3g} sigma from the exact one"
    for part, words in ((None, ""), (0, ", in the estimate alone"), (1, ", in the covariance alone")):
        for answer, d in known:
            least = max(d) if part is None else d[part]
            if least <= tolerance and (part is None or off[part] > tolerance):
                names = list(answer.mistakes)
                return f"{text}, and equals that of {' and '.join(names)} to {least:.1e}{words}", names
    answer, d = min(known, key=lambda k: max(k[1]))
    near = f"; the nearest known mistake ({' and '.join(answer.mistakes)}) is {max(d):.2g} away"
    return f"{text}{near}", ["unexplained difference"]


def shape_faults(P: F64) -> tuple[list[str], str]:
    """Whether a covariance (n, n) is finite, symmetric to 1e-8 and positive definite in units of its diagonal."""
    if not np.all(np.isfinite(P)):
        return ["not finite"], "the covariance holds NaN or infinity"
    d = np.diag(P)
    if np.any(d <= 0.0):
        return ["covariance not positive"], f"the least variance is {np.min(d):.3g}"
    part = P / np.sqrt(np.outer(d, d))
    skew = float(np.max(np.abs(part - part.T)))
    if skew > 1e-8:
        return ["covariance not symmetric"], f"P and P' differ by {skew:.2g} of the diagonal"
    least = float(np.linalg.eigvalsh(0.5 * (part + part.T))[0])
    if least <= 0.0:
        return ["covariance not positive"], f"the least eigenvalue of its correlations is {least:.2g}"
    return [], ""


class ProtocolError(ValueError):
    """The filter is not of the kind that can be examined."""


def snapshot(made: Filter, problem: Problem) -> Estimate:
    """Copies of the filter's estimate and covariance.

    Raises:
        ProtocolError: if they are not arrays (n,) and (n, n).
    """
    n = len(problem.x0)
    x, P = np.array(made.x, np.float64), np.array(made.P, np.float64)
    if x.shape != (n,) or P.shape != (n, n):
        raise ProtocolError(f"check_up: expected a filter with x ({n},) and P ({n}, {n}), got {x.shape} and {P.shape}")
    return x, P


def dissect(factory: FilterFactory, problem: Problem, seed: int, tolerance: float | None = None) -> list[Finding]:
    """Start, predictions and updates of one filter, each judged by itself.

    Args:
        factory: makes the filter.
        problem: linear, or with a small uncertainty.
        seed: of the measurements.
        tolerance: largest distance of equal answers in sigma; 1e-6 for linear problems, 2e-3 for others.
    """
    limit = tolerance or (1e-6 if problem.linear else 2e-3)
    rng, name = np.random.default_rng(seed), problem.name
    found: dict[tuple[str, str], Finding] = {}
    well: dict[str, str] = {}

    def note(stage: str, verdict: tuple[str, list[str]]) -> None:
        if not verdict[1]:
            well.setdefault(stage, verdict[0])
        for mistake in verdict[1]:
            found.setdefault((stage, mistake), Finding(mistake, stage, name, verdict[0]))

    def decide(stage: str, estimate: Estimate, answers: Iterator[Answer]) -> bool:
        """Note the cause, or else what is wrong with the covariance itself; False if no more can be learned."""
        faults, text = shape_faults(estimate[1])
        where = f"{'an' if stage == 'update' else 'a'} {stage}"
        verdict = (text, faults)
        if "not finite" not in faults:
            verdict = judge(estimate, answers, sizes, limit, where)
            if faults and verdict[1] in ([], ["unexplained difference"]):
                verdict = (text, faults)
        note(stage, verdict)
        return not faults

    stage = "start"
    made = factory(problem)
    sizes = np.sqrt(np.diag(problem.P0))
    estimate, last = snapshot(made, problem), None
    note("start", judge(estimate, starts(problem), sizes, limit, "the first guess"))
    root = np.linalg.cholesky(problem.P0)
    truth, noise = problem.x0 + root @ rng.normal(size=len(root)), np.linalg.cholesky(problem.R)
    try:
        for share in INTERVALS:
            dt, before = share * problem.dt, estimate
            truth = problem.motion(truth, dt)
            z = problem.measure(truth) + noise @ rng.normal(size=len(noise))
            stage = "prediction"
            made.predict(dt)
            after = snapshot(made, problem)
            if not decide(stage, after, predictions(problem, *before, dt)):
                break
            stage = "update"
            made.update(z.copy(), problem.R.copy())
            estimate = snapshot(made, problem)
            if not decide(stage, estimate, updates(Moment(problem, before, after, dt, z, last))):
                break
            last = z
    except ProtocolError:
        raise
    except Exception as error:
        found[stage, "raises"] = Finding("raises", stage, name, f"{type(error).__name__}: {error}")
    if ("update", "measurement at the wrong time") in found:  # of a late one, the first update makes no use yet
        found.pop(("update", "measurement ignored"), None)
    out = list(found.values())
    stages = {f.stage for f in out}
    return out + [Finding("", stage, name, text) for stage, text in well.items() if stage not in stages]
