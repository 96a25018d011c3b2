"""Result files: all of them appear, or none."""

from __future__ import annotations

import contextlib
import csv
import io
import os
import shutil
import tempfile
from collections.abc import Generator, Sequence
from datetime import datetime, timedelta
from pathlib import Path

from sim.scenarios.iss_photos.camera_file import BadInputError
from sim.scenarios.iss_photos.results import Fix
from sim.scenarios.iss_photos.track import Track

COLUMNS = (
    "file",
    "utc",
    "r_ecef_x_m",
    "r_ecef_y_m",
    "r_ecef_z_m",
    "sigma_pos_m",
    "inliers",
    "valid",
    "q_CO_0",
    "q_CO_1",
    "q_CO_2",
    "q_CO_3",
    "reason",
)
TRACK_COLUMNS = (
    "utc",
    *(f"r_ecef_{k}_m" for k in "xyz"),
    *(f"sigma_{k}_m" for k in ("radial", "along", "cross")),
    *(f"minus_orbit_{k}_m" for k in ("radial", "along", "cross")),
    "photos_used",
)


def _refusal(out: Path, error: OSError) -> BadInputError:
    reason = error.strerror or str(error)
    return BadInputError(
        f"results cannot be written to {out}: {reason}; nothing was changed there, choose another --out"
    )


def _move_in(made: Path, out: Path) -> None:
    """Put new files and folders in the place of old ones of the same name."""
    if not out.exists():
        made.rename(out)
        return
    old = Path(tempfile.mkdtemp(prefix=".old-", dir=made.parent))
    try:
        for entry in sorted(made.iterdir()):
            place = out / entry.name
            if place.is_dir():
                place.rename(old / entry.name)
            entry.replace(place)
    finally:
        shutil.rmtree(old, ignore_errors=True)


@contextlib.contextmanager
def output_folder(out: Path) -> Generator[Path]:
    """A folder to write into, whose contents are moved to ``out`` at the end if nothing went wrong.

    Raises:
        BadInputError: if ``out`` cannot be written, when entering or when the disk is full; then ``out`` is as it was.
    """
    out = Path(out).absolute()
    try:
        if out.exists() and not out.is_dir():
            raise NotADirectoryError(0, "it is a file, not a folder")
        if out.is_dir() and not os.access(out, os.W_OK | os.X_OK):
            raise PermissionError(0, "no permission to write there")
        out.parent.mkdir(parents=True, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    except OSError as error:
        raise _refusal(out, error) from error
    try:
        made.chmod(0o755)
        yield made
        _move_in(made, out)
    except OSError as error:
        raise _refusal(out, error) from error
    finally:
        shutil.rmtree(made, ignore_errors=True)


def utc_text(utc: datetime | None) -> str:
    """A time as 2023-05-05T03:28:50.567Z, or nothing."""
    return "" if utc is None else utc.strftime("%Y-%m-%dT%H:%M:%S.") + f"{utc.microsecond // 1000:03d}Z"


def fixes_csv(fixes: Sequence[Fix]) -> str:
    """The table of fixes; a photo without a valid fix has a row with valid = 0, a reason, and no numbers."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for fix in fixes:
        r, sigma, q = fix.r_CE_E, fix.sigma_pos_m, fix.beta_CO
        position = [""] * 3 if r is None else [f"{x:.1f}" for x in r]
        attitude = [""] * 4 if q is None else [f"{x:.8f}" for x in q]
        writer.writerow(
            [
                fix.path.name,
                utc_text(fix.utc),
                *position,
                "" if sigma is None else f"{sigma:.1f}",
                fix.inliers,
                int(fix.valid),
                *attitude,
                fix.reason,
            ]
        )
    return text.getvalue()


def track_csv(track: Track, epoch: datetime) -> str:
    """The filter's positions, second by second, with standard deviations and the difference from the orbit."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(TRACK_COLUMNS)
    for point in track.points:
        numbers = [*point.r_BE_E, *point.sigma_H, *point.error_H]
        utc = utc_text(epoch + timedelta(seconds=point.t_s))
        writer.writerow([utc, *[f"{x:.1f}" for x in numbers], point.images])
    return text.getvalue()
