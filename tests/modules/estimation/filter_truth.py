"""Truth for filters of orbits: many runs at once about Mars with process noise, circles of its limb, and statistics."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2 as _chi2

from fsw.math.camera import lens_vector
from fsw.math.compiled import compiled
from messages.base import F64
from messages.opnav import CameraConfigMsg, OpNavMsg
from modules.opnav.basilisk import body_of
from modules.opnav.pixel_line_converter.kernel import POINTS, limb_circle
from tests.modules.opnav.disk_truth import camera

chi2: Any = _chi2
Criterion = Callable[[str, float], None]
MU, RADIUS = 4.2828375816e13, 3396.19e3
DIRECTIONS = np.array([[1.0, 1.0, 1.0], [0.2, 0.3, 1.0], [1.0, 0.2, 0.1]])
"""Of the audit: the harm of a transposed noise factor depends on them."""
RANGES = (12e6, 40e6, 120e6)
STEP, FRAMES = 60.0, 40
DENSITY = np.diag([1e-4] * 3 + [1e-6] * 3 + [1e-5] * 3)
"""Of the truth's process noise: m^2/s, m^2/s^3, px^2/s."""
SPREAD = np.array([3e4] * 3 + [5.0] * 3 + [0.5] * 3)
"""Standard deviation of the first guess: m, m/s, px."""
CAMERA = camera(600.0)


def vectors(name: str) -> dict[str, Any]:
    """Cases of Basilisk."""
    path = Path(__file__).parents[2] / "data" / f"basilisk_{name}.json"
    return json.loads(path.read_text(encoding="utf-8"))


def square(values: Any, n: int) -> F64:
    return np.array(values, np.float64).reshape(n, n)


def triangle(S: F64) -> F64:
    """The lower triangle, row by row, as the vectors hold it."""
    return S[np.tril_indices(len(S))]


def relative_error(found: F64, expected: Any) -> float:
    """Largest difference relative to the largest element."""
    wanted = np.array(expected, np.float64)
    return float(np.max(np.abs(found - wanted)) / np.max(np.abs(wanted)))


def position_message(nav: dict[str, Any], **more: Any) -> OpNavMsg:
    """A position of Basilisk's vectors."""
    zero = {f"r_CP_{f}": np.zeros(3) for f in "BC"} | {f"P_rr_{f}": np.zeros((3, 3)) for f in "BC"}
    fields: dict[str, Any] = {
        "exposure_ns": 0,
        "valid": bool(nav["valid"]),
        "status": 0,
        "fault_detected": False,
        "body_id": body_of(nav["planetID"]),
        "r_CP_N": np.array(nav["r_BN_N"], np.float64),
        "P_rr_N": square(nav["covar_N"], 3),
        **zero,
    }
    return OpNavMsg(**{**fields, **more})


def pull(r: F64) -> F64:
    return -MU * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3


def flown(x: F64, dt: float, steps: int = 6) -> F64:
    """States (runs, 6 or more) after dt, by Runge-Kutta."""
    h, x = dt / steps, x.copy()

    def slope(y: F64) -> F64:
        return np.hstack([y[:, 3:6], pull(y[:, :3]), np.zeros_like(y[:, 6:])])

    for _ in range(steps):
        k1 = slope(x)
        k2 = slope(x + h / 2 * k1)
        k3 = slope(x + h / 2 * k2)
        k4 = slope(x + h * k3)
        x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


def histories(far: float, direction: F64, runs: int, rng: np.random.Generator) -> tuple[F64, F64]:
    """First guesses (runs, 9), and the truth (FRAMES, runs, 9) at STEP, 2 STEP, ..., with process noise and bias."""
    u = direction / np.linalg.norm(direction)
    side = np.cross(u, [0.3, -0.5, 0.6])
    guess = np.concatenate([far * u, 0.9 * np.sqrt(MU / far) * side / np.linalg.norm(side), np.zeros(3)])
    x = guess + SPREAD * rng.normal(size=(runs, 9))
    carry = np.eye(9)
    carry[:3, 3:6] = STEP * np.eye(3)
    # the exact covariance of white noise through position and velocity, by quadrature and not by the filter's formula
    nodes, weights = np.polynomial.legendre.leggauss(5)
    Q = np.zeros((9, 9))
    for node, weight in zip(nodes, weights, strict=True):
        F = np.eye(9)
        F[:3, 3:6] = 0.5 * STEP * (node + 1.0) * np.eye(3)
        Q += 0.5 * STEP * weight * F @ DENSITY @ F.T
    root, truth = np.linalg.cholesky(Q), np.empty((FRAMES, runs, 9))
    for k in range(FRAMES):
        x = flown(x, STEP) + rng.normal(size=(runs, 9)) @ root.T
        truth[k] = x
    return np.broadcast_to(guess, (runs, 9)), truth


def looking(r_N: F64, off: float = 0.15) -> F64:
    """dcm_CN (runs, 3, 3) of cameras that see the body ``off`` rad beside the boresight."""
    z = -r_N / np.linalg.norm(r_N, axis=1, keepdims=True)
    x = np.cross(z, [0.3, 0.2, 0.9])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    c, s = np.cos(off), np.sin(off)
    tilt = np.array([[c, 0.0, -s], [0.6 * s, 0.8, 0.6 * c], [0.8 * s, -0.6, 0.8 * c]])
    return tilt @ np.stack([x, np.cross(z, x), z], axis=1)


@compiled
def _circles(lens: F64, radius: float, r_C: F64, out: F64) -> None:
    limb = np.zeros((POINTS + 4, 2))
    one = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for i in range(r_C.shape[0]):
        at = (r_C[i, 0], r_C[i, 1], r_C[i, 2])
        _, circle = limb_circle(lens, (radius, radius, radius), one, at, (0.0, 0.0, 0.0), limb)
        out[i, 0], out[i, 1], out[i, 2] = circle


def circles_of(cam: CameraConfigMsg, r_C: F64) -> F64:
    """Circles (n, 3) through the limb of the sphere from cameras at r_C (n, 3); not by the filter's own model."""
    out = np.empty((len(r_C), 3))
    _circles(lens_vector(cam), RADIUS, np.ascontiguousarray(r_C), out)
    return out


def normalised(error: F64, P: F64) -> float:
    """Normalised squared error."""
    return float(error @ np.linalg.solve(P, error))


def outside_band(values: list[float], degrees: int, share: float = 0.95) -> float:
    """How far the mean of normalised squared errors lies outside its band, by the expected value; 0: inside."""
    runs, mean = len(values), float(np.mean(values))
    tail = (1.0 - share) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], runs * degrees) / runs
    return max(0.0, low - mean, mean - high) / degrees
