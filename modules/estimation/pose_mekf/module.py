"""PoseMekf: position, velocity and attitude from landmarks, gyro, receiver, star tracker and directions."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from fsw import In, KernelModule, Out, Record, Row, Shape, publish, zeros
from fsw.math.attitude import ep_to_mrp
from fsw.math.compiled import compiled
from fsw.math.square_root import OK
from fsw.math.vectors import M3, mat3, mat_t_vec, store3, vec3, vec4
from messages.base import F64, I64
from messages.environment import PlanetOrientationMsg
from messages.filters import DirectionsMsg, PoseFilterMsg, PoseNuisanceMsg
from messages.opnav import CameraConfigMsg, LandmarksMsg, PoseFixMsg
from messages.sensors import GPSSensorMsg, IMUSensorMsg, STAttMsg
from messages.states import NavAttMsg, NavTransMsg
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.images import take_fix, take_image
from modules.estimation.pose_mekf.instants import GYRO, RECEIVER, STAR, TRACKER, WIDTH
from modules.estimation.pose_mekf.layout import ESTIMATE, SIZE, X_BETA, X_R, X_V, modes
from modules.estimation.pose_mekf.memory import ENTRIES, SAVED, advance, remember, save_only
from modules.estimation.pose_mekf.motion import body_rate
from modules.estimation.pose_mekf.params import PoseMekfParams
from modules.estimation.pose_mekf.reports import blank, write_estimate, write_nuisance
from modules.estimation.pose_mekf.start import begin, knows_planet
from modules.opnav.relative import orientation_at

NEVER = -(2**62)
"""A time before all others [ns]."""


def _ints(n: int, value: int = 0) -> I64:
    array = np.full(n, value, np.int64)
    array.setflags(write=False)
    return array


@compiled
def take_gyro(params: Row, state: Row, in_gyro: Row) -> None:
    """Remember a new reading, in B components; one with NaN counts as silence."""
    if in_gyro.seq in (0, state.seen_gyro):
        return
    state.seen_gyro = in_gyro.seq
    reading, data = mat_t_vec(mat3(params.dcm_PB), vec3(in_gyro.omega_PN_P)), np.zeros(WIDTH)
    if math.isfinite(reading[0] + reading[1] + reading[2]):
        store3(data, reading)
        remember(state, GYRO, in_gyro.t_ns, data)


@compiled
def take_gps(t_ns: int, state: Row, in_gps: Row, in_orientation: Row) -> int:
    """Remember a new fix of the receiver; returns the status, UPDATED if it is to be used."""
    if in_gps.seq in (0, state.seen_gps):
        return status.NO_MEASUREMENT
    state.seen_gps = in_gps.seq
    data, total = np.zeros(WIDTH), 0.0
    for i in range(3):
        data[i], data[3 + i] = in_gps.r_AE_E[i], in_gps.v_AE_E[i]
        total += data[i] + data[3 + i]
    if not math.isfinite(total):
        return status.BAD_NUMBERS
    if not knows_planet(in_orientation):
        return status.NO_ORIENTATION
    if in_gps.fix_ns > t_ns:
        return status.FROM_FUTURE
    if in_gps.fix_ns <= state.gps_ns:
        return status.TOO_LATE
    what = remember(state, RECEIVER, in_gps.fix_ns, data)
    if what == status.UPDATED:
        state.gps_ns = in_gps.fix_ns
    return what


@compiled
def take_star_tracker(t_ns: int, state: Row, in_star_tracker: Row) -> int:
    """Remember a new attitude of the star tracker; as `take_gps`."""
    if in_star_tracker.seq in (0, state.seen_star):
        return status.NO_MEASUREMENT
    state.seen_star = in_star_tracker.seq
    if not in_star_tracker.valid:
        return status.INVALID
    data, square = np.zeros(WIDTH), 0.0
    for i in range(4):
        data[i] = in_star_tracker.beta_SN[i]
        square += data[i] * data[i]
    if not math.fabs(square - 1.0) < 1e-6:
        return status.BAD_NUMBERS
    if in_star_tracker.exposure_ns > t_ns:
        return status.FROM_FUTURE
    if in_star_tracker.exposure_ns <= state.star_ns:
        return status.TOO_LATE
    what = remember(state, TRACKER, in_star_tracker.exposure_ns, data)
    if what == status.UPDATED:
        state.star_ns = in_star_tracker.exposure_ns
    return what


@compiled
def take_directions(t_ns: int, state: Row, in_directions: Row) -> int:
    """Remember new directions; as `take_gps`. Those that are no directions are left out."""
    if in_directions.seq in (0, state.seen_vectors):
        return status.NO_MEASUREMENT
    state.seen_vectors = in_directions.seq
    if not in_directions.valid or in_directions.count == 0:
        return status.INVALID
    if in_directions.exposure_ns > t_ns:
        return status.FROM_FUTURE
    if in_directions.exposure_ns <= state.vectors_ns:
        return status.TOO_LATE
    what, data = status.BAD_NUMBERS, np.zeros(WIDTH)
    for k in range(in_directions.count):
        a = b = 0.0
        for i in range(3):
            a += in_directions.measured_B[k, i] ** 2
            b += in_directions.known_N[k, i] ** 2
        data[6] = in_directions.sigma[k]
        if not (a > 0.0 and b > 0.0 and data[6] > 0.0 and math.isfinite(a + b + data[6])):
            continue
        for i in range(3):
            data[i] = in_directions.measured_B[k, i] / math.sqrt(a)
            data[3 + i] = in_directions.known_N[k, i] / math.sqrt(b)
        what = remember(state, STAR, in_directions.exposure_ns, data)
        if what != status.UPDATED:
            return what
        state.vectors_ns = in_directions.exposure_ns
    return what


@compiled
def write_navigation(t_ns: int, x: F64, out_nav: Row, out_att: Row) -> None:
    """Publish position, velocity, attitude and rate of an estimate (34,)."""
    store3(out_nav.r_BN_N, vec3(x[X_R:]))
    store3(out_nav.v_BN_N, vec3(x[X_V:]))
    store3(out_att.sigma_BN, ep_to_mrp(vec4(x[X_BETA:])))
    store3(out_att.omega_BN_B, body_rate(x))
    publish(out_nav, t_ns)
    publish(out_att, t_ns)


class PoseMekf(KernelModule):
    """Multiplicative filter of pose, gyro bias and errors of the sensors. See SPEC.md."""

    Params = PoseMekfParams

    class State(Record):
        """The estimate, what is remembered of the last seconds, and what was seen last."""

        started: Annotated[bool, "-", "the initial estimate was taken over"] = False
        lost: Annotated[bool, "-", "the estimate is not trusted"] = False
        time_ns: Annotated[int, "ns", "time of the estimate"] = 0
        gyro_ns: Annotated[int, "ns", "time of the last reading of the gyro"] = 0
        x: Annotated[F64, Shape(ESTIMATE), "m, m/s, rad/s", "estimate; see layout.py"] = zeros(ESTIMATE)
        P: Annotated[F64, Shape(SIZE, SIZE), "products of units", "its covariance"] = zeros(SIZE, SIZE)
        image_ns: Annotated[int, "ns", "exposure of the last image used"] = NEVER
        gps_ns: Annotated[int, "ns", "time of the last fix of the receiver"] = NEVER
        star_ns: Annotated[int, "ns", "exposure of the last attitude of the star tracker"] = NEVER
        vectors_ns: Annotated[int, "ns", "time of the last directions"] = NEVER
        seen_landmarks: Annotated[int, "-", "seq of the last landmarks looked at"] = 0
        seen_fix: Annotated[int, "-", "seq of the last pose looked at"] = 0
        seen_gyro: Annotated[int, "-", "seq of the last reading looked at"] = 0
        seen_gps: Annotated[int, "-", "seq of the last fix looked at"] = 0
        seen_star: Annotated[int, "-", "seq of the last attitude looked at"] = 0
        seen_vectors: Annotated[int, "-", "seq of the last directions looked at"] = 0
        status_gps: Annotated[int, "-", "of the receiver"] = 1
        status_star: Annotated[int, "-", "of the star tracker"] = 1
        status_vectors: Annotated[int, "-", "of the directions"] = 1
        contradicting: Annotated[int, "-", "images in a row that contradicted the estimate"] = 0
        images: Annotated[int, "-", "images used"] = 0
        entries: Annotated[int, "-", "measurements remembered, in order of time"] = 0
        done: Annotated[int, "-", "of these, how many the estimate knows"] = 0
        entry_ns: Annotated[I64, Shape(ENTRIES), "ns", "their times"] = _ints(ENTRIES)
        entry_kind: Annotated[I64, Shape(ENTRIES), "-", "their kinds; see instants.py"] = _ints(ENTRIES)
        entry_data: Annotated[F64, Shape(ENTRIES, WIDTH), "-", "their numbers"] = zeros(ENTRIES, WIDTH)
        saved: Annotated[int, "-", "estimates remembered, in order of time"] = 0
        saved_ns: Annotated[I64, Shape(SAVED), "ns", "their times"] = _ints(SAVED)
        saved_gyro_ns: Annotated[I64, Shape(SAVED), "ns", "gyro_ns then"] = _ints(SAVED)
        saved_done: Annotated[I64, Shape(SAVED), "-", "done then"] = _ints(SAVED)
        saved_x: Annotated[F64, Shape(SAVED, ESTIMATE), "m, m/s, rad/s", "x then"] = zeros(SAVED, ESTIMATE)
        saved_P: Annotated[F64, Shape(SAVED, SIZE, SIZE), "products of units", "P then"] = zeros(SAVED, SIZE, SIZE)

    in_landmarks = In(LandmarksMsg, optional=True)
    in_camera = In(CameraConfigMsg, optional=True)
    in_gyro = In(IMUSensorMsg, optional=True)
    in_gps = In(GPSSensorMsg, optional=True)
    in_star_tracker = In(STAttMsg, optional=True)
    in_directions = In(DirectionsMsg, optional=True)
    in_fix = In(PoseFixMsg, optional=True)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    out_nav = Out(NavTransMsg)
    out_att = Out(NavAttMsg)
    out_nuisance = Out(PoseNuisanceMsg)
    out_filter = Out(PoseFilterMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_landmarks: Row,
        in_camera: Row,
        in_gyro: Row,
        in_gps: Row,
        in_star_tracker: Row,
        in_directions: Row,
        in_fix: Row,
        in_orientation: Row,
        out_nav: Row,
        out_att: Row,
        out_nuisance: Row,
        out_filter: Row,
    ) -> None:
        """Use what is new, each once and at its own time, and give the estimate at ``t_ns``."""
        if t_ns < params.start_ns:
            return
        estimated, sigma = np.empty(SIZE), np.empty(SIZE)
        modes(params, estimated, sigma)
        if not state.started:
            begin(state, params, sigma)
            save_only(state)
        blank(state, out_filter)
        # the pole, which is all that the field asks of the planet, hardly moves
        frame: M3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        if knows_planet(in_orientation):
            frame = orientation_at(in_orientation, t_ns)
        take_gyro(params, state, in_gyro)
        gps = take_gps(t_ns, state, in_gps, in_orientation)
        star = take_star_tracker(t_ns, state, in_star_tracker)
        vectors = take_directions(t_ns, state, in_directions)
        what = take_image(
            t_ns,
            params,
            state,
            estimated,
            sigma,
            frame,
            in_landmarks,
            in_camera,
            in_fix,
            in_orientation,
            out_filter,
        )
        fix = take_fix(t_ns, params, state, estimated, sigma, frame, in_camera, in_fix, in_orientation)
        code = advance(state, params, estimated, sigma, frame, in_orientation, t_ns)
        write_estimate(state, out_filter)
        if gps != status.UPDATED:
            out_filter.status_gps = gps
        if star != status.UPDATED:
            out_filter.status_star = star
        if vectors != status.UPDATED:
            out_filter.status_vectors = vectors
        out_filter.status, out_filter.status_fix = what, fix
        if code != OK:
            out_filter.status = status.FAILED_PREDICTION
        publish(out_filter, t_ns)
        if code != OK:
            return
        write_nuisance(state.x, state.P, out_nuisance)
        publish(out_nuisance, t_ns)
        write_navigation(t_ns, state.x, out_nav, out_att)
