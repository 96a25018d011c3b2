"""A catalogue of landmarks, made beforehand from a map: chips, places, heights, descriptors; in one file."""

from modules.opnav.landmark_catalogue.build import Region, build_catalogue, region_of
from modules.opnav.landmark_catalogue.catalogue import CHIP, Catalogue, CatalogueError, Landmarks, MapFeatures
from modules.opnav.landmark_catalogue.files import read_catalogue, write_catalogue
from modules.opnav.landmark_catalogue.kept import kept_catalogue

__all__ = [
    "CHIP",
    "Catalogue",
    "CatalogueError",
    "Landmarks",
    "MapFeatures",
    "Region",
    "build_catalogue",
    "kept_catalogue",
    "read_catalogue",
    "region_of",
    "write_catalogue",
]
