"""Why a fix was refused."""

from __future__ import annotations

import enum


class FixStatus(enum.IntEnum):
    """The value of ``status`` in `PoseFixMsg`; 0 is a valid fix, else the first check that failed."""

    VALID = 0
    NO_LANDMARKS = 1
    NO_PRIOR = 2
    NO_SOLUTION = 3
    FEW_INLIERS = 4
    LOW_SHARE = 5
    BADLY_SPREAD = 6
    LARGE_RESIDUALS = 7
    ALTITUDE = 8
    AGAINST_PRIOR = 9
    WEAK = 10


STATUS_TEXT: dict[FixStatus, str] = {
    FixStatus.VALID: "valid",
    FixStatus.NO_LANDMARKS: "no landmarks: nothing in the image was recognised with certainty",
    FixStatus.NO_PRIOR: "no camera, or no expected pose for this image",
    FixStatus.NO_SOLUTION: "the landmarks do not fix a pose",
    FixStatus.FEW_INLIERS: "too few landmarks agree",
    FixStatus.LOW_SHARE: "too small a share of the landmarks agrees",
    FixStatus.BADLY_SPREAD: "the landmarks lie in too small a part of the image",
    FixStatus.LARGE_RESIDUALS: "the residuals are too large",
    FixStatus.ALTITUDE: "the altitude is outside its limits",
    FixStatus.AGAINST_PRIOR: "the pose contradicts the expected one",
    FixStatus.WEAK: "the position is known too badly",
}
"""One line for a person."""
