"""Recordings: what is kept, how it is read, how it is saved."""

import os
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pytest

from fsw import (
    KernelModule,
    Message,
    Module,
    ObjectMessage,
    Out,
    Record,
    Row,
    Simulation,
    Task,
    Vec3,
    load,
    ms,
    publish,
    s,
    save,
    zeros,
)
from fsw.files import atomic


class StepMsg(Message):
    """A number that changes slowly."""

    n: Annotated[int, "-", "tenths of the step count"]
    r_BN_N: Annotated[Vec3, "m", "position"]


class PictureMsg(ObjectMessage):
    """A picture."""

    image: Annotated[Any, "-", "pixels"]


class Counter(KernelModule):
    """Counts."""

    class State(Record):
        n: Annotated[int, "-", "steps"] = 0

    out_step = Out(StepMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out_step: Row) -> None:
        out_step.n = state.n // 10
        for i in range(3):
            out_step.r_BN_N[i] = float(state.n // 10)
        state.n += 1
        if state.n != 5:  # one step without a message
            publish(out_step, t_ns)


class Imager(Module):
    """Makes a picture at each even step, and a row at every step."""

    out_picture = Out(PictureMsg)
    out_step = Out(StepMsg)

    def step(self, t_ns: int) -> None:
        """Write."""
        self.out_step.write(StepMsg(n=t_ns // s(1), r_BN_N=zeros(3)), t_ns)
        if t_ns // s(1) % 2 == 0:
            self.out_picture.write(PictureMsg(image=np.full((2, 2), t_ns // s(1))), t_ns)


def counting(**options: Any) -> tuple[Simulation, Any]:
    counter = Counter("counter")
    recording = counter.out_step.record(**options)
    return Simulation([Task("only", ms(100), [counter])]), recording


def test_every_write_is_kept_and_nothing_else() -> None:
    sim, recording = counting()
    sim.run_until(s(1))
    assert recording.t_ns.tolist() == [ms(100) * k for k in range(11) if k != 4]
    assert recording["n"].tolist() == [0] * 9 + [1] and recording["r_BN_N"].shape == (10, 3)
    assert recording.t_s[-1] == pytest.approx(1.0, abs=1e-15) and len(recording) == 10


def test_decimation_keeps_to_the_grid() -> None:
    sim, recording = counting(every=ms(250))
    sim.run_until(s(2))
    assert (recording.t_ns // ms(100)).tolist() == [0, 3, 5, 8, 10, 13, 15, 18, 20]


def test_only_changes() -> None:
    sim, recording = counting(on_change=True)
    sim.run_until(s(3))
    assert recording["n"].tolist() == [0, 1, 2, 3] and (recording.t_ns // ms(100)).tolist() == [0, 10, 20, 30]


def test_a_long_recording_grows_without_a_gap() -> None:
    sim, recording = counting()
    changes = recording.port.record(on_change=True)
    sim.run_until(s(20_000))
    assert len(recording) == 200_000 and np.array_equal(recording["n"][4:], np.arange(5, 200_001) // 10)
    assert np.array_equal(changes["n"], np.arange(20_001))
    sim.restore(sim.snapshot())
    assert len(recording) == 200_000 and len(changes) == 20_001
    sim.reset()
    assert len(recording) == len(changes) == 0 and recording.last_row is None
    sim.run_until(s(20_000))
    assert np.array_equal(recording["n"][4:], np.arange(5, 200_001) // 10)
    assert np.array_equal(changes["n"], np.arange(20_001))


def test_going_back_forgets_what_came_after() -> None:
    sim, recording = counting()
    sim.run_until(s(1000))
    early = sim.snapshot()
    sim.run_until(s(9000))
    sim.restore(early)
    assert recording.t_ns[-1] == s(1000) and len(recording) == 10_000
    sim.run_until(s(9000))
    assert np.array_equal(np.diff(recording.t_ns[4:]), np.full(89_995, ms(100)))


def test_objects_are_kept_by_reference() -> None:
    imager = Imager("imager")
    pictures, rows = imager.out_picture.record(), imager.out_step.record(every=s(2))
    sim = Simulation([Task("only", s(1), [imager])])
    sim.run_until(s(5))
    assert [int(p.image[0, 0]) for p in pictures.objects] == [0, 2, 4]
    assert pictures.t_ns.tolist() == [0, s(2), s(4)] and pictures["image"].shape == (3, 2, 2)
    assert rows["n"].tolist() == [0, 2, 4]
    sim.reset()
    assert len(pictures) == 0 and len(pictures.objects) == 0
    sim.run_until(0)
    assert len(pictures) == 1


def test_a_recording_that_begins_between_runs() -> None:
    counter = Counter("counter")
    sim = Simulation([Task("only", s(1), [counter])])
    sim.run_until(s(9))
    recording = counter.out_step.record()
    sim.run_until(s(12))
    assert recording.t_ns.tolist() == [s(10), s(11), s(12)]


def test_unknown_fields_and_periods_are_refused() -> None:
    sim, recording = counting()
    sim.run_until(0)
    with pytest.raises(KeyError, match=r"counter\.out_step has no field 'x'; it has n, r_BN_N"):
        recording["x"]
    with pytest.raises(ValueError, match="every must be positive"):
        recording.port.record(every=0)


def test_saved_and_loaded_rows_are_equal(tmp_path: Path) -> None:
    sim, recording = counting()
    sim.run_until(s(3))
    save(tmp_path / "run.npz", [recording])
    loaded = load(tmp_path / "run.npz")
    assert list(loaded) == ["counter.out_step"]
    assert loaded["counter.out_step"].tobytes() == recording.rows().tobytes()
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


def test_bad_files_are_named(tmp_path: Path) -> None:
    _, recording = counting()
    with pytest.raises(ValueError, match=r"run\.xyz: formats are \.npz"):
        save(tmp_path / "run.xyz", [recording])
    with pytest.raises(ValueError, match=r"imager\.out_picture: PictureMsg is an object message"):
        save(tmp_path / "run.npz", [Imager("imager").out_picture.record()])
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(ValueError, match=r"bad\.npz is damaged"):
        load(tmp_path / "bad.npz")
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "none.npz")
    with pytest.raises(FileNotFoundError):
        save(tmp_path / "no_such_folder" / "run.npz", [recording])


def test_nothing_half_written_stays(tmp_path: Path) -> None:
    (tmp_path / "table.csv").write_text("old")

    def fail_halfway() -> None:
        with atomic(tmp_path / "table.csv") as temporary:
            temporary.write_text("half")
            raise OSError(28, os.strerror(28))

    with pytest.raises(OSError, match="No space left"):
        fail_halfway()
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"] and (tmp_path / "table.csv").read_text() == "old"
