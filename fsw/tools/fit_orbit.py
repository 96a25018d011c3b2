"""``fsw fit-orbit``: an orbit from a file of positions, as a state, elements and a picture of the residuals."""

from __future__ import annotations

import argparse
import importlib.resources
import json
from pathlib import Path
from typing import Any

import numpy as np

from fsw.files import atomic
from fsw.math.compiled import plain
from fsw.math.earth_orientation import EarthParameters, assumed_parameters, read_parameters
from fsw.math.epoch import calendar, epoch
from fsw.math.harmonics import MAX_DEGREE, read_icgem
from fsw.math.kepler import rv_to_elements
from fsw.tools.orbit_files import Arc, read_orbit
from fsw.tools.orbit_fit import Fit, Surfaces, fit_orbit, inertial
from fsw.tools.orbit_flight import flight_params

_ANGLES = ("inclination", "right_ascension_of_node", "argument_of_periapsis", "true_anomaly")
EXAMPLE = "fit-orbit orbit.EOF --light -o out/fit"


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    made.add_argument("file", type=Path, metavar="FILE", help="positions: SP3, CCSDS OEM (text) or Sentinel EOF")
    made.add_argument("--satellite", metavar="ID", help="which one of an SP3 file, such as L51")
    made.add_argument(
        "--arc", nargs=2, metavar=("START", "STOP"), help="UTC, such as 2023-07-03T12:00:00; default: the whole file"
    )
    made.add_argument("--degree", type=int, default=MAX_DEGREE, help=f"of gravity, 2 to {MAX_DEGREE} (the default)")
    made.add_argument("--gravity", type=Path, metavar="GFC", help="gravity field in ICGEM format; default: EGM2008")
    force = made.add_mutually_exclusive_group()
    force.add_argument("--drag", action="store_true", help="fit a drag coefficient too (exponential atmosphere)")
    force.add_argument("--light", action="store_true", help="fit a coefficient of the pressure of sunlight too")
    turn = made.add_mutually_exclusive_group()
    turn.add_argument("--eop", type=Path, metavar="FILE", help="Earth orientation: finals2000A or EOP C04 of the IERS")
    turn.add_argument(
        "--ut1-utc", type=float, metavar="S", help="without such a file: UT1 - UTC in seconds, the pole fixed (18 m)"
    )
    made.add_argument(
        "-o", "--output", type=Path, default=Path("orbit_fit"), metavar="NAME", help="writes NAME.json and NAME.png"
    )


def shipped(folder: str) -> list[Path]:
    """Data files that come with the simulation, in a folder of its data."""
    path = Path(str(importlib.resources.files("sim"))) / "data" / folder
    return sorted(p for p in path.glob("*") if p.suffix in (".gfc", ".txt")) if path.is_dir() else []


def earth_parameters(arc: Arc, file: Path | None, ut1_utc: float | None) -> EarthParameters:
    """Orientation of the Earth for an arc: of a file, assumed, or of the shipped file that covers it.

    Raises:
        ValueError: if nothing covers the arc.
    """
    ends = int(arc.epoch_ns[0]), int(arc.epoch_ns[-1])
    if ut1_utc is not None:
        return assumed_parameters(ends[0], ut1_utc)
    if file is not None:
        found = read_parameters(file)
        for end in ends:
            found.at(end)
        return found
    for path in shipped("earth_orientation"):
        found = read_parameters(path)
        if found.epoch_ns[0] <= ends[0] and ends[1] <= found.epoch_ns[-1]:
            return found
    first, last = (calendar(t, decimals=0) for t in ends)
    raise ValueError(
        f"no Earth orientation data for {first} to {last}: give a finals2000A or EOP C04 file of the IERS with --eop, "
        "or a UT1 - UTC with --ut1-utc"
    )


