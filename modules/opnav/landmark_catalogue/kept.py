"""Catalogues made on demand, kept in the user's cache folder for the next time."""

from __future__ import annotations

import contextlib
import hashlib
from pathlib import Path

from fsw.cache import cache_folder
from fsw.imaging.maps import GeoMap
from modules.opnav.landmark_catalogue import build, kernel
from modules.opnav.landmark_catalogue.build import Region, build_catalogue
from modules.opnav.landmark_catalogue.catalogue import Catalogue, CatalogueError
from modules.opnav.landmark_catalogue.files import VERSION, read_catalogue, write_catalogue

MOST = 20
"""Catalogues kept; those not used for longest go first."""


def kept_catalogue(geo_map: GeoMap, region: Region, gsd: float, levels: int, detector: str | None) -> Catalogue:
    """`build_catalogue`, or what it made before of files with the same contents and the same arguments.

    Kept in the folder ``catalogues`` of `fsw.cache.cache_folder` (``FSW_CACHE_DIR``, or the user's cache folder). A
    folder that cannot be written changes nothing but the time.

    Args:
        geo_map: as of `build_catalogue`, and so are the others.
        region: see there.
        gsd: see there.
        levels: see there.
        detector: see there.

    Raises:
        CatalogueError: as `build_catalogue`.
        MapError: if a map cannot be read.
    """
    folder = cache_folder() / "catalogues"
    file = folder / f"{_key(geo_map, region, gsd, levels, detector)}.npz"
    with contextlib.suppress(CatalogueError, OSError):
        found = read_catalogue(file)
        file.touch()
        return found
    made = build_catalogue(geo_map, region, gsd, levels=levels, detector=detector)
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_catalogue(made, file)
        for old in sorted(folder.glob("*.npz"), key=lambda f: f.stat().st_mtime)[:-MOST]:
            old.unlink(missing_ok=True)
    return made


def _key(geo_map: GeoMap, region: Region, gsd: float, levels: int, detector: str | None) -> str:
    """Digest of all that a catalogue depends on: files, arguments, and the code that makes it."""
    total = hashlib.sha256(repr((VERSION, tuple(region), gsd, levels, detector)).encode())
    rasters = [r.path for r in (*geo_map.layers, *([geo_map.terrain] if geo_map.terrain else []))]
    beside = [p.with_name(p.name + end) for p in rasters for end in (".aux.xml", ".msk")]
    code = [Path(str(part.__file__)) for part in (build, kernel)]
    for path in [*rasters, *(p for p in beside if p.is_file()), *code]:
        with path.open("rb") as opened:
            total.update(path.name.encode() + hashlib.file_digest(opened, "sha256").digest())
    return total.hexdigest()[:32]
