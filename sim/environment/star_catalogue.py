"""The shipped star catalogue."""

from __future__ import annotations

import functools
from pathlib import Path

from fsw.math.stars import StarCatalogue, read_stars


@functools.cache
def bright_stars() -> StarCatalogue:
    """5,044 stars to magnitude 6, J2000, positions to 0.2 arcseconds; see ``sim/data/stars/LICENCE.md``.

    The directions are those of epoch 2000.0, without proper motion: 5.3 arcseconds a year for the fastest of
    them (61 Cygni), typically below 0.1 arcseconds a year.
    """
    return read_stars(Path(__file__).parents[1] / "data" / "stars" / "stars_6.csv")