def report(fit: Fit, eop: EarthParameters, gravity: str, degree: int) -> dict[str, Any]:
    """The fitted orbit and how good it is, for JSON."""
    elements = plain(rv_to_elements)(tuple(fit.r_N.tolist()), tuple(fit.v_N.tolist()), 3.986004415e14)
    rms = np.sqrt(np.mean(fit.residuals**2, axis=0))
    made: dict[str, Any] = {
        "satellite": fit.arc.name,
        "epoch_utc": calendar(fit.epoch_ns, decimals=9),
        "epoch_tai_ns": fit.epoch_ns,
        "frame": "GCRF",
        "r_N_m": fit.r_N.tolist(),
        "v_N_m_s": fit.v_N.tolist(),
        "sigma_r_m": fit.sigma[:3].tolist(),
        "sigma_v_m_s": fit.sigma[3:6].tolist(),
        "osculating_elements": {
            "semi_major_axis_m": elements[0],
            "eccentricity": elements[1],
            **{f"{name}_deg": float(np.degrees(x)) for name, x in zip(_ANGLES, elements[2:], strict=True)},
        },
        "forces": {"gravity": gravity, "degree": degree, "third_bodies": ["Sun", "Moon"], "surface": fit.surface},
        "earth_orientation": eop.source,
        "arc": {
            "format": fit.arc.format,
            "axes": fit.arc.axes,
            "positions": len(fit.arc.epoch_ns),
            "hours": float(fit.arc.seconds[-1] / 3600.0),
        },
        "residuals": {
            "rms_m": fit.rms,
            "rms_radial_along_across_m": rms.tolist(),
            "largest_m": float(np.linalg.norm(fit.residuals, axis=1).max()),
            "iterations": fit.iterations,
        },
    }
    if fit.surface != "none":
        made["coefficient_times_area_by_mass_m2_kg"] = fit.coefficient
        made["sigma_coefficient_m2_kg"] = float(fit.sigma[6])
    return made


def plot(fit: Fit, path: Path) -> None:
    """Save a picture of the residuals over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    rms = np.sqrt(np.mean(fit.residuals**2, axis=0))
    for name, value, column in zip(("radial", "along track", "across"), rms, fit.residuals.T, strict=True):
        axes.plot(fit.arc.seconds / 3600.0, column, label=f"{name}, RMS {value:.3g} m")
    start = calendar(fit.epoch_ns, decimals=0)
    axes.set(xlabel=f"time since {start} [h]", ylabel="measured minus fitted [m]")
    axes.set_title(f"{fit.arc.name}: {fit.rms:.3g} m RMS")
    axes.legend()
    axes.grid(visible=True, alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=120)


def run(args: argparse.Namespace) -> int:
    """Fit an orbit and write it; returns the exit code."""
    arc = read_orbit(args.file, args.satellite)
    if args.arc is not None:
        arc = arc.cut(*(epoch(text) for text in args.arc))
    fields = [args.gravity] if args.gravity is not None else shipped("gravity")
    if not fields:
        raise ValueError("there is no shipped gravity field here; give one in ICGEM format with --gravity")
    field = read_icgem(fields[0], args.degree)
    eop = earth_parameters(arc, args.eop, args.ut1_utc)
    surface: Surfaces = "drag" if args.drag else "light" if args.light else "none"
    height = float(np.linalg.norm(arc.r, axis=1).mean()) - 6371e3
    params = flight_params(int(arc.epoch_ns[0]), float(arc.seconds[-1]), height, eop, field)
    fit = fit_orbit(arc, params, inertial(arc, eop), surface)
    made = report(fit, eop, field.name, field.degree)
    target: Path = args.output
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic(target.with_name(f"{target.name}.json")) as temporary:
        temporary.write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
    plot(fit, target.with_name(f"{target.name}.png"))
    radial, along, across = made["residuals"]["rms_radial_along_across_m"]
    lines = [
        f"{arc.name}: {len(arc.epoch_ns)} positions over {arc.seconds[-1] / 3600.0:.2f} h ({arc.format}, {arc.axes})",
        f"residuals {fit.rms:.3f} m RMS: radial {radial:.3f}, along track {along:.3f}, across {across:.3f} m",
    ]
    if fit.surface != "none":
        lines.append(f"{surface} coefficient times area by mass {fit.coefficient:.5g} +- {fit.sigma[6]:.2g} m^2/kg")
    lines.append(f"wrote {target}.json, {target}.png")
    print(*lines, sep="\n")  # noqa: T201 - a command prints
    return 0
