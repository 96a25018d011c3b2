"""SimpleNav: stands in for a navigation system; the truth, with slowly varying errors if wanted."""

from __future__ import annotations

from typing import Annotated

from fsw import F64, Bound, In, KernelModule, Out, Record, Row, Shape, Stream, publish, unseeded, zeros
from fsw.math.attitude import ep_compose, ep_to_mrp, mrp_to_ep, rotvec_to_ep
from fsw.math.noise import gauss_markov_factors, random_walk
from fsw.math.random import normal
from fsw.math.vectors import store3, vec3
from messages.states import NavAttMsg, NavTransMsg, SCStatesMsg


class SimpleNav(KernelModule):
    """True position, velocity, attitude and rate, plus first-order Gauss-Markov errors. See SPEC.md."""

    class Params(Record):
        """Parameters; without any, the output is the truth."""

        sigma_r: Annotated[float, "m", "standard deviation of each position component", Bound(ge=0)] = 0.0
        sigma_v: Annotated[float, "m/s", "standard deviation of each velocity component", Bound(ge=0)] = 0.0
        sigma_att: Annotated[float, "rad", "standard deviation of the attitude about each body axis", Bound(ge=0)] = 0.0
        sigma_rate: Annotated[float, "rad/s", "standard deviation of each rate component", Bound(ge=0)] = 0.0
        tau: Annotated[float, "s", "correlation time of the errors", Bound(gt=0)] = 100.0
        walk_r: Annotated[float, "m/s^0.5", "random walk of each position component", Bound(ge=0)] = 0.0
        walk_v: Annotated[float, "m/s^1.5", "random walk of each velocity component", Bound(ge=0)] = 0.0
        walk_att: Annotated[float, "rad/s^0.5", "random walk of the attitude about each body axis", Bound(ge=0)] = 0.0
        walk_rate: Annotated[float, "rad/s^1.5", "random walk of each rate component", Bound(ge=0)] = 0.0

    class State(Record):
        """Errors: position, velocity, attitude, rate, three components each."""

        error: Annotated[F64, Shape(12), "-", "Gauss-Markov errors in units of their standard deviation"] = zeros(12)
        walk: Annotated[F64, Shape(12), "s^0.5", "random walks in units of their density"] = zeros(12)
        sample_ns: Annotated[int, "ns", "time of the last sample, -1 before the first"] = -1
        noise: Stream = unseeded

    in_state = In(SCStatesMsg)
    out_trans = Out(NavTransMsg)
    out_att = Out(NavAttMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_state: Row, out_trans: Row, out_att: Row) -> None:
        """Advance the errors and add them to the newest true state."""
        if in_state.seq == 0:
            return
        bounded = params.sigma_r + params.sigma_v + params.sigma_att + params.sigma_rate > 0.0
        walking = params.walk_r + params.walk_v + params.walk_att + params.walk_rate > 0.0
        dt = (t_ns - state.sample_ns) / 1e9 if state.sample_ns >= 0 else -1.0
        state.sample_ns = t_ns
        keep, fresh = gauss_markov_factors(dt, params.tau)
        error, walk = state.error, state.walk
        for i in range(12):
            if bounded:
                error[i] = keep * error[i] + fresh * normal(state.noise)
            if walking:
                walk[i] = random_walk(state.noise, walk[i], 1.0, dt)
        turn = (0.0, 0.0, 0.0)
        for i in range(3):
            out_trans.r_BN_N[i] = in_state.r_BN_N[i] + params.sigma_r * error[i] + params.walk_r * walk[i]
            out_trans.v_BN_N[i] = in_state.v_BN_N[i] + params.sigma_v * error[3 + i] + params.walk_v * walk[3 + i]
            turn = (turn[1], turn[2], params.sigma_att * error[6 + i] + params.walk_att * walk[6 + i])
            rate_error = params.sigma_rate * error[9 + i] + params.walk_rate * walk[9 + i]
            out_att.omega_BN_B[i] = in_state.omega_BN_B[i] + rate_error
        beta_BN = ep_compose(rotvec_to_ep(turn), mrp_to_ep(vec3(in_state.sigma_BN)))
        store3(out_att.sigma_BN, ep_to_mrp(beta_BN))
        publish(out_trans, t_ns)
        publish(out_att, t_ns)
