"""S13: position from a short arc of limb: the published least squares against HorizonNav, both on the same points."""

from __future__ import annotations

import math

import numpy as np

from benchmarks.scenarios.feed import fed
from benchmarks.scenarios.result import Scenario
from messages.base import F64
from messages.opnav import MAX_LIMB, CameraConfigMsg, OpNavLimbMsg
from messages.states import NavAttMsg
from modules.estimation.analysis import band
from modules.opnav.horizon_nav import HorizonNav

RADIUS, RANGE, FOCAL, SIDE = 3396.19e3, 18000e3, 492.0, 512
SIGMA_PX, FULL = 0.1, 400
"""Error of a point across the limb, and points on a whole limb."""
HALF_ARCS_DEG = 180, 90, 45, 30
OFF_AXIS = math.radians(10.0)


def points(half: float, rng: np.random.Generator) -> tuple[F64, F64]:
    """Noisy pixels (n, 2) of an arc of the limb about a random azimuth, and the true place r_PC_C."""
    sight = np.array([math.sin(OFF_AXIS), 0.0, math.cos(OFF_AXIS)])
    first = np.cross(sight, [0.3, 0.9, 0.1])
    first /= np.linalg.norm(first)
    second = np.cross(sight, first)
    n = max(3, round(FULL * half / math.pi))
    phi = rng.uniform(0.0, 2.0 * math.pi) + np.linspace(-half, half, n, endpoint=half < math.pi)
    rho = math.asin(RADIUS / RANGE)
    outward = np.outer(np.cos(phi), first) + np.outer(np.sin(phi), second)
    rays = math.cos(rho) * sight + math.sin(rho) * outward
    clean = FOCAL * rays[:, :2] / rays[:, 2:] + (SIDE - 1) / 2
    along = np.gradient(clean, axis=0)
    normal = np.column_stack([along[:, 1], -along[:, 0]])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return clean + SIGMA_PX * rng.normal(size=n)[:, None] * normal, RANGE * sight


def least_squares(pixels: F64) -> F64:
    """r_PC_C by Christian and Robinson (2016), "Noniterative horizon-based optical navigation", unweighted, sphere."""
    rays = np.column_stack([(pixels - (SIDE - 1) / 2) / FOCAL, np.ones(len(pixels))])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    n = np.asarray(np.linalg.lstsq(rays, np.ones(len(rays)), rcond=None)[0], np.float64)
    return RADIUS / math.sqrt(float(n @ n) - 1.0) * n


class Horizon:
    """HorizonNav, fed by hand."""

    def __init__(self) -> None:
        """Connect its inputs, and write what does not change."""
        self.module = HorizonNav("horizon", HorizonNav.Params(axes=np.full(3, RADIUS), max_sigma=0.9))
        self.ports = fed(self.module)
        camera = CameraConfigMsg(
            width_px=SIDE, height_px=SIDE, focal_px=np.full(2, FOCAL), center_px=np.full(2, (SIDE - 1) / 2)
        )
        self.ports["in_camera"].write(camera, 0)
        self.ports["in_attitude"].write(NavAttMsg(sigma_BN=np.zeros(3), omega_BN_B=np.zeros(3)), 0)

    def __call__(self, pixels: F64) -> tuple[F64, F64] | None:
        """r_PC_C and its covariance, or None."""
        n, limb, sigma = len(pixels), np.full((MAX_LIMB, 2), np.nan), np.full(MAX_LIMB, np.nan)
        limb[:n], sigma[:n] = pixels, SIGMA_PX
        message = OpNavLimbMsg(exposure_ns=0, valid=True, status=0, body_id=499, count=n, limb_px=limb, sigma_px=sigma)
        self.ports["in_limb"].write(message, 0)
        self.module.step(0)
        answer = self.module.out_position.latest()
        return (-answer.r_CP_C, answer.P_rr_C) if answer is not None and answer.valid else None


def study(runs: int) -> list[Scenario]:
    """Bias and scatter along the line of sight of both solutions for four arcs."""
    horizon = Horizon()
    ways = "bias / scatter (km) | in sigma"
    head = f"| half arc (deg) | bound (km) | least squares: {ways} | HorizonNav: {ways} | ratio | NEES (band) | none |"
    lines = [head, "|---" * 9 + "|"]
    for degrees in HALF_ARCS_DEG:
        rng = np.random.default_rng(degrees)
        plain, own, squares, limits, none = list[float](), list[float](), list[float](), list[float](), 0
        for _ in range(runs):
            pixels, truth = points(math.radians(degrees), rng)
            sight = truth / RANGE
            plain.append(float((least_squares(pixels) - truth) @ sight))
            limits.append(_bound(pixels, truth))
            answer = horizon(pixels)
            if answer is None:
                none += 1
                continue
            error = answer[0] - truth
            own.append(float(error @ sight))
            squares.append(float(error @ np.linalg.solve(answer[1], error)))
        low, high = band(3, len(own))
        a, b, limit = np.array(plain) / 1e3, np.array(own) / 1e3, float(np.sqrt(np.mean(np.square(limits)))) / 1e3
        lines.append(
            f"| {degrees} | {limit:.2f} | {a.mean():+.2f} / {a.std():.2f} | {abs(a.mean()) / limit:.2f} | "
            f"{b.mean():+.2f} / {b.std():.2f} | {abs(b.mean()) / limit:.2f} | "
            f"{np.sqrt(np.mean(b * b)) / limit:.3f} | {np.mean(squares):.2f} ({low:.2f} to {high:.2f}) | {none} |"
        )
    text = (
        f"Mars from {RANGE / 1e3:,.0f} km, {FOCAL:.0f} px focal length, 10 degrees off the axis, {SIGMA_PX} px for "
        f"each point, {FULL} points on a whole limb. {runs} runs for each arc about random azimuths. Bias and scatter "
        f"are along the line of sight. Bar: bias of HorizonNav below 0.3 sigma."
    )
    return [Scenario("S13", "short lit arcs", text, (), lines)]


def _bound(pixels: F64, truth: F64) -> float:
    """Sigma along the line of sight by section B2 of the audit."""
    sight, rho = truth / RANGE, math.asin(RADIUS / RANGE)
    rays = np.column_stack([(pixels - (SIDE - 1) / 2) / FOCAL, np.ones(len(pixels))])
    scale = FOCAL * np.linalg.norm(rays, axis=1)  # of a small angle in pixels, about
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    across: F64 = rays - (rays @ sight)[:, None] * sight
    across /= np.linalg.norm(across, axis=1)[:, None]
    H: F64 = (across - math.tan(rho) * sight) * scale[:, None] / RANGE
    return SIGMA_PX * math.sqrt(float(sight @ np.linalg.inv(H.T @ H) @ sight))
