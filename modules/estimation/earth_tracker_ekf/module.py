"""EarthTrackerEkf: position, velocity, attitude and rate relative to the orbit frame, from all sensors."""

from __future__ import annotations

from fsw import In, KernelModule, Out, Row, publish
from fsw.math.attitude import dcm_to_mrp
from fsw.math.square_root import OK
from fsw.math.vectors import store3
from messages.control import CmdTorqueBodyMsg
from messages.environment import EphemerisMsg, PlanetOrientationMsg
from messages.filters import EarthTrackerFilterMsg
from messages.opnav import CameraConfigMsg, LandmarksMsg
from messages.sensors import CSSArraySensorMsg, GPSSensorMsg, IMUSensorMsg, StarVectorsMsg, STAttMsg, TAMSensorMsg
from messages.states import NavAttMsg, NavTransMsg
from modules.estimation.earth_tracker_ekf.error import frame_of, pose_of
from modules.estimation.earth_tracker_ekf.kernel import begin, body_of, step
from modules.estimation.earth_tracker_ekf.params import EarthTrackerParams, EarthTrackerState


class EarthTrackerEkf(KernelModule):
    """The 13-state filter of the source, corrected. See SPEC.md."""

    class Params(EarthTrackerParams):
        """Parameters."""

    class State(EarthTrackerState):
        """The estimate, and what was looked at."""

    in_landmarks = In(LandmarksMsg, optional=True)
    in_camera = In(CameraConfigMsg, optional=True)
    in_gps = In(GPSSensorMsg, optional=True)
    in_gyro = In(IMUSensorMsg, optional=True)
    in_css = In(CSSArraySensorMsg, optional=True)
    in_magnetometer = In(TAMSensorMsg, optional=True)
    in_star_tracker = In(STAttMsg, optional=True)
    in_star_vectors = In(StarVectorsMsg, optional=True)
    in_sun = In(EphemerisMsg, optional=True)
    in_orientation = In(PlanetOrientationMsg, optional=True)
    in_torque = In(CmdTorqueBodyMsg, optional=True)
    out_nav = Out(NavTransMsg)
    out_attitude = Out(NavAttMsg)
    out_filter = Out(EarthTrackerFilterMsg)

    @staticmethod
    def kernel(
        t_ns: int,
        params: Row,
        state: Row,
        in_landmarks: Row,
        in_camera: Row,
        in_gps: Row,
        in_gyro: Row,
        in_css: Row,
        in_magnetometer: Row,
        in_star_tracker: Row,
        in_star_vectors: Row,
        in_sun: Row,
        in_orientation: Row,
        in_torque: Row,
        out_nav: Row,
        out_attitude: Row,
        out_filter: Row,
    ) -> None:
        """Use each new measurement once, at its own time, and give the estimate at ``t_ns``."""
        if t_ns < params.start_ns:
            return
        if not state.started:
            begin(params, state)
        feeds = (
            in_landmarks,
            in_gps,
            in_gyro,
            in_css,
            in_magnetometer,
            in_star_tracker,
            in_star_vectors,
            in_camera,
            in_sun,
            in_orientation,
        )
        code = step(t_ns, params, state, feeds, in_torque, out_filter)
        publish(out_filter, t_ns)
        if code != OK:
            return
        body = body_of(t_ns, params, in_torque, in_orientation)
        r, v, dcm_BN, omega = pose_of(state.x, frame_of(state.x, body[0]))
        store3(out_nav.r_BN_N, r)
        store3(out_nav.v_BN_N, v)
        store3(out_attitude.sigma_BN, dcm_to_mrp(dcm_BN))
        store3(out_attitude.omega_BN_B, omega)
        publish(out_nav, t_ns)
        publish(out_attitude, t_ns)
