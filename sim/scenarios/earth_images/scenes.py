"""What is looked at, and the effects that the pictures show one by one."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from messages.base import F64

DATA = Path(__file__).parents[2] / "data"
GLOBE = DATA / "earth" / "blue_marble_global_10800x5400.tif"
HEIGHTS = DATA / "earth" / "nasa_topography_2048x1024.png"


@dataclass(frozen=True)
class Scene:
    """A place, its maps, and a camera above it.

    Attributes:
        name: of files.
        title: for people.
        files: maps, fine to coarse.
        dem: heights, or None.
        lat_deg: geodetic latitude of the place that the camera looks at.
        lon_deg: its longitude.
        height_km: of the camera above the ellipsoid.
        focal_px: focal length for pictures of 1024 pixels.
        zoom_px: the same for the picture through a long lens.
        zoom_deg: latitude and longitude that it looks at.
        utc: time; it says where the Sun is.
        off_deg: angle at the camera between its axis and the vertical.
        azimuth_deg: direction on the ground, from north to east, towards which it looks.
        brightness: as of the camera's parameters: how long it exposes.
        cloud_seed: which clouds; chosen so that some are in view.
    """

    name: str
    title: str
    files: tuple[Path, ...]
    dem: Path | None
    lat_deg: float
    lon_deg: float
    height_km: float
    focal_px: float
    zoom_px: float
    zoom_deg: tuple[float, float]
    utc: str
    off_deg: float = 0.0
    azimuth_deg: float = 0.0
    brightness: float = 1.7
    cloud_seed: int = 4


SCENES = {
    "paris": Scene(
        "paris", "Paris", (DATA / "earth" / "blue_marble_z8_paris.tif", GLOBE), HEIGHTS,
        48.5, 2.9, 420.0, 1100.0, 4200.0, (48.86, 2.35), "2023-06-21T10:30:00Z", brightness=2.2,
    ),
    "cairo": Scene(
        "cairo", "Cairo and the pyramids", (DATA / "earth" / "blue_marble_z8_cairo.tif", GLOBE), HEIGHTS,
        29.7, 31.6, 420.0, 1000.0, 4200.0, (29.98, 31.13), "2023-06-21T08:30:00Z", brightness=1.2, cloud_seed=6,
    ),
    "itaipu": Scene(
        "itaipu", "Itaipu, Landsat 8", (DATA / "landsat" / "landsat8_itaipu_20200518_rgb.tif", GLOBE), HEIGHTS,
        -25.36, -54.55, 500.0, 9500.0, 17000.0, (-25.408, -54.589), "2020-05-18T13:30:00Z",
        brightness=2.6, cloud_seed=6,
    ),
}  # fmt: skip


def _nothing() -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class Effect:
    """One picture of a scene.

    Attributes:
        name: of the file.
        title: for people.
        params: of `EarthCamera`, beside those of the scene.
        lens: of `CameraConfigMsg`.
        change: fields of the scene that differ.
        omega_B: rate of the body [rad/s] of a picture of 1100 pixels focal length; longer lenses turn more slowly.
        terrain: whether heights are used.
    """

    name: str
    title: str
    params: dict[str, Any] = field(default_factory=_nothing)
    lens: dict[str, Any] = field(default_factory=_nothing)
    change: dict[str, Any] = field(default_factory=_nothing)
    omega_B: F64 = field(default_factory=lambda: np.zeros(3))
    terrain: bool = False


BARE: dict[str, Any] = {"haze": 0.0, "star_gain": 0.0}
LENS: dict[str, Any] = {
    "distortion": np.array([-0.35, 0.08, 0.001, -0.001, 0.0]),
    "chromatic": np.array([1.004, 1.0, 0.994]),
}
"""A wide lens, much worse than one would fly, so that it shows."""
NOISE: dict[str, Any] = {
    "psf_sigma_px": 0.8, "shot_noise": True, "full_well": 2500.0, "read_noise": 60.0, "vignetting": 0.4,
    "hot_pixels": 2e-4, "dead_pixels": 2e-4, "response_sigma": 0.03,
}  # fmt: skip
SHAKE: dict[str, Any] = {"row_time": 2e-4, "smear_time": 0.02}
TURN = np.array([0.1, 0.05, 0.35])


def effects(scene: Scene) -> list[Effect]:
    """The pictures of a scene, in the order of their names."""
    wide = {"focal_px": 420.0, "off_deg": 62.0, "azimuth_deg": 20.0, "height_km": 420.0}
    aside = {"off_deg": 45.0, "azimuth_deg": 150.0}
    lat, lon = scene.zoom_deg
    near = {"focal_px": scene.zoom_px, "lat_deg": lat, "lon_deg": lon, "off_deg": 0.0}
    clouds: dict[str, Any] = {"clouds": 0.4, "cloud_seed": scene.cloud_seed}
    slow = np.array([1100.0 / scene.focal_px, 1100.0 / scene.focal_px, 1.0]) * TURN
    return [
        Effect("01_map", "map only", {**BARE, "sunlight": False, "brightness": 1.0}),
        Effect("02_sunlight", "sunlight", BARE),
        Effect("03_haze", "haze"),
        Effect("04_clouds", "clouds and their shadows", clouds),
        Effect("05_terrain", "terrain, 45 degrees off", BARE, change=aside, terrain=True),
        Effect("06_lens", "distortion and colour fringes", lens=_worse(scene)),
        Effect("07_shutter", "rolling shutter and smear", SHAKE, omega_B=slow),
        Effect("08_detector", "detector: blur, noise, defects", NOISE),
        Effect("09_all", "all but terrain", {**NOISE, **SHAKE, **clouds, "smear_time": 0.006}, _worse(scene), {}, slow),
        Effect("10_limb", "limb, and stars a million times brighter", {"star_gain": 1e6}, change=wide),
        Effect("11_zoom", "zoom", change=near),
    ]


def _worse(scene: Scene) -> dict[str, Any]:
    """The bad lens for the field of view of a scene: distortion goes with the square of the angle."""
    factor = (scene.focal_px / 1100.0) ** 2
    return {**LENS, "distortion": LENS["distortion"] * np.array([factor, factor**2, factor**0.5, factor**0.5, 0.0])}


def with_effect(scene: Scene, effect: Effect) -> Scene:
    """The scene as an effect sees it."""
    changed = replace(scene, **effect.change)
    return changed if effect.terrain else replace(changed, dem=None)
