"""The scenario as a program."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fsw import minutes
from fsw.files import atomic
from messages.opnav import OpNavLimbMsg, OpNavMsg
from sim.camera.disk_camera import DiskTruth
from sim.scenarios.mars_disk.graph import PERIOD_S, MarsDisk, build

ACROSS = 4
"""Pictures in a row of the sheet."""
MOST = 16
"""Pictures on the sheet."""
WAYS = "horizon", "circle"


@dataclass(frozen=True)
class Picture:
    """An image, its time, what is truly in it, and what was found."""

    t_ns: int
    image: NDArray[np.uint8]
    truth: DiskTruth
    limb: OpNavLimbMsg
    horizon: OpNavMsg
    circle: OpNavMsg

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"mars_{round(self.t_ns / 60e9):05d}_min.png"

    def found(self, way: str) -> Found | None:
        """Error and sigma of a way, "horizon" or "circle"; None if it gave no position."""
        message: OpNavMsg = getattr(self, way)
        if not message.valid:
            return None
        distance = float(np.linalg.norm(self.truth.r_PC_C))
        sight = self.truth.r_PC_C / distance
        error = -message.r_CP_C - self.truth.r_PC_C
        along = float(error @ sight)
        variance = float(sight @ message.P_rr_C @ sight)
        total = float(np.trace(message.P_rr_C))
        return Found(
            along,
            float(np.linalg.norm(error - along * sight)),
            float(np.sqrt(variance)),
            float(np.sqrt(max(total - variance, 0.0))),
        )


class Found(NamedTuple):
    """Error of a position and its stated sigma, along the line of sight (longer: positive) and across it [m]."""

    range: float
    across: float
    sigma_range: float
    sigma_across: float


def take(scenario: MarsDisk, count: int, every_ns: int) -> list[Picture]:
    """Run, and keep every picture with its truth and what was found; ``every_ns`` from one to the next."""
    taken: list[Picture] = []
    for k in range(count):
        scenario.sim.run_until(k * every_ns)
        message, limb = scenario.camera.out_image.latest(), scenario.limb_finder.out_limb.latest()
        horizon, circle = scenario.horizon.out_position.latest(), scenario.converter.out_position.latest()
        if message is None or limb is None or horizon is None or circle is None:
            raise RuntimeError("mars_disk: the camera took no picture; check its connections")
        (exact,) = scenario.camera.truths()
        taken.append(Picture(message.exposure_ns, message.image, exact, limb, horizon, circle))
    return taken


def table(pictures: list[Picture]) -> list[str]:
    """Lines for people: errors of the position, each with its stated sigma."""
    lines = [
        "                                      limb: error (sigma) [km]            circle: error (sigma) [km]",
        "time [h]  phase [deg]  range [km]       range           across             range           across",
    ]
    for p in pictures:
        line = f"{p.t_ns / 3600e9:8.2f} {np.degrees(p.truth.phase):12.1f} {np.linalg.norm(p.truth.r_PC_C) / 1e3:11.0f} "
        for way in WAYS:
            found = p.found(way)
            if found is None:
                line += f"   {'no position, status ' + str(getattr(p, way).status):30s}"
                continue
            km = [x / 1e3 for x in found]
            line += f" {km[0]:8.2f} ({km[2]:6.2f}) {km[1]:6.2f} ({km[3]:5.2f})  "
        lines.append(line.rstrip())
    for way in WAYS:
        known = [f for f in (p.found(way) for p in pictures) if f is not None]
        name = {"horizon": "limb", "circle": "circle"}[way]
        if known:
            rms = [float(np.sqrt(np.mean([f[k] ** 2 for f in known]))) / 1e3 for k in range(2)]
            inside = np.mean([abs(f.range) < 3 * f.sigma_range and f.across < 3 * f.sigma_across for f in known])
            lines.append(
                f"{name}: {len(known)} of {len(pictures)} pictures, rms {rms[0]:.2f} km along and {rms[1]:.2f} km "
                f"across the line of sight, {100 * inside:.0f} % within 3 sigma"
            )
        else:
            lines.append(f"{name}: no position in any of {len(pictures)} pictures")
    return lines


def save_errors(pictures: list[Picture], path: Path) -> None:
    """Errors and three sigma, against time and against phase."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 2, sharex="col", sharey="row")
    for column, (label, where) in enumerate(
        (
            ("time (h)", [p.t_ns / 3600e9 for p in pictures]),
            ("phase (deg)", [float(np.degrees(p.truth.phase)) for p in pictures]),
        )
    ):
        for row, name in enumerate(("range", "across")):
            axes = panels[row, column]
            for way, colour in zip(WAYS, ("C0", "C1"), strict=True):
                points = [(x, f) for x, p in zip(where, pictures, strict=True) if (f := p.found(way)) is not None]
                points.sort(key=lambda point: point[0])
                x = [point[0] for point in points]
                error = [abs(getattr(f, name)) / 1e3 for _, f in points]
                bound = [3.0 * getattr(f, f"sigma_{name}") / 1e3 for _, f in points]
                what = {"horizon": "limb", "circle": "circle"}[way]
                axes.plot(x, error, "o", color=colour, markersize=4, label=f"{what}, error")
                axes.plot(x, bound, "--", color=colour, linewidth=0.9, label=f"{what}, 3 sigma")
            axes.set_yscale("log")
            axes.grid(alpha=0.3)
            if column == 0:
                axes.set_ylabel(f"{'along' if name == 'range' else 'across'} the line of sight (km)")
            if row == 1:
                axes.set_xlabel(label)
    panels[0, 0].legend(fontsize=8)
    figure.suptitle("Position relative to Mars from single images: size of the error, and three times its sigma")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save_sheet(pictures: list[Picture], path: Path) -> None:
    """Pictures on one sheet, each with the exact limb, the points found and the direction of the Sun."""
    from matplotlib.figure import Figure

    down = -(-len(pictures) // ACROSS)
    figure = Figure(figsize=(3.2 * ACROSS, 3.4 * down), layout="constrained")
    for k, p in enumerate(pictures):
        axes = figure.add_subplot(down, ACROSS, k + 1)
        axes.imshow(p.image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        axes.plot(*np.vstack([p.truth.limb_px, p.truth.limb_px[:1]]).T, color="C1", linewidth=0.5)
        found = p.limb.limb_px[: p.limb.count : 8]
        axes.plot(found[:, 0], found[:, 1], ".", color="C2", markersize=2.5)
        x, y = p.truth.center_px
        reach = 1.15 * p.truth.ellipse.semi_major_px * p.truth.sun_px
        axes.annotate("", (x + reach[0], y + reach[1]), (x, y), arrowprops={"arrowstyle": "->", "color": "C0"})
        axes.set_title(f"{p.t_ns / 3600e9:.1f} h, phase {np.degrees(p.truth.phase):.0f} deg", fontsize=9)
        axes.set(xlim=(-0.5, p.image.shape[1] - 0.5), ylim=(p.image.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    figure.suptitle("Mars: exact limb (orange), every eighth point of the limb found (green), towards the Sun (blue)")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save(pictures: list[Picture], folder: Path) -> None:
    """Every picture as PNG, a sheet of some of them, and a plot of the errors.

    Raises:
        OSError: if a file cannot be written.
    """
    for p in pictures:
        with atomic(folder / p.name) as temporary:
            Image.fromarray(p.image).save(temporary, format="PNG")
    every = max(1, -(-len(pictures) // MOST))
    save_sheet(pictures[::every], folder / "sheet.png")
    save_errors(pictures, folder / "errors.png")


def main(arguments: list[str] | None = None) -> int:
    """Run the scenario; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.mars_disk",
        description="Pictures of Mars along one orbit (semi-major axis 18,000 km, eccentricity 0.2), and the "
        "position that each gives: by its limb (LimbFinder, HorizonNav) and by its circle "
        "(CircleFinder, PixelLineConverter). There is no filter and "
        "the attitude is known. Prints errors against the truth with their sigma.",
        epilog="exit codes: 0 done, 1 files could not be written, 2 bad arguments",
    )
    default = Path("out") / "mars_disk"
    parser.add_argument(
        "--out", type=Path, default=default, metavar="DIR", help=f"folder for pictures and plots (default {default})"
    )
    parser.add_argument("--pictures", type=int, default=12, help="how many, evenly over one orbit (default 12)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the detector's noise (default 1)")
    given = parser.parse_args(arguments)
    if not 1 <= given.pictures <= 1000:
        parser.error(f"--pictures: expected a number between 1 and 1000, got {given.pictures}")
    try:
        given.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        parser.error(f"--out: cannot make the folder {given.out} ({error.strerror}); choose another")
    every_ns = minutes(max(1, round(PERIOD_S / 60.0 / given.pictures)))
    pictures = take(build(seed=given.seed, picture_ns=every_ns), given.pictures, every_ns)
    sys.stdout.write("\n".join(table(pictures)) + "\n")
    try:
        save(pictures, given.out)
    except OSError as error:
        sys.stderr.write(f"cannot save pictures in {given.out}: {error.strerror}; choose another folder with --out\n")
        return 1
    sys.stdout.write(f"saved {len(pictures)} pictures, sheet.png and errors.png in {given.out}\n")
    return 0
