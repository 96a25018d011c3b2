"""The Earth tracker by stages, against OpenCV used plainly, as a page: ``python -m benchmarks.earth_tracker``.

Plainly: SIFT on the photo and on the part of the map around the expected view, each feature's two nearest by brute
force, ratio 0.75, one homography by MAGSAC++; the matches that agree are the landmarks. Same photos, same map, same
expected pose; how the photos are made is said in `benchmarks/earth_scene.py`.
"""

from __future__ import annotations

import argparse
import platform
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import affine
import cv2
import numpy as np
import rasterio
from numpy.typing import NDArray
from rasterio import warp

from benchmarks.earth_scene import (
    DATA,
    LUMA,
    Shot,
    at,
    pose_over,
    random_camera,
    random_sky,
    shoot,
    write_black,
    write_date,
)
from fsw.files import atomic
from fsw.imaging.maps import GeoMap
from fsw.math.geodesy import ecef_from_geodetic
from messages.base import F64
from modules.estimation.rotations import dcm_from_rotation_vector
from modules.opnav.earth_tracker import Params, Tracked, Tracker
from modules.opnav.landmark_catalogue import Catalogue, Region, build_catalogue
from modules.opnav.landmark_finder.search import Pose

PAGE = Path(__file__).parents[1] / "docs" / "earth_tracker.md"
ITAIPU = DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif"
EARTH = DATA / "earth"
STAGES = {
    "edges": "edges of the photo (detection)",
    "query": "landmarks in view (footprint query)",
    "warp": "chips warped to the view",
    "correlate": "search by correlation (matching)",
    "consensus": "consensus (MAGSAC++)",
    "refine": "sub-pixel correlation and covariance",
    "pose": "resection",
    "cold start": "features (cold start)",
}
PLAIN = ("SIFT on the photo", "SIFT on the map", "matching, ratio", "homography (MAGSAC++)")
RATIO, THRESHOLD_PX = 0.75, 3.0
LIMIT_PX, WRONG_PX = 0.9, 3.0
"""Three times the sigma asked for; what counts as a wrong match."""
OPAQUE = 0.5
"""Cloud that counts in the share of a photo."""
WORSE = 0.3
"""Radians of longitude between meridians are no less than this times those between parallels: cosine of latitude."""
CV: Any = cv2
WARP: Any = warp
AFFINE: Any = affine.Affine
RASTERIO: Any = rasterio


class Case(NamedTuple):
    """What is seen, and how."""

    file: Path
    lat_deg: float
    lon_deg: float
    pixel_m: float
    size_px: int
    off_deg: float
    clouds: float
    seed: int


CASES = {
    "Landsat, another date and sensor": Case(ITAIPU, -25.34, -54.54, 30.0, 1024, 12.0, 0.0, 21),
    "Landsat, 35 degrees off nadir": Case(ITAIPU, -25.34, -54.54, 30.0, 1024, 35.0, 0.0, 22),
    "Landsat, clouds": Case(ITAIPU, -25.34, -54.54, 30.0, 1024, 12.0, 0.4, 40),
    "Caspian": Case(EARTH / "blue_marble_z8_caspian.tif", 37.2, 50.2, 611.0, 1024, 12.0, 0.0, 24),
    "Caspian, clouds": Case(EARTH / "blue_marble_z8_caspian.tif", 37.2, 50.2, 611.0, 1024, 12.0, 0.4, 25),
    "Cairo": Case(EARTH / "blue_marble_z8_cairo.tif", 30.1, 30.9, 611.0, 560, 12.0, 0.0, 26),
    "Paris": Case(EARTH / "blue_marble_z8_paris.tif", 48.4, 2.1, 611.0, 560, 12.0, 0.0, 27),
}


class Result(NamedTuple):
    """What one way did with one photo."""

    wall_ms: dict[str, float]
    used_ms: dict[str, float]
    error: F64
    """(n, 2) of the matches [px]."""
    square: F64
    """(n,) squared over the covariance; NaN where there is none."""


def photo_of(case: Case, folder: Path, black: GeoMap) -> tuple[Shot, Pose, F64]:
    """A photo of another date, and the expected pose: 2 km and 0.3 degrees off, as it says."""
    rng = np.random.default_rng(case.seed)
    dated = write_date(case.file, folder / f"{case.seed}.tif", rng, 1.0)
    lat, lon = np.radians([case.lat_deg, case.lon_deg]).tolist()
    pose = pose_over(lat, lon, 500e3, np.radians(case.off_deg), *rng.uniform(0.0, 2.0 * np.pi, 2))
    camera = random_camera(case.pixel_m, float(np.linalg.norm(pose[0] - at(lat, lon))), case.size_px, rng)
    shot = shoot(GeoMap.open([dated]), black, camera, pose, random_sky(lat, lon, rng, case.clouds), rng)
    turn = dcm_from_rotation_vector(np.radians(0.3) * rng.normal(size=3))
    start = Pose(shot.r_CE_E + 2e3 * rng.normal(size=3), turn @ shot.dcm_CE)
    return shot, start, np.diag([4e6] * 3 + [np.radians(0.3) ** 2] * 3)


