"""Milliseconds of a picture of 1024 x 1024 by the Earth camera: ``python -m benchmarks.earth_camera``.

What is timed is `EarthRenderer.render` from poses to radiance in three channels: rays, places on WGS84, map projection,
sampling, sunlight and haze, with the window of the map in memory, on two threads. Reading map files, the rays of the
lens (once for a camera) and the detector are not in it. Cases take turns. Shown are the least and the median of the
wall times, and the processor time of both threads, half of which is the least that two idle cores would need.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.timing import figure, interleaved
from fsw.imaging.maps import GeoMap
from messages.opnav import CameraConfigMsg
from sim.camera.earth_camera import EarthCameraParams, EarthRenderer, Pose
from sim.scenarios.earth_images.graph import viewpoint
from sim.scenarios.earth_images.scenes import DATA, GLOBE, HEIGHTS, Scene

SIZE_PX = 1024
BARS_MS = {False: 35.0, True: 8.0}
"""For every ray, and on the interpolated grid."""
PARIS, ITAIPU = DATA / "earth" / "blue_marble_z8_paris.tif", DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif"
UTC = "2023-06-21T10:30:00Z"
CASES = {
    "region at 611 m, straight down": Scene(
        "a", "a", (PARIS, GLOBE), None, 48.43, 2.11, 420.0, 1500.0, 0.0, (0.0, 0.0), UTC
    ),
    "Landsat at 30 m, straight down": Scene(
        "b", "b", (ITAIPU, GLOBE), None, -25.41, -54.54, 500.0, 14000.0, 0.0, (0.0, 0.0), UTC
    ),
    "region and globe, 30 degrees off": Scene(
        "c", "c", (PARIS, GLOBE), None, 48.0, 2.75, 420.0, 900.0, 0.0, (0.0, 0.0), UTC, 30.0, 40.0
    ),
    "globe, straight down from 2,000 km": Scene(
        "d", "d", (GLOBE,), None, 48.0, 10.0, 2000.0, 1000.0, 0.0, (0.0, 0.0), UTC
    ),
    "globe with limb": Scene("e", "e", (GLOBE,), None, 48.0, 2.75, 420.0, 700.0, 0.0, (0.0, 0.0), UTC, 60.0, 20.0),
    "region and globe with terrain, 30 degrees off": Scene(
        "f", "f", (PARIS, GLOBE), HEIGHTS, 48.0, 2.75, 420.0, 900.0, 0.0, (0.0, 0.0), UTC, 30.0, 40.0
    ),
}  # fmt: skip
JUDGED = 2
"""The bars are for the first cases; the others show what costs more."""


class Case:
    """One view, drawn in one way."""

    def __init__(self, scene: Scene, interpolated: bool) -> None:
        """Open maps and prepare the camera."""
        focal, middle = np.full(2, scene.focal_px), np.full(2, 0.5 * (SIZE_PX - 1))
        bent = np.array([-0.05, 0.01, 1e-4, -1e-4, 0.0])
        camera = CameraConfigMsg(width_px=SIZE_PX, height_px=SIZE_PX, focal_px=focal, center_px=middle, distortion=bent)
        maps = GeoMap.open(scene.files, scene.dem)
        self.renderer = EarthRenderer(camera, maps, EarthCameraParams(interpolated=interpolated), workers=2)
        r, dcm = viewpoint(scene)
        self.pose = Pose(r[None], np.ascontiguousarray(dcm[None]), np.eye(3)[None])
        self.sun_E = r / np.linalg.norm(r) + np.array([0.3, 0.3, -0.2])
        self.processor_ms: list[float] = []

    def draw(self) -> NDArray[np.float32]:
        """The picture."""
        return self.renderer.render(self.pose, self.sun_E).radiance

    def wall_ms(self) -> float:
        """Draw once."""
        begin, used = time.perf_counter(), time.process_time()
        self.draw()
        wall = time.perf_counter() - begin
        self.processor_ms.append(1e3 * (time.process_time() - used))
        return 1e3 * wall


def verdict(ms: float, bar_ms: float) -> str:
    """A word for a time beside its bar."""
    return "met" if ms <= bar_ms else "missed"


def main(arguments: list[str] | None = None) -> int:
    """Measure and print; returns 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.earth_camera", description=__doc__)
    parser.add_argument("--repeats", type=int, default=15, help="pictures of each case (default 15)")
    given = parser.parse_args(arguments)
    cases = {(name, way): Case(scene, way) for name, scene in CASES.items() for way in (False, True)}
    runs: dict[str, Callable[[], float]] = {f"{name} {way}": case.wall_ms for (name, way), case in cases.items()}
    samples = interleaved(runs, given.repeats)
    head = "ms: least / median, processor time of two threads (least)"
    sys.stdout.write(f"{SIZE_PX} x {SIZE_PX}, three channels, two threads; {head}\n")
    missed = False
    for k, name in enumerate(CASES):
        pictures = {
            way: cases[name, way].renderer.render(cases[name, way].pose, cases[name, way].sun_E).radiance
            for way in BARS_MS
        }
        for way, title in ((False, "every ray"), (True, "interpolated")):
            got = figure(samples[f"{name} {way}"])
            used = min(cases[name, way].processor_ms)
            bar = ""
            if k < JUDGED:
                wall, half = (verdict(ms, BARS_MS[way]) for ms in (got.least, 0.5 * used))
                missed |= wall == "missed"
                bar = f"bar {BARS_MS[way]:g} ms: {wall}; by half the processor time: {half}"
            sys.stdout.write(f"{name:48s} {title:14s} {got.least:7.1f} / {got.median:7.1f}  {used:7.1f}  {bar}\n")
        away = 255.0 * np.abs(pictures[True] - pictures[False])
        worst = f"mean {away.mean():.3f}, 99.9 % {np.percentile(away, 99.9):.2f}, greatest {away.max():.1f}"
        sys.stdout.write(f"{'':48s} grey levels between both: {worst}\n")
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
