"""What came of one method in one scenario, and the page of all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from modules.estimation.analysis import failure_bound


class Result(NamedTuple):
    """Figures of a method; NaN or None where one does not apply."""

    scenario: str
    method: str
    ours: bool
    runs: int
    position_m: float = math.nan
    """Root mean square error, three axes, second half of the arc."""
    attitude_arcsec: float = math.nan
    bound_m: float = math.nan
    bound_arcsec: float = math.nan
    eta_position: float = math.nan
    eta_attitude: float = math.nan
    spread: float = math.nan
    """Half the 95 % interval of the larger ratio."""
    nees: float = math.nan
    band: tuple[float, float] = (math.nan, math.nan)
    """Where the mean NEES of an honest filter lies in 95 of 100 such studies, at the end of the arc."""
    diverged: int = 0
    converged_s: float = math.nan
    """Median time until the error stays below twice the bound."""
    ms: float = math.nan
    """Processor time for each image [ms]."""
    bar: str = ""
    met: bool | None = None
    note: str = ""

    @property
    def divergence(self) -> str:
        """Diverged runs, with the upper bound of their probability at 95 %."""
        return f"{self.diverged}/{self.runs} (< {failure_bound(self.diverged, self.runs):.1%})"


class Scenario(NamedTuple):
    """A row of the table of scenarios: what is done, and what came of it."""

    name: str
    title: str
    text: str
    results: Sequence[Result]
    lines: Sequence[str] = ()
    """More lines of Markdown below the table."""


def number(value: float, form: str = ".3g") -> str:
    """For a cell."""
    return "-" if math.isnan(value) else format(value, form)


COLUMNS = (
    "method",
    "position (m)",
    "bound (m)",
    "ratio",
    'attitude (")',
    'bound (")',
    "ratio",
    "NEES (band)",
    "diverged",
    "settled (s)",
    "ms",
    "bar",
)


def _row(r: Result) -> str:
    nees = f"{number(r.nees)} ({r.band[0]:.2f} to {r.band[1]:.2f})" if not math.isnan(r.band[0]) else number(r.nees)
    verdict = "" if r.met is None else (": met" if r.met else ": **missed**")
    cells = (
        f"**{r.method}**" if r.ours else r.method,
        number(r.position_m),
        number(r.bound_m),
        number(r.eta_position, ".2f"),
        number(r.attitude_arcsec),
        number(r.bound_arcsec),
        number(r.eta_attitude, ".2f"),
        nees,
        r.divergence,
        number(r.converged_s, ".0f"),
        number(r.ms, ".3g"),
        f"{r.bar}{verdict}",
    )
    return "| " + " | ".join(cells) + " |"


def section(scenario: Scenario) -> str:
    """A scenario in Markdown."""
    lines = [f"## {scenario.name}: {scenario.title}", "", scenario.text, ""]
    if scenario.results:
        lines += ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
        lines += [_row(r) for r in scenario.results]
        lines += [""] + [f"- {r.method}: {r.note}" for r in scenario.results if r.note]
    lines += list(scenario.lines)
    return "\n".join(lines).rstrip() + "\n"
