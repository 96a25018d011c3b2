"""What limbs and circles in rendered images are worth, as a page: ``python -m benchmarks.limb_navigation``."""

from __future__ import annotations

import argparse
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

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
    known_range: float
    """Bound with the light of the limb known."""
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


def _split(v: F64, P: F64, sight: F64) -> tuple[float, float, float]:
    """Component along the line of sight, one across it (rms), and the normalised square error."""
    along = float(v @ sight)
    return along, float(np.sqrt(max(float(v @ v) - along**2, 0.0) / 2.0)), float(v @ np.linalg.solve(P, v))


def measure(case: Case, runs: int, seed: int = 1, circle: bool = True) -> Row:
    """Run a case with new places, attitudes and noise each time."""
    rng = np.random.default_rng(seed)
    taken: list[tuple[float, ...]] = []
    circles: list[tuple[float, ...]] = []
    bounds: list[tuple[float, ...]] = []
    for k in range(runs):
        given = case if case.law != "any" else case._replace(law=LAWS[k % 2])
        scene = Scene(given, rng)
        sight = scene.r_PC_C / scene.range
        if k < len(LAWS):  # it differs little between places
            unknown, known = (np.linalg.inv(f) for f in scene.information())
            along = float(sight @ unknown @ sight)
            bounds.append((along, (float(np.trace(unknown)) - along) / 2.0, float(sight @ known @ sight)))
        image = scene.picture(scene.radiance(), 1000 * seed + k)
        chain = Chain(scene, "limb")
        answer = chain.look(image)
        if answer.valid:
            errors = scene.errors(chain.points())
            parts = _split(-answer.r_CP_C - scene.r_PC_C, answer.P_rr_C, sight)
            taken.append((*parts, float(errors.mean()), float(errors.std())))
        if circle and (answer := Chain(scene, "circle").look(image)).valid:
            circles.append(_split(-answer.r_CP_C - scene.r_PC_C, answer.P_rr_C, sight))
    bound = np.sqrt(np.mean(bounds, axis=0))
    limb, round_ = np.array(taken or [[np.nan] * 5]), np.array(circles or [[np.nan] * 3])

    def rms(values: F64) -> float:
        return float(np.sqrt(np.mean(values**2)))

    return Row(
        case,
        runs,
        len(taken),
        rms(limb[:, 1]),
        rms(limb[:, 0]),
        float(bound[1]),
        float(bound[0]),
        float(bound[2]),
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
image's derivative taken by rendering it anew. Sky, and a step, an arch and a slope of light behind the limb are unknown
in each of 24 sectors, for no one knows a limb's light beforehand. *Known*: the same with the light known. *Ratio*: root
mean square error over bound, good to {{spread:.0%}}. *NEES*: normalised square error, mean; 3 is expected, and
less is cautious.
*Bias*, *scatter*: of the points found, from the exact limb, positive outside. *Circle*: CircleFinder and
PixelLineConverter on the same images.

| radius (px) | phase, off axis, arc (deg) | light | found | across (km) | ratio | range (km) | ratio | to known |
NEES | bias, scatter (px) | circle: across, range (km) | NEES |
"""
TAIL = """
## Why some rows stay above the bound

- The profile is a model of the light in the last pixels before the limb. What it gets wrong is common to many points
  and does not average out: some thousandths of a pixel on large disks with Lambert's and Lommel-Seeliger's laws,
  hundredths on small ones and near the horns. Minnaert's law with an exponent below 1 grows without limit at the limb,
  and so does Lommel-Seeliger's at full phase seen from nearby: a rim narrower than the blur looks like a limb 0.03 to
  0.05 px further out. No image tells the difference.
- So LimbFinder states 0.03 px as common to all points (`common_px`), and 0.008 px for each sector. Where noise is small
  the position's covariance consists of these, and the ratio to the bound of the noise says little.
- Disks below 40 px of radius, and thin crescents, are measured with the simple profile: the full one has too
  few pixels.
"""


def page(rows: list[Row]) -> str:
    """The page in Markdown."""
    head = HEAD.format(spread=1.0 / np.sqrt(2.0 * rows[0].runs)).replace("to known |\nNEES", "to known | NEES")
    lines = [head + "|---" * 13 + "|"]
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
            f"{r.range / r.known_range:.1f}",
            f"{r.nees:.1f}",
            f"{r.bias_px:+.3f}, {r.sigma_px:.3f}",
            f"{r.circle_across / 1e3:.3g}, {r.circle_range / 1e3:.3g}",
            f"{r.circle_nees:.1f}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    ratios = np.array([r.ratio for r in rows])
    across, along = (int(k) for k in (ratios <= 1.3).sum(axis=0))
    lines.append(f"\nWithin 1.3 of the bound: {across} of {len(rows)} rows across, {along} along the line of sight.")
    return "\n".join(lines) + "\n" + TAIL


def _one(job: tuple[Case, int]) -> Row:
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
    given = parser.parse_args(arguments)
    if given.runs < 1:
        parser.error(f"--runs: expected at least 1, got {given.runs}")
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = list(pool.map(_one, [(case, given.runs) for case in CASES]))
    text = page(rows)
    with atomic(given.output) as file:
        file.write_text(text, encoding="utf-8")
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
