"""The 13-state filter of the Earth tracker: errors against the bound, and its forms on the same measurements."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from benchmarks.scenarios.earth_runs import EVERY, NARROW, WIDE, Outcome, fly
from benchmarks.scenarios.earth_truth import ARCSEC
from benchmarks.scenarios.result import Result, Scenario
from messages.base import F64
from modules.estimation.analysis import band, divergences, efficiency

SECONDS = 300
REVERSED = np.arange(6, -1, -1)
FORMS: dict[str, dict[str, Any]] = {
    "sequential, the most accurate first": {"form": 0},
    "sequential, the most accurate last": {"form": 0, "order": REVERSED},
    "batch": {"form": 1},
    "federated": {"form": 2},
}
WHY = """Where all that is measured at one instant is linear in the state, order and form make no difference: the test
`test_forms_on_a_linear_problem` finds 1e-12. Here they differ by the place of linearisation: a sequential update takes
each sensor's derivatives after those before it, the batch form iterates all of them together, the federated form takes
all at the prediction, once. So the first image, which moves the estimate most, tells them apart more than the last."""


class Setup(NamedTuple):
    """A set-up of the benchmark."""

    name: str
    title: str
    focal: float
    tilt_deg: float
    use: str


SETUPS = (
    Setup("S1", "narrow at nadir, star tracker and GPS", NARROW, 0.0, "tracker gps"),
    Setup("S3", "narrow, 30 degrees off nadir, alone", NARROW, 30.0, ""),
    Setup("S4", "60 degrees wide, alone", WIDE, 0.0, ""),
    Setup("S5", "narrow at nadir, star tracker", NARROW, 0.0, "tracker"),
)


def judged(setup: Setup, o: Outcome) -> Result:
    """Figures of the sequential form."""
    errors = [np.swapaxes(e, 0, 1) for e in (o.position, o.attitude)]
    bounds = [o.bound[:, g, g] for g in (slice(0, 3), slice(6, 9))]
    scores = [efficiency(e, b) for e, b in zip(errors, bounds, strict=True)]
    sigma = scores[0].bound
    lost = divergences(errors[0][:, -1], np.full(1, sigma), max(10e3, 5.0 * sigma))
    runs = len(errors[0])
    value = float(np.add.reduce(o.nees[-1])) / runs
    limits = band(12, runs)
    good = max(s.eta for s in scores) <= 1.1 and limits[0] <= value <= limits[1]
    return Result(
        setup.name,
        f"ours: EarthTrackerEkf, {setup.title}",
        True,
        runs,
        position_m=scores[0].rmse,
        attitude_arcsec=scores[1].rmse / ARCSEC,
        bound_m=scores[0].bound,
        bound_arcsec=scores[1].bound / ARCSEC,
        eta_position=scores[0].eta,
        eta_attitude=scores[1].eta,
        nees=value,
        band=limits,
        diverged=lost.count,
        bar="ratios at most 1.1, NEES in band, none lost",
        met=bool(good and lost.count == 0),
    )


def apart(a: Outcome, b: Outcome) -> F64:
    """Root mean square over the runs of the greatest difference of a state, in its sigma, at each image."""
    sigma = np.sqrt(np.diagonal(a.P, axis1=2, axis2=3))
    greatest = np.max(np.abs(a.error - b.error) / sigma, axis=2)
    return np.sqrt(np.mean(np.square(greatest), axis=1))


def study(runs: int) -> list[Scenario]:
    """Errors against the bound in four set-ups, and the forms in one of them."""
    results = [judged(x, fly(x.focal, math.radians(x.tilt_deg), x.use, runs, SECONDS, 31)) for x in SETUPS]
    few = max(4, runs // 5)
    taken = {name: fly(NARROW, 0.0, "tracker gps", few, SECONDS, 32, **given) for name, given in FORMS.items()}
    reference = taken["batch"]
    images = (0, 1, 4, SECONDS // EVERY - 1)
    head = " | ".join(f"image {k + 1}" for k in images)
    lines = [
        f"| form | position (m) | NEES at the end | sigma from batch: {head} |",
        "|---" * (3 + len(images)) + "|",
    ]
    for name, o in taken.items():
        late = o.position[len(o.position) // 2 :]
        rms = math.sqrt(3.0 * float(np.mean(late * late)))
        away = apart(reference, o)
        cells = " | ".join(f"{away[k]:.1e}" for k in images)
        lines.append(f"| {name} | {rms:.2f} | {np.mean(o.nees[-1]):.2f} | {cells} |")
    text = (
        f"Thirteen states (position, velocity, attitude and rate relative to the orbit frame) and rigid-body motion; "
        f"the gyro is a measurement. {SECONDS} s, sensors at 1 Hz, an image of 30 landmarks every {EVERY} s, "
        f"{runs} runs ({few} for the forms, with star tracker and GPS)."
    )
    return [Scenario("EKF", "the 13-state filter and fusion", text, results, ["", *lines, "", WHY])]
