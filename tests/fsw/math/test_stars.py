"""Star catalogues: the shipped one against published places of bright stars, and files that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fsw.math.stars import COLUMNS, read_stars

PATH = Path(__file__).parents[3] / "sim/data/stars/stars_6.csv"
BRIGHT = {
    32349: ("06:45:08.92", "-16:42:58.0", -1.46),  # Sirius
    69673: ("14:15:39.67", "+19:10:56.7", -0.05),  # Arcturus
    91262: ("18:36:56.34", "+38:47:01.3", 0.03),  # Vega
    24436: ("05:14:32.27", "-08:12:05.9", 0.13),  # Rigel
    11767: ("02:31:49.09", "+89:15:50.8", 1.98),  # Polaris
}
"""Hipparcos number: right ascension (h:m:s), declination (d:m:s) of J2000 and V, of SIMBAD."""


def sexagesimal(text: str) -> float:
    parts = [float(x) for x in text.strip("+-").split(":")]
    return (-1.0 if text.startswith("-") else 1.0) * (parts[0] + parts[1] / 60.0 + parts[2] / 3600.0)


def write(path: Path, *lines: str, header: str = ",".join(COLUMNS)) -> Path:
    path.write_text("\n".join([header, *lines]) + "\n")
    return path


@pytest.mark.parametrize("hip", BRIGHT)
def test_bright_stars_are_where_they_are(hip: int) -> None:
    stars = read_stars(PATH)
    k = int(np.flatnonzero(stars.hip == hip)[0])
    ra, dec, magnitude = BRIGHT[hip]
    a, d = np.radians(15.0 * sexagesimal(ra)), np.radians(sexagesimal(dec))
    known = [np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)]
    # four decimals of a degree are 0.26 arc seconds on both axes, and the published places are rounded too
    assert np.linalg.norm(stars.u_N[k] - known) * 206265.0 < 0.4
    assert stars.magnitude[k] == pytest.approx(magnitude, abs=0.06)


def test_brightest_first_and_as_many_as_the_sky_has() -> None:
    stars = read_stars(PATH)
    assert np.all(np.diff(stars.magnitude) >= 0.0)
    np.testing.assert_allclose(np.linalg.norm(stars.u_N, axis=1), 1.0, rtol=4e-16)
    assert np.unique(stars.hip).size == stars.hip.size
    # counts of the Bright Star Catalogue: some 1,600 stars to magnitude 5, 5,000 to 6
    assert stars.brighter_than(5.0).hip.size == pytest.approx(1600, rel=0.05)
    assert stars.brighter_than(-2.0).hip.size == 0
    assert stars.brighter_than(stars.magnitude[10]).hip.size >= 11
    # the sky is full: no octant has less than a twelfth of the stars
    octants = np.bincount((stars.u_N > 0.0) @ np.array([1, 2, 4]), minlength=8)
    assert octants.min() > stars.hip.size / 12


def test_arrays_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        read_stars(PATH).u_N[0, 0] = 0.0


def test_missing_colour_is_nan(tmp_path: Path) -> None:
    stars = read_stars(write(tmp_path / "two.csv", "2,10.0,-90.0,3.5,", "1,359.9,0.0,1.0,0.4"))
    np.testing.assert_array_equal(stars.hip, [1, 2])
    assert np.isnan(stars.b_v[1])
    np.testing.assert_allclose(stars.u_N[1], [0.0, 0.0, -1.0], atol=1e-16)


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("1,360.0,0.0,1.0,0.4", r"line 2: expected hip > 0, ra_deg in \[0, 360\)"),
        ("1,10.0,90.1,1.0,0.4", "line 2: expected hip"),
        ("1,10.0,nan,1.0,0.4", "line 2: expected hip"),
        ("0,10.0,0.0,1.0,0.4", "line 2: expected hip"),
        ("1,10.0,0.0,99.0,0.4", "line 2: expected hip"),
        ("1,10.0,0.0,bright,0.4", "line 2: expected a number in every column"),
        ("1,10.0,0.0", "line 2: expected a number in every column"),
        ("", "expected at least one star"),
    ],
)
def test_wrong_lines_are_refused(tmp_path: Path, line: str, says: str) -> None:
    with pytest.raises(ValueError, match=r"bad\.csv.*" + says):
        read_stars(write(tmp_path / "bad.csv", line))


def test_wrong_header_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"bad\.csv: expected the columns hip, ra_deg"):
        read_stars(write(tmp_path / "bad.csv", "1,2,3", header="a,b,c"))
