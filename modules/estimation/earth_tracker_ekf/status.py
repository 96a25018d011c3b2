"""The sensors, and what the filter did with the newest measurement of each."""

from __future__ import annotations

from modules.estimation.relative_od_ukf import status as orbit

LANDMARKS, GPS, GYRO, SUN_SENSORS, MAGNETOMETER, STAR_TRACKER, STARS = 0, 1, 2, 3, 4, 5, 6
"""Places of the sensors in parameters and messages."""
SENSORS = 7

UPDATED = orbit.UPDATED
NO_MEASUREMENT = orbit.NO_MEASUREMENT
INVALID = orbit.INVALID
BAD_NUMBERS = orbit.BAD_NUMBERS
FROM_FUTURE = orbit.FROM_FUTURE
TOO_LATE = orbit.TOO_LATE
GATED = orbit.GATED
FAILED_UPDATE = orbit.FAILED_UPDATE
FAILED_PREDICTION = orbit.FAILED_PREDICTION
NO_INPUT = orbit.NO_INPUT
"""Something that its model needs was never written or given: camera, orientation, Sun, coefficients, catalogue."""
TOO_FEW = 14
"""Fewer landmarks, lit cells or stars are left than are needed."""
IN_SHADOW = 15
"""The Sun is hidden, at least in part."""
