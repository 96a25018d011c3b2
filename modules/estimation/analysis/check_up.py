"""A check-up of a filter that names the usual mistakes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from modules.estimation.analysis.filters import FilterFactory
from modules.estimation.analysis.mistakes import Finding
from modules.estimation.analysis.problems import (
    Problem,
    linear_problem,
    nonlinear_problem,
    partly_observed_problem,
    scaled_problem,
)
from modules.estimation.analysis.runs import endurance, many_runs
from modules.estimation.analysis.steps import dissect

SMALL = 1e-3
"""Factor of all standard deviations for the single steps of a nonlinear problem."""


@dataclass(frozen=True)
class CheckUp:
    """The report; `str` writes it.

    Attributes:
        findings: of all stages.
        false_alarm: probability that a right filter on linear problems is called wrong.
    """

    findings: tuple[Finding, ...]
    false_alarm: float

    @property
    def passed(self) -> bool:
        """Whether no mistake was found."""
        return not self.mistakes

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the mistakes that single steps show, each once."""
        return tuple(dict.fromkeys(f.mistake for f in self.findings if f.mistake and f.stage != "runs"))

    @property
    def mistakes(self) -> tuple[str, ...]:
        """Names of all that is wrong: causes, then what they do over many runs."""
        return tuple(dict.fromkeys([*self.causes, *(f.mistake for f in self.findings if f.mistake)]))

    def __str__(self) -> str:
        """The report."""
        if self.passed:
            head = (
                f"Filter check-up: no mistake found (a right filter fails with a probability of {self.false_alarm:g})."
            )
        else:
            head = f"Filter check-up: {', '.join(self.causes or self.mistakes)}."
        shown = dict[tuple[str, str], Finding]()
        for f in self.findings:  # the same mistake once for each stage
            shown.setdefault((f.stage, f.mistake or f.problem), f)
        wrong = [str(f) for f in shown.values() if f.mistake and f.stage != "runs"]
        effect = [str(f) for f in shown.values() if f.mistake and f.stage == "runs"]
        good = [str(f) for f in shown.values() if not f.mistake]
        parts = [head, *wrong]
        if effect:
            parts += ["What it does to the estimates:" if wrong else "No single step is wrong, but:", *effect]
        return "\n".join([*parts, *good])


def check_up(
    factory: FilterFactory,
    problems: Sequence[Problem] | None = None,
    lasting: Problem | None = None,
    seed: int = 0,
    runs: int = 40,
    epochs: int = 25,
    steps: int = 300,
    false_alarm: float = 1e-4,
    tolerance: float | None = None,
) -> CheckUp:
    """Find out whether a filter is right and, if not, what is wrong with it.

    Single steps are compared with the exact answer and with the answers of known mistakes (`steps`); runs are judged by
    NEES, NIS, bias and whiteness (`runs`); a long run shows whether the covariance lasts.

    Args:
        factory: ``factory(problem)`` makes a filter with ``x``, ``P``, ``predict(dt)`` and ``update(z, R)`` that
            starts from ``problem.x0`` and ``problem.P0``; motion, measurement and noise are those of the problem.
        problems: that it is tried on; a linear, a partly observed and a mildly nonlinear one if left out. For a filter
            with a model of its own give problems with that model.
        lasting: problem of the long run; metres of 1e7 beside 1e-9 rad if problems are left out too, else the first.
        seed: of all random numbers.
        runs: of each problem, for the statistics.
        epochs: of each run.
        steps: of the long run.
        false_alarm: probability that a right filter on linear problems is called wrong. On nonlinear ones no filter is
            exactly consistent, and more runs than some hundreds will show it.
        tolerance: of single steps, in sigma; 1e-6 on linear problems, 2e-3 on others if left out.

    Raises:
        ValueError: if the filter does not keep the protocol, or arguments cannot be.
    """
    if runs < 2 or epochs < 7 or steps < 1 or not 0.0 < false_alarm < 1.0:
        raise ValueError(
            "check_up: expected runs >= 2, epochs >= 7, steps >= 1 and a false_alarm between 0 and 1, "
            f"got {runs}, {epochs}, {steps}, {false_alarm}"
        )
    chosen = [linear_problem(), partly_observed_problem(), nonlinear_problem()] if problems is None else list(problems)
    if not chosen:
        raise ValueError("check_up: there is no problem to try the filter on; give one, or leave problems out")
    made = factory(chosen[0])
    absent = [name for name in ("x", "P", "predict", "update") if not hasattr(made, name)]
    if absent:
        raise ValueError(
            f"check_up: the filter {type(made).__name__} has no {', '.join(absent)}; it needs x, P, predict(dt) and "
            "update(z, R)"
        )
    found = list[Finding]()
    for problem in chosen:
        found += dissect(factory, problem if problem.linear else problem.shrunk(SMALL), seed, tolerance)
    last = lasting or (scaled_problem() if problems is None else chosen[0])
    lost = endurance(factory, last, steps, seed)
    if not any(f.mistake for f in found) or lost[0].mistake != "digits lost":  # a wrong filter's covariance is wrong
        found += lost
    for problem in chosen:
        found += many_runs(factory, problem, runs, epochs, seed, false_alarm / len(chosen))
    return CheckUp(tuple(found), false_alarm)
