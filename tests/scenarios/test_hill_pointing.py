"""The hill-pointing scenario asserts its physics: it converges, it conserves, and its orbit is the right one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fsw import minutes, s
from fsw.math.gravity import J2_EARTH, MU_EARTH, RADIUS_EARTH
from messages.base import F64
from sim.scenarios.hill_pointing import build, main, pointing_error


def test_pointing_converges() -> None:
    """From tumbling to the noise floor, which the star tracker's roll noise and the gyro's noise set."""
    scenario = build()
    guid = scenario.tracking_error.out_guid.record(every=s(1))
    truth = scenario.spacecraft.out_state.record(every=s(1))
    reference = scenario.hill_point.out_ref.record(every=s(1))
    scenario.sim.run_until(minutes(30))
    error = pointing_error(guid)
    assert np.degrees(error[0]) > 90.0
    # the loop settles like exp(-P t / 2 J), J = 900 kg m^2: 1e-4 of the start after 10 min
    settled = error[guid.t_s > 900.0]
    assert np.sqrt(np.mean(settled**2)) < 3e-4
    assert settled.max() < 1e-3
    assert np.abs(guid["omega_BR_B"][guid.t_s > 900.0]).max() < 5e-4
    # and the true attitude follows too, not only the estimated one: compare axes, in N
    when = guid.t_s > 900.0
    assert np.array_equal(truth.t_ns[when], guid.t_ns[when])
    axis_B, axis_R = x_axis(truth["sigma_BN"][when]), x_axis(reference["sigma_RN"][when])
    assert np.degrees(np.arccos(np.clip(np.sum(axis_B * axis_R, axis=1), -1, 1))).max() < 0.05


def x_axis(sigma: F64) -> F64:
    """First row of the matrices of MRPs, (n, 3)."""
    s1, s2, s3 = sigma.T
    square = np.sum(sigma**2, axis=1)
    d, m = (1 + square) ** 2, 1 - square
    first = 4 * (s1**2 - s2**2 - s3**2) + m**2
    return np.stack([first / d, (8 * s1 * s2 + 4 * s3 * m) / d, (8 * s1 * s3 - 4 * s2 * m) / d], axis=1)


def test_free_motion_conserves_energy_and_momentum() -> None:
    scenario = build(control=False)
    rec = scenario.spacecraft.out_conserved.record(every=s(10))
    scenario.sim.run_until(minutes(100))
    for values in (rec["energy_orbit"], rec["momentum_orbit_N"][:, 2], rec["energy_rotation"]):
        assert np.max(np.abs(values / values[0] - 1.0)) < 1e-10
    momentum = rec["momentum_rotation_N"]
    assert np.max(np.linalg.norm(momentum - momentum[0], axis=1)) < 1e-10 * np.linalg.norm(momentum[0])


def test_orbit_against_dop853() -> None:
    """Position after 100 minutes against an independent integrator, whose own error is some 1e-5 m."""
    scenario = build()
    rec = scenario.spacecraft.out_state.record(every=s(60))
    scenario.sim.run_until(minutes(100))

    def slope(_: float, y: F64) -> F64:
        r = float(np.linalg.norm(y[:3]))
        sin2 = (y[2] / r) ** 2
        factor = 1.5 * J2_EARTH * (RADIUS_EARTH / r) ** 2
        bracket = 1 + factor * (np.array([1.0, 1.0, 3.0]) - 5 * sin2)
        return np.concatenate([y[3:], -MU_EARTH / r**3 * bracket * y[:3]])

    start = np.concatenate([rec["r_BN_N"][0], rec["v_BN_N"][0]])
    tolerance = np.repeat([1e-7, 1e-10], 3)
    solved = solve_ivp(slope, (0, 6000.0), start, method="DOP853", rtol=1e-13, atol=tolerance)
    assert np.linalg.norm(rec["r_BN_N"][-1] - solved.y[:3, -1]) < 1e-4
    assert np.linalg.norm(rec["v_BN_N"][-1] - solved.y[3:, -1]) < 1e-7


def test_seed_changes_noise_only() -> None:
    def run(seed: int) -> tuple[F64, F64]:
        scenario = build(seed=seed, control=False)
        truth, gyro = scenario.spacecraft.out_state.record(), scenario.gyro.out_imu.record()
        scenario.sim.run_until(s(5))
        return truth["r_BN_N"], gyro["omega_PN_P"]

    (r_1, w_1), (r_2, w_2), (r_3, w_3) = run(1), run(1), run(2)
    assert np.array_equal(r_1, r_2)
    assert np.array_equal(w_1, w_2)
    assert np.array_equal(r_1, r_3)
    assert not np.any(w_1 == w_3)


def test_main_prints_a_table_and_saves_a_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--minutes", "1", "--out", str(tmp_path / "new")]) == 0
    shown = capsys.readouterr().out
    assert "pointing error [deg]" in shown
    assert (tmp_path / "new" / "hill_pointing.png").stat().st_size > 10_000


def test_main_says_what_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(SystemExit):
        main(["--out", str(tmp_path / "file" / "new")])
    assert "cannot make the folder" in capsys.readouterr().err
    (tmp_path / "hill_pointing.png").mkdir()
    assert main(["--minutes", "0.1", "--out", str(tmp_path)]) == 1
    assert "cannot save" in capsys.readouterr().err
    assert {p.name for p in tmp_path.iterdir()} == {"file", "hill_pointing.png"}


@pytest.mark.parametrize("arguments", [["--minutes", "-1"], ["--minutes", "nan"], ["--seed", "x"]])
def test_main_refuses_nonsense(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(arguments)
    assert arguments[0] in capsys.readouterr().err
