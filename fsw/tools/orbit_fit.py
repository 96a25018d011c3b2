"""An orbit fitted to positions by least squares: six parameters of the state, and one of drag or sunlight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import erfa
import msgspec
import numpy as np

from fsw.math.compiled import plain
from fsw.math.earth_orientation import EarthParameters, orientation, orientation_table
from fsw.math.gravity import MU_EARTH
from fsw.tools.orbit_files import Arc
from fsw.tools.orbit_flight import Flight, fly
from messages.base import F64

ERFA: Any = erfa
Surfaces: TypeAlias = Literal["none", "drag", "light"]

STEPS = np.array([20.0, 20.0, 20.0, 0.02, 0.02, 0.02, 1e-3])
"""Changes of the unknowns (m, m/s, m^2/kg) from which derivatives are taken."""

_ABSURD = 0.01
"""Residuals of this part of the distance are no fit."""
ROUGH_DEGREE = 6
"""Degree of gravity for these derivatives: they need a few digits only, and the fit converges to the same."""


@dataclass(frozen=True)
class Fit:
    """A fitted orbit.

    Attributes:
        arc: what was fitted. surface: which coefficient was fitted too.
        r_N, v_N: (3,) state in GCRF at the first epoch of the arc, m, m/s.
        coefficient: of drag or light times area by mass, m^2/kg; 0 if there is none.
        covariance: (6, 6) or (7, 7) of state and coefficient, formal, from the scatter of the residuals.
        residuals: (n, 3) measured minus fitted: radial, along the track, across, m.
        iterations: of the least squares.
    """

    arc: Arc
    surface: Surfaces
    r_N: F64
    v_N: F64
    coefficient: float
    covariance: F64
    residuals: F64
    iterations: int

    @property
    def epoch_ns(self) -> int:
        """Epoch of the state, TAI ns since 2000-01-01T12:00:00 TAI."""
        return int(self.arc.epoch_ns[0])

    @property
    def sigma(self) -> F64:
        """Formal standard deviations (6,) or (7,) of state and coefficient."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square distance, m."""
        return float(np.linalg.norm(self.residuals)) / math.sqrt(len(self.residuals))


def inertial(arc: Arc, eop: EarthParameters) -> F64:
    """Positions (n, 3) of an arc in GCRF, m."""
    if arc.axes == "GCRF":
        return arc.r
    if arc.axes == "EME2000":
        return arc.r @ np.asarray(ERFA.bp00(2451545.0, 0.0)[0], np.float64)
    start = int(arc.epoch_ns[0])
    first, rows, table = orientation_table(start, int(arc.epoch_ns[-1]) - start, eop)
    to_itrf = [plain(orientation)(t, first, rows, table)[0] for t in arc.epoch_ns.tolist()]
    return np.einsum("nij,ni->nj", np.array(to_itrf), arc.r)


def velocity_by_gibbs(a: F64, b: F64, c: F64) -> F64:
    """Velocity (m/s) at ``a`` of the two-body orbit of the Earth through three positions (m), less than an orbit apart.

    Method of Gibbs: Vallado, "Fundamentals of Astrodynamics", 4th ed., algorithm 54, which holds at each of the three.
    """
    ra, rb, rc = (float(np.linalg.norm(x)) for x in (a, b, c))
    ab, bc, ca = np.cross(a, b), np.cross(b, c), np.cross(c, a)
    n, d = ra * bc + rb * ca + rc * ab, ab + bc + ca
    s = (rb - rc) * a + (rc - ra) * b + (ra - rb) * c
    return math.sqrt(MU_EARTH / float(np.linalg.norm(n) * np.linalg.norm(d))) * (np.cross(d, a) / ra + s)


def first_guess(seconds: F64, r_N: F64) -> F64:
    """State (6,) at the first time from positions: a polynomial through up to nine of the first fifth of an orbit."""
    fifth = 0.4 * math.pi * math.sqrt(float(np.linalg.norm(r_N[0])) ** 3 / MU_EARTH)
    chosen = np.unique(np.searchsorted(seconds[:-1], np.linspace(0.0, fifth, 9)))
    if len(chosen) < 5:
        if seconds[2] > 0.3 * fifth:
            return np.concatenate([r_N[0], velocity_by_gibbs(*r_N[:3])])
        chosen = np.arange(min(9, len(seconds)))
    half = seconds[chosen[-1]] / 2.0
    x = seconds[chosen] / half - 1.0
    weights = np.linalg.solve(np.vander(x, increasing=True), r_N[chosen])
    powers = np.arange(1, len(chosen))
    return np.concatenate([r_N[0], (powers * x[0] ** (powers - 1)) @ weights[1:] / half])


