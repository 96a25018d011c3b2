"""One picture for each sensor: what it measured with the truth, and the error."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from fsw.files import atomic
from messages.base import F64
from sim.scenarios.leo_sensors.errors import Compared

LABELS = {
    "gps": "xyz",
    "simple_nav": "xyz",
    "gyro": "xyz",
    "accelerometer": "xyz",
    "star_tracker": ("beta 0", "beta 1", "beta 2", "beta 3"),
    "star_vectors": ("seen",),
    "magnetometer": "xyz",
    "css_array": ("+x", "-x", "+y", "-y", "+z", "-z"),
}
"""Names of the measured columns."""
MOST_POINTS = 4200
"""Points in the upper panel of a picture; 1200 of a line at most."""


def plot(name: str, compared: Compared, path: Path) -> None:
    """Save the picture of one sensor."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.6, 5.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    every = max(1, len(compared.t_min) // min(1200, MOST_POINTS // len(LABELS[name])))
    t_min = compared.t_min[::every]
    for k, label in enumerate(LABELS[name]):
        above.plot(t_min, compared.measured[::every, k], ".", markersize=2.5, color=f"C{k}", label=label)
    for k, column in enumerate(compared.true[::every].T):
        above.plot(t_min, column, color="k", linewidth=0.8, label="truth" if k == 0 else None)
    above.set(ylabel=f"measured [{compared.unit}]", title=compared.title)
    _errors(below, LABELS[name], t_min, compared, every)
    for axes in (above, below):
        axes.grid(visible=True, alpha=0.3)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small", markerscale=4, frameon=False)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=80, format="png")


def _errors(axes: Any, labels: Any, t_min: F64, compared: Compared, every: int) -> None:
    """The lower panel, with lines one standard deviation on both sides of the expected mean."""
    error = compared.error[::every]
    columns = error.shape[1]
    names = labels if columns == len(labels) else "xyz" if columns == 3 else None
    varies = compared.expected.ndim == 2
    sigma = compared.expected[::every].T if varies else compared.expected[:, None]
    pale = 0.35 if len(sigma) > 1 else 1.0
    for k in range(columns):
        label = names[k] if names else "error" if k == 0 else None
        color = f"C{k}" if names else "C0"
        axes.plot(t_min, error[:, k], ".", markersize=2.5, color=color, alpha=pale, label=label)
    mean = np.broadcast_to(compared.offset[:, None], sigma.shape)
    for k in range(len(sigma)):
        # lines of the colour of what they belong to, in black where they belong to all
        color = f"C{k}" if len(sigma) > 1 else "k"
        for side in (-1.0, 1.0):
            level = np.broadcast_to(mean[k] + side * sigma[k], t_min.shape)
            label = "expected\n1 sigma" if k == 0 and side > 0 else None
            axes.plot(t_min, level, color=color, linestyle="--", linewidth=1.4, label=label)
    axes.set(xlabel="time [min]", ylabel=f"error [{compared.error_unit}]")
    axes.set_xlim(float(t_min[0]), float(t_min[-1]))
