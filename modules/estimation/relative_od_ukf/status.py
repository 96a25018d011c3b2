"""What a filter did with the newest measurement."""

from __future__ import annotations

UPDATED = 0
"""It was used."""
NO_MEASUREMENT = 1
"""There is none since the last step."""
INVALID = 2
"""Its sender says that it is not valid."""
OTHER_BODY = 3
"""It is relative to another body than the state."""
BAD_NUMBERS = 4
"""NaN, or a covariance that is not positive definite."""
FROM_FUTURE = 5
"""It was exposed after the time of the step."""
TOO_LATE = 6
"""It was not exposed after the last one used, or it was exposed before the start."""
GATED = 7
"""Its innovation is larger than the gate lets pass."""
FAILED_UPDATE = 8
"""The update has no result; the state is the predicted one."""
FAILED_PREDICTION = 9
"""The prediction has no result; the state is as it was, at its own time."""
NO_INPUT = 10
"""Camera or attitude were never written."""
OLD_ATTITUDE = 11
"""The attitude is too far from the time of the exposure."""
NO_ORIENTATION = 12
"""The body is not a sphere, and nothing says how it is turned."""
OUTSIDE_LENS = 13
"""A part of the disk that is expected lies where the lens sees nothing, or the camera inside the body."""
