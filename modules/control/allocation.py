"""A vector shared among actuators with fixed axes, with the least effort, and kept within their limits. Compiled."""

from __future__ import annotations

import math

import numpy as np

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, dot, inverse, mat_t_vec, matvec, vec3
from messages.base import F64

IDENTITY: M3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@compiled
def projector(axes: F64, limit: F64, control: M3) -> M3:
    """(M M')^-1 for M = C G', the axes of the actuators seen along the control axes.

    Args:
        axes: (n, 3) unit vectors, the rows of G. limit: (n,) 0 for no actuator. control: C; rows of zeros are not
            controlled and get 1 on the diagonal.
    """
    a, b, c = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(len(limit)):
        if limit[i] > 0.0:
            m = matvec(control, vec3(axes[i]))
            a = (a[0] + m[0] * m[0], a[1] + m[0] * m[1], a[2] + m[0] * m[2])
            b = (b[0] + m[1] * m[0], b[1] + m[1] * m[1], b[2] + m[1] * m[2])
            c = (c[0] + m[2] * m[0], c[1] + m[2] * m[1], c[2] + m[2] * m[2])
    one = 1.0 if dot(control[0], control[0]) == 0.0 else 0.0
    two = 1.0 if dot(control[1], control[1]) == 0.0 else 0.0
    three = 1.0 if dot(control[2], control[2]) == 0.0 else 0.0
    return inverse(((a[0] + one, a[1], a[2]), (b[0], b[1] + two, b[2]), (c[0], c[1], c[2] + three)))


@compiled
def share(demand_B: V3, axes: F64, limit: F64, control: M3, out: F64) -> None:
    """Into ``out`` (n,) the efforts of least sum of squares whose sum along the control axes is ``demand_B`` (B).

    Args:
        demand_B: B components. axes: (n, 3) unit vectors. limit: (n,) 0 for no actuator. control: rows of unit vectors
            or zeros. out: (n,) in the unit of the demand; 0 for no actuator.
    """
    shares = mat_t_vec(control, matvec(projector(axes, limit, control), matvec(control, demand_B)))
    for i in range(len(limit)):
        out[i] = dot(vec3(axes[i]), shares) if limit[i] > 0.0 else 0.0


@compiled
def within(efforts: F64, limit: F64, used: F64) -> float:
    """The largest factor up to 1 by which ``efforts`` may be added to ``used`` within +-limit; NaN if one is NaN.

    Args:
        efforts: (n,). limit: (n,) 0 for no actuator. used: (n,) within the limits.
    """
    factor = 1.0
    for i in range(len(limit)):
        if math.isnan(efforts[i]):
            return math.nan
        if limit[i] > 0.0 and efforts[i] != 0.0:
            room = limit[i] - used[i] if efforts[i] > 0.0 else limit[i] + used[i]
            factor = min(factor, max(room, 0.0) / math.fabs(efforts[i]))
    return factor


def require_axes(where: str, axes: F64, there: F64, control: F64) -> None:
    """Check that the axes of the actuators are unit vectors and reach every control axis.

    Args:
        where: "Class.Params.field" for the text. axes: (n, 3). there: (n,) above 0 for an actuator. control: (3, 3).

    Raises:
        ValueError: if not.
    """
    rows = axes[there > 0.0]
    length = np.linalg.norm(rows, axis=1)
    if np.any(np.abs(length - 1.0) > 1e-9):
        text = f"expected unit vectors for the actuators with a limit, got lengths {length.tolist()}"
        raise ValueError(f"{where}: {text}; divide by them")
    wanted = control[np.any(control != 0.0, axis=1)]
    if not len(wanted):
        return
    values = np.linalg.svd(wanted @ rows.T, compute_uv=False) if len(rows) else np.zeros(1)
    if len(values) < len(wanted) or values[-1] < 1e-6 * max(values[0], 1e-300) or values[0] == 0.0:
        text = f"expected axes that reach {len(wanted)} control axes, got {rows.tolist()}"
        raise ValueError(f"{where}: {text}; add actuators or control fewer axes")
