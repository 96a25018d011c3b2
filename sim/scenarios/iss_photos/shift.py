"""How far the fixes follow the approximate orbit: the orbit shifted, the calibration left as it is."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import msgspec
import numpy as np

from sim.scenarios.iss_photos.graph import build
from sim.scenarios.iss_photos.inputs import Inputs
from sim.scenarios.iss_photos.results import Results

DIRECTIONS = ("radial", "along track", "cross track")
SHIFTS_M = (5e3, 10e3, 20e3)
_MOST_PHOTOS = 3


class ShiftRow(msgspec.Struct, frozen=True, kw_only=True):
    """One shift of the orbit: how many of the photos gave a fix, and how far fixes moved along the shift (mean, m)."""

    direction: str
    shift_m: float
    valid: int
    photos: int
    followed_m: float

    def as_dict(self) -> dict[str, Any]:
        """For JSON; a mean over no fix is null."""
        return {**msgspec.structs.asdict(self), "followed_m": self.followed_m if self.valid else None}


def shift_study(
    inputs: Inputs, results: Results, ticker: Callable[[str, int], AbstractContextManager[Callable[[], None]]]
) -> list[ShiftRow]:
    """Repeat the fixes of some photos, spread over the pass, with shifted orbits.

    The prior says honestly that the orbit may be off by the shift; nothing else is told to the modules.
    """
    calibrated = msgspec.structs.replace(inputs, camera=results.camera, accuracy=results.accuracy)
    before = {i: f for i, f in enumerate(results.fixes[: len(inputs.played)]) if f.valid}
    chosen: list[int] = [
        list(before)[round(float(x))] for x in np.linspace(0, len(before) - 1, min(len(before), _MOST_PHOTOS))
    ]
    rows: list[ShiftRow] = []
    with ticker("orbit shifted", len(DIRECTIONS) * len(SHIFTS_M) * len(chosen)) as tick:
        for axis, direction in enumerate(DIRECTIONS):
            for shift in SHIFTS_M:
                offset = np.zeros(3)
                offset[axis] = shift
                run = build(calibrated, inputs.orbit.shifted(offset), sigma_shift_m=shift)
                run.round(chosen, tick)
                moved: list[float] = []
                for row in run.fixes.rows():
                    index: int = next(i for i in chosen if inputs.played[i].exposure_ns == row["exposure_ns"])
                    fix = before[index]
                    if row["valid"] and fix.r_CE_E is not None and fix.t_s is not None:
                        dcm_HE = inputs.orbit.frames(fix.t_s)[2]
                        moved.append(float((dcm_HE @ (row["r_CE_E"] - fix.r_CE_E))[axis]))
                mean = float(np.mean(moved)) if moved else float("nan")
                rows.append(
                    ShiftRow(direction=direction, shift_m=shift, valid=len(moved), photos=len(chosen), followed_m=mean)
                )
    return rows
