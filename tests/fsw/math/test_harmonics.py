"""Spherical harmonics against the gradient of the potential in 40 digits, zonal formulas, Laplace, and bad files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mpmath as _mpmath
import numpy as np
import pytest

from fsw.math.compiled import plain
from fsw.math.epoch import epoch
from fsw.math.gravity import zonal_acceleration, zonal_potential
from fsw.math.harmonics import SIZE, GravityField, harmonic_acceleration, harmonic_potential, read_icgem

mpmath: Any = _mpmath
FILE = Path(__file__).parents[3] / "sim" / "data" / "gravity" / "EGM2008_50.gfc"
PLACES = [(7.0e6, 1.2e6, -2.1e6), (-3.9e6, 3.3e6, -5.2e6), (1e-3, 0.0, 6.9e6), (0.0, 0.0, -7.2e6), (0.0, 6.6e6, 0.0)]


@pytest.fixture(scope="module")
def field() -> GravityField:
    return read_icgem(FILE)


def potential(at: list[Any], field: GravityField, degree: int) -> Any:
    """-mu/r (1 + sum (R/r)^n P_nm (C cos m lon + S sin m lon)), with Legendre functions by Rodrigues' formula.

    cos^m(latitude) (cos, sin)(m lon) is the real and imaginary part of ((x + i y)/r)^m, so poles are no exception.
    """
    x, y, z = at
    r = mpmath.sqrt(x * x + y * y + z * z)
    u, w, total = z / r, mpmath.mpc(x, y) / r, mpmath.mpf(1)
    for n in range(2, degree + 1):
        # coefficients of P_n in powers of u, to be differentiated m times
        powers = {
            n - 2 * k: mpmath.mpf(-1) ** k
            * mpmath.binomial(n, k)
            * mpmath.binomial(2 * n - 2 * k, n)
            / mpmath.mpf(2) ** n
            for k in range(n // 2 + 1)
        }
        for m in range(n + 1):
            value = mpmath.fsum(c * mpmath.ff(p, m) * u ** (p - m) for p, c in powers.items() if p >= m)
            norm = mpmath.sqrt((1 if m == 0 else 2) * (2 * n + 1) * mpmath.factorial(n - m) / mpmath.factorial(n + m))
            turn = w**m
            wave = mpmath.mpf(field.C[n, m]) * turn.real + mpmath.mpf(field.S[n, m]) * turn.imag
            total += (mpmath.mpf(field.radius) / r) ** n * norm * value * wave
    return -mpmath.mpf(field.mu) / r * total


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("degree", [2, 8])
def test_gradient_in_40_digits(place: tuple[float, float, float], degree: int, field: GravityField) -> None:
    with mpmath.workdps(40):
        at = [mpmath.mpf(x) for x in place]
        value, step, slope = potential(at, field, degree), mpmath.mpf(10) ** -3, []
        for axis in range(3):
            ends = [[x + sign * step * (i == axis) for i, x in enumerate(at)] for sign in (1, -1)]
            slope.append(float((potential(ends[0], field, degree) - potential(ends[1], field, degree)) / (2 * step)))
    arguments = (place, field.mu, field.radius, degree, field.C, field.S)
    got = np.array(harmonic_acceleration(*arguments))
    np.testing.assert_allclose(got, -np.array(slope), rtol=0, atol=3e-15 * float(np.linalg.norm(slope)))
    assert harmonic_potential(*arguments) == pytest.approx(float(value), rel=1e-15)


def test_degree_50_in_40_digits(field: GravityField) -> None:
    place = PLACES[1]
    with mpmath.workdps(40):
        at, step = [mpmath.mpf(x) for x in place], mpmath.mpf(10) ** -3
        ends = [[at[0], at[1], at[2] + sign * step] for sign in (1, -1)]
        slope = float((potential(ends[0], field, 50) - potential(ends[1], field, 50)) / (2 * step))
    got = harmonic_acceleration(place, field.mu, field.radius, 50, field.C, field.S)
    assert got[2] == pytest.approx(-slope, rel=2e-14)


def test_zonal_field_is_that_of_the_zonals(field: GravityField) -> None:
    """Only C20 to C60: equal to J2 to J6 by Legendre polynomials, tested elsewhere against mpmath."""
    c = np.zeros((SIZE, SIZE))
    c[0, 0], c[2:7, 0] = 1.0, field.C[2:7, 0]
    zonals = tuple(-field.C[n, 0] * math.sqrt(2 * n + 1) for n in range(2, 7))
    for place in PLACES:
        got = harmonic_acceleration(place, field.mu, field.radius, 6, c, np.zeros((SIZE, SIZE)))
        expected = zonal_acceleration(place, field.mu, field.radius, zonals)
        np.testing.assert_allclose(got, expected, rtol=0, atol=4e-15 * float(np.linalg.norm(expected)))


def test_laplace(field: GravityField) -> None:
    """No mass outside: the divergence of the acceleration vanishes against the gradient, degree 50."""
    h = 10.0
    for place in PLACES[:3]:
        gradient = []
        for axis in range(3):
            ends: Any = [tuple(x + sign * h * (i == axis) for i, x in enumerate(place)) for sign in (1, -1)]
            a, b = (harmonic_acceleration(p, field.mu, field.radius, 50, field.C, field.S)[axis] for p in ends)
            gradient.append((a - b) / (2 * h))
        assert abs(sum(gradient)) < 2e-9 * max(abs(g) for g in gradient)


@pytest.mark.parametrize("place", [(7e6, 1e6, -2e6), (0.0, 0.0, 6.9e6)])
def test_zonals_against_mpmath(place: tuple[float, float, float]) -> None:
    mu, radius, zonals = 3.986004415e14, 6378136.3, (1.0826e-3, -2.5e-6, -1.6e-6, -2.2e-7, 5.4e-7)
    with mpmath.workdps(40):

        def energy(x: Any, y: Any, z: Any) -> Any:
            r = mpmath.sqrt(x * x + y * y + z * z)
            terms = (mpmath.mpf(j) * (radius / r) ** n * mpmath.legendre(n, z / r) for n, j in enumerate(zonals, 2))
            return -mpmath.mpf(mu) / r * (1 - mpmath.fsum(terms))

        at = [mpmath.mpf(x) for x in place]
        slope = [float(mpmath.diff(energy, at, n, h=1)) for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
        value = float(energy(*at))
    got = np.array(zonal_acceleration(place, mu, radius, zonals))
    np.testing.assert_allclose(got, -np.array(slope), rtol=0, atol=5e-14 * float(np.linalg.norm(slope)))
    assert zonal_potential(place, mu, radius, zonals) == pytest.approx(value, rel=1e-15)


def test_compiled_and_plain_agree(field: GravityField) -> None:
    arguments = (PLACES[0], field.mu, field.radius, 20, field.C, field.S)
    a, b = harmonic_acceleration(*arguments), plain(harmonic_acceleration)(*arguments)
    np.testing.assert_allclose(a, b, rtol=1e-15)


def test_egm2008_is_read_whole(field: GravityField) -> None:
    assert (field.name, field.degree, field.tide_system) == ("EGM2008", 50, "tide_free")
    assert field.C[2, 0] == -0.484165143790815e-03
    assert field.S[2, 2] == -0.140027370385934e-05
    assert np.count_nonzero(field.C) == 1 + sum(n + 1 for n in range(2, 51))
    small = read_icgem(FILE, 4)
    assert small.degree == 4 and not small.C[5:].any()


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("end_of_head", "end", "ICGEM"),
        ("fully_normalized", "unnormalized", "norm"),
        ("gfc     3    1    0.203046201047864e-05", "gfct    3    1    0.203046201047864e-05", "static"),
        ("gfc     3    1 ", "gfc    99    1 ", "n=3, m=1"),
        ("0.957161207093473e-06", "what", "ICGEM"),
        ("0.957161207093473e-06", "nan", "n=3, m=0"),
        ("earth_gravity_constant", "constant", "earth_gravity_constant"),
    ],
)
def test_damaged_files(old: str, new: str, text: str, tmp_path: Path) -> None:
    whole = FILE.read_text()
    assert old in whole
    path = tmp_path / "field.gfc"
    path.write_text(whole.replace(old, new))
    with pytest.raises(ValueError, match=text):
        read_icgem(path)


HEAD = "earth_gravity_constant 3.986004415e14\nradius 6378136.3\nmax_degree 2\nnorm fully_normalized\n"
FIRST = """
gfct 2 0 -4.84e-04 0.0 1e-13 0.0 20050101
trnd 2 0 2.0e-11 0.0 1e-13 0.0
acos 2 0 4.0e-11 0.0 1e-13 0.0 1.0
asin 2 0 -3.0e-11 0.0 1e-13 0.0 1.0
gfc 2 1 -2.0e-10 1.4e-09 1e-13 1e-13
gfct 2 2 2.4e-06 -1.4e-06 1e-13 1e-13 20050101
trnd 2 2 0.0 1.0D-11 1e-13 1e-13
"""
SECOND = """
gfct 2 0 -4.00e-04 0.0 1e-13 0.0 19500101.0000 20050101.0000
gfct 2 0 -4.84e-04 0.0 1e-13 0.0 20050101.0000 20500101.0000
trnd 2 0 2.0e-11 0.0 1e-13 0.0 20050101.0000 20500101.0000
trnd 2 0 9.0e-11 0.0 1e-13 0.0 19500101.0000 20050101.0000
acos 2 0 4.0e-11 0.0 1e-13 0.0 20050101.0000 20500101.0000 1.0
asin 2 0 -3.0e-11 0.0 1e-13 0.0 20050101.0000 20500101.0000 1.0
gfc 2 1 -2.0e-10 1.4e-09 1e-13 1e-13
gfct 2 2 2.4e-06 -1.4e-06 1e-13 1e-13 20050101.0000 20500101.0000
trnd 2 2 0.0 1.0D-11 1e-13 1e-13 20050101.0000 20500101.0000
"""


@pytest.mark.parametrize(("form", "lines"), [("icgem1.0", FIRST), ("icgem2.0", SECOND)])
def test_a_field_that_varies_with_time(form: str, lines: str, tmp_path: Path) -> None:
    """Drift and yearly wave, by hand: ten years and a quarter after the date 0 the cosine is 0 and the sine 1."""
    path = tmp_path / "field.gfc"
    path.write_text(f"begin_of_head\nformat {form}\n{HEAD}end_of_head ===={lines}")
    start = epoch("2005-01-01T00:00:00", "tai")
    later = start + round(10.25 * 365.25 * 86400e9)
    field = read_icgem(path, epoch_ns=later)
    assert field.C[2, 0] == pytest.approx(-4.84e-4 + 20.5e-11 - 3e-11, rel=1e-15)
    assert (field.C[2, 1], field.S[2, 1], field.C[2, 2]) == (-2e-10, 1.4e-9, 2.4e-6)
    assert field.S[2, 2] == pytest.approx(-1.4e-6 + 10.25e-11, rel=1e-13)
    assert read_icgem(path, epoch_ns=start).C[2, 0] == pytest.approx(-4.84e-4 + 4e-11, rel=1e-15)
    with pytest.raises(ValueError, match=r"field\.gfc: .* the field varies with time: give the epoch_ns"):
        read_icgem(path)
    if form == "icgem2.0":
        with pytest.raises(ValueError, match="none of n=2, m=0"):
            read_icgem(path, epoch_ns=epoch("2060-01-01", "tt"))


def test_a_field_of_the_moon_with_words_before_its_head(tmp_path: Path) -> None:
    """Comments may come first, and the constant of another body has a name of its own."""
    whole = FILE.read_text().replace("earth_gravity_constant", "gravity_constant")
    path = tmp_path / "field.gfc"
    path.write_text(f"radius of the reference: see below\nnorm is explained\nbegin_of_head ====\n{whole}")
    there, whole_field = read_icgem(str(path), 4), read_icgem(FILE, 4)
    assert there.mu == whole_field.mu and there.radius == whole_field.radius
    np.testing.assert_array_equal(there.C, whole_field.C)


def test_wrong_degree() -> None:
    with pytest.raises(ValueError, match="2 to 50"):
        read_icgem(FILE, 51)
