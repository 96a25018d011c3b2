"""Where the spacecraft, the Sun, another body and the planet are, as tests want it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from fsw import Module, Out
from messages.base import F64
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.states import SCStatesMsg

Criterion = Callable[[str, float], None]
STILL = np.zeros(3)


class Sky(Module):
    """Feeds every input of one module that it can."""

    out_state = Out(SCStatesMsg)
    out_sun = Out(EphemerisMsg)
    out_moon = Out(EphemerisMsg)
    out_orientation = Out(PlanetOrientationMsg)

    def __init__(self, reader: Any, without: tuple[str, ...] = ()) -> None:
        super().__init__("sky")
        self.reader = reader
        for port in reader.inputs:
            if port.name not in without:
                vars(self)["out_" + port.name[3:]].connect(port)

    def place(self, r: Any, t_ns: int = 0) -> None:
        self.out_state.write(
            SCStatesMsg(r_BN_N=np.array(r, float), v_BN_N=STILL, sigma_BN=STILL, omega_BN_B=STILL, omegaDot_BN_B=STILL),
            t_ns,
        )

    def turn(self, dcm_EN: Any = None, omega: Any = STILL, t_ns: int = 0) -> None:
        dcm = np.eye(3) if dcm_EN is None else np.array(dcm_EN)
        self.out_orientation.write(PlanetOrientationMsg(dcm_EN=dcm, omega_EN_N=np.array(omega)), t_ns)

    def answer(self, t_ns: int = 0) -> Any:
        """Run the module and return what it publishes."""
        self.reader.step(t_ns)
        return self.reader.outputs[0].latest()


def body_at(r: Any, radius: float) -> EphemerisMsg:
    return EphemerisMsg(body_id=10, mu=1.0, radius=radius, r_PN_N=np.array(r, float), v_PN_N=STILL)


def position_of(lat: float, lon: float, h: float, a: float = 6378137.0, f: float = 1 / 298.257223563) -> F64:
    """Earth-fixed position of a geodetic latitude, longitude (rad) and height, by the definition of the ellipsoid."""
    e2 = f * (2 - f)
    n = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    flat = (n + h) * np.cos(lat)
    return np.array([flat * np.cos(lon), flat * np.sin(lon), (n * (1 - e2) + h) * np.sin(lat)])


def north_east_down(lat: float, lon: float) -> F64:
    """Rows are the three directions in Earth-fixed components."""
    north = np.array([-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.array([north, east, np.cross(north, east)])
