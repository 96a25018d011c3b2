"""EarthOrientation: the rotation from the inertial to the Earth-fixed frame."""

from __future__ import annotations

from typing import Annotated

from fsw import F64, Bound, KernelModule, Out, Record, Row, Shape, publish, zeros
from fsw.math.earth_orientation import OMEGA_EARTH, earth_rotation_angle, orientation, spin
from fsw.math.vectors import store3, store33
from messages.environment import PlanetOrientationMsg

ALIGNED, EARTH_ROTATION, IAU_2006 = 0, 1, 2
ERA_RATE = 7.292115146706979e-5
"""Rate of the Earth rotation angle at the nominal length of day [rad/s] (IAU 2000)."""


class EarthOrientation(KernelModule):
    """The Earth's orientation by a mode that the user chooses. See SPEC.md."""

    class Params(Record):
        """Parameters; made by `aligned`, `earth_rotation` or `iau2006`."""

        mode: Annotated[int, "-", "0 aligned at start, 1 Earth rotation angle, 2 IAU 2006/2000A", Bound(ge=0, le=2)]
        epoch_tai_ns: Annotated[int, "ns", "epoch of time zero, TAI since 2000-01-01T12:00:00; unused in mode 0"]
        rate: Annotated[float, "rad/s", "rate of the Earth in mode 0"] = OMEGA_EARTH
        ut1_minus_tai: Annotated[float, "s", "UT1 - TAI in mode 1, where 0 is refused"] = 0.0
        table_start_ns: Annotated[int, "ns", "epoch of the first row of the table in mode 2"] = 0
        table_rows: Annotated[int, "-", "rows in use of the table in mode 2", Bound(ge=0, le=800)] = 0
        table: Annotated[F64, Shape(800, 12), "-", "values and slopes of slow angles in mode 2"] = zeros(800, 12)

        def __post_init__(self) -> None:
            """Check that the mode has what it needs."""
            super().__post_init__()
            name = type(self).__qualname__
            if self.mode == EARTH_ROTATION and self.ut1_minus_tai == 0.0:
                raise ValueError(
                    f"{name}.ut1_minus_tai: expected UT1 - TAI (about -37 s), got 0; "
                    "use earth_rotation(epoch, parameters)"
                )
            if self.mode == IAU_2006 and self.table_rows < 2:
                raise ValueError(
                    f"{name}.table_rows: expected a table of 2 rows or more, got {self.table_rows}; "
                    "use iau2006(epoch, duration, parameters)"
                )

    out_orientation = Out(PlanetOrientationMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_orientation: Row) -> None:
        """Publish the orientation at ``t_ns``."""
        epoch_ns = params.epoch_tai_ns + t_ns
        if params.mode == 2:
            since = epoch_ns - params.table_start_ns
            if since < 0 or since > (params.table_rows - 1) * 43_200_000_000_000:
                raise ValueError("Params.table: expected a time that it covers; give iau2006 a longer duration")
            dcm_EN, omega = orientation(epoch_ns, params.table_start_ns, params.table_rows, params.table)
        elif params.mode == 1:
            dcm_EN, omega = spin(earth_rotation_angle(epoch_ns, params.ut1_minus_tai), ERA_RATE)
        else:
            dcm_EN, omega = spin(params.rate * (t_ns / 1e9), params.rate)
        store33(out_orientation.dcm_EN, dcm_EN)
        store3(out_orientation.omega_EN_N, omega)
        publish(out_orientation, t_ns)
