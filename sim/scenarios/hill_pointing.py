"""Hill pointing: a tumbling spacecraft in low orbit finds and holds the attitude of the Hill frame.

Truth (orbit with J2, rigid body, gyro, star tracker, navigation solution) and flight software (attitude read-out,
guidance, feedback law) close the loop through a commanded torque. Run ``python -m sim.scenarios.hill_pointing --help``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fsw import Recording, Simulation, Task, minutes, ms, s
from fsw.files import atomic
from fsw.math.compiled import plain
from fsw.math.gravity import MU_EARTH
from fsw.math.kepler import elements_to_rv
from messages.attitude import AttGuidMsg
from messages.base import F64
from modules.control.mrp_feedback import MrpFeedback
from modules.estimation.attitude_readout import AttitudeReadout
from modules.guidance.att_tracking_error import AttTrackingError
from modules.guidance.hill_point import HillPoint
from sim.dynamics.spacecraft import Spacecraft
from sim.sensors.gyro import Gyro
from sim.sensors.simple_nav import SimpleNav
from sim.sensors.star_tracker import StarTracker

INERTIA_B = np.diag([900.0, 800.0, 600.0])
"""Inertia of the spacecraft, kg m^2."""


@dataclass(frozen=True)
class HillPointing:
    """The simulation and its modules."""

    sim: Simulation
    spacecraft: Spacecraft
    gyro: Gyro
    star_tracker: StarTracker
    simple_nav: SimpleNav
    readout: AttitudeReadout
    hill_point: HillPoint
    tracking_error: AttTrackingError
    feedback: MrpFeedback


def build(seed: int = 1, control: bool = True, period_ns: int = ms(100)) -> HillPointing:
    """Make the graph.

    Args:
        seed: of the sensors' noise. control: False leaves the torque unconnected, so that the body tumbles freely.
        period_ns: of both tasks, ns.

    Returns:
        The simulation at time zero with its modules, nothing recorded yet.
    """
    inclination, node, periapsis, anomaly = np.radians([33.3, 48.2, 347.8, 85.3]).tolist()
    r, v = plain(elements_to_rv)((7000e3, 0.01, inclination, node, periapsis, anomaly), MU_EARTH)
    start = Spacecraft.State(
        r_BN_N=np.array(r),
        v_BN_N=np.array(v),
        sigma_BN=np.array([0.1, 0.2, -0.3]),
        omega_BN_B=np.array([0.001, -0.01, 0.03]),
    )
    spacecraft = Spacecraft("spacecraft", Spacecraft.Params(inertia_B=INERTIA_B, mass=750.0), start)
    gyro, star_tracker = Gyro("gyro"), StarTracker("star_tracker")
    simple_nav = SimpleNav("simple_nav", SimpleNav.Params(sigma_r=10.0, sigma_v=0.01))
    readout = AttitudeReadout("readout", AttitudeReadout.Params(gain=0.05))
    hill_point, tracking_error = HillPoint("hill_point"), AttTrackingError("tracking_error")
    feedback = MrpFeedback("feedback", MrpFeedback.Params(inertia_B=INERTIA_B))

    spacecraft.out_state.connect(gyro.in_state)
    spacecraft.out_state.connect(star_tracker.in_state)
    spacecraft.out_state.connect(simple_nav.in_state)
    gyro.out_imu.connect(readout.in_imu)
    star_tracker.out_attitude.connect(readout.in_star)
    simple_nav.out_trans.connect(hill_point.in_trans)
    readout.out_att.connect(tracking_error.in_att)
    hill_point.out_ref.connect(tracking_error.in_ref)
    tracking_error.out_guid.connect(feedback.in_guid)
    if control:
        feedback.out_torque.connect(spacecraft.in_torque, delayed=True)

    truth = Task("truth", period=period_ns, modules=[spacecraft, gyro, star_tracker, simple_nav])
    flight = Task("flight", period=period_ns, modules=[readout, hill_point, tracking_error, feedback])
    sim = Simulation([truth, flight], seed=seed)
    return HillPointing(sim, spacecraft, gyro, star_tracker, simple_nav, readout, hill_point, tracking_error, feedback)


def pointing_error(guid: Recording[AttGuidMsg]) -> F64:
    """Angle between body and reference, rad, (n,), of recorded tracking errors."""
    return 4.0 * np.arctan(np.linalg.norm(guid["sigma_BR"], axis=1))


def plot(guid: Recording[AttGuidMsg], path: Path) -> None:
    """Save a picture of angle and rate error over time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    angle, rate = figure.subplots(2, 1, sharex=True)
    time_min = guid.t_s / 60.0
    angle.semilogy(time_min, np.degrees(pointing_error(guid)))
    angle.set(ylabel="pointing error [deg]", title="Hill pointing")
    for i, axis in enumerate("xyz"):
        rate.plot(time_min, np.degrees(guid["omega_BR_B"][:, i]), label=axis)
    rate.set(xlabel="time [min]", ylabel="rate error, body axes [deg/s]")
    rate.legend()
    for axes in (angle, rate):
        axes.grid(visible=True, alpha=0.3)
    with atomic(path) as temporary:
        figure.savefig(temporary, dpi=120)


def table(guid: Recording[AttGuidMsg]) -> list[tuple[float, float, float]]:
    """Time (min), angle (deg) and rate error (deg/s) at eight instants spread over a recording."""
    error, rate = pointing_error(guid), np.linalg.norm(guid["omega_BR_B"], axis=1)
    rows = np.unique(np.linspace(0, len(guid) - 1, 8).astype(int))
    return [(float(guid.t_s[k]) / 60.0, float(np.degrees(error[k])), float(np.degrees(rate[k]))) for k in rows]


def main(arguments: list[str] | None = None) -> int:
    """Run the scenario as a program; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m sim.scenarios.hill_pointing", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder for hill_pointing.png (made if missing)")
    parser.add_argument("--minutes", type=float, default=20.0, help="simulated time in minutes (default 20)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sensors' noise (default 1)")
    given = parser.parse_args(arguments)
    if not 0.1 <= given.minutes <= 1e5:
        parser.error(f"--minutes: expected a number between 0.1 and 100000, got {given.minutes:g}")
    if given.out is not None:
        try:
            given.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            parser.error(f"--out: cannot make the folder {given.out} ({error.strerror}); choose another")

    scenario = build(seed=given.seed)
    guid = scenario.tracking_error.out_guid.record(every=s(1))
    scenario.sim.run_until(minutes(given.minutes))
    out = sys.stdout.write
    out("time [min]   pointing error [deg]   rate error [deg/s]\n")
    for time_min, error_deg, rate_deg in table(guid):
        out(f"{time_min:10.2f}   {error_deg:20.4f}   {rate_deg:18.5f}\n")
    if given.out is not None:
        picture = given.out / "hill_pointing.png"
        try:
            plot(guid, picture)
        except OSError as error:
            sys.stderr.write(f"cannot save {picture}: {error.strerror}; choose another folder with --out\n")
            return 1
        out(f"saved {picture}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
