"""The detectors compared on real pairs, as a page: ``python -m benchmarks.features``.

Two kinds of pairs: photos of the space station 12 s apart, and each photo with the map rendered into its view (another
year, another sensor, half a kilometre a pixel). Where a feature of the one belongs in the other is known from the poses
that the main scenario finds and from the terrain; what is left of their error is taken out by one robust affine map for
each pair. The places are therefore not those of the detectors under test.
"""

from __future__ import annotations

import argparse
import contextlib
import platform
import sys
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from fsw.files import atomic
from fsw.math.camera import lens_vector, project
from messages.base import F64
from modules.opnav.features import DETECTORS, Features, detect, mutual_matches
from modules.opnav.landmark_finder import View, render_view
from sim.camera.photo_player import read_image
from sim.scenarios.iss_photos.inputs import Inputs, read_inputs
from sim.scenarios.iss_photos.options import parse
from sim.scenarios.iss_photos.results import Fix, collect
from sim.scenarios.iss_photos.run import locate

PAGE = Path(__file__).parents[1] / "docs" / "features.md"
LIMIT = 2000
"""Most features of an image; all detectors find more in these photos."""
RATIO = 0.85
NEAR_PX, AGREE_PX, REACH_PX = 2.0, 3.0, 12.0
"""A feature is repeated within the first distance, a match is right within the second; the third bounds pose errors."""
SIZES = 1.6
"""Largest ratio of the sizes of a feature found twice."""
CV: Any = cv2
Where = Callable[[F64], F64]
Grey = NDArray[np.uint8]


class Pair(NamedTuple):
    """Two images and where a pixel of the first lies in the second (NaN where it does not)."""

    first: Grey
    second: Grey
    where: Where
    mask: NDArray[np.bool_] | None


class Score(NamedTuple):
    """What a detector did on one pair."""

    features: float
    repeatability: float
    matches: float
    inliers: float
    sigma_px: float
    milliseconds: float


def _poses() -> tuple[Inputs, F64, list[Fix]]:
    """The main scenario's inputs, calibrated lens and poses."""

    @contextlib.contextmanager
    def silent(name: str, total: int) -> Generator[Callable[[], None]]:
        del name, total
        yield lambda: None

    inputs = read_inputs(parse([]))
    results = collect(inputs, locate(inputs, silent))
    return inputs, lens_vector(results.camera), [fix for fix in results.fixes if fix.valid]


def _pairs() -> dict[str, list[Pair]]:
    """All pairs of both kinds."""
    inputs, lens, fixes = _poses()
    photos = [CV.cvtColor(np.array(read_image(fix.path)), cv2.COLOR_RGB2GRAY) for fix in fixes]
    views: list[View] = []
    for fix, photo in zip(fixes, photos, strict=True):
        assert fix.r_CE_E is not None and fix.dcm_CE is not None
        views.append(render_view(inputs.geo_map, lens, photo.shape[:2], fix.r_CE_E, fix.dcm_CE))

    def next_photo(k: int) -> Where:
        r_CE_E, dcm_CE = fixes[k + 1].r_CE_E, fixes[k + 1].dcm_CE
        assert r_CE_E is not None and dcm_CE is not None

        def where(pixel: F64) -> F64:
            out = np.empty((len(pixel), 2))
            project(lens, np.ascontiguousarray((views[k].ground(pixel) - r_CE_E) @ dcm_CE.T), out)
            return out

        return where

    def same(pixel: F64) -> F64:
        return pixel.copy()

    return {
        "photo and photo, 12 s apart": [
            Pair(photos[k], photos[k + 1], next_photo(k), None) for k in range(len(photos) - 1)
        ],
        "photo and map": [Pair(p, v.image, same, v.mask) for p, v in zip(photos, views, strict=True)],
    }


def _corrected(expected: F64, seen: F64) -> F64:
    """An affine map (3, 2) from expected to seen places (n, 2), by those that agree with most others."""
    shift = np.median(seen - expected, axis=0)
    near = np.linalg.norm(seen - expected - shift, axis=1) < REACH_PX
    full = np.column_stack([expected, np.ones(len(expected))])
    fit = np.vstack([np.eye(2), shift])
    for threshold in (REACH_PX, 6.0, AGREE_PX, AGREE_PX):
        near = np.linalg.norm(full @ fit - seen, axis=1) < threshold
        if near.sum() < 6:
            break
        fit = np.asarray(np.linalg.lstsq(full[near], seen[near], rcond=None)[0], np.float64)
    return fit


