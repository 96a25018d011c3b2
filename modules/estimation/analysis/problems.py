"""Test problems for filters: their motion, measurement and noise are known exactly, so a right answer is too."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.square_root import OK
from fsw.math.two_body import noise_of_interval, two_body_motion
from messages.base import F64

Kernels: TypeAlias = tuple[Any, Any, Any, Any]
"""A motion and its arguments, a measurement and its arguments, as `fsw.math.unscented` wants them."""


@dataclass(frozen=True)
class Problem:
    """What a filter is to be built for.

    Truth moves by ``motion`` plus noise of covariance ``noise(dt)``; it is measured by ``measure`` plus noise R.

    Attributes:
        name: for reports.
        names: of the states.
        linear: whether motion and measurement are.
        x0: (n,) first guess.
        P0: (n, n) its covariance; the truth is drawn from it.
        R: (m, m) covariance of measurements.
        dt: usual interval [s]; others happen.
        motion: ``motion(x, dt)`` gives the state (n,) after dt without noise; it leaves x alone.
        measure: ``measure(x)`` gives what is measured (m,) without noise.
        noise: ``noise(dt)`` gives the covariance (n, n) of the process noise of an interval.
        kernels: the same motion and measurement as compiled functions, None if there are none.
    """

    name: str
    names: tuple[str, ...]
    linear: bool
    x0: F64
    P0: F64
    R: F64
    dt: float
    motion: Callable[[F64, float], F64]
    measure: Callable[[F64], F64]
    noise: Callable[[float], F64]
    kernels: Kernels | None = None
    _kept: dict[float, F64] = field(default_factory=dict[float, F64], init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check shapes, so that a problem of the user fails here and not inside his filter."""
        n, m = len(self.x0), len(self.R)
        for what, got, wanted in (
            ("P0", self.P0, (n, n)),
            ("R", self.R, (m, m)),
            ("noise(dt)", self.noise(self.dt), (n, n)),
            ("motion(x0, dt)", self.motion(self.x0, self.dt), (n,)),
            ("measure(x0)", self.measure(self.x0), (m,)),
            ("names", self.names, (n,)),
        ):
            if np.shape(got) != wanted:
                raise ValueError(f"Problem {self.name}: {what}: expected the shape {wanted}, got {np.shape(got)}")

    def F(self, x: F64, dt: float) -> F64:
        """Derivative (n, n) of the motion over dt at x, by midpoint differences over one prior sigma."""
        if not self.linear:
            return differences(lambda y: self.motion(y, dt), x, np.sqrt(np.diag(self.P0)))
        if dt not in self._kept:
            self._kept[dt] = differences(lambda y: self.motion(y, dt), self.x0, np.sqrt(np.diag(self.P0)))
        return self._kept[dt].copy()

    def H(self, x: F64) -> F64:
        """Derivative (m, n) of the measurement at x, by midpoint differences over one prior sigma."""
        if not self.linear:
            return differences(self.measure, x, np.sqrt(np.diag(self.P0)))
        if -math.inf not in self._kept:  # no interval, so no key of F
            self._kept[-math.inf] = differences(self.measure, self.x0, np.sqrt(np.diag(self.P0)))
        return self._kept[-math.inf].copy()

    def shrunk(self, factor: float) -> Problem:
        """The same with all standard deviations multiplied by a small factor, which makes it as good as linear."""
        square, full = factor * factor, self.noise

        def noise(dt: float) -> F64:
            return square * full(dt)

        return replace(self, P0=square * self.P0, R=square * self.R, noise=noise)


def differences(function: Callable[[F64], F64], x: F64, steps: F64) -> F64:
    """Derivative of a function by midpoint differences; exact for linear ones."""
    columns = list[F64]()
    for i, h in enumerate(steps):
        up, down = x.copy(), x.copy()
        up[i] += h
        down[i] -= h
        columns.append((function(up) - function(down)) / (up[i] - down[i]))
    return np.stack(columns, axis=1)


@compiled
def moving(point: F64, dt: float, args: tuple[F64, float]) -> int:
    """x + A x dt + A A x dt^2/2, then drag against the velocity, the last two of four states."""
    A, drag = args
    n = point.shape[0]
    first, second = np.empty(n), np.empty(n)
    for i in range(n):
        first[i] = 0.0
        for j in range(n):
            first[i] += A[i, j] * point[j]
    for i in range(n):
        second[i] = 0.0
        for j in range(n):
            second[i] += A[i, j] * first[j]
    speed = math.hypot(point[n - 2], point[n - 1])
    for i in range(2):
        push = drag * speed * point[n - 2 + i]
        first[n - 2 + i] -= push
        second[i] -= push
    for i in range(n):
        point[i] += first[i] * dt + 0.5 * second[i] * dt * dt
    return OK


@compiled
def seeing(point: F64, seen: F64, args: tuple[F64, bool]) -> int:
    """H x; with the flag, distance and direction of the first two components instead of these themselves."""
    H, polar = args
    for k in range(seen.shape[0]):
        seen[k] = 0.0
        for j in range(point.shape[0]):
            seen[k] += H[k, j] * point[j]
    if polar:
        a, b = seen[0], seen[1]
        seen[0], seen[1] = math.hypot(a, b), math.atan2(b, a)
    return OK


