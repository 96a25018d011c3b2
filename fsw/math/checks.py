"""Checks of parameters that bounds cannot express; a record calls them in its ``__post_init__``."""

from __future__ import annotations

import numpy as np

from messages.base import Record


def require_rotation(record: object, field: str) -> None:
    """Check that a field (3, 3) is a rotation matrix: orthonormal to 1e-9, determinant +1.

    Raises:
        ValueError: if it is not; the text names record and field.
    """
    m = getattr(record, field)
    error = float(np.max(np.abs(m @ m.T - np.eye(3))))
    if error > 1e-9 or np.linalg.det(m) < 0.0:
        what = f"rows are orthonormal to {error:.1e} only" if error > 1e-9 else "the determinant is -1 (a mirror)"
        where = f"{type(record).__qualname__}.{field}"
        raise ValueError(f"{where}: expected a rotation matrix, got {m.tolist()}: {what}; check rows, columns, signs")


def require_inertia(record: Record, field: str) -> None:
    """Check that a field (3, 3) can be the inertia of a body: symmetric, positive, no axis above the sum of the others.

    Raises:
        ValueError: if it is not; the text names record and field.
    """
    m = getattr(record, field)
    where = f"{type(record).__qualname__}.{field}: expected an inertia matrix (kg m^2), got {m.tolist()}"
    if np.max(np.abs(m - m.T)) > 1e-9 * np.max(np.abs(m)):
        raise ValueError(f"{where}: it is not symmetric")
    a, b, c = np.linalg.eigvalsh(m)
    if a <= 0.0:
        raise ValueError(f"{where}: the moment about a principal axis is {a:.6g}, it must be > 0")
    if c > (a + b) * (1.0 + 1e-9):
        text = f"principal moments {a:.6g}, {b:.6g}, {c:.6g}; the largest cannot exceed the sum of the others"
        raise ValueError(f"{where}: {text}")