def score(name: str, pair: Pair) -> Score:
    """A detector on a pair."""
    detect(name, pair.first[:200, :200], limit=10)
    begin = time.perf_counter()
    a = detect(name, pair.first, limit=LIMIT)
    spent = 1e3 * (time.perf_counter() - begin)
    b = detect(name, pair.second, pair.mask, limit=LIMIT)
    expected = pair.where(a.place_px)
    rows, columns = pair.second.shape
    inside: NDArray[np.bool_] = np.all((expected > 10.0) & (expected < [columns - 11.0, rows - 11.0]), axis=1)
    if pair.mask is not None:
        at = np.rint(np.where(inside[:, None], expected, 0.0)).astype(np.int64)
        inside &= pair.mask[at[:, 1], at[:, 0]]
    a, expected = a.pick(inside), expected[inside]
    matches = mutual_matches(a.words, b.words, RATIO)
    error = b.place_px[matches[:, 1]] - expected[matches[:, 0]]
    wanted = np.linalg.norm(error, axis=1) < 2.0 * REACH_PX
    if wanted.sum() < 6:
        return Score(len(a.place_px), np.nan, len(matches), np.nan, np.nan, spent)
    fit = _corrected(expected[matches[wanted, 0]], b.place_px[matches[wanted, 1]])
    moved = np.column_stack([expected, np.ones(len(expected))]) @ fit
    error = b.place_px[matches[:, 1]] - moved[matches[:, 0]]
    right = np.linalg.norm(error, axis=1) < AGREE_PX
    # a match has the errors of both places; the deviation is robust, for the threshold cuts the tails
    sigma = 1.4826 * float(np.median(np.abs(error[right]))) / np.sqrt(2.0)
    return Score(len(a.place_px), _repeated(a, moved, b), len(matches), float(right.mean()), sigma, spent)


def _repeated(a: Features, moved: F64, b: Features) -> float:
    """Share of features that are found again, where they belong and about as large (Mikolajczyk et al. 2005)."""
    found = 0
    for place, size in zip(moved, a.size_px, strict=True):
        near = np.linalg.norm(b.place_px - place, axis=1) < NEAR_PX
        ratio = b.size_px[near] / size
        found += bool(np.any((ratio < SIZES) & (ratio > 1.0 / SIZES)))
    return found / max(len(moved), 1)


def page(scores: dict[str, dict[str, list[Score]]]) -> str:
    """The page in Markdown."""
    lines = [
        "# Detectors compared",
        "",
        "Made by `python -m benchmarks.features`; not to be edited. Means over pairs of ten real photos from the",
        "space station, and of the map rendered into their views; how the right places are known is said at the",
        f"head of that program. At most {LIMIT} features an image, mutual matches with a ratio below {RATIO}.",
        "",
        f"*Repeatability*: found again within {NEAR_PX:g} px and of similar size. *Inliers*: matches within",
        f"{AGREE_PX:g} px of the right place. *Sigma*: of one place and coordinate, robust; where few matches are",
        "right, it is that of chance.",
        f"*Time*: the least, for an image of 1296 x 972 pixels ({platform.machine()}, two cores).",
        "",
    ]
    for kind, rows in scores.items():
        count = len(next(iter(rows.values())))
        lines += [f"## {kind[0].upper()}{kind[1:]} ({count} pairs)", ""]
        lines += ["| detector | features | repeatability | matches | inliers | sigma (px) | time (ms) |"]
        lines += ["|---|---|---|---|---|---|---|"]
        for name, all_scores in rows.items():
            mean = Score(*(float(np.nanmean(column)) for column in zip(*all_scores, strict=True)))
            least = min(one.milliseconds for one in all_scores)
            lines.append(
                f"| {name.upper()} | {mean.features:.0f} | {100 * mean.repeatability:.0f} % | {mean.matches:.0f} | "
                f"{100 * mean.inliers:.0f} % | {mean.sigma_px:.2f} | {least:.0f} |"
            )
        lines.append("")
    if "akaze" not in DETECTORS:
        lines += ["AKAZE is not in the build of OpenCV that made this page.", ""]
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> int:
    """Compare and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.features",
        description="Compare the detectors of features on real pairs of images and write a page.",
    )
    parser.add_argument("-o", "--output", type=Path, default=PAGE, metavar="FILE", help="default: docs/features.md")
    given = parser.parse_args(arguments)
    scores = {
        kind: {name: [score(name, pair) for pair in pairs] for name in DETECTORS} for kind, pairs in _pairs().items()
    }
    text = page(scores)
    with atomic(given.output) as file:
        file.write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
