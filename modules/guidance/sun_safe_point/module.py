"""SunSafePoint: turns an axis of the body to the Sun with what a safe mode has."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import F64, Bound, In, KernelModule, Mat3, Out, Record, Row, Shape, Vec3, eye, publish, zeros
from fsw.math.checks import require_rotation
from fsw.math.compiled import compiled
from fsw.math.vectors import M3, V3, axpy, dot, inverse, mat3, mat_t_vec, matvec, norm, scale, store3, sub, unit, vec3
from messages.attitude import AttGuidMsg, SunDirectionMsg
from messages.sensors import CSSArraySensorMsg, IMUSensorMsg
from modules.guidance.alignment import alignment_error

CELLS = 6
NORMALS_B = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
"""One cell on each face of a box."""
NORMALS_B.setflags(write=False)
AXIS_B = np.array([0.0, 0.0, 1.0])
AXIS_B.setflags(write=False)
SPREAD = 0.1
"""Sine of the angle from which the normals of lit cells count as apart."""


@compiled
def span(signal: F64, normals_B: F64, threshold: float) -> M3:
    """Rows: orthonormal vectors that span the normals of the lit cells; zeros for directions that they leave out."""
    one = two = three = (0.0, 0.0, 0.0)
    for i in range(CELLS):
        if not signal[i] <= threshold:
            n = vec3(normals_B[i])
            rest = axpy(-dot(one, n), one, axpy(-dot(two, n), two, axpy(-dot(three, n), three, n)))
            if norm(rest) > SPREAD:
                if norm(one) == 0.0:
                    one = unit(rest)
                elif norm(two) == 0.0:
                    two = unit(rest)
                else:
                    three = unit(rest)
    return one, two, three


@compiled
def sun_vector(signal: F64, normals_B: F64, threshold: float) -> V3:
    """Vector to the Sun in B components, as long as the light is strong (1 at 1 au), by weighted least squares (Eq. 1).

    Args:
        signal: (6,) currents. normals_B: (6, 3) unit vectors. threshold: cells below it count as dark.
    """
    basis = span(signal, normals_B, threshold)
    a, b, c, y = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(CELLS):
        if not signal[i] <= threshold:
            n = matvec(basis, vec3(normals_B[i]))
            w = signal[i]
            a, b, c = axpy(w * n[0], n, a), axpy(w * n[1], n, b), axpy(w * n[2], n, c)
            y = axpy(w * w, n, y)
    a = (a[0] + (1.0 if norm(basis[0]) == 0.0 else 0.0), a[1], a[2])
    b = (b[0], b[1] + (1.0 if norm(basis[1]) == 0.0 else 0.0), b[2])
    c = (c[0], c[1], c[2] + (1.0 if norm(basis[2]) == 0.0 else 0.0))
    return mat_t_vec(basis, matvec(inverse((a, b, c)), y))


class SunSafePoint(KernelModule):
    """Points an axis of the body at the Sun, and searches in the dark. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        axis_B: Annotated[Vec3, "-", "axis to point, any length, B components"] = AXIS_B
        normals_B: Annotated[F64, Shape(6, 3), "-", "normals of the cells, unit vectors, B components"] = NORMALS_B
        threshold: Annotated[float, "-", "signal below which a cell counts as dark", Bound(ge=0, lt=1)] = 0.1
        least_light: Annotated[float, "-", "length of the Sun vector from which it counts as seen", Bound(gt=0)] = 0.3
        spin_rate: Annotated[float, "rad/s", "wanted rate about the direction of the Sun"] = 0.0
        search_rate_B: Annotated[Vec3, "rad/s", "wanted rate while no Sun is seen, B components"] = zeros(3)
        small_angle: Annotated[float, "rad", "error that counts as none", Bound(gt=0, lt=0.1)] = 1e-6
        dcm_PB: Annotated[Mat3, "-", "mounting of the gyro: maps body to case components"] = eye(3)

        def __post_init__(self) -> None:
            """Check axis, normals and mounting too."""
            super().__post_init__()
            require_rotation(self, "dcm_PB")
            if not np.linalg.norm(self.axis_B) > 0.1:
                text = f"expected a vector longer than 0.1, got {self.axis_B.tolist()}"
                raise ValueError(f"SunSafePoint.Params.axis_B: {text}")
            length = np.linalg.norm(self.normals_B, axis=1)
            if np.any(np.abs(length - 1.0) > 1e-9):
                text = f"expected unit vectors, got lengths {length.tolist()}; divide by them"
                raise ValueError(f"SunSafePoint.Params.normals_B: {text}")

    in_css = In(CSSArraySensorMsg)
    in_imu = In(IMUSensorMsg)
    out_guid = Out(AttGuidMsg)
    out_sun = Out(SunDirectionMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_css: Row, in_imu: Row, out_guid: Row, out_sun: Row) -> None:
        """Find the Sun in the newest signals, and write the error."""
        if in_imu.seq == 0 or in_css.seq == 0:
            return
        omega_BN = mat_t_vec(mat3(params.dcm_PB), vec3(in_imu.omega_PN_P))
        if not math.isfinite(norm(omega_BN)):
            return
        sigma, omega_RN = (0.0, 0.0, 0.0), vec3(params.search_rate_B)
        sun = sun_vector(in_css.signal, params.normals_B, params.threshold)
        light = norm(sun)
        out_sun.valid = light >= params.least_light and math.isfinite(light)
        store3(out_sun.u_SB_B, (math.nan, math.nan, math.nan))
        if out_sun.valid:
            sun = unit(sun)
            store3(out_sun.u_SB_B, sun)
            sigma = alignment_error(unit(vec3(params.axis_B)), sun, params.small_angle)
            omega_RN = scale(params.spin_rate, sun)
        store3(out_guid.sigma_BR, sigma)
        store3(out_guid.omega_RN_B, omega_RN)
        store3(out_guid.omega_BR_B, sub(omega_BN, omega_RN))
        store3(out_guid.domega_RN_B, (0.0, 0.0, 0.0))
        publish(out_guid, t_ns)
        publish(out_sun, t_ns)
