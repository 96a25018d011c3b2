"""A star catalogue as arrays."""

from __future__ import annotations

import csv
from pathlib import Path

import msgspec
import numpy as np

from messages.base import F64, I64

COLUMNS = ("hip", "ra_deg", "dec_deg", "magnitude", "b_v")


class StarCatalogue(msgspec.Struct, frozen=True):
    """Stars, brightest first; n of them.

    Attributes:
        hip: number in the Hipparcos catalogue, (n,).
        u_N: direction from the Sun's system, ICRS axes, epoch J2000, unit length, (n, 3).
        magnitude: visual magnitude, (n,).
        b_v: colour index B - V, magnitudes; NaN where it is unknown, (n,).
    """

    hip: I64
    u_N: F64
    magnitude: F64
    b_v: F64

    def brighter_than(self, limit: float) -> StarCatalogue:
        """The stars of magnitude ``limit`` and brighter."""
        n = int(np.searchsorted(self.magnitude, limit, side="right"))
        return StarCatalogue(self.hip[:n], self.u_N[:n], self.magnitude[:n], self.b_v[:n])


def read_stars(path: Path | str) -> StarCatalogue:
    """Read a table (CSV) with the columns hip, ra_deg, dec_deg, magnitude, b_v; b_v may be empty.

    Raises:
        ValueError: if a column is missing or a line holds no star; the text names file, line and field.
    """
    path = Path(path)
    with path.open(newline="") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise ValueError(f"{path.name}: expected the columns {', '.join(COLUMNS)}, got {reader.fieldnames}")
        rows = [_star(row, f"{path.name}, line {k}") for k, row in enumerate(reader, 2)]
    if not rows:
        raise ValueError(f"{path.name}: expected at least one star, found none")
    table = np.array(sorted(rows, key=lambda row: row[3]))
    ra, dec = np.radians(table[:, 1]), np.radians(table[:, 2])
    u_N = np.column_stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    arrays = (table[:, 0].astype(np.int64), u_N, table[:, 3].copy(), table[:, 4].copy())
    for array in arrays:
        array.setflags(write=False)
    return StarCatalogue(*arrays)


def _star(row: dict[str, str], where: str) -> tuple[float, ...]:
    try:
        hip, ra, dec, magnitude = (float(row[c]) for c in COLUMNS[:4])
        b_v = float(row["b_v"]) if row["b_v"] else np.nan
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: expected a number in every column, got {row}") from error
    if not (0.0 <= ra < 360.0 and -90.0 <= dec <= 90.0 and abs(magnitude) < 40.0 and 0.0 < hip < 1e7):
        text = "expected hip > 0, ra_deg in [0, 360), dec_deg in [-90, 90] and a magnitude"
        raise ValueError(f"{where}: {text}, got {row}")
    return hip, ra, dec, magnitude, b_v
