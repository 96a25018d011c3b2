"""Orbit files of many kinds, written here from one orbit that scipy propagated, and fits of such orbits."""

from __future__ import annotations

import gzip
import json
import math
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest

from fsw.math.compiled import COMPILE
from fsw.math.earth_orientation import EarthParameters, assumed_parameters, gcrf_to_itrf
from fsw.math.epoch import calendar, epoch
from fsw.tools.cli import main
from fsw.tools.orbit_files import read_orbit
from fsw.tools.orbit_fit import inertial, velocity_by_gibbs
from messages.base import F64
from tests.fsw.tools.test_fit_orbit import J2, MU, RADIUS, simple_orbit

ERFA: Any = erfa
TO_EME2000: F64 = ERFA.bp00(2451545.0, 0.0)[0]
LEO, GPS = np.array([6.9e6, 1e5, 0.0, 0.0, 1.2e3, 7.4e3]), np.array([2.0e7, 1.7e7, 3e6, -1.6e3, 1.2e3, 3.3e3])
OFFSETS = {"TAI": 0, "GPS": 19, "GAL": 19, "BDT": 33, "TT": -32.184}
"""TAI minus the time, s."""


@dataclass
class Orbit:
    """Positions (n, 3) in GCRF and TAI epochs (n,)."""

    epoch_ns: list[int]
    r_N: F64
    eop: EarthParameters


def orbit(start: F64, step: float, count: int) -> Orbit:
    zero = epoch("2018-02-03T00:00:00Z")
    eop, times = assumed_parameters(zero, 0.1), step * np.arange(count, dtype=np.float64)
    return Orbit([zero + round(1e9 * t) for t in times], simple_orbit(zero, times, start, eop), eop)


@pytest.fixture(scope="module")
def leo() -> Orbit:
    return orbit(LEO, 120.0, 60)


def stamp(t_ns: int, system: str) -> str:
    if system in ("UTC", "GLO"):
        return calendar(t_ns, "utc", 6).rstrip("Z")
    return calendar(t_ns - round(OFFSETS[system] * 1e9), "tai", 6)


def itrf_km(made: Orbit, k: int) -> F64:
    return gcrf_to_itrf(made.epoch_ns[k], made.eop) @ made.r_N[k] / 1e3


def sp3(made: Orbit, kind: str = "d", system: str = "GPS", axes: str = "IGS20", missing: tuple[int, ...] = ()) -> str:
    """Three satellites: one, its mirror image, and one without any position; velocities are to be passed over."""
    lines = [f"#{kind}V2018  2  3  0  0  0.00000000      60 ORBIT {axes:5s} FIT TEST", "/* a comment"]
    lines += [f"%c M  cc {system} ccc cccc"] if kind in "cd" else []
    for k, t in enumerate(made.epoch_ns):
        day, clock = stamp(t, system).split("T")
        year, month, dom, hour, minute = (int(w) for w in (*day.split("-"), *clock.split(":")[:2]))
        lines.append(f"*  {year} {month:2d} {dom:2d} {hour:2d} {minute:2d} {float(clock[6:]):11.8f}")
        x, gap = itrf_km(made, k), np.array([0.0, 0.0, 0.0] if k % 2 else [999999.999999] * 3)
        for name, r in (("L51", gap if k in missing else x), ("G07", -x), ("G08", gap)):
            lines.append(f"P{name}{r[0]:14.6f}{r[1]:14.6f}{r[2]:14.6f} 999999.999999")
            lines.append(f"V{name}{1.0:14.6f}{2.0:14.6f}{3.0:14.6f} 999999.999999")
    return "\n".join([*lines, "EOF", ""])


