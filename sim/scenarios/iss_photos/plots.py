"""Plots: errors with their sigma against the orbit, and the track over the map."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import erfa as _erfa
import matplotlib as mpl
import numpy as np

mpl.use("Agg")

import cv2
import matplotlib.pyplot as plt
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap
from messages.base import F64
from sim.scenarios.iss_photos.inputs import Inputs
from sim.scenarios.iss_photos.results import Fix, Results, Summary
from sim.scenarios.iss_photos.track import Track

CV: Any = cv2
erfa: Any = _erfa
PLT: Any = plt
_AXES = ("radial", "along track", "cross track")
_CAPTION = (
    "Mean errors are inherited from the orbit, to which lens and mounting were calibrated\n"
    "(grey: its 1 sigma). The scatter is what the photos show on their own; along the track it is partly\n"
    "circular, as the cadence of the shutter was estimated from the photos too."
)


def errors_plot(path: Path, results: Results) -> None:
    """Fix minus orbit along each axis against time, with one sigma: the photo's own (thick) and all of it (thin)."""
    good = [f for f in results.fixes if f.valid]
    summary, accuracy = results.summary, results.accuracy
    assert summary is not None and accuracy is not None and good[0].t_s is not None
    t = np.array([f.t_s for f in good]) - good[0].t_s
    error, own, total = (
        np.array([getattr(f, name) for f in good]) / 1e3 for name in ("error_H", "sigma_H", "sigma_all_H")
    )
    figure, axes = PLT.subplots(3, 1, figsize=(8.0, 8.2), sharex=True, layout="constrained")
    for k, axis in enumerate(axes):
        common = accuracy.sigma_common_H[k] / 1e3
        axis.axhspan(-common, common, color="0.92", zorder=0, label="orbit, 1 sigma (common to all)")
        axis.axhline(0.0, color="0.6", linewidth=0.8)
        axis.axhline(summary.mean_H[k] / 1e3, color="C3", linestyle="--", linewidth=1.2, label="mean of the fixes")
        axis.errorbar(
            t, error[:, k], total[:, k], fmt="none", ecolor="C0", alpha=0.35, capsize=3, label="sigma, all of it"
        )
        axis.errorbar(t, error[:, k], own[:, k], fmt="o", color="C0", elinewidth=2.5, label="fix, its own sigma")
        if results.track is not None:
            _band(axis, k, results.track, good[0].t_s)
        _label(axis, k, summary)
    axes[0].legend(ncols=3, fontsize="small", loc="lower center", bbox_to_anchor=(0.5, 1.1))
    assert good[0].utc is not None
    axes[2].set_xlabel(f"time after {good[0].utc:%Y-%m-%d %H:%M:%S} UTC, s")
    figure.suptitle("Position from photos minus approximate orbit")
    figure.text(0.5, -0.005, _CAPTION, ha="center", va="top", fontsize="small")
    figure.savefig(path, dpi=130, bbox_inches="tight")
    PLT.close(figure)


def _band(axis: Any, k: int, track: Track, start_s: float) -> None:
    """The filter of the whole pass, with one sigma."""
    t = np.array([p.t_s for p in track.points]) - start_s
    error = np.array([p.error_H[k] for p in track.points]) / 1e3
    sigma = np.array([p.sigma_H[k] for p in track.points]) / 1e3
    axis.fill_between(t, error - sigma, error + sigma, color="C2", alpha=0.15, linewidth=0.0, label="filter, sigma")
    axis.plot(t, error, color="C2", linewidth=1.5, label="filter of the whole pass")


def _label(axis: Any, k: int, summary: Summary) -> None:
    text = f"mean {summary.mean_H[k] / 1e3:+.2f} km"
    if np.isfinite(summary.scatter_H[k]):
        text += f", scatter {summary.scatter_H[k] / 1e3:.2f} km"
    axis.set_title(text, loc="left", fontsize="medium")
    axis.set_ylabel(f"{_AXES[k]}, km")
    reach = max(abs(x) for x in axis.get_ylim())
    axis.set_ylim(-1.15 * reach, 1.15 * reach)
    axis.grid(color="0.9")