def region_of_case(case: Case) -> Region:
    """The part of the map that a catalogue is made of, and that SIFT sees: a view and half more."""
    half = 0.75 * case.size_px * case.pixel_m / 6.371e6 / np.cos(np.radians(case.off_deg)) ** 2
    lat, lon = np.radians([case.lat_deg, case.lon_deg]).tolist()
    wide = half / max(np.cos(lat), WORSE)
    return Region(lat - half, lon - wide, lat + half, lon + wide)


def by_tracker(catalogue: Catalogue, shot: Shot, start: Pose, P_pose: F64, repeats: int) -> Result:
    """This project's way; the covariances are those of the matches alone, for the maps agree."""
    found: Tracked | None = None
    wall: dict[str, float] = {}
    used: dict[str, float] = {}
    for _ in range(repeats):
        begin, begun = time.perf_counter(), time.process_time()
        tracker = Tracker(catalogue, shot.lens, shot.photo, Params(sigma_map=0.0))
        found = tracker.run(start, P_pose)
        whole = time.perf_counter() - begin, time.process_time() - begun
        for least, spent, total in zip((wall, used), (tracker.watch.spent, tracker.watch.used), whole, strict=True):
            for name, seconds in (*spent.items(), ("whole", total)):
                least[name] = min(least.get(name, np.inf), 1e3 * seconds)
    if found is None:
        return Result(wall, used, np.empty((0, 2)), np.empty(0))
    error = found.found.seen - shot.pixels(found.r_LE_E)
    return Result(wall, used, error, np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.P_px), error))


def _map(case: Case) -> tuple[NDArray[np.uint8], Callable[[F64], F64]]:
    """The part of the map, grey, and Earth-fixed places of its pixels."""
    region = region_of_case(case)
    with RASTERIO.open(case.file) as data:
        west, south, east, north = np.degrees([region.west, region.south, region.east, region.north]).tolist()
        bounds = WARP.transform_bounds("EPSG:4326", data.crs, west, south, east, north)
        window = data.window(*bounds).round_offsets().round_lengths()
        window = window.intersection(RASTERIO.windows.Window(0, 0, data.width, data.height))
        colour, crs = data.read([1, 2, 3], window=window), data.crs
        # by hand: rasterio 1.4 multiplies in a way that affine 3 warns of
        transform = data.transform @ AFFINE.translation(window.col_off, window.row_off)
    grey = np.rint(np.tensordot(LUMA, colour, 1)).astype(np.uint8)

    def places(pixel: F64) -> F64:
        x, y = transform @ (pixel[:, 0] + 0.5, pixel[:, 1] + 0.5)
        lon, lat = WARP.transform(crs, "EPSG:4326", x.tolist(), y.tolist())[:2]
        known: list[list[float]] = np.radians(np.column_stack([lat, lon])).tolist()
        return np.array([ecef_from_geodetic(a, b, 0.0) for a, b in known]).reshape(-1, 3)

    return grey, places


def by_opencv(case: Case, shot: Shot, repeats: int) -> Result:
    """OpenCV's functions, one after the other, with their defaults."""
    grey, places = _map(case)
    wall: dict[str, float] = {}
    used: dict[str, float] = {}

    def timed(name: str, run: Callable[[], Any]) -> Any:
        begin, begun = time.perf_counter(), time.process_time()
        made = run()
        for least, spent in ((wall, time.perf_counter() - begin), (used, time.process_time() - begun)):
            least[name] = min(least.get(name, np.inf), 1e3 * spent)
        return made

    error = np.empty((0, 2))
    for _ in range(repeats):
        sift = CV.SIFT_create()
        seen_keys, seen_words = timed(PLAIN[0], lambda s=sift: s.detectAndCompute(shot.photo, None))
        map_keys, map_words = timed(PLAIN[1], lambda s=sift: s.detectAndCompute(grey, None))
        if seen_words is None or len(seen_keys) < 4:
            continue
        pairs = timed(PLAIN[2], lambda a=seen_words, b=map_words: CV.BFMatcher().knnMatch(a, b, k=2))
        good = [a for a, b in pairs if a.distance < RATIO * b.distance]
        if len(good) < 4:
            continue
        seen = np.array([seen_keys[m.queryIdx].pt for m in good])
        mapped = np.array([map_keys[m.trainIdx].pt for m in good])
        matrix, agree = timed(PLAIN[3], lambda a=mapped, b=seen: CV.findHomography(a, b, cv2.USAC_MAGSAC, THRESHOLD_PX))
        if matrix is not None:
            inlier = agree.ravel() > 0
            error = seen[inlier] - shot.pixels(places(mapped[inlier]))
    for least in (wall, used):
        least["whole"] = sum(least.values())
    return Result(wall, used, error, np.full(len(error), np.nan))


