"""Disk finders against Basilisk's and plain OpenCV on the same images: ``python -m benchmarks --only vision``.

Times are the least of some repeats, of the process's processor time: OpenCV and both frameworks run in one thread.
Basilisk's finders read a PNG, so OpenCV's decoding of the same file is timed too and subtracted.
"""

from __future__ import annotations

import csv
import importlib
import importlib.util
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from rich.table import Table
from scipy.spatial.transform import Rotation

from benchmarks.limb_scene import Case, Chain, Scene
from fsw.files import atomic
from messages.base import F64
from modules.opnav.center_of_brightness.kernel import FOUND, centre_of_light
from modules.opnav.disks import find_disks

CV: Any = cv2
CASSINI = Path(__file__).parents[1] / "sim" / "data" / "cassini_limb"
CASES = (
    Case(80.0, 0.0),
    Case(80.0, 60.0, 4.0),
    Case(200.0, 30.0),
    Case(200.0, 90.0, 1.0),
    Case(200.0, 120.0),
    Case(400.0, 30.0),
    Case(400.0, 90.0, 3.0),
)
SIDES = {80.0: 512, 200.0: 512, 400.0: 1024}
PAGE = Path(__file__).parents[1] / "docs" / "vision_disks.md"
WAYS = (
    ("CircleFinder", "Basilisk houghCircles", "OpenCV HoughCircles"),
    ("LimbFinder", "Basilisk limbFinding", "OpenCV Canny"),
)
"""What does the same kind of thing: ours first."""


HEAD = """# Disk finders measured

Made by `python -m benchmarks --only vision`; not to be edited. {machine}. Time of a frame, least of some
repeats, of the process's processor time, in one thread; Basilisk's without the decoding of the PNG that it reads.
Errors of centre and radius against the rendered truth, or the nominal place of Cassini's moons, which is good to some
0.3 px; `-` where nothing was found. An error of several pixels is mostly a terminator taken for a limb.
For limbs they are those of the ellipse that OpenCV fits to the points of the first disk.
The centre of brightness is no centre of the disk: the difference is what a phase does.
Position: size of its error to the distance.
"""


class Frame(NamedTuple):
    """An image, and where its disk is."""

    name: str
    image: Any
    center: F64
    """(2,) of the limb's ellipse [px]."""
    radius: float
    scene: Scene | None


class Result(NamedTuple):
    """What a way made of a frame; NaN where it makes nothing of the kind."""

    milliseconds: float
    center_px: float = math.nan
    radius_px: float = math.nan
    position: float = math.nan
    """Size of the position's error to the distance."""