def _background(geo_map: GeoMap, lon_deg: F64, lat_deg: F64) -> NDArray[np.uint8]:
    """Colours of the map at a grid of places, (lat, lon, 3), white where there is none."""
    lon, lat = np.meshgrid(np.radians(lon_deg), np.radians(lat_deg))
    picture = np.full((*lon.shape, 3), 255, np.uint8)
    known = np.zeros(lon.shape, bool)
    for layer in geo_map.layers:
        column, row = layer.locate(lat, lon)
        spread = float(np.median(np.abs(np.diff(column, axis=1))))
        factor = 2 ** max(0, int(np.floor(np.log2(max(spread, 1.0)))))
        patch = layer.patch(column, row, factor)
        if patch is None:
            continue
        x = ((column - patch.column + 0.5) / factor - 0.5).astype(np.float32)
        y = ((row - patch.row + 0.5) / factor - 0.5).astype(np.float32)
        fresh = layer.inside(column, row) & ~known
        picture[fresh] = CV.remap(patch.image, x, y, cv2.INTER_LINEAR)[fresh]
        known |= fresh
    return picture


def _nadirs(positions: F64) -> F64:
    """Longitude and latitude below Earth-fixed positions (n, 3), degrees, (n, 2)."""
    coordinates = erfa.gc2gd(1, positions)
    return np.degrees(np.column_stack([coordinates[0], coordinates[1]]))


def ground_track_plot(path: Path, inputs: Inputs, results: Results) -> None:
    """Places below the fixes over the map and the approximate track, with the differences enlarged."""
    good: list[Fix] = [f for f in results.fixes if f.r_CE_E is not None]
    t = np.array([f.t_s for f in good], float)
    span: F64 = np.linspace(float(t.min()) - 20.0, float(t.max()) + 20.0, 80)
    track, at = _nadirs(inputs.orbit.at(span)[0]), _nadirs(inputs.orbit.at(t)[0])
    found = _nadirs(np.array([f.r_CE_E for f in good]))
    low, high = track.min(axis=0) - 1.6, track.max(axis=0) + 1.6
    stretch = 1.0 / np.cos(np.radians(0.5 * (low[1] + high[1])))
    west, south, east, north = float(low[0]), float(low[1]), float(high[0]), float(high[1])
    rows = int(1100 * stretch * (north - south) / (east - west))
    lon: F64 = np.linspace(west, east, 1100)
    lat: F64 = np.linspace(north, south, rows)
    figure, axis = PLT.subplots(figsize=(8.5, 7.2), layout="constrained")
    axis.imshow(_background(inputs.geo_map, lon, lat), extent=(low[0], high[0], low[1], high[1]), aspect=stretch)
    axis.plot(track[:, 0], track[:, 1], color="w", linewidth=1.2, label="approximate orbit (TLE)")
    axis.plot(at[:, 0], at[:, 1], "+", color="w", markersize=8, label="orbit at the times of the photos")
    axis.plot(
        found[:, 0],
        found[:, 1],
        "o",
        color="C1",
        markersize=6,
        markeredgecolor="k",
        label="below the station, from photos",
    )
    shift = 100.0 * (found - at)
    axis.quiver(
        at[:, 0],
        at[:, 1],
        shift[:, 0],
        shift[:, 1],
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color="C1",
        width=0.003,
        label="difference, 100 times enlarged",
    )
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    axis.set_xlabel("longitude, degrees east")
    axis.set_ylabel("latitude, degrees north")
    axis.set_title("Ground track")
    axis.legend(loc="upper right", framealpha=0.85, facecolor="0.25", labelcolor="w", fontsize="small")
    figure.savefig(path, dpi=130)
    PLT.close(figure)