A = np.array([[0.0, 0.0, 1.0, 0.2], [0.0, 0.0, -0.1, 1.0], [-0.05, 0.0, -0.1, 0.3], [0.0, -0.02, -0.2, 0.0]])
DENSITY = np.array([[0.4, 0.1, 0.05, 0.0], [0.1, 0.3, 0.0, -0.04], [0.05, 0.0, 0.2, 0.1], [0.0, -0.04, 0.1, 0.25]])
PRIOR = np.array([[4.0, 1.2, 0.5, 0.0], [1.2, 2.5, 0.0, -0.3], [0.5, 0.0, 0.6, 0.2], [0.0, -0.3, 0.2, 0.9]])


def _planar(name: str, linear: bool, drag: float, H: F64, R: F64, x0: F64) -> Problem:
    """Four states in a plane, the covariances full, so that a transposed or missing part shows."""
    AA, identity = A @ A, np.eye(4)
    nodes, weights = np.polynomial.legendre.leggauss(4)

    def motion(x: F64, dt: float) -> F64:
        push = drag * math.hypot(x[2], x[3]) * x[2:]
        first, second = A @ x, AA @ x
        first[2:] -= push
        second[:2] -= push
        return x + dt * first + 0.5 * dt * dt * second

    def measure(x: F64) -> F64:
        seen = H @ x
        return seen if linear else np.array([math.hypot(seen[0], seen[1]), math.atan2(seen[1], seen[0])])

    @functools.cache
    def integral(dt: float) -> F64:
        Q = np.zeros((4, 4))
        for node, weight in zip(nodes, weights, strict=True):
            s = 0.5 * dt * (node + 1.0)
            F = identity + A * s + 0.5 * s * s * AA
            Q += 0.5 * dt * weight * F @ DENSITY @ F.T
        return 0.5 * (Q + Q.T)

    def noise(dt: float) -> F64:
        return integral(dt).copy()

    names = ("position 1", "position 2", "velocity 1", "velocity 2")
    kernels = (moving, (A, drag), seeing, (H, not linear))
    return Problem(name, names, linear, x0, PRIOR, R, 0.7, motion, measure, noise, kernels)


def linear_problem() -> Problem:
    """Two positions and velocities, coupled, and two mixtures measured. The exact answer is the Kalman filter's."""
    H = np.array([[1.0, 0.5, 0.0, 0.0], [0.0, 1.0, 0.2, 0.0]])
    R = np.array([[0.25, 0.12], [0.12, 0.36]])
    return _planar("linear", True, 0.0, H, R, np.array([30.0, -20.0, 1.5, 0.8]))


def partly_observed_problem() -> Problem:
    """The same with one measured number, the first position: it sees the other three by their motion alone."""
    H, R = np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([[0.3]])
    return _planar("linear, one number measured", True, 0.0, H, R, np.array([30.0, -20.0, 1.5, 0.8]))


def nonlinear_problem() -> Problem:
    """Distance and direction of a body with drag: curved by thousandths of sigma, so a good filter is consistent."""
    H = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])
    R = np.array([[0.25, 2e-4], [2e-4, 1e-6]])
    return _planar("mildly nonlinear", False, 2e-4, H, R, np.array([400.0, 300.0, 6.0, -9.0]))


def scaled_problem() -> Problem:
    """A distance of 1e7 m, its rate, and an angle of 1e-9 rad, measured precisely, for arithmetic that loses digits."""
    drift = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    H = np.array([[1.0, 0.0, 0.0], [2e-17, 0.0, 1.0]])
    Q, P0 = np.diag([0.0, 1e-2, 1e-22]), np.diag([1e14, 1e6, 1e-18])
    return Problem(
        "badly scaled",
        ("distance", "rate", "angle"),
        True,
        np.array([4e7, -2e3, 3e-9]),
        P0,
        np.diag([1.0, 1e-20]),
        1.0,
        lambda x, dt: x + dt * drift @ x,
        lambda x: H @ x,
        lambda dt: Q * dt + dt * dt / 2.0 * (drift @ Q + Q @ drift.T) + dt**3 / 3.0 * drift @ Q @ drift.T,
        (moving, (drift, 0.0), seeing, (H, False)),
    )


def orbit_problem(mu: float = 4.2828375816e13, far: float = 12e6, dt: float = 60.0) -> Problem:
    """Position and velocity about a planet (Mars), the position measured: for filters of orbits.

    Motion by one Runge-Kutta step of an interval; noise as that of white accelerations and velocities.

    Args:
        mu: gravitational parameter [m^3/s^2].
        far: distance [m].
        dt: interval [s].
    """
    density = np.diag([1e-2] * 3 + [1e-6] * 3) + 1e-7
    step: Any = getattr(two_body_motion, "py_func", two_body_motion)
    spread: Any = getattr(noise_of_interval, "py_func", noise_of_interval)
    u = np.array([1.0, 0.6, 0.3]) / np.linalg.norm([1.0, 0.6, 0.3])
    side = np.cross(u, [0.3, -0.5, 0.6])
    x0 = np.concatenate([far * u, math.sqrt(mu / far) * side / np.linalg.norm(side)])
    rho = np.array([[9.0, 2.0, 1.0], [2.0, 4.0, 0.5], [1.0, 0.5, 6.0]])
    P0 = np.block([[1e6 * rho, 50.0 * rho], [50.0 * rho, 0.02 * rho]])

    def motion(x: F64, interval: float) -> F64:
        out = x.copy()
        step(out, interval, mu)
        return out

    def noise(interval: float) -> F64:
        out = np.zeros((6, 6))
        spread(density, interval, out)
        return out

    names = ("x", "y", "z", "vx", "vy", "vz")
    return Problem("orbit", names, False, x0, P0, 1e4 * rho, dt, motion, lambda x: x[:3].copy(), noise)