class _Problem:
    """States as a function of the unknowns."""

    def __init__(self, params: Flight.Params, surface: Surfaces, epoch_ns: list[int]) -> None:
        self.params, self.epoch_ns = params, epoch_ns
        self.rough = msgspec.structs.replace(params, degree=min(params.degree, ROUGH_DEGREE))
        self.surface: Surfaces = surface

    def states(self, x: F64, params: Flight.Params) -> F64:
        """Positions and velocities (n, 6)."""
        change = {self.surface: float(x[6])} if self.surface != "none" else {}
        return fly(msgspec.structs.replace(params, **change), x[:6], self.epoch_ns)

    def partials(self, x: F64, count: int) -> F64:
        """Derivatives (3 n, count) of the positions by the first unknowns."""
        columns: list[F64] = []
        states = self.states(x, self.rough)
        for i in range(count):
            moved = x.copy()
            moved[i] += STEPS[i]
            columns.append((self.states(moved, self.rough) - states)[:, :3].ravel() / STEPS[i])
        return np.column_stack(columns)


def fit_orbit(arc: Arc, params: Flight.Params, r_N: F64, surface: Surfaces, most: int = 30) -> Fit:
    """Fit an orbit by Gauss-Newton steps over ever longer parts of the arc, so that a rough first guess is enough.

    A step that makes the residuals larger is halved.

    Args:
        arc: measured. params: forces, from `flight_params` for the first epoch of the arc.
        r_N: (n, 3) positions of the arc in GCRF, m. surface: which coefficient is fitted too. most: iterations.

    Raises:
        ValueError: if the fit does not converge, or positions are fewer than unknowns.
    """
    seconds, epochs = arc.seconds, arc.epoch_ns.tolist()
    x = np.append(first_guess(seconds, r_N), [] if surface == "none" else [0.01])
    count, rms = 0, math.inf
    if 3 * len(seconds) <= len(x):
        raise ValueError(f"the fit needs more than {len(x)} coordinates, the arc has {3 * len(seconds)}")
    used, before = min(max(int(np.searchsorted(seconds, 6000.0)), 4), len(seconds)), math.inf
    best, step, halved = x, np.zeros_like(x), False
    for count in range(1, most + 1):
        problem, whole = _Problem(params, surface, epochs[:used]), used == len(seconds)
        states = problem.states(x, params)
        difference = (r_N[:used] - states[:, :3]).ravel()
        rms = math.sqrt(float(difference @ difference) / used)
        # a step that had to be halved: the derivatives are not good for more digits
        enough = 0.2 if not whole else 1e-3 if halved else 1e-4
        if abs(before - rms) <= enough * rms:
            if whole and rms > _ABSURD * float(np.linalg.norm(r_N, axis=1).mean()):
                break
            if whole:
                return _result(arc, problem, x, states, r_N, count)
            used, before = min(8 * used, len(seconds)), math.inf
            continue
        if rms > before:
            step, halved = 0.5 * step, True
            x = best + step
            continue
        best, before, step, halved = x, rms, np.zeros_like(x), False
        # over a short part the coefficient is hardly seen: it joins when the whole arc is used
        free = len(x) if whole else 6
        partials = problem.partials(x, free)
        size = np.linalg.norm(partials, axis=0)
        step[:free] = np.linalg.lstsq(partials / size, difference, rcond=1e-12)[0] / size
        x = best + step
    text = f"no orbit passes the positions: after {count} iterations the residuals are {rms:.0f} m RMS"
    raise ValueError(f"{text}; choose a shorter arc without manoeuvres, or fit another coefficient (--drag, --light)")


def _result(arc: Arc, problem: _Problem, x: F64, states: F64, r_N: F64, count: int) -> Fit:
    r, v, difference = states[:, :3], states[:, 3:], r_N - states[:, :3]
    radial: F64 = r / np.linalg.norm(r, axis=1)[:, None]
    across: F64 = np.cross(r, v)
    across /= np.linalg.norm(across, axis=1)[:, None]
    axes = np.stack([radial, np.cross(across, radial), across], axis=1)
    partials = problem.partials(x, len(x))
    size = np.linalg.norm(partials, axis=0)
    inverse = np.asarray(np.linalg.pinv(partials / size), np.float64)
    variance = float(np.sum(difference**2)) / (difference.size - len(x))
    covariance = variance * (inverse @ inverse.T) / np.outer(size, size)
    residuals = np.einsum("nij,nj->ni", axes, difference)
    coefficient = float(x[6]) if len(x) > 6 else 0.0
    return Fit(arc, problem.surface, x[:3], x[3:6], coefficient, covariance, residuals, count)
