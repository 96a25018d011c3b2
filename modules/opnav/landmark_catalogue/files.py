"""Catalogues as files: one .npz, with version, sources and a checksum."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from fsw.files import atomic
from modules.opnav.landmark_catalogue.catalogue import CHIP, Catalogue, CatalogueError, Landmarks, MapFeatures

VERSION = 1
"""Of the format; a file of another version is refused."""
DIGEST = "sha256"


def _arrays(catalogue: Catalogue) -> dict[str, Any]:
    """All that is stored, by name."""
    parts: dict[str, Any] = {
        "version": np.array(VERSION),
        "maps": np.array(catalogue.maps),
        "gsd_m": np.array(catalogue.gsd),
        "detector": np.array(catalogue.detector),
    }
    parts |= {f"landmark_{name}": part for name, part in catalogue.landmarks._asdict().items()}
    return parts | {f"feature_{name}": part for name, part in catalogue.features._asdict().items()}


def digest(arrays: dict[str, Any]) -> str:
    """SHA-256 over names, types, shapes and values."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def write_catalogue(catalogue: Catalogue, path: str | Path) -> str:
    """Write a catalogue to a file (.npz, compressed), which appears when it is complete.

    Returns:
        The digest that the file carries.
    """
    arrays = _arrays(catalogue)
    arrays[DIGEST] = np.array(digest(arrays))
    with atomic(Path(path)) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)
    return str(arrays[DIGEST])


def read_catalogue(path: str | Path) -> Catalogue:
    """Read a catalogue and check it.

    Raises:
        CatalogueError: if the file is missing, damaged, of another version, or no catalogue.
    """
    path = Path(path)
    if not path.is_file():
        raise CatalogueError(f"catalogue {path} does not exist; make one with fsw catalogue MAP -o {path.name}")
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile, zipfile.error) as error:
        raise CatalogueError(f"catalogue {path} cannot be read ({error}); make it again with fsw catalogue") from error
    if "version" not in arrays or DIGEST not in arrays:
        raise CatalogueError(f"{path} is not a landmark catalogue; make one with fsw catalogue")
    if arrays["version"].shape != () or arrays["version"].tolist() != VERSION:
        found = arrays["version"].tolist()
        raise CatalogueError(
            f"catalogue {path} has format {found}, expected {VERSION}; make it again with fsw catalogue"
        )
    stated = str(arrays.pop(DIGEST))
    if digest(arrays) != stated:
        raise CatalogueError(f"catalogue {path} is damaged (its checksum differs); make it again with fsw catalogue")
    try:
        landmarks = Landmarks(*(arrays[f"landmark_{name}"] for name in Landmarks._fields))
        features = MapFeatures(*(arrays[f"feature_{name}"] for name in MapFeatures._fields))
        maps, gsd = tuple(str(m) for m in arrays["maps"]), float(arrays["gsd_m"])
    except KeyError as error:
        raise CatalogueError(f"catalogue {path} lacks {error}; make it again with fsw catalogue") from error
    n = len(landmarks.lat)
    if landmarks.chips.shape != (n, CHIP, CHIP) or any(len(part) != n for part in landmarks):
        raise CatalogueError(f"catalogue {path}: its arrays do not fit each other; make it again with fsw catalogue")
    return Catalogue(maps, gsd, str(arrays["detector"]), landmarks, features)
