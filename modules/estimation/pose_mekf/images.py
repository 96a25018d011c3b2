"""A new image or pose: when it is used, what a contradiction means, and how a lost estimate is found again."""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.memory import advance, go_back, save_only
from modules.estimation.pose_mekf.start import knows_planet, lose, place, trust
from modules.estimation.pose_mekf.update import use_image


@compiled
def _to_exposure(
    state: Row,
    params: Row,
    estimated: F64,
    sigma: F64,
    frame: M3,
    in_orientation: Row,
    exposure_ns: int,
    t_ns: int,
) -> int:
    """Take the estimate to an exposure, which may be past; returns UPDATED or why that cannot be."""
    if exposure_ns > t_ns:
        return status.FROM_FUTURE
    if exposure_ns < state.time_ns and not go_back(state, exposure_ns):
        return status.TOO_LATE
    code = advance(state, params, estimated, sigma, frame, in_orientation, exposure_ns)
    return status.UPDATED if code == 0 else status.FAILED_PREDICTION


@compiled
def _search(
    state: Row,
    params: Row,
    estimated: F64,
    sigma: F64,
    in_landmarks: Row,
    in_camera: Row,
    in_fix: Row,
    in_orientation: Row,
    out: Row,
) -> int:
    """Look for a lost estimate in an image, near a pose of the same image if there is one."""
    near = in_fix.seq != 0 and in_fix.valid and in_fix.exposure_ns == in_landmarks.exposure_ns
    if near and place(state.x, in_fix, in_camera, in_orientation, params):
        lose(state.x, state.P, params, sigma)
    what = use_image(state.x, state.P, estimated, sigma, params, in_landmarks, in_camera, in_orientation, True, out)
    if what != status.UPDATED:
        return status.LOST
    state.lost, state.contradicting = False, 0
    return status.REACQUIRED


@compiled
def _use(
    state: Row,
    params: Row,
    estimated: F64,
    sigma: F64,
    in_landmarks: Row,
    in_camera: Row,
    in_orientation: Row,
    out: Row,
) -> int:
    """Use an image, and count contradictions; the estimate is given up after several in a row."""
    what = use_image(state.x, state.P, estimated, sigma, params, in_landmarks, in_camera, in_orientation, False, out)
    if what == status.UPDATED:
        state.contradicting = 0
    elif what == status.GATED or (what == status.TOO_FEW and out.landmarks >= params.min_landmarks):
        state.contradicting += 1
        if state.contradicting >= params.patience:
            lose(state.x, state.P, params, sigma)
            state.lost, state.contradicting = True, 0
            return status.DIVERGED
    return what


@compiled
def take_image(
    t_ns: int,
    params: Row,
    state: Row,
    estimated: F64,
    sigma: F64,
    frame: M3,
    in_landmarks: Row,
    in_camera: Row,
    in_fix: Row,
    in_orientation: Row,
    out: Row,
) -> int:
    """Use the newest image once; returns the status. The estimate is then at the time of the exposure."""
    if in_landmarks.seq in (0, state.seen_landmarks):
        return status.NO_MEASUREMENT
    state.seen_landmarks = in_landmarks.seq
    if in_landmarks.count == 0:
        return status.INVALID
    if in_camera.seq == 0:
        return status.NO_CAMERA
    if not knows_planet(in_orientation):
        return status.NO_ORIENTATION
    if in_landmarks.exposure_ns <= state.image_ns:
        return status.TOO_LATE
    what = _to_exposure(state, params, estimated, sigma, frame, in_orientation, in_landmarks.exposure_ns, t_ns)
    if what != status.UPDATED:
        return what
    if state.lost:
        what = _search(state, params, estimated, sigma, in_landmarks, in_camera, in_fix, in_orientation, out)
    else:
        what = _use(state, params, estimated, sigma, in_landmarks, in_camera, in_orientation, out)
    if what in (status.UPDATED, status.REACQUIRED, status.DIVERGED, status.LOST):
        state.image_ns = in_landmarks.exposure_ns
        state.images += 1 if what in (status.UPDATED, status.REACQUIRED) else 0
        save_only(state)
    return what


@compiled
def take_fix(
    t_ns: int,
    params: Row,
    state: Row,
    estimated: F64,
    sigma: F64,
    frame: M3,
    in_camera: Row,
    in_fix: Row,
    in_orientation: Row,
) -> int:
    """Start again from a new pose, if the estimate is lost; returns the status."""
    if in_fix.seq in (0, state.seen_fix):
        return status.NO_MEASUREMENT
    state.seen_fix = in_fix.seq
    if not in_fix.valid:
        return status.INVALID
    if not state.lost:
        return status.NO_MEASUREMENT
    if in_camera.seq == 0:
        return status.NO_CAMERA
    if not knows_planet(in_orientation):
        return status.NO_ORIENTATION
    what = _to_exposure(state, params, estimated, sigma, frame, in_orientation, in_fix.exposure_ns, t_ns)
    if what != status.UPDATED:
        return what
    if not place(state.x, in_fix, in_camera, in_orientation, params):
        return status.BAD_NUMBERS
    lose(state.x, state.P, params, sigma)
    if not trust(state.x, state.P, in_fix, in_camera, in_orientation):
        return status.BAD_NUMBERS
    state.lost, state.contradicting = False, 0
    save_only(state)
    return status.REACQUIRED
