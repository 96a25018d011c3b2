"""Reading and checking everything a run needs, before anything is computed."""

from __future__ import annotations

from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import erfa as _erfa
import msgspec
import numpy as np

from fsw.imaging.maps import GeoMap, MapError
from messages.opnav import CameraConfigMsg
from messages.orbit import CameraAccuracyMsg
from modules.estimation.orbit_pose_prior import OrbitError, TleOrbit, require_fresh
from sim.camera.photo_player import Cadence, Photo, PhotoError, PlayedPhoto, Times, estimate_times, open_photo
from sim.scenarios.iss_photos.camera_file import BadInputError, read_calibration, read_camera
from sim.scenarios.iss_photos.options import Options

erfa: Any = _erfa
OLDEST_TLE_DAYS = 10.0
_SIGHT_RAD = (-0.07, -0.035, 0.0, 0.035, 0.07)
_SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp"}


class Inputs(msgspec.Struct, frozen=True, kw_only=True):
    """Everything a run needs, checked.

    Attributes:
        epoch: UTC of simulation time zero. photos, played, times: of the usable photos, in order of time.
        refused: name of a photo that cannot be used, and why. camera, accuracy: lens, mounting.
        orbit: the approximate orbit. geo_map: map and heights.
    """

    epoch: datetime
    photos: list[Photo]
    played: list[PlayedPhoto]
    times: Times
    refused: dict[str, str]
    camera: CameraConfigMsg
    accuracy: CameraAccuracyMsg | None
    orbit: TleOrbit
    geo_map: GeoMap


def photo_files(given: tuple[Path, ...]) -> list[Path]:
    """Photo files named directly or lying in the folders named, in order of name.

    Raises:
        BadInputError: if a path does not exist or a folder holds no photos.
    """
    files: list[Path] = []
    for path in given:
        if path.is_dir():
            found = sorted(f for f in path.iterdir() if f.suffix.lower() in _SUFFIXES and not f.name.startswith("."))
            if not found:
                raise BadInputError(f"folder {path} holds no photos ({', '.join(sorted(_SUFFIXES))})")
            files += found
        elif path.exists():
            files.append(path)
        else:
            raise BadInputError(f"there is no photo file or folder {path}")
    return list(dict.fromkeys(files))


def _read_photos(files: list[Path], camera: CameraConfigMsg, camera_path: Path) -> tuple[list[Photo], dict[str, str]]:
    photos: list[Photo] = []
    refused: dict[str, str] = {}
    for file in files:
        try:
            photo = open_photo(file)
        except PhotoError as error:
            refused[str(file)] = str(error)
            continue
        if (photo.width_px, photo.height_px) != (camera.width_px, camera.height_px):
            size, wanted = f"{photo.width_px} x {photo.height_px}", f"{camera.width_px} x {camera.height_px}"
            refused[str(file)] = f"it has {size} px, but the camera of {camera_path.name} has {wanted} px"
            continue
        photos.append(photo)
    if not photos:
        first, reason = next(iter(refused.items()))
        others = f" (and {len(refused) - 1} more)" if len(refused) > 1 else ""
        raise BadInputError(f"no photo can be used: {first}: {reason}{others}")
    return sorted(photos, key=lambda p: (p.stamp, p.path.name)), refused


def _play_list(photos: list[Photo], epoch: datetime, hint: Cadence | None) -> tuple[list[PlayedPhoto], Times]:
    stamps = [(p.stamp - epoch).total_seconds() for p in photos]
    times = estimate_times(stamps, [p.resolution_s for p in photos], hint)
    used: set[int] = set()
    played: list[PlayedPhoto] = []
    for k, photo in enumerate(photos):
        exposure_ns = round(times.t_s[k] * 1e9)
        while exposure_ns in used:
            exposure_ns += 1
        used.add(exposure_ns)
        played.append(
            PlayedPhoto(
                path=str(photo.path),
                exposure_ns=exposure_ns,
                earliest_ns=round(times.earliest_s[k] * 1e9),
                latest_ns=round(times.latest_s[k] * 1e9),
                sigma_s=float(times.sigma_s[k]),
                even=bool(times.even[k]),
            )
        )
    return played, times


def _in_sight(geo_map: GeoMap, orbit: TleOrbit, t_s: float) -> str | None:
    """None if the maps cover any place within sight of the station, else where the station is."""
    lon, lat = (float(x) for x in erfa.gc2gd(1, orbit.at(t_s)[0][0])[:2])
    shrink = max(float(np.cos(lat)), 0.05)
    for north in _SIGHT_RAD:
        for east in _SIGHT_RAD:
            if geo_map.covers(lat + north, lon + east / shrink):
                return None
    return f"{np.degrees(lat):.1f} deg N {np.degrees(lon):.1f} deg E"


def _out_of_reach(photo: Photo, orbit: TleOrbit, geo_map: GeoMap, maps: str) -> str | None:
    """Why orbit or map do not reach a photo, or None."""
    t_s = (photo.stamp - orbit.epoch).total_seconds()
    try:
        require_fresh(orbit, t_s, OLDEST_TLE_DAYS)
    except OrbitError as error:
        return str(error)
    place = _in_sight(geo_map, orbit, t_s)
    if place is None:
        return None
    advice = "if that is the right place, give a map of it with --map (and heights with --dem)"
    return f"map {maps} covers nothing within sight of the photo, which was taken over {place}; {advice}"


def read_inputs(options: Options) -> Inputs:
    """Read and check everything.

    Raises:
        BadInputError, OrbitError, MapError: with one sentence for a person.
    """
    accuracy: CameraAccuracyMsg | None = None
    hint: Cadence | None = None
    if options.calibration is None:
        camera_path, camera = options.camera, read_camera(options.camera)
    else:
        camera_path = options.calibration
        camera, accuracy, hint = read_calibration(camera_path)
    geo_map = GeoMap.open(options.maps, options.dem)
    readable, refused = _read_photos(photo_files(options.photos), camera, camera_path)
    first = readable[0].stamp
    epoch = first - timedelta(microseconds=first.microsecond)
    orbit = TleOrbit.open(options.tle, epoch)
    maps = ", ".join(str(m) for m in options.maps)
    photos: list[Photo] = []
    for photo in readable:
        reason = _out_of_reach(photo, orbit, geo_map, maps)
        if reason is None:
            photos.append(photo)
        else:
            refused[str(photo.path)] = reason
    if not photos:
        raise BadInputError(f"{readable[0].path.name}: {refused[str(readable[0].path)]}")
    played, times = _play_list(photos, epoch, hint)
    return Inputs(
        epoch=epoch,
        photos=photos,
        played=played,
        times=times,
        refused=refused,
        camera=camera,
        accuracy=accuracy,
        orbit=orbit,
        geo_map=geo_map,
    )


BAD = (BadInputError, OrbitError, MapError, PhotoError)
"""Errors that are a person's input, and are told in one sentence."""
