"""The scenario as a program."""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from fsw import minutes
from fsw.files import atomic
from sim.camera.disk_camera import DiskTruth
from sim.scenarios.mars_disk.graph import PERIOD_S, MarsDisk, build

ACROSS = 4
"""Pictures in a row of the sheet."""


@dataclass(frozen=True)
class Picture:
    """An image, its time and what is truly in it."""

    t_ns: int
    image: NDArray[np.uint8]
    truth: DiskTruth

    @property
    def name(self) -> str:
        """Name of its file."""
        return f"mars_{round(self.t_ns / 60e9):05d}_min.png"


def take(scenario: MarsDisk, count: int, every_ns: int) -> list[Picture]:
    """Run, and keep every picture with its truth; ``every_ns`` from one to the next."""
    taken: list[Picture] = []
    for k in range(count):
        scenario.sim.run_until(k * every_ns)
        message = scenario.camera.out_image.latest()
        if message is None:
            raise RuntimeError("mars_disk: the camera took no picture; check its connections")
        (exact,) = scenario.camera.truths()
        taken.append(Picture(message.exposure_ns, message.image, exact))
    return taken


def table(pictures: list[Picture]) -> list[str]:
    """Lines for people."""
    lines = ["  time [h]  phase [deg]  range [km]  centre of Mars [px]  semi-axes of the limb [px]"]
    for p in pictures:
        x, y = p.truth.center_px
        limb = p.truth.ellipse
        lines.append(
            f"{p.t_ns / 3600e9:10.2f} {np.degrees(p.truth.phase):12.1f} {np.linalg.norm(p.truth.r_PC_C) / 1e3:11.0f} "
            f"{x:12.2f} {y:7.2f} {limb.semi_major_px:17.2f} {limb.semi_minor_px:9.2f}"
        )
    return lines


def save_sheet(pictures: list[Picture], path: Path) -> None:
    """All pictures on one sheet, each with the exact limb, the planet's centre and the direction of the Sun."""
    from matplotlib.figure import Figure

    down = -(-len(pictures) // ACROSS)
    figure = Figure(figsize=(3.2 * ACROSS, 3.4 * down), layout="constrained")
    for k, p in enumerate(pictures):
        axes = figure.add_subplot(down, ACROSS, k + 1)
        axes.imshow(p.image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
        axes.plot(*np.vstack([p.truth.limb_px, p.truth.limb_px[:1]]).T, color="C1", linewidth=0.5)
        x, y = p.truth.center_px
        reach = 1.15 * p.truth.ellipse.semi_major_px * p.truth.sun_px
        axes.annotate("", (x + reach[0], y + reach[1]), (x, y), arrowprops={"arrowstyle": "->", "color": "C0"})
        axes.set_title(f"{p.t_ns / 3600e9:.1f} h, phase {np.degrees(p.truth.phase):.0f} deg", fontsize=9)
        axes.set(xlim=(-0.5, p.image.shape[1] - 0.5), ylim=(p.image.shape[0] - 0.5, -0.5), xticks=[], yticks=[])
    figure.suptitle("Mars: exact limb (orange), towards the Sun (blue)")
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=110)


def save(pictures: list[Picture], folder: Path) -> None:
    """Every picture as PNG, and the sheet.

    Raises:
        OSError: if a file cannot be written.
    """
    for p in pictures:
        with atomic(folder / p.name) as temporary:
            Image.fromarray(p.image).save(temporary, format="PNG")
    save_sheet(pictures, folder / "sheet.png")


def main(arguments: list[str] | None = None) -> int:
    """Run the scenario; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.mars_disk",
        description="Pictures of Mars along one orbit (semi-major axis 18,000 km, eccentricity 0.2), at many phases.",
    )
    default = Path("out") / "mars_disk"
    parser.add_argument(
        "--out", type=Path, default=default, metavar="DIR", help=f"folder for the pictures (default {default})"
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
    sys.stdout.write(f"saved {len(pictures)} pictures and sheet.png in {given.out}\n")
    return 0
