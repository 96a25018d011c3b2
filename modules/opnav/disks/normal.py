"""Normal equations of many small least squares problems in one pass over the observations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import compiled
from messages.base import F64


@compiled
def sums(group: NDArray[np.int64], columns: F64, target: F64, weight: F64, a: F64, b: F64) -> None:
    """Add rows^T w rows to a (m, k, k), its lower half, and rows^T w target to b (m, k), for each observation's group.

    Args:
        group: (n,) which problem an observation belongs to.
        columns: (k, n) derivatives. target: (n,). weight: (n,).
        a, b: outputs, zero before.
    """
    k, n = columns.shape
    for o in range(n):
        g = group[o]
        for i in range(k):
            c = columns[i, o] * weight[o]
            b[g, i] += c * target[o]
            for j in range(i + 1):
                a[g, i, j] += c * columns[j, o]


def normal(group: NDArray[np.int64], count: int, columns: F64, target: F64, weight: F64) -> tuple[F64, F64]:
    """Normal equations (count, k, k) and (count, k) of each group; see `sums`."""
    k = len(columns)
    a, b = np.zeros((count, k, k)), np.zeros((count, k))
    sums(group, columns, target, weight, a, b)
    upper = np.triu_indices(k, 1)
    a[:, upper[0], upper[1]] = a[:, upper[1], upper[0]]
    return a, b
