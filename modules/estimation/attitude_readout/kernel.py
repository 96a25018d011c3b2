"""Carrying an attitude along with a rate, and correcting it with a measured one."""

from __future__ import annotations

from fsw.math.attitude import ep_compose, ep_normalize, ep_relative, ep_to_rotvec, rotvec_to_ep
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, V4, scale


@compiled
def is_unit(beta: V4) -> bool:
    """Whether Euler parameters have length 1 to 1e-6; False for NaN."""
    return abs(beta[0] * beta[0] + beta[1] * beta[1] + beta[2] * beta[2] + beta[3] * beta[3] - 1.0) < 2e-6


@compiled
def turned(beta_BN: V4, omega_BN_B: V3, seconds: float) -> V4:
    """beta_BN after a rotation at a constant rate (rad/s) (Eq. 1 of the spec)."""
    return ep_normalize(ep_compose(rotvec_to_ep(scale(seconds, omega_BN_B)), beta_BN))


@compiled
def weighted(beta_BN: V4, seen_BN: V4, gain: float) -> V4:
    """beta_BN turned by the share ``gain`` of the rotation that leads to ``seen_BN`` (Eq. 2 of the spec)."""
    return turned(beta_BN, ep_to_rotvec(ep_relative(seen_BN, beta_BN)), gain)