def oem(made: Orbit, system: str = "UTC", frame: str = "EME2000", segments: int = 1, **change: str) -> str:
    """With a covariance block after each segment, and segments that share an epoch."""
    lines = ["CCSDS_OEM_VERS = 2.0", "COMMENT not = a value", "ORIGINATOR = TEST", ""]
    for part in np.array_split(np.arange(len(made.r_N)), segments):
        names = {"OBJECT_NAME": "SAT", "CENTER_NAME": "EARTH", "REF_FRAME": frame, "TIME_SYSTEM": system, **change}
        lines += ["META_START", *(f"{k} = {v}" for k, v in names.items()), "META_STOP", "COMMENT of the segment"]
        for k in sorted({max(part[0] - 1, 0), *part.tolist()}):
            r = TO_EME2000 @ made.r_N[k] / 1e3 if frame in ("EME2000", "J2000") else made.r_N[k] / 1e3
            r = itrf_km(made, k) if frame.startswith("ITRF") else r
            lines.append(f"{stamp(made.epoch_ns[k], system)} {r[0]:.9f} {r[1]:.9f} {r[2]:.9f} 1 2 3")
        lines += ["COVARIANCE_START", "EPOCH = 2018-02-03T00:00:00", "COV_REF_FRAME = RTN", "1e-4", "2e-5 3e-4"]
        lines += ["COVARIANCE_STOP"]
    return "\n".join([*lines, ""])


def eof(made: Orbit, bad: tuple[int, ...] = ()) -> str:
    lines = ["<Earth_Explorer_File><Mission>Sentinel-2B</Mission><Ref_Frame>EARTH_FIXED</Ref_Frame><List_of_OSVs>"]
    for k, t in enumerate(made.epoch_ns):
        r = 1e3 * itrf_km(made, k) + (5000.0 if k in bad else 0.0)
        numbers = "".join(f'<{axis} unit="m">{x:.6f}</{axis}>' for axis, x in zip("XYZ", r, strict=True))
        quality = "DEGRADED" if k in bad else "NOMINAL"
        lines.append(f"<OSV><TAI>TAI={stamp(t, 'TAI')}</TAI>{numbers}<Quality>{quality}</Quality></OSV>")
    return "\n".join([*lines, "</List_of_OSVs></Earth_Explorer_File>"])


def day_of_year(text: str) -> str:
    first = date(2018, 1, 1).toordinal()
    return text.replace("2018-02-03T", f"2018-{date(2018, 2, 3).toordinal() - first + 1:03d}T").replace("\n", "\r\n")


