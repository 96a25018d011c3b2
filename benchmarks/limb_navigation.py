"""What limbs and circles in rendered images are worth, as a page: ``python -m benchmarks.limb_navigation``."""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from benchmarks.limb_bound import information
from benchmarks.limb_scene import DETECTOR, PSF_PX, Case, Chain, Scene
from fsw.files import atomic
from messages.base import F64

PAGE = Path(__file__).parents[1] / "docs" / "limb_navigation.md"
LAWS = "lambert", "lommel_seeliger"
"""The law alternates from run to run: a flight program does not know it."""
CASES = (
    *(Case(20.0, phase, off) for phase, off in ((0.0, 0.0), (60.0, 20.0), (90.0, 10.0), (120.0, 0.0))),
    *(Case(60.0, phase, off) for phase, off in ((0.0, 10.0), (30.0, 0.0), (60.0, 20.0), (90.0, 10.0), (120.0, 10.0))),
    *(Case(200.0, phase, off) for phase, off in ((0.0, 10.0), (60.0, 20.0), (120.0, 10.0))),
    *(Case(200.0, 30.0, 10.0, arc) for arc in (60.0, 120.0, 180.0)),
    Case(800.0, 60.0, 20.0, 90.0),
    Case(200.0, 60.0, 10.0, law="minnaert"),
    Case(200.0, 60.0, 10.0, contrast=0.18),
    Case(200.0, 60.0, 10.0, full_well=40000.0),
)


class Row(NamedTuple):
    """What came of some runs of a case; lengths in m, root mean squares over the runs."""

    case: Case
    runs: int
    valid: int
    across: float
    """Error across the line of sight, of one of its two components."""
    range: float
    bound_across: float
    bound_range: float
    known: tuple[float, float]
    """Bound with the light of the limb known, across and along."""
    free: tuple[float, float]
    """Bound with the light of each sector of the limb free."""
    edges: tuple[float, float]
    """The closed form of independent edges: the points found, independent and with the scatter that they have."""
    nees: float
    bias_px: float
    """Mean of the points' distance from the exact limb."""
    sigma_px: float
    """Scatter of the points about that."""
    circle_across: float
    circle_range: float
    circle_nees: float
    circle_valid: int

    @property
    def ratio(self) -> tuple[float, float]:
        """Error over bound, across and along."""
        return self.across / self.bound_across, self.range / self.bound_range

    def over(self, bound: tuple[float, float]) -> str:
        """Error over another bound, in words."""
        return f"{self.across / bound[0]:.2f}, {self.range / bound[1]:.2f}"


def _split(v: F64, P: F64, sight: F64) -> tuple[float, float, float]:
    """Component along the line of sight, one across it (rms), and the normalised square error."""
    along = float(v @ sight)
    return along, float(np.sqrt(max(float(v @ v) - along**2, 0.0) / 2.0)), float(v @ np.linalg.solve(P, v))


def _variances(P: F64, sight: F64) -> tuple[float, float]:
    """Of a covariance: that of a component across the line of sight (mean of both), and that along it."""
    along = float(sight @ P @ sight)
    return (float(np.trace(P)) - along) / 2.0, along


def measure(case: Case, runs: int, seed: int = 1, circle: bool = True, bounds_of: int = 4) -> Row:
    """Run a case with new places, attitudes and noise each time; the bound is the mean of the first ``bounds_of``."""
    rng = np.random.default_rng(seed)
    taken: list[tuple[float, ...]] = []
    circles: list[tuple[float, ...]] = []
    bounds: list[F64] = []
    edges: list[tuple[float, float]] = []
    for k in range(runs):
        given = case if case.law != "any" else case._replace(law=LAWS[k % 2])
        scene = Scene(given, rng)
        sight = scene.r_PC_C / scene.range
        if k < bounds_of:  # it differs little between places
            bounds.append(
                np.array([_variances(np.asarray(np.linalg.inv(f), np.float64), sight) for f in information(scene)])
            )
        image = scene.picture(scene.radiance(), 1000 * seed + k)
        chain = Chain(scene, "limb")
        answer = chain.look(image)
        if answer.valid:
            points = chain.points()
            errors, H = scene.errors(points), scene.edges(points)
            edges.append(_variances(np.linalg.inv(H.T @ H) * errors.var(), sight))
            parts = _split(-answer.r_CP_C - scene.r_PC_C, answer.P_rr_C, sight)
            taken.append((*parts, float(errors.mean()), float(errors.std())))
        if circle and (answer := Chain(scene, "circle").look(image)).valid:
            circles.append(_split(-answer.r_CP_C - scene.r_PC_C, answer.P_rr_C, sight))
    law, free, known = (tuple(b) for b in np.sqrt(np.mean(bounds, axis=0)).tolist())
    b2: list[float] = np.sqrt(np.mean(edges or [(np.nan, np.nan)], axis=0)).tolist()
    limb, round_ = np.array(taken or [[np.nan] * 5]), np.array(circles or [[np.nan] * 3])

    def rms(values: F64) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return Row(
        case,
        runs,
        len(taken),
        rms(limb[:, 1]),
        rms(limb[:, 0]),
        law[0],
        law[1],
        (known[0], known[1]),
        (free[0], free[1]),
        (b2[0], b2[1]),
        float(np.mean(limb[:, 2])),
        float(np.mean(limb[:, 3])),
        float(np.mean(limb[:, 4])),
        rms(round_[:, 1]),
        rms(round_[:, 0]),
        float(np.mean(round_[:, 2])),
        len(circles),
    )


