"""Judging filters: consistency, whiteness, observability, the bound, scores, and a check-up that names mistakes."""

from modules.estimation.analysis.bound import Bound, BoundHistory, bound_history, bound_steps
from modules.estimation.analysis.consistency import Consistency, band, nees, nis
from modules.estimation.analysis.observability import Direction, Observability, observability
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
    "Bound",
    "BoundHistory",
    "Consistency",
    "Direction",
    "Divergences",
    "Efficiency",
    "Observability",
    "Whiteness",
    "band",
    "bound_history",
    "bound_steps",
    "divergences",
    "efficiency",
    "failure_bound",
    "nees",
    "nis",
    "observability",
    "time_to_converge",
    "whiteness",
]
