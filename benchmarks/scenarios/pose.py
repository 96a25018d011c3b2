"""S1 to S8, S10 and S11: the Earth tracker with its sensors about the Earth, every filter on the same measurements."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from benchmarks.baselines.seed_ekf import AS_WRITTEN, BUG_FIXED
from benchmarks.scenarios import seed
from benchmarks.scenarios.pose_truth import (
    ARCSEC,
    NARROW,
    WIDE,
    Cached,
    Scene,
    Setup,
    Truth,
    monte_carlo,
    nees,
    pcrb,
    run,
)
from benchmarks.scenarios.result import Result, Scenario
from messages.base import F64
from modules.estimation.analysis import band, divergences, efficiency, time_to_converge

EVERY = 10
"""Seconds between the epochs that are judged, and between images."""
H = 500e3
"""Altitude [m]."""
LOST_M, LOST_RAD = 10e3, math.radians(1.0)


class Case(NamedTuple):
    """A scenario: where the camera looks, what else measures, and the bars."""

    name: str
    title: str
    focal: float
    setup: Setup
    tilt_deg: float = 0.0
    duration: int = 600
    clear: float = 1.0
    """Share of images without cloud."""
    bar: float = 1.1
    relief: float = 0.0
    text: str = ""
    altitudes_m: tuple[float, ...] = ()
    """That the source's filter assumes; none: it does not take part."""
    flavours: tuple[str, ...] = (AS_WRITTEN, BUG_FIXED, "tuned")


def _with(setup: Setup, **params: Any) -> Setup:
    return replace(setup, params={**setup.params, **params})


ALONE = Setup()
STAR = Setup(star=1)
GPS = Setup(gps=1)
ALL = Setup(star=1, gps=1)
NUISANCE = Setup(
    star=1,
    nuisance=("mount", "focal"),
    params={"mount_mode": 2, "focal_mode": 2},
)
CASES = (
    Case(
        "S1",
        "nominal: 15 m pixels at nadir, star tracker and GPS",
        NARROW,
        ALL,
        altitudes_m=(H,),
        flavours=(AS_WRITTEN, BUG_FIXED),
    ),
    Case("S2", "Earth tracker alone, narrow, nadir", NARROW, ALONE, bar=1.15),
    Case("S3", "Earth tracker alone, narrow, 30 degrees off nadir", NARROW, ALONE, tilt_deg=30.0, altitudes_m=(H,)),
    Case("S4", "Earth tracker alone, 60 degrees wide", WIDE, ALONE, altitudes_m=(H,), flavours=(BUG_FIXED,)),
    Case("S5", "Earth tracker and star tracker, no GPS", NARROW, STAR, altitudes_m=(H,)),
    Case("S6", "Earth tracker and GPS, no star tracker", NARROW, GPS),
    Case(
        "S7",
        "no altitude is assumed: 5 degrees off nadir",
        NARROW,
        STAR,
        tilt_deg=5.0,
        altitudes_m=(H, H + 1e3),
        flavours=(BUG_FIXED,),
    ),
    Case("S7", "no altitude is assumed: 20 degrees off nadir", NARROW, STAR, tilt_deg=20.0),
    Case(
        "S8",
        "a fifth of the images without cloud, 30 % of their matches wrong",
        NARROW,
        replace(STAR, outliers=0.3),
        clear=0.2,
        bar=1.2,
    ),
    Case("S8", "all images clear, half of their matches wrong", NARROW, replace(STAR, outliers=0.5), bar=1.2),
    Case("S10", "mounting 60 arc seconds, focal length 0.1 %, nadir, no GPS", NARROW, NUISANCE, bar=1.2),
    Case("S10", "the same, 30 degrees off nadir", NARROW, NUISANCE, tilt_deg=30.0, bar=1.2),
    Case(
        "S10",
        "the same with GPS for 600 s, then an outage of an orbit",
        NARROW,
        replace(NUISANCE, gps=1, outage=(600.0, math.inf)),
        tilt_deg=30.0,
        duration=6300,
        bar=1.2,
    ),
    Case(
        "S11",
        "GPS with a Gauss-Markov error of 3 m, and an outage of 30 minutes",
        NARROW,
        Setup(gps=1, star=1, outage=(300.0, 2100.0), nuisance=("gps",), params={"gps_mode": 2, "gps_bias_tau": 300.0}),
        tilt_deg=30.0,
        duration=2400,
    ),
)


class Study(NamedTuple):
    """Errors of many runs of one filter."""

    errors: F64
    """(runs, K, 12)."""
    P: F64 | None
    """(runs, K, 12, 12); None where the states are others."""
    ms: float