def frames() -> list[Frame]:
    """The rendered ones on a square, and Cassini's."""
    made: list[Frame] = []
    rng = np.random.default_rng(5)
    for case in CASES:
        scene = Scene(case._replace(law="lommel_seeliger", full_well=10000.0, side_px=SIDES[case.radius_px]), rng)
        limb = scene.truth.ellipse
        radius = math.sqrt(limb.semi_major_px * limb.semi_minor_px)
        name = f"Mars {case.radius_px:.0f} px, phase {case.phase_deg:.0f}, {SIDES[case.radius_px]} px"
        made.append(Frame(name, scene.picture(scene.radiance(), 1), limb.center_px, radius, scene))
    with (CASSINI / "truth.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            image = CV.imread(str(CASSINI / row["image"]), cv2.IMREAD_GRAYSCALE)
            center = np.array([float(row["cx"]), float(row["cy"])])
            made.append(Frame(f"Cassini {row['image'][:11]}", image, center, float(row["r_overlay_px"]), None))
    return made


def least(run: Callable[[], object], repeats: int) -> float:
    """Processor time of a run [ms], the least of some."""
    run()
    spent: list[float] = []
    for _ in range(repeats):
        begin = time.process_time()
        run()
        spent.append(1e3 * (time.process_time() - begin))
    return min(spent)


def _off(frame: Frame, center: F64, radius: float) -> tuple[float, float]:
    return float(np.linalg.norm(center - frame.center)), abs(radius - frame.radius)


def ours(frame: Frame, repeats: int) -> dict[str, Result]:
    """Finders, and the positions of their answers."""
    light = centre_of_light(frame.image, 15.0, 5, 4.0, 0.05)
    spent = least(lambda: centre_of_light(frame.image, 15.0, 5, 4.0, 0.05), repeats)
    off = float(np.linalg.norm(light.center_px - frame.center)) if light.status == FOUND else math.nan
    made = {"CenterOfBrightness": Result(spent, off)}
    if frame.scene is None:  # both modules do the same here
        spent = least(lambda: find_disks(frame.image), repeats)
        _, disks = find_disks(frame.image)
        off = _off(frame, np.array(disks[0].ellipse[:2]), disks[0].ellipse.radius) if disks else ()
        made["CircleFinder"] = made["LimbFinder"] = Result(spent, *off)
        return made
    for kind in ("circle", "limb"):
        chain = Chain(frame.scene, kind)
        answer = chain.look(frame.image)
        find = least(lambda chain=chain: chain.find(frame.image), repeats)
        turn = least(lambda chain=chain: chain.convert(), repeats)
        error = float(np.linalg.norm(-answer.r_CP_C - frame.scene.r_PC_C)) / frame.scene.range
        off = (math.nan, math.nan)
        if kind == "circle" and (circle := chain.circle()) is not None:
            off = _off(frame, circle[:2], float(circle[2]))
        elif kind == "limb" and len(chain.points()):
            off = _round(frame, chain.points())
        made["CircleFinder" if kind == "circle" else "LimbFinder"] = Result(find, *off)
        name = "HorizonNav" if kind == "limb" else "PixelLineConverter"
        made[name] = Result(turn, position=error if answer.valid else math.nan)
    return made


def _round(frame: Frame, points: F64) -> tuple[float, float]:
    """Errors of the ellipse that OpenCV fits to points of a limb."""
    if len(points) < 6:
        return math.nan, math.nan
    (x, y), (a, b), _ = CV.fitEllipseDirect(points.astype(np.float32))
    return _off(frame, np.array([x, y]), 0.5 * math.sqrt(a * b))


def opencv(frame: Frame, repeats: int) -> dict[str, Result]:
    """OpenCV as one uses it first."""

    def hough() -> Any:
        smooth = CV.GaussianBlur(frame.image, (5, 5), 1.0)
        return CV.HoughCircles(smooth, cv2.HOUGH_GRADIENT, 1, 50, param1=200, param2=20)

    def canny() -> Any:
        return np.argwhere(CV.Canny(CV.GaussianBlur(frame.image, (3, 3), 1.0), 100, 200))[:, ::-1].astype(float)

    circles, points = hough(), canny()
    found = () if circles is None else _off(frame, circles[0, 0, :2].astype(float), float(circles[0, 0, 2]))
    return {
        "OpenCV HoughCircles": Result(least(hough, repeats), *found),
        "OpenCV Canny": Result(least(canny, repeats), *_round(frame, points)),
    }


def basilisk(frame: Frame, repeats: int, folder: Path) -> dict[str, Result]:
    """Basilisk's finders and converters."""
    path = folder / "frame.png"
    CV.imwrite(str(path), frame.image)
    names = "houghCircles", "limbFinding", "horizonOpNav", "pixelLineConverter"
    hough, limb, horizon, line = (importlib.import_module(f"Basilisk.fswAlgorithms.{n}") for n in names)
    messaging: Any = importlib.import_module("Basilisk.architecture.messaging")
    finders = {"houghCircles": hough.HoughCircles(), "limbFinding": limb.LimbFinding()}
    source = messaging.CameraImageMsg()
    source.write(messaging.CameraImageMsgPayload(), 0)
    for finder in finders.values():
        finder.filename = str(path)
        finder.imageInMsg.subscribeTo(source)
        finder.Reset(0)
    decode = least(lambda: CV.imread(str(path)), repeats)  # as they do, to three channels
    made: dict[str, Result] = {}
    spent = {n: least(lambda f=f: f.UpdateState(0), repeats) - decode for n, f in finders.items()}
    circles, points = finders["houghCircles"].opnavCirclesOutMsg.read(), finders["limbFinding"].opnavLimbOutMsg.read()
    off = (math.nan, math.nan)
    if circles.valid:
        off = _off(frame, np.array(circles.circlesCenters[:2]), float(circles.circlesRadii[0]))
    made["Basilisk houghCircles"] = Result(spent["houghCircles"], *off)
    edge = np.array(points.limbPoints[: 2 * points.numLimbPoints]).reshape(-1, 2)
    made["Basilisk limbFinding"] = Result(spent["limbFinding"], *_round(frame, edge))
    scene = frame.scene
    if scene is None:
        return made
    payload, state = messaging.CameraConfigMsgPayload(), messaging.NavAttMsgPayload()
    rows, columns = frame.image.shape
    payload.fieldOfView = 2.0 * math.atan(0.5 * columns / scene.focal)
    payload.resolution, payload.sigma_CB, payload.cameraID = [columns, rows], [0.0, 0.0, 0.0], 1
    # N is fixed to Mars, for theirs takes the pole along the third axis of N
    sigma = Rotation.from_matrix(scene.dcm_CP).inv().as_mrp()
    state.sigma_BN = sigma.tolist()
    camera, attitude = messaging.CameraConfigMsg().write(payload), messaging.NavAttMsg().write(state)
    converters = {"horizonOpNav": horizon.horizonOpNav(), "pixelLineConverter": line.pixelLineConverter()}
    converters["horizonOpNav"].limbInMsg.subscribeTo(finders["limbFinding"].opnavLimbOutMsg)
    converters["horizonOpNav"].noiseSF, converters["horizonOpNav"].planetTarget = 1.0, 2
    converters["pixelLineConverter"].circlesInMsg.subscribeTo(finders["houghCircles"].opnavCirclesOutMsg)
    for name, module in converters.items():
        module.cameraConfigInMsg.subscribeTo(camera)
        module.attInMsg.subscribeTo(attitude)
        module.SelfInit()
        module.Reset(0)
        turn = least(lambda m=module: m.UpdateState(0), repeats)
        said = module.opNavOutMsg.read()
        error = float(np.linalg.norm(-np.array(said.r_BN_C) - scene.r_PC_C)) / scene.range
        made[f"Basilisk {name}"] = Result(turn, position=error if said.valid else math.nan)
    return made


def table(rows: list[tuple[str, dict[str, Result]]]) -> Table:
    """For people."""
    made = Table(title="Disks: time of a frame and errors")
    for k, column in enumerate(("image", "way", "ms", "centre (px)", "radius (px)", "position (%)")):
        made.add_column(column, justify="left" if k < 2 else "right")
    for name, results in rows:
        for k, (way, r) in enumerate(results.items()):
            cells = [f"{r.milliseconds:.2f}"]
            cells += ["-" if math.isnan(x) else f"{x:.2f}" for x in (r.center_px, r.radius_px, 100.0 * r.position)]
            made.add_row(name if k == 0 else "", way, *cells)
        made.add_section()
    return made


def measure(repeats: int, *, basilisk_too: bool) -> list[tuple[str, dict[str, Result]]]:
    """Every way on every frame."""
    CV.setNumThreads(1)
    rows: list[tuple[str, dict[str, Result]]] = []
    with tempfile.TemporaryDirectory() as folder:
        for frame in frames():
            results = ours(frame, repeats) | opencv(frame, repeats)
            if basilisk_too:
                results |= basilisk(frame, repeats, Path(folder))
            rows.append((frame.name, results))
    return rows


def installed() -> bool:
    """Whether Basilisk's vision modules are there (they are a package of their own)."""
    if importlib.util.find_spec("Basilisk") is None:
        return False
    return importlib.util.find_spec("Basilisk.fswAlgorithms.houghCircles") is not None


def page(rows: list[tuple[str, dict[str, Result]]], machine: str) -> str:
    """The page in Markdown."""

    def number(value: float) -> str:
        return "-" if math.isnan(value) else f"{value:.2f}"

    lines = [HEAD.format(machine=machine)]
    for ways in WAYS:
        lines += ["| | " + " | ".join(f"{way} | | " for way in ways) + "|"]
        lines += [
            "|---" * (1 + 3 * len(ways)) + "|",
            "| image" + " | ms | centre (px) | radius (px)" * len(ways) + " |",
        ]
        for name, results in rows:
            cells = [results.get(way, Result(math.nan)) for way in ways]
            numbers = [number(x) for r in cells for x in (r.milliseconds, r.center_px, r.radius_px)]
            lines.append(f"| {name} | " + " | ".join(numbers) + " |")
        lines.append("")
    lines += ["| image | CenterOfBrightness (ms) | from the disk's centre (px) |", "|---|---|---|"]
    for name, results in rows:
        r = results["CenterOfBrightness"]
        lines.append(f"| {name} | {number(r.milliseconds)} | {number(r.center_px)} |")
    named = "HorizonNav", "PixelLineConverter", "Basilisk horizonOpNav", "Basilisk pixelLineConverter"
    lines += ["", "| image" + "".join(f" | {n} (%)" for n in named) + " |", "|---" * (1 + len(named)) + "|"]
    for name, results in rows:
        if "HorizonNav" in results:
            errors = (number(100.0 * results[n].position) if n in results else "-" for n in named)
            lines.append(f"| {name} | " + " | ".join(errors) + " |")
    return "\n".join(lines) + "\n"


def write(rows: list[tuple[str, dict[str, Result]]], machine: str) -> None:
    """Write the page."""
    with atomic(PAGE) as file:
        file.write_text(page(rows, machine), encoding="utf-8")
