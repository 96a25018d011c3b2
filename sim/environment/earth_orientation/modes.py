"""Parameters of EarthOrientation for its three modes."""

from __future__ import annotations

from fsw.math.earth_orientation import OMEGA_EARTH, EarthParameters, orientation_table
from sim.environment.earth_orientation.module import ALIGNED, EARTH_ROTATION, IAU_2006, EarthOrientation


def aligned(rate: float = OMEGA_EARTH) -> EarthOrientation.Params:
    """E and N coincide at simulation time zero, and E turns about z: for tests and for the seeds' scenarios.

    Args:
        rate: rad/s.
    """
    return EarthOrientation.Params(mode=ALIGNED, epoch_tai_ns=0, rate=rate)


def earth_rotation(epoch_ns: int, parameters: EarthParameters) -> EarthOrientation.Params:
    """E turns about z of N by the Earth rotation angle: no precession, nutation or polar motion.

    Args:
        epoch_ns: epoch of simulation time zero, as `fsw.math.epoch.epoch` makes it.
        parameters: of an IERS file or assumed (`fsw.math.earth_orientation`); UT1 - TAI at the epoch is kept.

    Raises:
        ValueError: if the parameters do not cover the epoch.
    """
    ut1_minus_tai = float(parameters.at(epoch_ns)[0])
    return EarthOrientation.Params(mode=EARTH_ROTATION, epoch_tai_ns=epoch_ns, ut1_minus_tai=ut1_minus_tai)


def iau2006(epoch_ns: int, duration_ns: int, parameters: EarthParameters) -> EarthOrientation.Params:
    """N is GCRF and E is ITRF, by IAU 2006/2000A.

    Args:
        epoch_ns: epoch of simulation time zero, as `fsw.math.epoch.epoch` makes it.
        duration_ns: how long the simulation may run, up to 399 days.
        parameters: of an IERS file or assumed (`fsw.math.earth_orientation`).

    Raises:
        ValueError: if the parameters do not cover the time, or it is too long.
    """
    start, rows, table = orientation_table(epoch_ns, duration_ns, parameters)
    return EarthOrientation.Params(
        mode=IAU_2006, epoch_tai_ns=epoch_ns, table_start_ns=start, table_rows=rows, table=table
    )
