"""Why there is no attitude from directions."""

from __future__ import annotations

VALID = 0
INVALID = 1
"""The sender says that the directions are not valid."""
TOO_FEW = 2
"""Less than two directions."""
BAD_NUMBERS = 3
"""NaN, a direction of no length, or a standard deviation that is not positive."""
PARALLEL = 4
"""All directions are nearly parallel: nothing says how the body is turned about them."""
DISAGREE = 5
"""The angles between measured and known directions differ by more than the errors allow."""
