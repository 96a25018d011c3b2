"""Central bodies: gravity, size, rotation. Unknown ones are refused, never replaced by a default.

Identifiers are those of NAIF. Sources: gravitational parameters and radii of planets and large moons, Park, Folkner,
Williams and Boggs (2021), "The JPL Planetary and Lunar Ephemerides DE440 and DE441", Astron. J. 161:105, and Archinal
et al. (2018), "Report of the IAU Working Group on Cartographic Coordinates and Rotational Elements: 2015", Celest.
Mech. Dyn. Astr. 130:22; zonal terms: Earth EGM2008; Moon GRGM900C (Lemoine et al. 2014); Mars MRO120D (Konopliv et al.
2016); Jupiter, Iess et al. (2018), Nature 555:220; Saturn, Iess et al. (2019), Science 364:eaat2965; Venus MGNP180U
(Konopliv et al. 1999); Galilean moons, Schubert et al. (2004); Vesta and Ceres, Konopliv et al. (2014, 2018); Eros,
Miller et al. (2002); Bennu, Scheeres et al. (2020). Terms that are not listed are 0.
"""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

DAY = 86400.0
HOUR = 3600.0


@dataclass(frozen=True)
class Body:
    """A central body.

    Attributes:
        naif: identifier. name: in English. mu: gravitational parameter, m^3/s^2. radius: equatorial (of a small
            body: mean), m. flattening: of the surface. period: of the rotation relative to the stars, s; negative:
            retrograde. field_radius: reference radius of the zonal terms, m. zonals: J2 to J6, not normalised.
    """

    naif: int
    name: str
    mu: float
    radius: float
    flattening: float
    period: float
    field_radius: float
    zonals: tuple[float, float, float, float, float]

    @property
    def rate(self) -> float:
        """Angular rate of the rotation, rad/s."""
        return 2.0 * math.pi / self.period


def _normalised(*c: float) -> tuple[float, float, float, float, float]:
    """J2 to J6 from normalised zonal coefficients C20 to C60."""
    j = [-value * math.sqrt(2 * n + 1) for n, value in enumerate(c, 2)] + [0.0] * 5
    return j[0], j[1], j[2], j[3], j[4]


