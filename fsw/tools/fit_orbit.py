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
from fsw.math.epoch import DAY, calendar, epoch
from fsw.math.harmonics import MAX_DEGREE, GravityField, read_icgem
from fsw.math.kepler import rv_to_elements
from fsw.tools.orbit_files import Arc, read_orbit
from fsw.tools.orbit_fit import Fit, Surfaces, fit_orbit, inertial
from fsw.tools.orbit_flight import flight_params

_ANGLES = ("inclination", "right_ascension_of_node", "argument_of_periapsis", "true_anomaly")
FAR = 20.0
"""A residual of so many times the median is no noise."""
EXAMPLE = "fit-orbit orbit.EOF --light -o out/fit"


def add_arguments(made: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    made.description = (
        "Find the orbit of the Earth that passes the positions in a file most closely\n"
        "(least squares), under gravity, Sun and Moon, and drag or sunlight if asked for.\n"
        "Writes NAME.json (state and elements at the first position, covariance,\n"
        "coefficient, residuals) and NAME.png (residuals over time)."
    )
    made.add_argument("file", type=Path, metavar="FILE", help="positions: SP3, CCSDS OEM (text) or Sentinel EOF")
    made.add_argument("--satellite", metavar="ID", help="which one, if the file has several, such as L51")
    made.add_argument(
        "--arc", nargs=2, metavar=("START", "STOP"), help="part to fit, UTC, such as 2023-07-03T12:00:00; default: all"
    )
    made.add_argument(
        "--degree", type=int, default=MAX_DEGREE, metavar="N", help=f"of gravity, 2 to {MAX_DEGREE} (the default)"
    )
    made.add_argument("--gravity", type=Path, metavar="GFC", help="gravity field in ICGEM format; default: EGM2008")
    force = made.add_mutually_exclusive_group()
    force.add_argument(
        "--drag", action="store_true", help="fit a coefficient of drag too: below 700 km or so, over hours"
    )
    force.add_argument(
        "--light", action="store_true", help="fit a coefficient of the pressure of sunlight too: higher up"
    )
    turn = made.add_mutually_exclusive_group()
    turn.add_argument(
        "--eop",
        type=Path,
        metavar="FILE",
        help="Earth orientation: a file of the IERS, finals2000A or EOP C04; default: the shipped one",
    )
    turn.add_argument(
        "--ut1-utc",
        type=float,
        metavar="S",
        help="instead of such a file: UT1 - UTC in seconds, the pole fixed (errors of 18 m)",
    )
    made.add_argument(
        "-o", "--output", type=Path, default=Path("orbit_fit"), metavar="NAME", help="writes NAME.json and NAME.png"
    )


def shipped(folder: str) -> list[Path]:
    """Data files that come with the simulation, in a folder of its data, small ones first."""
    path = Path(str(importlib.resources.files("sim"))) / "data" / folder
    found = [p for p in path.glob("*") if p.suffix in (".gfc", ".txt")] if path.is_dir() else []
    return sorted(found, key=lambda p: p.stat().st_size)


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
            found.require(end)
        return _around(found, *ends)
    for path in shipped("earth_orientation"):
        found = read_parameters(path)
        if found.epoch_ns[0] <= ends[0] and ends[1] <= found.epoch_ns[-1]:
            return _around(found, *ends)
    first, last = (calendar(t, decimals=0) for t in ends)
    raise ValueError(
        f"no Earth orientation data for {first} to {last}: give a finals2000A or EOP C04 file of the IERS with --eop, "
        "or a UT1 - UTC with --ut1-utc"
    )


def _around(eop: EarthParameters, first: int, last: int) -> EarthParameters:
    """Without the days that are more than eight from an arc: splines through decades take long."""
    near = [k for k, t in enumerate(eop.epoch_ns) if first - 8 * DAY <= t <= last + 8 * DAY]
    return EarthParameters(eop.source, eop.epoch_ns[near[0] : near[-1] + 1], eop.values[near[0] : near[-1] + 1])


def report(fit: Fit, eop: EarthParameters, field: GravityField) -> dict[str, Any]:
    """The fitted orbit and how good it is, for JSON."""
    elements = plain(rv_to_elements)(tuple(fit.r_N.tolist()), tuple(fit.v_N.tolist()), field.mu)
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
        "covariance_r_v": fit.covariance[:6, :6].tolist(),
        "osculating_elements": {
            "semi_major_axis_m": elements[0],
            "eccentricity": elements[1],
            **{f"{name}_deg": float(np.degrees(x)) for name, x in zip(_ANGLES, elements[2:], strict=True)},
        },
        "forces": {
            "gravity": field.name,
            "degree": field.degree,
            "mu_m3_s2": field.mu,
            "third_bodies": ["Sun", "Moon"],
            "surface": fit.surface,
        },
        "earth_orientation": eop.source,
        "arc": {
            "format": fit.arc.format,
            "axes": fit.arc.axes,
            "positions": len(fit.arc.epoch_ns),
            "left_out": fit.arc.left_out,
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

    figure = Figure(figsize=(9, 4.5), layout="constrained")
    axes = figure.subplots()
    rms = np.sqrt(np.mean(fit.residuals**2, axis=0))
    for name, value, column in zip(("radial", "along track", "across"), rms, fit.residuals.T, strict=True):
        axes.plot(
            fit.arc.seconds / 3600.0, column, ".-", markersize=2, linewidth=0.8, label=f"{name}\nRMS {value:.3g} m"
        )
    start = calendar(fit.epoch_ns, decimals=0)
    axes.set(xlabel=f"time since {start} [h]", ylabel="measured minus fitted position [m]")
    forces = {"none": "", "drag": " and drag", "light": " and sunlight"}[fit.surface]
    axes.set_title(f"{fit.arc.name}: residuals of an orbit with gravity{forces}, {fit.rms:.3g} m RMS")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, markerscale=4)
    axes.grid(visible=True, alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=100, format="png")


def outliers(fit: Fit) -> list[str]:
    """A line that warns of positions that fit far worse than the others: damaged, or before or after a manoeuvre."""
    distance = np.linalg.norm(fit.residuals, axis=1)
    worst = int(np.argmax(distance))
    typical = float(np.median(distance))
    if distance[worst] <= FAR * max(typical, 1.0):
        return []
    when = calendar(int(fit.arc.epoch_ns[worst]), decimals=0)
    text = f"warning: the position at {when} is {distance[worst]:.0f} m off, half of them are within {typical:.1f} m"
    return [f"{text}; correct the file, or fit a part of it with --arc"]


def run(args: argparse.Namespace) -> int:
    """Fit an orbit and write it; returns the exit code."""
    arc = read_orbit(args.file, args.satellite)
    if args.arc is not None:
        arc = arc.cut(*(epoch(text) for text in args.arc))
    fields = [args.gravity] if args.gravity is not None else shipped("gravity")
    if not fields:
        raise ValueError("there is no shipped gravity field here; give one in ICGEM format with --gravity")
    field = read_icgem(fields[0], args.degree, int(arc.epoch_ns[0]))
    eop = earth_parameters(arc, args.eop, args.ut1_utc)
    surface: Surfaces = "drag" if args.drag else "light" if args.light else "none"
    height = float(np.linalg.norm(arc.r, axis=1).mean()) - 6371e3
    params = flight_params(int(arc.epoch_ns[0]), float(arc.seconds[-1]), height, eop, field)
    fit = fit_orbit(arc, params, inertial(arc, eop), surface)
    made = report(fit, eop, field)
    target: Path = args.output
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic(target.with_name(f"{target.name}.json")) as temporary:
        temporary.write_text(json.dumps(made, indent=2) + "\n", encoding="utf-8")
    plot(fit, target.with_name(f"{target.name}.png"))
    radial, along, across = made["residuals"]["rms_radial_along_across_m"]
    axis, shape, tilt = list(made["osculating_elements"].values())[:3]
    without = f", {arc.left_out} missing or bad ones left out" if arc.left_out else ""
    span = f"{arc.seconds[-1] / 3600.0:.2f} h ({arc.format}, {arc.axes})"
    orbit = f"semi-major axis {axis / 1e3:.3f} km, eccentricity {shape:.6f}, inclination {tilt:.4f} deg"
    lines = [
        f"{arc.name}: {len(arc.epoch_ns)} positions over {span}{without}",
        f"orbit at {calendar(fit.epoch_ns, decimals=3)}: {orbit}",
        f"residuals {fit.rms:.3f} m RMS: radial {radial:.3f}, along track {along:.3f}, across {across:.3f} m",
    ]
    if fit.surface != "none":
        lines.append(f"{surface} coefficient times area by mass {fit.coefficient:.5g} +- {fit.sigma[6]:.2g} m^2/kg")
    lines += outliers(fit)
    lines.append(f"wrote {target}.json, {target}.png")
    print(*lines, sep="\n")  # noqa: T201 - a command prints
    return 0
