"""Gravity against derivatives of the potential taken in 40 digits, and a published value."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH, gravity_acceleration, gravity_potential

PLACES = [(7e6, 0.0, 0.0), (0.0, 0.0, 6.9e6), (-4.1e6, 3.3e6, -5.2e6), (2.1e7, -3.9e7, 1e6)]


def potential(x: mpmath.mpf, y: mpmath.mpf, z: mpmath.mpf, j2: float) -> mpmath.mpf:
    """-mu/r (1 - J2 (R/r)^2 P2(sin latitude)), with mpmath's own Legendre polynomial."""
    r = mpmath.sqrt(x * x + y * y + z * z)
    zonal = mpmath.mpf(j2) * (mpmath.mpf(RADIUS_EARTH) / r) ** 2 * mpmath.legendre(2, z / r)
    return -mpmath.mpf(MU_EARTH) / r * (1 - zonal)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("j2", [0.0, J2_EARTH])
def test_gravity_against_mpmath(place: tuple[float, float, float], j2: float) -> None:
    with mpmath.workdps(40):
        at = [mpmath.mpf(x) for x in place]
        value = float(potential(at[0], at[1], at[2], j2))
        orders = [(1, 0, 0), (0, 1, 0), (0, 0, 1)]
        slope = [float(mpmath.diff(lambda x, y, z: potential(x, y, z, j2), at, n, h=1)) for n in orders]
    got = np.array(gravity_acceleration(place, MU_EARTH, RADIUS_EARTH, j2))
    # the step of 1 m of the difference in 40 digits leaves (1/7e6)^2 = 2e-14
    np.testing.assert_allclose(got, -np.array(slope), rtol=0, atol=5e-14 * float(np.linalg.norm(slope)))
    assert gravity_potential(place, MU_EARTH, RADIUS_EARTH, j2) == pytest.approx(value, rel=4e-16)


def test_j2_of_egm2008() -> None:
    """Published unnormalised value: 1.0826261738522e-3 (Pavlis et al. 2012, tide free)."""
    assert pytest.approx(1.0826261738522e-3, rel=1e-12) == J2_EARTH
