"""Where a photo was taken, without a scenario: what the command ``fsw geolocate`` does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.imaging.maps import GeoMap, MapError
from fsw.math.camera import lens_vector, project
from fsw.math.geodesy import A, ecef_from_geodetic, geodetic_from_ecef
from messages.base import F64
from messages.opnav import CameraConfigMsg
from modules.estimation.orbit_pose_prior import TleOrbit
from modules.opnav.earth_tracker.ground import angles, ground_points, looking_down
from modules.opnav.earth_tracker.track import Params, Tracked, Tracker
from modules.opnav.landmark_catalogue import (
    Catalogue,
    CatalogueError,
    Region,
    kept_catalogue,
    read_catalogue,
    region_of,
)
from modules.opnav.landmark_catalogue.build import map_gsd
from modules.opnav.landmark_catalogue.catalogue import ground_circle
from modules.opnav.landmark_finder.acquire import acquire
from modules.opnav.landmark_finder.render import render_view
from modules.opnav.landmark_finder.search import Pose

CV: Any = cv2
WIDE_RAD = 0.6
"""Photos of a wider field are looked for in a rendered view first."""
ACQUIRED = np.diag([5e3**2] * 3 + [2e-3**2] * 3)
"""Covariance of a pose from that."""
GREEN, RED, CYAN, ORANGE, PALE = (80, 255, 80), (60, 60, 255), (200, 200, 0), (0, 150, 255), (255, 255, 120)
"""Blue, green, red."""
MAP_SHARE = 0.5
"""Without a height, the photo is taken to be this part of the map wide."""


class Guess(NamedTuple):
    """What is known of the pose beforehand."""

    pose: Pose
    P_pose: F64


class Located(NamedTuple):
    """A photo with its place."""

    tracked: Tracked
    report: dict[str, Any]


def expected(
    camera: CameraConfigMsg,
    maps: GeoMap | Catalogue,
    place: tuple[float | None, float | None, float | None],
    heading: float | None,
    sigma_rad: float,
    tle: tuple[Path, str] | None,
) -> Guess:
    """An expected pose: from elements and a time, or a place, or the middle of the map; looking down.

    Args:
        camera: of the photo.
        maps: map or catalogue.
        place: latitude, longitude [rad] and height [m] of the camera; None where unknown.
        heading: azimuth of the top of the image [rad], or None.
        sigma_rad: standard deviation of the boresight and of the heading.
        tle: file of two-line elements, and UTC.

    Raises:
        ValueError: if the elements or the time cannot be used.
    """
    lat, lon, height = place
    sigma_m = 10e3
    if tle is not None:
        r_CE_E = orbit_position(*tle)
        lat, lon, height = geodetic_from_ecef(*r_CE_E.tolist())
    if lat is None or lon is None or height is None:
        a, b, width = middle_of(maps)
        lat, lon = (a, b) if lat is None or lon is None else (lat, lon)
        half_field = math.atan(0.5 * camera.width_px / float(camera.focal_px[0]))
        height = min(max(MAP_SHARE * width / (2.0 * math.tan(half_field)), 150e3), 40e6) if height is None else height
        sigma_m = 0.3 * height
    r_CE_E, dcm_CE = looking_down(lat, lon, height, 0.0 if heading is None else heading)
    turn = math.pi if heading is None else sigma_rad
    return Guess(Pose(r_CE_E, dcm_CE), np.diag([sigma_m**2] * 3 + [sigma_rad**2] * 2 + [turn**2]))


def orbit_position(path: Path, utc: str) -> F64:
    """Earth-fixed position (3,) [m] by a file of two-line elements at a UTC such as 2023-05-05T03:28:50."""
    try:
        moment = datetime.fromisoformat(utc)
    except ValueError as error:
        raise ValueError(f"--utc: expected a time such as 2023-05-05T03:28:50, got {utc!r}") from error
    moment = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment
    return TleOrbit.open(path, moment).at(0.0)[0][0]


def middle_of(maps: GeoMap | Catalogue) -> tuple[float, float, float]:
    """Latitude, longitude [rad] of the middle of a map or catalogue, and its width [m]."""
    if isinstance(maps, Catalogue):
        r = maps.landmarks.r_LE_E
        middle = r.mean(axis=0)
        lat, lon, _ = geodetic_from_ecef(*middle.tolist())
        return lat, lon, 2.0 * float(np.quantile(np.linalg.norm(r - middle, axis=1), 0.9))
    region = region_of(maps.layers[-1])
    lat = 0.5 * (region.south + region.north)
    width = min((region.east - region.west) * math.cos(lat), region.north - region.south)
    return lat, 0.5 * (region.west + region.east), A * width


def open_maps(files: Sequence[Path], dem: Path | None) -> GeoMap | Catalogue:
    """Map files, or one catalogue.

    Raises:
        ValueError: if they cannot be used.
    """
    if any(f.suffix == ".npz" for f in files):
        if len(files) > 1 or dem is not None:
            raise CatalogueError(f"{files[0]}: a catalogue stands alone, without other maps or heights")
        return read_catalogue(files[0])
    return GeoMap.open(files, dem)


def region_around(lens: F64, shape: tuple[int, int], guess: Guess, map_region: Region) -> Region | None:
    """Part of the map's region that a camera may see within 3 sigma; None if it is nothing.

    Rounded outwards, so that photos from near by share it.
    """
    middle, radius = ground_circle(lens, shape, guess.pose.r_CE_E, guess.pose.dcm_CE, 0.0)
    lat, lon, height = geodetic_from_ecef(*guess.pose.r_CE_E.tolist())
    radius += 3.0 * math.sqrt(guess.P_pose[0, 0]) + 6.0 * height * math.sqrt(guess.P_pose[3, 3])
    lat, lon, _ = geodetic_from_ecef(*middle.tolist())
    reach = radius / A
    step = 2.0 ** math.floor(math.log2(0.5 * reach))
    south, north = step * math.floor((lat - reach) / step), step * math.ceil((lat + reach) / step)
    south, north = max(south, map_region.south), min(north, map_region.north)
    cosine = math.cos(min(abs(lat) + reach, math.pi / 2.0))
    width = math.pi if cosine < 1e-3 else min(reach / cosine, math.pi)
    middle_lon = 0.5 * (map_region.west + map_region.east)
    lon = middle_lon + math.remainder(lon - middle_lon, 2.0 * math.pi)
    west, east = step * math.floor((lon - width) / step), step * math.ceil((lon + width) / step)
    west, east = max(west, map_region.west), min(east, map_region.east)
    return Region(south, west, north, east) if south < north and west < east else None


def catalogue_for(
    maps: GeoMap, lens: F64, shape: tuple[int, int], guess: Guess, detector: str | None
) -> Catalogue | None:
    """A catalogue of what a camera may see, no finer than the camera; None if the map has nothing there."""
    region = region_around(lens, shape, guess, region_of(maps.layers[-1]))
    if region is None:
        return None
    middle, _ = ground_circle(lens, shape, guess.pose.r_CE_E, guess.pose.dcm_CE, 0.0)
    pixel = float(np.linalg.norm(middle - guess.pose.r_CE_E)) / math.sqrt(lens[0] * lens[1])
    finest = min(map_gsd(layer, region_of(layer)) for layer in maps.layers)
    gsd = finest * 2.0 ** (0.25 * math.floor(4.0 * math.log2(max(1.0, 0.9 * pixel / finest))))
    try:
        return kept_catalogue(maps, region, gsd, 3, detector)
    except CatalogueError:
        return None


def locate(photo: NDArray[np.uint8], camera: CameraConfigMsg, maps: GeoMap | Catalogue, guess: Guess) -> Located | None:
    """Find where a photo was taken.

    Args:
        photo: grey (rows, columns).
        camera: lens and size.
        maps: map or catalogue.
        guess: see `expected`.

    Returns:
        The place; None if nothing is sure.
    """
    lens, shape = lens_vector(camera), (photo.shape[0], photo.shape[1])
    if isinstance(maps, GeoMap):
        field = 2.0 * math.atan(0.5 * camera.width_px / float(camera.focal_px[0]))
        near = acquire(maps, lens, photo, guess.pose.r_CE_E, guess.pose.dcm_CE) if field > WIDE_RAD else None
        guess = guess if near is None else Guess(Pose(*near), ACQUIRED)
        catalogue = catalogue_for(maps, lens, shape, guess, None if near is not None else "sift")
    else:
        catalogue = maps
    if catalogue is None:
        return None
    tracked = Tracker(catalogue, lens, photo, Params()).run(guess.pose, guess.P_pose)
    return None if tracked is None else Located(tracked, report_of(camera, tracked))


def report_of(camera: CameraConfigMsg, tracked: Tracked) -> dict[str, Any]:
    """What ``--json`` prints: degrees, metres, pixels."""
    fit, lens = tracked.fit, lens_vector(camera)
    lat, lon, height, off, heading = angles(fit.r_CE_E, fit.dcm_CE)
    w, h = camera.width_px - 1.0, camera.height_px - 1.0
    pixel = np.array([[0.5 * w, 0.5 * h], [0.0, 0.0], [w, 0.0], [w, h], [0.0, h]])
    names = ("center", "top_left", "top_right", "bottom_right", "bottom_left")
    ground = np.degrees(ground_points(lens, fit.r_CE_E, fit.dcm_CE, pixel)[:, :2])
    places = {n: g.round(6).tolist() if np.isfinite(g).all() else None for n, g in zip(names, ground, strict=True)}
    return {
        "located": True,
        "lat_deg": math.degrees(lat),
        "lon_deg": math.degrees(lon),
        "height_m": height,
        "off_nadir_deg": math.degrees(off),
        "heading_deg": math.degrees(heading),
        "r_ecef_m": fit.r_CE_E.tolist(),
        "dcm_CE": fit.dcm_CE.tolist(),
        "sigma_position_m": float(np.sqrt(np.trace(fit.P_pose[:3, :3]))),
        "landmarks": len(tracked.P_px),
        "candidates": tracked.candidates,
        "sigma_px": float(np.median(np.sqrt(0.5 * np.trace(tracked.P_px, axis1=1, axis2=2)))),
        "rms_px": float(np.sqrt(np.mean(fit.residual_px**2))),
        "ground": places,
    }


def draw(
    photo: NDArray[np.uint8], camera: CameraConfigMsg, tracked: Tracked, maps: GeoMap | Catalogue
) -> NDArray[np.uint8]:
    """The photo with what was found, in OpenCV's order of colours.

    Landmarks that were matched (green), those looked for and not matched or rejected (red), a grid of latitude and
    longitude (cyan) and, where a map is given, its strong edges - coasts, rivers - where the pose puts them (orange).
    """
    canvas = CV.cvtColor(photo, cv2.COLOR_GRAY2BGR)
    lens, fit = lens_vector(camera), tracked.fit
    size = max(0.4, photo.shape[1] / 2400)
    if isinstance(maps, GeoMap):
        _draw_edges(canvas, maps, lens, fit.r_CE_E, fit.dcm_CE)
    _draw_grid(canvas, lens, fit.r_CE_E, fit.dcm_CE, size)
    radius = round(16 * 10 * size)
    missed = np.empty((len(tracked.r_missed_E), 2))
    project(lens, (tracked.r_missed_E - fit.r_CE_E) @ fit.dcm_CE.T, missed)
    for u, v in np.rint(16 * missed[(np.abs(missed) < 1e4).all(axis=1)]).astype(int).tolist():
        d = radius // 2
        for x, y in ((d, d), (d, -d)):
            CV.line(canvas, (u - x, v - y), (u + x, v + y), RED, 1, cv2.LINE_AA, 4)
    for u, v in np.rint(16 * tracked.found.seen).astype(int).tolist():
        CV.circle(canvas, (u, v), radius, GREEN, 1, cv2.LINE_AA, 4)
    names = [(GREEN, f"{len(tracked.P_px)} matched"), (RED, f"{len(missed)} not matched or rejected"), (CYAN, "grid")]
    names += [(ORANGE, "edges of the map")] if isinstance(maps, GeoMap) else []
    _draw_legend(canvas, names, size)
    return canvas


def _draw_edges(canvas: NDArray[np.uint8], maps: GeoMap, lens: F64, r_CE_E: F64, dcm_CE: F64) -> None:
    try:
        view = render_view(maps, lens, (canvas.shape[0], canvas.shape[1]), r_CE_E, dcm_CE)
    except MapError:
        return
    smooth = CV.GaussianBlur(view.image, (0, 0), 3.0)
    dx, dy = CV.Sobel(smooth, cv2.CV_16S, 1, 0), CV.Sobel(smooth, cv2.CV_16S, 0, 1)
    strong = float(np.percentile(np.hypot(dx, dy)[view.mask], 94.0))
    lines = CV.Canny(dx, dy, 0.5 * strong, strong, L2gradient=True) > 0
    lines &= CV.erode(view.mask.astype(np.uint8), np.ones((13, 13), np.uint8)) > 0
    canvas[lines] = ORANGE


def _draw_grid(canvas: NDArray[np.uint8], lens: F64, r_CE_E: F64, dcm_CE: F64, size: float) -> None:
    rows, columns = canvas.shape[:2]
    edge: F64 = np.mgrid[0:1:9j, 0:1:9j].reshape(2, -1).T * [columns - 1.0, rows - 1.0]
    ground = np.degrees(ground_points(lens, r_CE_E, dcm_CE, edge)[:, :2])
    ground = ground[np.isfinite(ground).all(axis=1)]
    lon0 = float(ground[0, 1])
    ground[:, 1] = lon0 + np.remainder(ground[:, 1] - lon0 + 180.0, 360.0) - 180.0
    (south, west), (north, east) = ground.min(axis=0), ground.max(axis=0)
    step = _nice(max(north - south, (east - west) * math.cos(math.radians(0.5 * (south + north)))) / 5.0)
    along_lat, along_lon = south + (north - south) * np.arange(60.0) / 59, west + (east - west) * np.arange(60.0) / 59
    lines = [(_degrees(lat, "NS"), 0.0 * along_lon + lat, along_lon) for lat in _ticks(south, north, step)]
    lines += [(_degrees(lon, "EW"), along_lat, 0.0 * along_lat + lon) for lon in _ticks(west, east, step)]
    for name, lats, lons in lines:
        both: list[list[float]] = np.radians(np.column_stack([lats, lons])).tolist()
        places = np.array([ecef_from_geodetic(a, b, 0.0) for a, b in both])
        pixel = np.empty((60, 2))
        project(lens, (places - r_CE_E) @ dcm_CE.T, pixel)
        shown = (np.abs(pixel) < 1e4).all(axis=1)
        CV.polylines(canvas, [np.rint(16 * pixel[shown]).astype(np.int32)], False, CYAN, 1, cv2.LINE_AA, 4)
        inside = np.flatnonzero(shown & (pixel > 25).all(axis=1) & (pixel < [columns - 70, rows - 70]).all(axis=1))
        if len(inside):
            x, y = np.rint(pixel[inside[len(inside) // 8]]).astype(int).tolist()
            CV.putText(canvas, name, (x + 3, y - 4), cv2.FONT_HERSHEY_SIMPLEX, size, PALE, 1, cv2.LINE_AA)


def _draw_legend(canvas: NDArray[np.uint8], names: list[tuple[tuple[int, int, int], str]], size: float) -> None:
    """Names in their colours, on a dark ground in the lower left corner."""
    font, line = cv2.FONT_HERSHEY_SIMPLEX, round(36 * size)
    width = max(CV.getTextSize(text, font, size, 1)[0][0] for _, text in names) + line
    top = canvas.shape[0] - line * len(names) - line // 2
    box = canvas[max(top, 0) :, : width + line // 2]
    box[:] = (0.35 * box).astype(np.uint8)
    for k, (colour, text) in enumerate(names):
        y = top + line * k + line
        CV.circle(canvas, (line // 2, y - line // 4), line // 5, colour, -1, cv2.LINE_AA)
        CV.putText(canvas, text, (line, y), font, size, (255, 255, 255), 1, cv2.LINE_AA)


def _degrees(value: float, ends: str) -> str:
    """Degrees between -180 and 180 with their hemisphere."""
    turn = (value + 180.0) % 360.0 - 180.0
    return f"{abs(turn):g} {ends[turn < 0]}"


def _nice(step: float) -> float:
    """1, 2 or 5 times a power of ten, near ``step``."""
    power = 10.0 ** math.floor(math.log10(step))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(math.log(m * power / step)))


def _ticks(low: float, high: float, step: float) -> list[float]:
    return [round(k * step, 9) for k in range(math.ceil(low / step), math.floor(high / step) + 1)]
