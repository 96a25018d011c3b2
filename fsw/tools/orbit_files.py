"""Orbits as positions at times, read from the files that ground stations and agencies publish.

Formats: SP3-a to SP3-d (IGS), CCSDS Orbit Ephemeris Message in its text form (CCSDS 502.0-B), and the orbit files of
the Sentinels (Earth Explorer EOF). What a file is, its contents tell, not its name.
"""

from __future__ import annotations

import gzip
import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass
from datetime import date, timedelta
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from fsw.math.epoch import SECOND, Scale, calendar, epoch
from messages.base import F64, I64

Axes: TypeAlias = Literal["GCRF", "EME2000", "ITRF"]

GPS_BEHIND_TAI = 19 * SECOND
"""TAI - GPS time, ns."""
_EVEN_SCALES: dict[str, tuple[Scale, int]] = {
    "UTC": ("utc", 0),
    "TAI": ("tai", 0),
    "TT": ("tt", 0),
    "GPS": ("tai", GPS_BEHIND_TAI),
    "GAL": ("tai", GPS_BEHIND_TAI),
    "QZS": ("tai", GPS_BEHIND_TAI),
    "IRN": ("tai", GPS_BEHIND_TAI),
    "BDT": ("tai", 33 * SECOND),
    "GLO": ("utc", 0),
}
"""Time systems of files: a scale of ours, and what to add to it, ns."""
_AXES: dict[str, Axes] = {"EME2000": "EME2000", "J2000": "EME2000", "GCRF": "GCRF", "ICRF": "GCRF"}
_NO_POSITION = 999999.0
"""A coordinate of an SP3 file that is missing, km; zeros too."""
_DAY_OF_YEAR = re.compile(r"(\d{4})-(\d{3})T(.*)")


@dataclass(frozen=True)
class Arc:
    """Part of an orbit.

    Attributes:
        name: of the satellite. format: of the file. axes: of the positions; the origin is the Earth's centre.
        epoch_ns: (n,) ascending, TAI ns since 2000-01-01T12:00:00 TAI. r: (n, 3) positions, m.
        left_out: number of positions that the file says are missing or bad.
    """

    name: str
    format: str
    axes: Axes
    epoch_ns: I64
    r: F64
    left_out: int = 0

    @property
    def seconds(self) -> F64:
        """Times (n,) since the first, s."""
        return (self.epoch_ns - self.epoch_ns[0]) / 1e9

    def cut(self, start_ns: int, stop_ns: int) -> Arc:
        """The positions from one epoch to another, both included.

        Raises:
            ValueError: if fewer than four are left.
        """
        if start_ns >= stop_ns:
            raise ValueError("arc: expected a start before its stop, got the reverse")
        inside = (self.epoch_ns >= start_ns) & (self.epoch_ns <= stop_ns)
        times, positions = self.epoch_ns[inside].tolist(), self.r[inside].tolist()
        if len(times) < 4:
            first, last = (calendar(int(t), decimals=0) for t in self.epoch_ns[[0, -1]])
            text = f"expected a part with at least 4 positions, got {len(times)}; the file has {first} to {last}"
            raise ValueError(f"arc: {text}")
        return _arc(self.name, self.format, self.axes, times, positions, self.left_out)


def _arc(name: str, kind: str, axes: Axes, times: list[int], positions: list[list[float]], left_out: int = 0) -> Arc:
    """Sort by time, drop what is there twice, check."""
    unique = dict(zip(times, positions, strict=True))
    if len(unique) < 4:
        raise ValueError(f"an orbit needs at least 4 positions, the file has {len(unique)}")
    epoch_ns = np.array(sorted(unique), np.int64)
    r = np.array([unique[t] for t in epoch_ns.tolist()])
    if not np.all(np.isfinite(r)):
        raise ValueError("positions: expected finite numbers, got NaN or infinity")
    d = np.linalg.norm(r, axis=1)
    if d.min() < 6.3e6 or d.max() > 1e9:
        low, high = d.min() / 1e3, d.max() / 1e3
        raise ValueError(f"positions: expected orbits of the Earth, got distances from {low:.0f} to {high:.0f} km")
    return Arc(name, kind, axes, epoch_ns, r, left_out)


def read_orbit(path: Path | str, satellite: str | None = None) -> Arc:
    """The positions in a file.

    Args:
        path: SP3, CCSDS OEM (text) or Sentinel EOF; packed with gzip or not.
        satellite: which of the file's, "L51" say; None: the only one.

    Raises:
        ValueError: if the file is of no known format, or is damaged; the text names file and line.
    """
    path = Path(path)
    data = path.read_bytes()
    if data[:2] == b"\x1f\x8b":
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError) as error:
            raise ValueError(f"{path.name}: expected a file of gzip, got a damaged one ({error})") from error
    text = data.decode("utf-8", errors="replace")
    head = text.lstrip("\ufeff \n\r")[:4000]
    try:
        if head.startswith("#") and head[1:2] in "abcd":
            return _read_sp3(text, satellite)
        if head.startswith("CCSDS_OEM_VERS"):
            return _read_oem(text, satellite)
        if "<Earth_Explorer_File" in head:
            return _read_eof(text, satellite)
    except ET.ParseError as error:
        raise ValueError(f"{path.name}: expected a whole file in XML, got a damaged or cut one: {error}") from error
    except (ValueError, IndexError) as error:
        raise ValueError(f"{path.name}: {error}") from error
    packed = "; unpack it first" if head.startswith("PK") else ""
    got = f"got {head[:40]!r}{packed}"
    raise ValueError(f"{path.name}: expected an orbit in SP3, CCSDS OEM (text) or Sentinel EOF, {got}")


