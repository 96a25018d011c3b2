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
    "star_vectors": ("count",),
    "magnetometer": "xyz",
    "css_array": ("+x", "-x", "+y", "-y", "+z", "-z"),
}
"""Names of the measured columns."""
MOST_POINTS = 1500
"""Points of one line in a picture."""


def plot(name: str, compared: Compared, path: Path) -> None:
    """Save the picture of one sensor."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    every = max(1, len(compared.t_min) // MOST_POINTS)
    t_min = compared.t_min[::every]
    for k, label in enumerate(LABELS[name]):
        above.plot(t_min, compared.measured[::every, k], ".", markersize=2.0, color=f"C{k}", label=label)
    for k, column in enumerate(compared.true[::every].T):
        if np.isfinite(column).any():
            above.plot(t_min, column, color="k", linewidth=0.7, alpha=0.7, label="truth" if k == 0 else None)
    above.set(ylabel=f"measured [{compared.unit}]", title=compared.title)
    above.legend(loc="upper right", fontsize="small", markerscale=4)
    _errors(below, t_min, compared, every)
    for axes in (above, below):
        axes.grid(visible=True, alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=80, format="png")


def _errors(axes: Any, t_min: F64, compared: Compared, every: int) -> None:
    """The lower panel, with lines one standard deviation on both sides of the expected mean."""
    error = compared.error[::every]
    many = error.shape[1] > 6
    for k in range(error.shape[1]):
        label = "xyz"[k] if error.shape[1] == 3 else None
        axes.plot(t_min, error[:, k], ".", markersize=2.0, color="C0" if many else f"C{k}", label=label)
    levels = np.broadcast_arrays(compared.offset, compared.expected)
    for k, (mean, sigma) in enumerate(zip(*levels, strict=True)):
        for side in (-1.0, 1.0) if np.isfinite(sigma) else ():
            label = "expected 1 sigma" if k == 0 and side > 0 else None
            axes.axhline(mean + side * sigma, color="k", linestyle="--", linewidth=0.8, label=label)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="upper right", fontsize="small", markerscale=4)
    axes.set(xlabel="time [min]", ylabel=f"error [{compared.error_unit}]")
    axes.set_xlim(float(t_min[0]), float(t_min[-1]))
