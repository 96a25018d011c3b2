"""What a person sees on the terminal."""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sim.scenarios.iss_photos.results import Fix, Results, Summary
from sim.scenarios.iss_photos.shift import ShiftRow
from sim.scenarios.iss_photos.track import Track

LIMITS = (
    "What this does not show: lens and mounting were calibrated with positions held to the approximate orbit, so the "
    "mean error is not independent of that orbit. What the photos show on their own is the scatter; along the track "
    "that is partly circular, as the cadence of the shutter was estimated from the photos too. Sigma covers both parts."
)
ARC_MINUTE = np.pi / 10800.0


def _row(fix: Fix) -> list[str]:
    if fix.error_H is None or fix.sigma_pos_m is None or fix.utc is None:
        return [fix.path.name, *[""] * 7, "[red]no[/red]"]
    error = [f"{x / 1e3:+.2f}" for x in fix.error_H]
    total, sigma = np.linalg.norm(fix.error_H) / 1e3, fix.sigma_pos_m / 1e3
    time = fix.utc.strftime("%H:%M:%S.") + str(fix.utc.microsecond // 100000)
    return [fix.path.name, time, str(fix.inliers), *error, f"{total:.2f}", f"{sigma:.2f}", "[green]yes[/green]"]


def fixes_table(results: Results) -> Table:
    """One line for each photo."""
    table = Table(title="Position from each photo, compared with the approximate orbit (km)", title_justify="left")
    for name in ("photo", "UTC", "landmarks", "radial", "along", "cross", "3-D", "sigma", "valid"):
        table.add_column(name, justify="left" if name in ("photo", "valid") else "right", no_wrap=True)
    for fix in results.fixes:
        table.add_row(*_row(fix))
    return table


def summary_table(summary: Summary) -> Table:
    """Mean and scatter apart, along each axis."""
    table = Table(title="Photo minus approximate orbit (km)", title_justify="left")
    for name in ("", "radial", "along track", "cross track"):
        table.add_column(name, justify="left" if not name else "right")
    for label, value in (
        ("mean (not independent of the orbit)", summary.mean_H),
        ("scatter (what the photos show)", summary.scatter_H),
        ("rms", summary.rms_H),
    ):
        table.add_row(label, *[f"{x / 1e3:.2f}" if np.isfinite(x) else "-" for x in value])
    return table


def shift_table(rows: list[ShiftRow]) -> Table:
    """How far fixes follow a shifted orbit."""
    table = Table(title="The approximate orbit shifted, calibration as it is", title_justify="left")
    for name in ("direction", "shift, km", "valid", "fixes follow by, km", "share"):
        table.add_column(name, justify="left" if name == "direction" else "right")
    for row in rows:
        moved = (
            (f"{row.followed_m / 1e3:+.3f}", f"{100.0 * row.followed_m / row.shift_m:.1f} %") if row.valid else ("", "")
        )
        table.add_row(row.direction, f"{row.shift_m / 1e3:.0f}", f"{row.valid} of {row.photos}", *moved)
    return table


def _camera_line(results: Results) -> str:
    lens, accuracy = results.camera, results.accuracy
    if accuracy is None:
        return "lens and mounting: unknown"
    boresight = results.camera.dcm_CB[2]
    tilt = np.degrees(np.arccos(np.clip(boresight[2], -1.0, 1.0)))
    source = "calibrated from these photos" if results.calibrated_here else "from the calibration file"
    focal = f"focal length {lens.focal_px[0]:.1f} +- {accuracy.sigma_focal_px:.1f} px"
    centre = f"principal point ({lens.center_px[0]:.1f}, {lens.center_px[1]:.1f}) px"
    return f"camera, {source}: {focal}, {centre}, boresight {tilt:.2f} deg from nadir, rms {accuracy.rms_px:.2f} px"


def _track_line(results: Results) -> str | None:
    clock = results.clock
    if clock is None or not results.fixes:
        return None
    sigma = np.sqrt(np.diag(clock.P))
    offset = ", ".join(
        f"{n} {x / 1e3:+.2f} +- {e / 1e3:.2f}" for n, x, e in zip("RTN", clock.offset_H, sigma, strict=False)
    )
    parts = f"track of all photos together: offset (km) {offset}; along-track rate {clock.rate_T:+.2f} m/s"
    if results.calibrated_here and clock.clock_s:
        parts += f"; shutter's clock {clock.clock_s:+.3f} s and {1e3 * clock.clock_rate:+.3f} ms/s against the stamps"
    return parts


def _summary_line(summary: Summary) -> str:
    text = f"{summary.valid} of {summary.photos} photos valid; 3-D difference: median {summary.median / 1e3:.2f} km, "
    text += f"largest {summary.largest / 1e3:.2f} km"
    if summary.valid > 1:
        spread = " / ".join(f"{x / ARC_MINUTE:.1f}" for x in summary.attitude)
        text += f"; attitude scatter {spread} arc minutes about the camera's x, y, z"
    return text


def track_table(track: Track) -> Table:
    """The filter of the whole pass, after each photo."""
    title = "All photos through one filter of pose, lens, mounting and clock, minus approximate orbit (km)"
    table = Table(title=title, title_justify="left")
    for name in ("photos used", "radial", "along", "cross", "sigma radial", "along", "cross", "distance"):
        table.add_column(name, justify="right", no_wrap=True)
    for t_s in track.photos:
        point = track.at(t_s)
        error, sigma = ([f"{x / 1e3:{sign}.2f}" for x in v] for v, sign in ((point.error_H, "+"), (point.sigma_H, "")))
        table.add_row(str(point.images), *error, *sigma, f"{np.sqrt(point.distance):.1f}")
    return table


def _filter_line(track: Track) -> str:
    largest = max(track.at(t).distance for t in track.photos)
    text = (
        f"the filter used {track.used} of {len(track.photos)} photos. Its sigma has two parts: what lens and mounting "
    )
    text += "inherited from the orbit, which does not average out, and what the photos leave open. Distance is the "
    text += "difference in units of that sigma; chance alone passes 2.8 once in 20 times; "
    turn, sigma = (" / ".join(f"{x / ARC_MINUTE:.1f}" for x in v) for v in track.nuisance["mount_C"])
    text += f"here at most {np.sqrt(largest):.1f}. It turns the mounting by {turn} +- {sigma} arc minutes about the "
    return text + "camera's x, y, z, which includes the station's attitude"


def show(console: Console, results: Results) -> None:
    """Print tables and text."""
    console.print(fixes_table(results))
    for fix in results.fixes:
        if not fix.valid:
            told = escape(f"{fix.path.name}: {fix.reason}")
            console.print(f"[yellow]not used:[/yellow] {told}", soft_wrap=True, highlight=False)
    if results.summary is not None:
        console.print(summary_table(results.summary))
        console.print(_summary_line(results.summary), soft_wrap=True)
        if results.summary.wrong:
            far = f"fixes off by more than 6 km and 3 sigma: {results.summary.wrong}. Orbit or fixes are wrong"
            console.print(f"[red]{far}; do not trust this run[/red]", soft_wrap=True)
    if results.track is not None:
        console.print(track_table(results.track))
        console.print(_filter_line(results.track), soft_wrap=True)
    console.print(_camera_line(results), soft_wrap=True)
    line = _track_line(results)
    if line is not None:
        console.print(line, soft_wrap=True)
    console.print(LIMITS, style="italic")
