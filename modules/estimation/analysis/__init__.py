"""Judging filters: consistency, whiteness, observability, the bound, scores, and a check-up that names mistakes."""

from modules.estimation.analysis.bound import Bound, BoundHistory, bound_history, bound_steps
from modules.estimation.analysis.check_up import CheckUp, check_up
from modules.estimation.analysis.consistency import Consistency, band, nees, nis
from modules.estimation.analysis.filters import ExtendedFilter, Filter, FilterFactory, FunctionFilter, UnscentedFilter
from modules.estimation.analysis.mistakes import MISTAKES, Finding
from modules.estimation.analysis.observability import Direction, Observability, observability
from modules.estimation.analysis.problems import (
    Problem,
    linear_problem,
    nonlinear_problem,
    orbit_problem,
    partly_observed_problem,
    scaled_problem,
)
from modules.estimation.analysis.scores import (
    Divergences,
    Efficiency,
    divergences,
    efficiency,
    failure_bound,
    time_to_converge,
)
from modules.estimation.analysis.whiteness import Whiteness, whiteness

__all__ = [
    "MISTAKES",
    "Bound",
    "BoundHistory",
    "CheckUp",
    "Consistency",
    "Direction",
    "Divergences",
    "Efficiency",
    "ExtendedFilter",
    "Filter",
    "FilterFactory",
    "Finding",
    "FunctionFilter",
    "Observability",
    "Problem",
    "UnscentedFilter",
    "Whiteness",
    "band",
    "bound_history",
    "bound_steps",
    "check_up",
    "divergences",
    "efficiency",
    "failure_bound",
    "linear_problem",
    "nees",
    "nis",
    "nonlinear_problem",
    "observability",
    "orbit_problem",
    "partly_observed_problem",
    "scaled_problem",
    "time_to_converge",
    "whiteness",
]
