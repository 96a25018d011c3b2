"""What the filter did with the newest measurement of a kind."""

from __future__ import annotations

UPDATED = 0
"""It was used."""
NO_MEASUREMENT = 1
"""There is none since the last step."""
INVALID = 2
"""Its sender says that it is not valid, or that nothing was found."""
BAD_NUMBERS = 3
"""NaN, or a covariance that is not positive definite."""
FROM_FUTURE = 4
"""It was made after the time of the step."""
TOO_LATE = 5
"""It is not later than the last one used, or older than what the filter remembers."""
GATED = 6
"""Its innovation is larger than the gate lets pass; of an image: that of all its landmarks together."""
TOO_FEW = 7
"""An image has too few landmarks, or too few of them agree with the estimate."""
NO_CAMERA = 8
"""Nothing says what the camera is like."""
NO_ORIENTATION = 9
"""Nothing says how the planet is turned."""
FAILED_UPDATE = 10
"""The update has no result; the estimate is the predicted one."""
FAILED_PREDICTION = 11
"""The prediction has no result; the estimate is as it was, at its own time."""
DIVERGED = 12
"""Several images in a row contradict the estimate: it is no longer trusted, and a pose is looked for."""
REACQUIRED = 13
"""The estimate was lost, and this image has found it again."""
LOST = 14
"""The estimate is lost, and this image has not found it again."""