def ours(cached: Cached, setup: Setup, runs: int) -> Study:
    """PoseMekf."""
    started = time.process_time()
    errors, P = monte_carlo(cached, setup, runs, EVERY)
    spent = time.process_time() - started
    return Study(errors, P, 1e3 * spent / max(1, runs * len(cached.scene.images)))


def unaware(cached: Cached, setup: Setup, runs: int) -> Study:
    """PoseMekf without the states of the sensors' errors: what it costs to leave them out."""
    off = {name: 0 for name in setup.params if name.endswith("_mode")}
    return ours(cached, _with(setup, **off), runs)


def scene_of(case: Case, number: int = 1) -> Cached:
    """Truth, images and landmarks of a case."""
    images = np.arange(EVERY, case.duration + 1, EVERY, dtype=float)
    if case.clear < 1.0:
        images = images[np.random.default_rng([number, 8]).random(len(images)) < case.clear]
    truth = Truth(float(case.duration), tilt=math.radians(case.tilt_deg))
    return Cached(Scene(truth, case.focal, images, relief=case.relief, seed=number), case.duration)


def judge(case: Case, method: str, own: bool, study: Study, bound: F64, note: str = "") -> Result:
    """Figures of a study."""
    e: F64 = study.errors
    runs = len(e)
    groups = (slice(0, 3), slice(6, 9))
    sigma = [np.sqrt(np.trace(bound[:, g, g], axis1=1, axis2=2)) for g in groups]
    lost = np.zeros(runs, np.bool_)
    for g, values, limit in zip(groups, sigma, (LOST_M, LOST_RAD), strict=True):
        gone = divergences(e[:, -1, g], values[-1:], max(limit, 5.0 * float(values[-1])))
        lost[list(gone.which)] = True
    kept = ~lost if own else np.isfinite(e[..., :9]).all(axis=(1, 2))
    if kept.sum() < 2:
        return Result(case.name, method, own, runs, diverged=int(lost.sum()), ms=study.ms, note=note)
    scores = [efficiency(e[kept][..., g], bound[:, g, g]) for g in groups]
    value, limits = math.nan, (math.nan, math.nan)
    if study.P is not None:
        value, limits = float(np.mean(nees(e[kept], study.P[kept])[:, -1])), band(12, int(kept.sum()))
    times = float(EVERY) * np.array([1.0 + k for k in range(e.shape[1])])
    settled = time_to_converge(times, e[kept][..., :3], sigma[0])
    met, text = None, ""
    if own:
        text = f"ratios at most {case.bar:g}, NEES in band, none lost"
        good = max(score.eta for score in scores) <= case.bar and limits[0] <= value <= limits[1]
        met = bool(good and not lost.any())
    return Result(
        case.name,
        method,
        own,
        runs,
        position_m=scores[0].rmse,
        attitude_arcsec=scores[1].rmse / ARCSEC,
        bound_m=scores[0].bound,
        bound_arcsec=scores[1].bound / ARCSEC,
        eta_position=scores[0].eta,
        eta_attitude=scores[1].eta,
        spread=max(0.5 * (s.high - s.low) for s in scores),
        nees=value,
        band=limits,
        diverged=int(lost.sum()),
        converged_s=settled,
        ms=study.ms,
        bar=text,
        met=met,
        note=note,
    )


def study(case: Case, runs: int) -> list[Scenario]:
    """Every filter in one scenario."""
    cached = scene_of(case)
    next(run(cached, case.setup, 0))  # compiles, which is not to be timed
    bound = pcrb(cached, case.setup)
    runs = max(2, runs * 600 // max(case.duration, 600)) if case.duration > 3000 else runs
    results = [judge(case, "ours: PoseMekf", True, ours(cached, case.setup, runs), bound)]
    if any(name.endswith("_mode") for name in case.setup.params):
        blind = unaware(cached, case.setup, runs)
        results.append(judge(case, "PoseMekf without these states", False, blind, bound))
    for flavour in case.flavours if case.altitudes_m else ():
        for altitude in case.altitudes_m:
            errors, ms = seed.study(cached, case.setup, flavour, max(2, runs // 50), altitude, EVERY)
            assumed = f", {altitude / 1e3:.0f} km assumed" if len(case.altitudes_m) > 1 else ""
            results.append(judge(case, f"source, {flavour}{assumed}", False, Study(errors, None, ms), bound))
    return [Scenario(case.name, case.title, case.text, results)]