HEAD = f"""# Limb navigation measured

Made by `python -m benchmarks.limb_navigation`; not to be edited. Mars is rendered at random places, attitudes and
azimuths of the Sun, blurred by {PSF_PX:g} px before the pixels sum the light up, with shot noise,
{DETECTOR.read_noise:g} electrons of read noise and eight bits. A full well holds 1000 electrons unless the row says
otherwise: an edge is then good to some 0.1 px for each pixel along it. The law of reflection
alternates between Lambert's and Lommel-Seeliger's.

*Bound*: Cramer-Rao, from the pixels within 6 px of the lit limb up to 82 degrees from the Sun's azimuth, with the
image's derivative taken by rendering it anew; what the detector cuts off at its zero and its top is lost. Unknown is
what a flight program cannot know: the sky's level, the brightness of the surface in each of 24 sectors of the limb, the
blur, and the mixture of Lambert's law and Lommel-Seeliger's by which it reflects (with Minnaert's where the row says
so). The angles of incidence and emission are known: they follow from the outline, the camera and the Sun's direction.
The bound takes no texture for unknown beyond its 24 sectors, so no program can reach it in the row with texture.
*Ratio*: root mean square error over bound, good to {{spread:.0%}} (one sigma). *Known*: error over the bound with the
light of every pixel known, across and along the line of sight; *free*: with a step, an arch and a slope of light free
in each sector. *Edges*: over the closed form of independent edges, with the points found, independent and with the
scatter they have:
it knows of nothing common to all points, which at full phase the laws and the blur are. *NEES*: normalised square error
of the position, mean; 3 is expected, and the 95 % band of the mean is {{low:.2f}} to {{high:.2f}}. *Bias*, *scatter*:
of the points found, from the exact limb, positive outside. *Circle*: CircleFinder and PixelLineConverter on the same
images.

| radius (px) | phase, off axis, arc (deg) | light | found | across (km) | ratio | range (km) | ratio | NEES |
known | free | edges | bias, scatter (px) | circle: across, range (km) | NEES |
"""
TAIL = """
## How it is done, and what is left

- With camera, attitude and Sun, LimbFinder fits one model of the light to all pixels near the limb: laws of reflection
  blurred by the point-spread function, with the unknowns above free and random factors and shifts for each cell of the
  limb. What the points have in common comes from that fit's covariance, as `modes_px`. Priors of the shares of the
  laws, of the blur's tails and of the brightness are set by hand.
- A body that reflects by another law than these (a limb darkened by a polynomial, seen head on) is measured up to
  0.7 px wrong, and what is stated is then too small.
- Lommel-Seeliger's limb is brighter than the detector's top here. Such pixels are left out by what the model expects.
  On the largest disk all that is left of that limb is its flank; the errors there are above what is stated.
- Texture is a random change of brightness along the limb and inward, with variances from the pixels.
- Without the Sun's direction the profile is free in each sector, and 0.03 px are stated as common to all points.
"""


def page(rows: list[Row]) -> str:
    """The page in Markdown."""
    runs = rows[0].runs
    low, high = (float(chi2.ppf(q, 3 * runs)) / runs for q in (0.025, 0.975))
    head = HEAD.format(spread=1.0 / np.sqrt(2.0 * runs), low=low, high=high)
    head = head.replace("NEES |\nknown", "NEES | known")
    lines = [head + "|---" * 15 + "|"]
    for r in rows:
        c, (across, along) = r.case, r.ratio
        light = {"any": "two laws", "minnaert": "Minnaert 0.75"}.get(c.law, c.law)
        light += ", texture" if c.contrast else ""
        light += f", well {c.full_well:.0f}" if c.full_well != 1000.0 else ""
        cells = (
            f"{c.radius_px:.0f}",
            f"{c.phase_deg:.0f}, {c.off_axis_deg:.0f}, {c.arc_deg:.0f}",
            light,
            f"{r.valid}/{r.runs}",
            f"{r.across / 1e3:.3g}",
            f"{across:.2f}",
            f"{r.range / 1e3:.3g}",
            f"{along:.2f}",
            f"{r.nees:.1f}",
            r.over(r.known),
            r.over(r.free),
            r.over(r.edges),
            f"{r.bias_px:+.3f}, {r.sigma_px:.3f}",
            f"{r.circle_across / 1e3:.3g}, {r.circle_range / 1e3:.3g}",
            f"{r.circle_nees:.1f}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    ratios = np.array([r.ratio for r in rows])
    across, along = (int(k) for k in (ratios <= 1.3).sum(axis=0))
    lines.append(f"\nWithin 1.3 of the bound: {across} of {len(rows)} rows across, {along} along the line of sight.")
    within = sum(low <= r.nees <= high for r in rows)
    lines.append(f"NEES inside the band: {within} of {len(rows)}.")
    return "\n".join(lines) + "\n" + TAIL


def _one(job: tuple[Case, int, int]) -> Row:
    return measure(*job)


def main(arguments: list[str] | None = None) -> int:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.limb_navigation",
        description="Measure positions from rendered limbs against the bound of the information in them; write a page.",
    )
    parser.add_argument("--runs", type=int, default=20, help="runs of each case (default 20)")
    parser.add_argument(
        "-o", "--output", type=Path, default=PAGE, metavar="FILE", help="default: docs/limb_navigation.md"
    )
    parser.add_argument("--seed", type=int, default=1, help="of places, attitudes and noise (default 1)")
    given = parser.parse_args(arguments)
    if given.runs < 1:
        parser.error(f"--runs: expected at least 1, got {given.runs}")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(_one, [(case, given.runs, given.seed) for case in CASES]))
    text = page(rows)
    with atomic(given.output) as file:
        file.write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