def _time(text: str, system: str) -> int:
    """Epoch of a calendar or day-of-year time in a named system."""
    if system not in _EVEN_SCALES:
        raise ValueError(f"time system: expected one of {', '.join(_EVEN_SCALES)}, got {system or 'nothing'}")
    if found := _DAY_OF_YEAR.fullmatch(text):
        day = date(int(found[1]), 1, 1) + timedelta(days=int(found[2]) - 1)
        text = f"{day.isoformat()}T{found[3]}"
    scale, offset = _EVEN_SCALES[system]
    return epoch(text.rstrip("Z"), scale) + offset


def _read_sp3(text: str, satellite: str | None) -> Arc:
    lines = text.splitlines()
    systems = [line[9:12].strip() for line in lines if line.startswith("%c")]
    system = systems[0] if systems and systems[0] != "ccc" else "GPS" if lines[0][1] in "ab" else ""
    axes = lines[0][46:51].strip()
    if not axes.startswith(("IT", "IG", "SL", "WG")):
        raise ValueError(f"axes: expected a frame fixed to the Earth (ITRF, IGS, WGS), got {axes or 'nothing'}")
    missing: Counter[str] = Counter()
    times: dict[str, list[int]] = {}
    positions: dict[str, list[list[float]]] = {}
    now = 0
    for number, line in enumerate(lines, 1):
        try:
            if line.startswith("* "):
                year, month, day, hour, minute = (int(w) for w in line[1:].split()[:5])
                second = float(line.split()[6])
                whole = f"{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:00"
                now = _time(whole, system) + round(second * 1e9)
            elif line.startswith("P"):
                name, r = line[1:4].strip(), [1e3 * float(line[a : a + 14]) for a in (4, 18, 32)]
                times.setdefault(name, [])
                positions.setdefault(name, [])
                if any(r) and max(r) < 1e3 * _NO_POSITION:
                    times[name].append(now)
                    positions[name].append(r)
                else:
                    missing[name] += 1
        except ValueError as error:
            raise ValueError(f"line {number}: {error}") from error
    satellite = _chosen(satellite, sorted(name for name, there in times.items() if there))
    return _arc(satellite, "SP3", "ITRF", times[satellite], positions[satellite], missing[satellite])


def _chosen(satellite: str | None, there: list[str]) -> str:
    """The satellite that is asked for, or the only one."""
    if satellite is None and len(there) == 1:
        return there[0]
    if satellite not in there:
        asked = f"no positions of {satellite}" if satellite else f"{len(there)} satellites"
        raise ValueError(f"the file has {asked}; choose one with --satellite: {', '.join(there) or 'there is none'}")
    return satellite


def _read_oem(text: str, satellite: str | None) -> Arc:
    known: dict[str, str] = {}
    times: list[int] = []
    positions: list[list[float]] = []
    names: list[str] = []
    kinds: set[tuple[str, ...]] = set()
    skip = False
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or words[0] in ("COMMENT", "META_STOP"):
            continue
        if words[0] in ("COVARIANCE_START", "COVARIANCE_STOP"):
            skip = words[0].endswith("START")
        elif words[0] == "META_START":
            known = {}
        elif "=" in line:
            key, _, value = line.partition("=")
            known[key.strip()] = value.strip()
        elif not skip:
            try:
                times.append(_time(words[0], known["TIME_SYSTEM"].upper()))
                positions.append([1e3 * float(w) for w in words[1:4]])
                names.append(known["OBJECT_NAME"])
                kinds.add(tuple(known[k] for k in ("OBJECT_NAME", "CENTER_NAME", "REF_FRAME")))
            except KeyError as error:
                raise ValueError(f"line {number}: the metadata before it have no {error.args[0]}") from error
            except ValueError as error:
                raise ValueError(f"line {number}: {error}") from error
            if len(positions[-1]) != 3:
                raise ValueError(f"line {number}: expected a time and at least three numbers, got {line.strip()!r}")
    name = _chosen(satellite, sorted(set(names)))
    frames = sorted({(center, frame) for who, center, frame in kinds if who == name})
    if len(frames) != 1:
        raise ValueError(f"expected segments of {name} in one frame, got {frames}; split the file")
    center, frame = frames[0]
    axes = "ITRF" if frame.startswith(("ITRF", "WGS")) else _AXES.get(frame)
    if center.upper() != "EARTH" or axes is None:
        wanted = f"{', '.join(_AXES)} or ITRF"
        raise ValueError(
            f"expected the centre EARTH and the frame {wanted}, got {center} and {frame}; convert the file"
        )
    mine = [k for k, who in enumerate(names) if who == name]
    return _arc(name, "CCSDS OEM", axes, [times[k] for k in mine], [positions[k] for k in mine])


def _read_eof(text: str, satellite: str | None) -> Arc:
    root = ET.fromstring(text)
    frame, name = root.findtext(".//Ref_Frame"), root.findtext(".//Mission")
    if frame != "EARTH_FIXED":
        raise ValueError(f"Ref_Frame: expected EARTH_FIXED, got {frame}")
    times: list[int] = []
    positions: list[list[float]] = []
    degraded = 0
    for number, item in enumerate(root.iter("OSV"), 1):
        if (item.findtext("Quality") or "NOMINAL").strip() != "NOMINAL":
            degraded += 1
            continue
        try:
            tai = (item.findtext("TAI") or "").partition("=")[2]
            r = [float(item.findtext(key) or "nan") for key in "XYZ"]
            if not math.isfinite(sum(r)):
                raise ValueError("X, Y or Z is missing")
            times.append(epoch(tai, "tai"))
        except ValueError as error:
            raise ValueError(f"state vector {number}: {error}") from error
        positions.append(r)
    name = _chosen(satellite, [name or "satellite"])
    return _arc(name, "Sentinel EOF", "ITRF", times, positions, degraded)