_NONE = (0.0, 0.0, 0.0, 0.0, 0.0)
_EARTH = _normalised(
    -0.484165143790815e-03, 0.957161207093473e-06, 0.539965866638991e-06, 0.686702913736681e-07, -0.149953927978527e-06
)
_BODIES = (
    Body(10, "Sun", 1.32712440041279419e20, 695700e3, 0.0, 25.38 * DAY, 695700e3, (2.2e-7, 0.0, 0.0, 0.0, 0.0)),
    Body(199, "Mercury", 2.2031868551e13, 2440.53e3, 0.0009301, 58.6462 * DAY, 2440e3, (5.03e-5, 0, 0, 0, 0)),
    Body(299, "Venus", 3.24858592e14, 6051.8e3, 0.0, -243.0185 * DAY, 6051e3, (4.40443e-6, -2.1082e-6, 0, 0, 0)),
    Body(399, "Earth", 3.986004415e14, 6378137.0, 1 / 298.257223563, 86164.09890369, 6378136.3, _EARTH),
    Body(301, "Moon", 4.9028001184575496e12, 1737.4e3, 0.0, 27.321661 * DAY, 1738e3, (2.0330e-4, 8.4759e-6, 0, 0, 0)),
    Body(499, "Mars", 4.2828375816e13, 3396.19e3, 0.00588600756, 88642.66, 3396e3, (1.95661e-3, 3.145e-5, 0, 0, 0)),
    Body(401, "Phobos", 7.0875e5, 11.08e3, 0.0, 27553.84, 11.08e3, _NONE),
    Body(402, "Deimos", 9.615e4, 6.2e3, 0.0, 109074.8, 6.2e3, _NONE),
    Body(
        599,
        "Jupiter",
        1.266865341960128e17,
        71492e3,
        0.0648744,
        9.92492 * HOUR,
        71492e3,
        (14696.572e-6, -0.042e-6, -586.609e-6, -0.069e-6, 34.198e-6),
    ),
    Body(501, "Io", 5.959916e12, 1821.49e3, 0.0, 1.769138 * DAY, 1821.6e3, (1.8595e-3, 0, 0, 0, 0)),
    Body(502, "Europa", 3.202739e12, 1560.8e3, 0.0, 3.551181 * DAY, 1565e3, (4.355e-4, 0, 0, 0, 0)),
    Body(503, "Ganymede", 9.887834e12, 2631.2e3, 0.0, 7.154553 * DAY, 2631.2e3, (1.2753e-4, 0, 0, 0, 0)),
    Body(504, "Callisto", 7.179289e12, 2410.3e3, 0.0, 16.689017 * DAY, 2410.3e3, (3.27e-5, 0, 0, 0, 0)),
    Body(
        699,
        "Saturn",
        3.7931206234e16,
        60268e3,
        0.0979624,
        10.65622 * HOUR,
        60330e3,
        (16290.573e-6, 0.059e-6, -935.314e-6, -0.224e-6, 86.340e-6),
    ),
    Body(606, "Titan", 8.978137e12, 2575e3, 0.0, 15.945421 * DAY, 2575e3, (3.341e-5, 0, 0, 0, 0)),
    Body(799, "Uranus", 5.793951256e15, 25559e3, 0.0229273, -17.24 * HOUR, 25559e3, (3510.68e-6, 0, -34.17e-6, 0, 0)),
    Body(899, "Neptune", 6.83509997e15, 24764e3, 0.0170816, 16.11 * HOUR, 25225e3, (3408.43e-6, 0, -33.4e-6, 0, 0)),
    Body(999, "Pluto", 8.696e11, 1188.3e3, 0.0, -6.387230 * DAY, 1188.3e3, _NONE),
    Body(2000001, "Ceres", 6.2628888645e10, 482.1e3, 0.0751, 9.074170 * HOUR, 470e3, (2.6499e-2, 0, 0, 0, 0)),
    Body(2000004, "Vesta", 1.7288245e10, 284.5e3, 0.2, 5.342128 * HOUR, 265e3, (7.1060892e-2, 0, 0, 0, 0)),
    Body(2000433, "Eros", 4.4631e5, 8.42e3, 0.0, 5.27025547 * HOUR, 16e3, (0.1174, 0, 0, 0, 0)),
    Body(2025143, "Itokawa", 2.36, 0.165e3, 0.0, 12.132 * HOUR, 0.165e3, _NONE),
    Body(2162173, "Ryugu", 30.0, 0.448e3, 0.0, -7.63262 * HOUR, 0.448e3, _NONE),
    Body(2101955, "Bennu", 4.8904, 0.245e3, 0.0, -4.296057 * HOUR, 0.29e3, (1.926e-2, 0, 0, 0, 0)),
)


def bodies() -> tuple[Body, ...]:
    """All bodies of the table."""
    return _BODIES


def body(which: int | str) -> Body:
    """A body by its NAIF identifier or its English name (capitals do not matter).

    Raises:
        ValueError: if the table has no such body; the text names those it has, or the nearest name.
    """
    if isinstance(which, str):
        found = {b.name.lower(): b for b in _BODIES}.get(which.strip().lower())
    else:
        found = {b.naif: b for b in _BODIES}.get(which)
    if found is None:
        labels = {text: f"{b.name} ({b.naif})" for b in _BODIES for text in (b.name, str(b.naif))}
        close = [labels[x] for x in difflib.get_close_matches(str(which).strip().title(), labels, 3)]
        hint = (
            f"did you mean {' or '.join(dict.fromkeys(close))}?"
            if close
            else f"it has {', '.join(dict.fromkeys(labels.values()))}"
        )
        raise ValueError(f"body: expected the name or NAIF identifier of a body of the table, got {which!r}; {hint}")
    return found