def same(path: Path, text: str | bytes, made: Orbit, satellite: str | None = None, without: int = 0) -> None:
    """Read what was written: same epochs, and positions to the digits of the file."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    arc = read_orbit(path, satellite)
    rows = [made.epoch_ns.index(t) for t in arc.epoch_ns.tolist()]
    assert (len(rows), arc.left_out) == (len(made.r_N) - without, without)
    assert np.max(np.abs(inertial(arc, made.eop) - made.r_N[rows])) < 2e-3


@pytest.mark.parametrize(("kind", "system"), [("a", "GPS"), ("c", "GPS"), ("d", "UTC"), ("d", "BDT"), ("d", "GLO")])
def test_sp3(kind: str, system: str, leo: Orbit, tmp_path: Path) -> None:
    """The third satellite has no position at all, the first lacks three."""
    same(tmp_path / "x.sp3", sp3(leo, kind, system, missing=(0, 5, 6)), leo, "L51", without=3)


@pytest.mark.parametrize(
    ("system", "frame", "segments"),
    [("UTC", "EME2000", 1), ("TAI", "GCRF", 3), ("GPS", "ICRF", 2), ("TT", "ITRF2014", 1), ("UTC", "ITRF-97", 2)],
)
def test_oem(system: str, frame: str, segments: int, leo: Orbit, tmp_path: Path) -> None:
    same(tmp_path / "x.oem", oem(leo, system, frame, segments), leo)


def test_oem_with_days_of_the_year_and_two_objects(leo: Orbit, tmp_path: Path) -> None:
    same(tmp_path / "days.oem", day_of_year(oem(leo)), leo)
    both = oem(leo) + oem(Orbit(leo.epoch_ns, -leo.r_N, leo.eop), OBJECT_NAME="OTHER").partition("\n")[2]
    same(tmp_path / "both.oem", both, leo, "SAT")


def test_eof_leaves_out_what_is_degraded_and_may_be_packed(leo: Orbit, tmp_path: Path) -> None:
    same(tmp_path / "x.EOF", eof(leo, bad=(0, 1, 30)), leo, without=3)
    same(tmp_path / "x.EOF.gz", gzip.compress(eof(leo).encode()), leo)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (sp3, "choose one with --satellite: G07, L51"),
        (lambda made: sp3(made, axes="J2000"), "fixed to the Earth"),
        (lambda made: sp3(made).replace("%c", "/*"), "time system: expected"),
        (lambda made: oem(made, frame="TEME"), "got EARTH and TEME; convert"),
        (lambda made: oem(made, CENTER_NAME="MARS"), "got MARS"),
        (lambda made: oem(made, TIME_SYSTEM="TDB"), "got TDB"),
        (lambda made: oem(made) + oem(made, OBJECT_NAME="B").partition("\n")[2], "2 satellites; choose one"),
        (lambda made: oem(made, segments=2).replace("EME2000", "GCRF", 1), "in one frame"),
        (lambda made: eof(made, bad=tuple(range(60))), "at least 4 positions, the file has 0"),
        (lambda made: eof(made)[:3000], "expected a whole file in XML"),
        (lambda _: "PK\x03\x04", "unpack it first"),
        (lambda _: b"\x1f\x8babc", "a damaged one"),
    ],
)
def test_refused(make: Any, text: str, leo: Orbit, tmp_path: Path) -> None:
    path, made = tmp_path / "bad.txt", make(leo)
    path.write_bytes(made if isinstance(made, bytes) else made.encode())
    with pytest.raises(ValueError, match=rf"^bad\.txt: .*({text})"):
        read_orbit(path)


def test_gibbs_on_a_conic() -> None:
    """Positions of an ellipse at three true anomalies; its velocity is known."""
    p, e = 9e6, 0.3
    at = [p / (1 + e * math.cos(f)) * np.array([math.cos(f), math.sin(f), 0.0]) for f in (0.4, 1.3, 2.4)]
    expected = math.sqrt(MU / p) * np.array([-math.sin(0.4), e + math.cos(0.4), 0.0])
    np.testing.assert_allclose(velocity_by_gibbs(*at), expected, rtol=1e-9, atol=1e-6)


@pytest.mark.skipif(not COMPILE, reason="slow as plain Python")
@pytest.mark.parametrize(("start", "step", "options"), [(GPS, 900.0, ["--light"]), (LEO, 900.0, []), (LEO, 30.0, [])])
def test_fit_with_other_spacings(start: F64, step: float, options: list[str], tmp_path: Path) -> None:
    """A day in a GPS orbit, 15 h with six positions in an orbit, and half an hour; in a field of J2 alone."""
    made = orbit(start, step, 60)
    (tmp_path / "x.sp3").write_text(sp3(made, missing=(3,)))
    rows = [(0, 0, 1.0), (2, 0, -J2 / math.sqrt(5.0)), (2, 1, 0.0), (2, 2, 0.0)]
    head = f"modelname J2\nearth_gravity_constant {MU}\nradius {RADIUS}\nmax_degree 2\nnorm fully_normalized\nerrors no"
    body = "\n".join(f"gfc {n} {m} {c:.16e} 0.0" for n, m, c in rows)
    (tmp_path / "j2.gfc").write_text(f"{head}\nend_of_head\n{body}\n")
    files = [str(tmp_path / "x.sp3"), "--gravity", str(tmp_path / "j2.gfc"), "-o", str(tmp_path / "fit")]
    more = ["--degree", "2", "--satellite", "L51", "--ut1-utc", "0.1", *options]
    assert main(["fit-orbit", *files, *more]) == 0
    found = json.loads((tmp_path / "fit.json").read_text())
    assert found["residuals"]["rms_m"] < 0.01
    assert found["arc"]["left_out"] == 1
    assert np.linalg.norm(found["r_N_m"] - start[:3]) < 0.01
    assert np.linalg.norm(found["v_N_m_s"] - start[3:]) < 1e-5
    sigma = np.sqrt(np.diag(found["covariance_r_v"]))
    np.testing.assert_allclose(sigma, found["sigma_r_m"] + found["sigma_v_m_s"], rtol=1e-12)
