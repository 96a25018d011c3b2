"""The predicted pose: elements against pyerfa's full chain of frames, covariance against samples."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sgp4.api import Satrec

from fsw import Module, Out, Simulation, Task, s
from messages.opnav import CameraConfigMsg
from messages.orbit import CameraAccuracyMsg, OrbitClockMsg, PhotoTimeMsg
from modules.estimation.orbit_pose_prior import OrbitError, OrbitPosePrior, TleOrbit, require_fresh

ROOT = Path(__file__).parents[3]
TLE = ROOT / "sim" / "data" / "orbits" / "iss_tle_2023-05-03.txt"
EPOCH = datetime(2023, 5, 5, 3, 28, 50, tzinfo=UTC)
LINES = TLE.read_text().splitlines()
CAMERA = CameraConfigMsg(width_px=1296, height_px=972, focal_px=np.full(2, 1030.0), center_px=np.array([647.5, 485.5]))
ACCURACY = CameraAccuracyMsg(
    photos=5,
    rms_px=1.5,
    sigma_focal_px=1.0,
    sigma_center_px=np.ones(2),
    sigma_distortion=np.zeros(5),
    sigma_mounting=np.full(3, 1e-3),
    sigma_common_H=np.array([300.0, 2000.0, 500.0]),
)


class Source(Module):
    """Writes what it is given, once each step."""

    out_time = Out(PhotoTimeMsg)
    out_clock = Out(OrbitClockMsg)

    def __init__(self, times: list[PhotoTimeMsg | None], clock: OrbitClockMsg | None = None) -> None:
        super().__init__("source")
        self.times, self.clock = times, clock

    def step(self, t_ns: int) -> None:
        time = self.times[t_ns // s(1)]
        if time is not None:
            self.out_time.write(time, t_ns)
        if self.clock is not None:
            self.out_clock.write(self.clock, t_ns)


def photo(**changes: Any) -> PhotoTimeMsg:
    at: dict[str, Any] = {"exposure_ns": s(30), "earliest_ns": s(29.5), "latest_ns": s(30.5), "sigma_s": 0.3}
    return PhotoTimeMsg(**(at | changes))


def predict(
    time: PhotoTimeMsg, accuracy: CameraAccuracyMsg | None = ACCURACY, clock: OrbitClockMsg | None = None
) -> Any:
    source = Source([time], clock)
    prior = OrbitPosePrior("prior", TleOrbit.open(TLE, EPOCH), CAMERA, accuracy)
    source.out_time.connect(prior.in_time)
    source.out_clock.connect(prior.in_clock)
    Simulation([Task("t", s(1), [source, prior])]).run_until(0)
    return prior.out_prior.latest()


def test_position_agrees_with_the_iau_2006_chain(criterion: Callable[[str, float], None]) -> None:
    """TEME to TOD (IAU 1994), to J2000 (IAU 1976/1980), and from there to ITRF by IAU 2006/2000A: another way round."""
    orbit = TleOrbit.open(TLE, EPOCH)
    r, v = orbit.at(np.array([0.0, 100.0]))
    worst = 0.0
    for k, t in enumerate((0.0, 100.0)):
        jd, fraction = 2460069.5, (3 * 3600 + 28 * 60 + 50 + t) / 86400.0
        tt = fraction + 69.184 / 86400.0
        r_teme, v_teme = (1e3 * np.array(x) for x in Satrec.twoline2rv(*LINES).sgp4(jd, fraction)[1:])
        to_j2000 = erfa.pnm80(jd, tt).T @ erfa.rz(-erfa.eqeq94(jd, tt), np.eye(3))
        to_earth = erfa.c2t06a(jd, tt, jd, fraction, 0.0, 0.0) @ to_j2000
        worst = max(worst, float(np.linalg.norm(r[k] - to_earth @ r_teme)))
        assert np.linalg.norm(v[k] - to_earth @ v_teme) < 0.01
    criterion("PRIOR-1", worst)


def test_velocity_relative_to_the_earth_is_the_derivative_of_position() -> None:
    orbit = TleOrbit.open(TLE, EPOCH)
    r, _ = orbit.at(np.array([49.5, 50.5]))
    np.testing.assert_allclose(
        orbit.velocity_earth(50.0), r[1] - r[0], atol=0.02
    )  # SGP4 velocity is no exact derivative


def test_shifted_orbit_moves_along_the_hill_frame() -> None:
    orbit = TleOrbit.open(TLE, EPOCH)
    offset = np.array([1e3, 20e3, -3e3])
    moved, (r, v) = orbit.shifted(offset).at(0.0)[0][0], (x[0] for x in orbit.at(0.0))
    h = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    up = r / np.linalg.norm(r)
    np.testing.assert_allclose([up, np.cross(h, up), h] @ (moved - r), offset, atol=1e-6)


def test_attitude_of_the_prior_is_mounting_times_orbit_frame(criterion: Callable[[str, float], None]) -> None:
    prior = predict(photo())
    orbit = TleOrbit.open(TLE, EPOCH)
    r, v = (x[0] for x in orbit.at(30.0))
    z, y = -r / np.linalg.norm(r), -np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    expected = np.array([np.cross(y, z), y, z])  # the mounting of this camera is the identity
    dcm_CE = Rotation.from_quat(prior.beta_CE, scalar_first=True).as_matrix().T
    criterion("PRIOR-2", float(np.abs(dcm_CE - expected).max()))
    np.testing.assert_allclose(prior.r_CE_E, r, atol=1e-6)


def test_covariance_agrees_with_samples_of_orbit_and_time() -> None:
    prior = predict(photo())
    orbit = TleOrbit.open(TLE, EPOCH)
    rng = np.random.default_rng(3)
    r, v = (x[0] for x in orbit.at(30.0))
    h = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    up = r / np.linalg.norm(r)
    axes = np.array([up, np.cross(h, up), h])
    times = orbit.at(30.0 + 0.3 * rng.standard_normal(4000))[0]
    errors = (axes @ (times - r).T).T + orbit.sigma_H(30.0) * rng.standard_normal((4000, 3))
    sigma = np.sqrt(np.diag(axes @ prior.P_pose[:3, :3] @ axes.T))
    ratio = errors.std(axis=0) / sigma
    # 4000 samples know a sigma to 1.1 %; the turning Earth adds 75 m to the 450 m across the track, another 1.4 %
    assert ratio == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(np.sqrt(np.diag(prior.P_pose)[3:]), np.hypot(1e-3, 2e-3), rtol=1e-12)


def test_clock_of_the_shutter_is_applied() -> None:
    clock = OrbitClockMsg(
        photos=1, landmarks=9, rms_px=1.0, reference_ns=s(20), offset_H=np.zeros(3), rate_T=0.0, clock_s=0.25,
        clock_rate=0.01, P=np.eye(6),
    )  # fmt: skip
    prior = predict(photo(), clock=clock)
    np.testing.assert_allclose(prior.r_CE_E, TleOrbit.open(TLE, EPOCH).at(30.35)[0][0], atol=1e-3)


def test_later_attempts_and_an_unknown_mounting_widen_the_prior() -> None:
    near, far = predict(photo()), predict(photo(attempt=1))
    lost = predict(photo(), accuracy=None)
    for first, second in itertools.pairwise(np.sqrt(np.diag(x.P_pose)) for x in (near, far, lost)):
        assert np.all(second > first)
    assert np.sqrt(lost.P_pose[5, 5]) == pytest.approx(np.pi)
    np.testing.assert_array_equal(far.beta_CE, near.beta_CE)


def test_nothing_is_written_without_a_new_photo() -> None:
    source = Source([None, photo(), None])
    prior = OrbitPosePrior("prior", TleOrbit.open(TLE, EPOCH), CAMERA)
    source.out_time.connect(prior.in_time)
    simulation = Simulation([Task("t", s(1), [source, prior])])
    seq: list[int] = []
    for _ in range(3):
        simulation.step()
        seq.append(prior.out_prior.seq)
    assert seq == [0, 1, 1]
    simulation.reset()
    simulation.run_until(s(2))
    assert prior.out_prior.seq == 1


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([LINES[0][:-1] + "5", LINES[1]], "checksum of line 1"),
        ([LINES[0], LINES[1].replace("51.6420", "51.6421")], "checksum of line 2"),
        ([LINES[0], LINES[1][:50]], "69 characters"),
        ([LINES[0], LINES[1].replace("25544", "25545")[:-1] + "8"], "satellite 25544"),
        (["nothing", "here"], "no two-line elements"),
    ],
)
def test_damaged_elements_are_refused(tmp_path: Path, lines: list[str], words: str) -> None:
    path = tmp_path / "tle.txt"
    path.write_text("\n".join(lines))
    with pytest.raises(OrbitError, match=words):
        TleOrbit.open(path, EPOCH)


def test_elements_with_a_name_line_are_read(tmp_path: Path) -> None:
    path = tmp_path / "tle.txt"
    path.write_text("ISS (ZARYA)\n" + "\n".join(LINES))
    orbit = TleOrbit.open(path, EPOCH)
    assert orbit.satellite == 25544
    assert orbit.age_days(0.0) == pytest.approx(1.4807684681, abs=1e-9)


@pytest.mark.parametrize("days", [-30.0, 30.0])
def test_elements_of_another_time_are_refused(days: float) -> None:
    orbit = TleOrbit.open(TLE, EPOCH + timedelta(days=days))
    with pytest.raises(OrbitError, match=r"days (older|newer) than the photos"):
        require_fresh(orbit, 0.0, 10.0)


def test_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OrbitError, match="cannot be read"):
        TleOrbit.open(tmp_path / "none.txt", EPOCH)
