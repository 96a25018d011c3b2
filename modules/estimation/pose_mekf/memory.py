"""What is remembered so that an image can come late: measurements of some seconds, and the estimate now and then.

An image is processed seconds after its exposure. The filter then goes back to an estimate from before the exposure,
repeats the measurements up to it, uses the image, and repeats those that follow. That is exact: the result is that of
an image without delay.
"""

from __future__ import annotations

from fsw.math.compiled import compiled
from fsw.math.vectors import M3, vec3
from fsw.module import Row
from messages.base import F64
from modules.estimation.pose_mekf import status
from modules.estimation.pose_mekf.instants import GYRO, RECEIVER, STAR, TRACKER, WIDTH, use_instant
from modules.estimation.pose_mekf.layout import X_HELD, copy_estimate
from modules.estimation.pose_mekf.motion import hold_rate, move, read_gyro
from modules.opnav.relative import orientation_at

ENTRIES, SAVED = 512, 4
"""Capacities: measurements, and estimates."""


@compiled
def save(state: Row) -> None:
    """Remember the estimate as it is; the oldest one is forgotten if there is no room."""
    if state.saved == SAVED:
        for k in range(1, SAVED):
            copy_estimate(state.saved_x[k], state.saved_P[k], state.saved_x[k - 1], state.saved_P[k - 1])
            state.saved_ns[k - 1], state.saved_done[k - 1] = state.saved_ns[k], state.saved_done[k]
            state.saved_gyro_ns[k - 1] = state.saved_gyro_ns[k]
        state.saved -= 1
    k = state.saved
    copy_estimate(state.x, state.P, state.saved_x[k], state.saved_P[k])
    state.saved_ns[k], state.saved_done[k], state.saved_gyro_ns[k] = state.time_ns, state.done, state.gyro_ns
    state.saved += 1
    _forget(state, state.saved_done[0])


@compiled
def save_only(state: Row) -> None:
    """Remember nothing before the estimate as it is."""
    state.saved = 0
    save(state)


@compiled
def _forget(state: Row, count: int) -> None:
    """Drop the first ``count`` measurements."""
    if count == 0:
        return
    for k in range(count, state.entries):
        state.entry_ns[k - count], state.entry_kind[k - count] = state.entry_ns[k], state.entry_kind[k]
        for j in range(WIDTH):
            state.entry_data[k - count, j] = state.entry_data[k, j]
    state.entries -= count
    state.done -= count
    for k in range(state.saved):
        state.saved_done[k] -= count


@compiled
def go_back(state: Row, to_ns: int) -> bool:
    """Take the newest remembered estimate that is not later than ``to_ns``; later ones are forgotten."""
    k = state.saved - 1
    while k >= 0 and state.saved_ns[k] > to_ns:
        k -= 1
    if k < 0:
        return False
    copy_estimate(state.saved_x[k], state.saved_P[k], state.x, state.P)
    state.time_ns, state.done, state.saved = state.saved_ns[k], state.saved_done[k], k + 1
    state.gyro_ns = state.saved_gyro_ns[k]
    return True


@compiled
def remember(state: Row, kind: int, time_ns: int, data: F64) -> int:
    """Put a measurement (7,) in its place in time; one that is earlier than the estimate takes the estimate back."""
    if state.entries == ENTRIES:
        save_only(state)
        _forget(state, state.done)
    if state.entries == ENTRIES:
        return status.TOO_LATE
    at = state.entries
    while at > 0 and state.entry_ns[at - 1] > time_ns:
        at -= 1
    if (at < state.done or time_ns < state.time_ns) and not go_back(state, time_ns):
        return status.TOO_LATE
    for k in range(state.entries, at, -1):
        state.entry_ns[k], state.entry_kind[k] = state.entry_ns[k - 1], state.entry_kind[k - 1]
        for j in range(WIDTH):
            state.entry_data[k, j] = state.entry_data[k - 1, j]
    state.entry_ns[at], state.entry_kind[at] = time_ns, kind
    for j in range(WIDTH):
        state.entry_data[at, j] = data[j]
    state.entries += 1
    return status.UPDATED


@compiled
def _choose_rate(state: Row, params: Row, to_ns: int) -> None:
    """The angular rate for the interval from the estimate to ``to_ns``: read, the last one still, or held."""
    for k in range(state.done, state.entries):
        if state.entry_kind[k] == GYRO:
            if (state.entry_ns[k] - state.time_ns) * 1e-9 <= params.gyro_timeout:
                read_gyro(state.x, state.P, vec3(state.entry_data[k]), params)
                state.gyro_ns = state.entry_ns[k]
                return
            break
    if state.x[X_HELD] < 0.5 and (to_ns - state.gyro_ns) * 1e-9 > params.gyro_timeout:
        hold_rate(state.x, state.P, params)


@compiled
def _move_to(state: Row, params: Row, sigma: F64, frame: M3, to_ns: int) -> int:
    """Move the estimate to a time at or after its own, in steps of ``max_step`` at most."""
    while state.time_ns < to_ns:
        end_ns = min(to_ns, state.time_ns + round(params.max_step * 1e9))
        _choose_rate(state, params, end_ns)
        code = move(state.x, state.P, sigma, (end_ns - state.time_ns) * 1e-9, frame, params)
        if code != 0:
            return code
        state.time_ns = end_ns
        if end_ns - state.saved_ns[state.saved - 1] >= round(params.max_delay * 1e9) // (SAVED - 1):
            save(state)
    return 0


@compiled
def advance(state: Row, params: Row, estimated: F64, sigma: F64, frame: M3, in_orientation: Row, to_ns: int) -> int:
    """Move the estimate to ``to_ns`` through the measurements on the way; notes what became of them.

    Returns:
        A code of `fsw.math.square_root`; on failure the estimate stays at the time that it has reached.
    """
    while state.done < state.entries and state.entry_ns[state.done] <= to_ns:
        k = state.done
        code = _move_to(state, params, sigma, frame, state.entry_ns[k])
        if code != 0:
            return code
        k = state.done  # saving an estimate may have dropped earlier ones
        kind = state.entry_kind[k]
        if kind == GYRO:
            read_gyro(state.x, state.P, vec3(state.entry_data[k]), params)
            state.gyro_ns = state.entry_ns[k]
        else:
            dcm_EN = orientation_at(in_orientation, state.entry_ns[k])
            what = use_instant(kind, state.entry_data[k], state.x, state.P, estimated, dcm_EN, params, in_orientation)
            if kind == RECEIVER:
                state.status_gps = what
            elif kind == TRACKER:
                state.status_star = what
            elif kind == STAR:
                state.status_vectors = what
        state.done += 1
    return _move_to(state, params, sigma, frame, to_ns)