def accuracy(result: Result) -> str:
    """Cells of a row: matches, sigma, share within, wrong."""
    if not len(result.error):
        return "0 | - | - | - | 0"
    size = np.linalg.norm(result.error, axis=1)
    good = result.error[size < WRONG_PX]
    sigma = f"{np.sqrt(np.mean(good**2)):.2f}" if len(good) else "-"
    near = 100.0 * float((np.abs(result.error).max(axis=1) < LIMIT_PX).mean())
    stated = "-" if np.isnan(result.square).any() else f"{100.0 * np.mean(result.square <= 9.0):.1f} %"
    return f"{len(size)} | {sigma} | {near:.1f} % | {stated} | {int((size >= WRONG_PX).sum())}"


def page(results: dict[str, tuple[Result, Result]]) -> str:
    """The page in Markdown."""
    lines = [
        "# The Earth tracker, by stages",
        "",
        "Made by `python -m benchmarks.earth_tracker`; not to be edited. Photos with known poses, drawn by the Earth",
        "camera from the map at another date and by another sensor, with haze, blur and noise, matched with the map",
        "itself. The expected pose is off by 2 km and 0.3 degrees a component. *OpenCV*: SIFT on the photo and on",
        "the map around the view, two nearest by brute force, ratio 0.75, one homography by MAGSAC++ (3 px), with its",
        "default values.",
        "",
        f"Least of several repeats, milliseconds, {platform.machine()}, two cores that other programs share.",
        "",
        "## Accuracy and time of a frame",
        "",
        "*Sigma*: rms error of a coordinate of the matches that are not wrong. *Near*: both coordinates within",
        f"{LIMIT_PX} px. *Within 3 sigma*: of the covariance stated. *Wrong*: {WRONG_PX:g} px off or more. The time",
        "without the map is what is left if the features of the map are kept.",
        "",
        "| photo | way | matches | sigma (px) | near | within 3 sigma | wrong | wall (ms) | processor (ms) |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, (ours, plain) in results.items():
        lines.append(
            f"| {name} | tracker | {accuracy(ours)} | {ours.wall_ms['whole']:.0f} | {ours.used_ms['whole']:.0f} |"
        )
        least = plain.wall_ms["whole"], plain.used_ms["whole"]
        away = plain.wall_ms[PLAIN[1]], plain.used_ms[PLAIN[1]]
        cells = [f"{t:.0f} ({t - m:.0f} without map)" for t, m in zip(least, away, strict=True)]
        lines.append(f"| | OpenCV | {accuracy(plain)} | {cells[0]} | {cells[1]} |")
    first, last = next(iter(results.items()))
    lines += ["", f"## Stages: {first}", ""]
    lines += ["The stages of the tracker run several times in a frame: a coarse search, then one or two fine ones.", ""]
    lines += ["| stage | wall (ms) | processor (ms) |", "|---|---|---|"]
    for key, title in STAGES.items():
        if key in last[0].wall_ms:
            lines.append(f"| tracker: {title} | {last[0].wall_ms[key]:.1f} | {last[0].used_ms[key]:.1f} |")
    for title in PLAIN:
        if title in last[1].wall_ms:
            lines.append(f"| OpenCV: {title} | {last[1].wall_ms[title]:.1f} | {last[1].used_ms[title]:.1f} |")
    return "\n".join([*lines, ""])


def main(arguments: list[str] | None = None) -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.earth_tracker",
        description="Time the stages of the Earth tracker, compare with OpenCV used plainly, and write a page.",
    )
    parser.add_argument(
        "-o", "--output", type=Path, default=PAGE, metavar="FILE", help="default: docs/earth_tracker.md"
    )
    parser.add_argument("--repeats", type=int, default=5, metavar="N", help="of each photo; default: 5")
    parser.add_argument("--photos", type=int, default=len(CASES), metavar="N", help="only the first N photos")
    given = parser.parse_args(arguments)
    if given.repeats < 1 or given.photos < 1:
        parser.error("--repeats and --photos must be at least 1")
    results: dict[str, tuple[Result, Result]] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        black = GeoMap.open([write_black(folder / "black.tif")])
        for name, case in list(CASES.items())[: given.photos]:
            catalogue = build_catalogue(GeoMap.open([case.file]), region_of_case(case))
            shot, start, P_pose = photo_of(case, folder, black)
            ours = by_tracker(catalogue, shot, start, P_pose, given.repeats)
            hidden = f" ({100.0 * np.mean(shot.cloud > OPAQUE):.0f} % of it)" if case.clouds > 0.0 else ""
            results[name + hidden] = ours, by_opencv(case, shot, min(given.repeats, 3))
    text = page(results)
    with atomic(given.output) as file:
        file.write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
