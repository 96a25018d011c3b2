"""Every compiled module: it leaves its inputs alone, means the same uncompiled, and trusts nothing blindly.

Modules are found by themselves; messages and parameters are made from their declarations, with names as the guide
(``beta_`` is a unit quaternion, ``dcm_`` a rotation, ``r_`` a position in orbit). A module that needs more than that
gets it in `PARAMS`.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import modules
import sim
from fsw import In, KernelModule, Message, Module, Out, OutPort, Record, Row, publish, s
from fsw.math.camera import UNLIMITED
from fsw.math.compiled import COMPILE
from fsw.streams import stream_words
from messages.base import F64, Field, fields_of
from messages.filters import PoseNuisanceMsg
from modules.control.b_dot import BDot
from modules.control.magnetic_momentum_dump import MagneticMomentumDump
from modules.control.wheel_torque_map import WheelTorqueMap
from modules.guidance.ground_target_point import GroundTargetPoint
from sim.actuators.magnetic_torquers import MagneticTorquers
from sim.actuators.reaction_wheels import ReactionWheels
from sim.camera.landmark_oracle import LandmarkOracle

ULPS = 2.0
"""Units in the last place of an array's largest element by which compiled and plain code may differ.

Both do the same IEEE operations in the same order, and nearly always agree to the last bit. The compiler may merge
constants or use another library's sine, which moves an intermediate result by one unit; sums pass that on.
"""

PARAMS: dict[str, Callable[[], Record]] = {
    "LandmarkOracle.Params": lambda: LandmarkOracle.Params(  # so wide that the Earth is in view whatever the attitude
        lens=np.array([50.0, 50.0, 511.5, 511.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, UNLIMITED])
    )
}
"""Parameters and states by ``Class.Params`` or ``Class.State``, where the rules below cannot make them."""
THREE = {"axes": np.eye(8, 3), "limit": np.array([0.1, 0.1, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0])}
"""Three actuators along the axes of the body."""
PARAMS |= {
    "WheelTorqueMap.Params": lambda: WheelTorqueMap.Params(wheel_axes_B=THREE["axes"], max_torque=THREE["limit"]),
    "GroundTargetPoint.Params": lambda: GroundTargetPoint.Params(lat=0.8, lon=0.1, stop_below=False),
    "BDot.Params": lambda: BDot.Params(torquer_axes_B=THREE["axes"], max_dipole=THREE["limit"]),
    "MagneticMomentumDump.Params": lambda: MagneticMomentumDump.Params(
        wheel_axes_B=THREE["axes"],
        wheel_inertia=THREE["limit"],
        torquer_axes_B=THREE["axes"],
        max_dipole=THREE["limit"],
    ),
    "ReactionWheels.Params": lambda: ReactionWheels.Params(axes_B=THREE["axes"], inertia=THREE["limit"]),
    "MagneticTorquers.Params": lambda: MagneticTorquers.Params(axes_B=THREE["axes"], max_dipole=THREE["limit"]),
}


def _special_messages() -> dict[str, Callable[[np.random.Generator, int], Message]]:
    """The Moon as a camera sees it, and directions: fields that fit each other, which no rule for one field makes."""
    from messages.filters import DirectionsMsg
    from messages.opnav import OpNavBrightnessMsg, OpNavMsg
    from tests.modules.opnav.disk_truth import camera, circles_message, limb_message

    spot = np.array([500.0, 520.0])

    def limb(rng: np.random.Generator, t_ns: int) -> Message:
        angle = rng.uniform(0.0, 2.0 * np.pi, 40)
        return limb_message(spot + 60.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1), 0.1, 301, t_ns)

    def circles(rng: np.random.Generator, t_ns: int) -> Message:
        return circles_message(np.array([[*spot + rng.normal(size=2), 60.0]]), np.eye(3), 301, t_ns)

    def light(rng: np.random.Generator, t_ns: int) -> Message:
        fields: dict[str, Any] = {"exposure_ns": t_ns, "valid": True, "status": 0, "body_id": 301}
        return OpNavBrightnessMsg(center_px=spot + rng.normal(size=2), P_px=np.eye(2), area_px=30.0, **fields)

    def position(rng: np.random.Generator, t_ns: int) -> Message:
        fields: dict[str, Any] = {"exposure_ns": t_ns, "valid": True, "status": 0, "fault_detected": False}
        fields |= {f"r_CP_{f}": np.full(3, 1e7) + rng.normal(size=3) for f in "NBC"}
        fields |= {f"P_rr_{f}": np.diag([4.0, 5.0, 9.0]) for f in "NBC"}
        return OpNavMsg(body_id=301, **fields)

    def directions(rng: np.random.Generator, t_ns: int) -> Message:
        numbers = {"measured_B": np.eye(3), "known_N": np.eye(3) + 0.001 * rng.normal(size=(3, 3)), "sigma": np.ones(3)}
        padded = {k: np.concatenate([v, np.full((13, *v.shape[1:]), np.nan)]) for k, v in numbers.items()}
        return DirectionsMsg(exposure_ns=t_ns, valid=True, count=3, **(padded | {"sigma": 0.01 * padded["sigma"]}))

    return {
        "DirectionsMsg": directions,
        "CameraConfigMsg": lambda rng, t_ns: camera(800.0),
        "OpNavLimbMsg": limb,
        "OpNavCirclesMsg": circles,
        "OpNavBrightnessMsg": light,
        "OpNavMsg": position,
    }


MESSAGES = _special_messages()
"""Messages by class name, where the rules below cannot make them."""


_ESTIMATE = {"out_filter.x", "out_filter.P", "out_nav.r_BN_N", "out_nav.v_BN_N"}
PREDICTED = {
    "RelativeOdUkf": _ESTIMATE,
    "PixelLineBiasUkf": _ESTIMATE,
    "EarthTrackerEkf": {"out_filter.x", "out_filter.P"},  # as it was, with its time; a torque of NaN predicts nothing
    "PoseMekf": {
        *(f"out_filter.{name}" for name in ("r_BN_N", "v_BN_N", "beta_BN", "bias_B", "P")),
        *("out_nav.r_BN_N", "out_nav.v_BN_N", "out_att.sigma_BN", "out_att.omega_BN_B"),
        *(f"out_nuisance.{f.name}" for f in fields_of(PoseNuisanceMsg)),
    },
    "HeadingUkf": {"out_filter.x", "out_filter.P", "out_direction.u_PC_B", "out_direction.P_uu_B"},
}
"""What filters know without a good measurement: the prediction from their initial state. Nothing else goes on."""


def kernel_modules() -> list[type[KernelModule]]:
    """All classes of compiled modules in ``modules`` and ``sim``."""
    found: set[type[KernelModule]] = set()
    for package in (modules, sim):
        for info in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if info.name.endswith(".module"):
                members = vars(importlib.import_module(info.name)).values()
                found |= {
                    m for m in members if isinstance(m, type) and issubclass(m, KernelModule) and m is not KernelModule
                }
    return sorted(found, key=lambda c: f"{c.__module__}.{c.__qualname__}")


CLASSES = kernel_modules()


def plausible(field: Field, rng: np.random.Generator) -> Any:
    """A value of a field that a real system could have."""
    name, shape = field.name, field.shape
    if field.kind == "bool":
        return True
    if name == "body_id":
        return 301
    if field.kind == "int":
        return np.zeros(shape, np.int64) if shape else 0
    if name.startswith("inertia"):
        return np.diag([900.0, 800.0, 600.0]) + np.array([[0, 12.0, -7.0], [12.0, 0, 20.0], [-7.0, 20.0, 0]])
    if name.startswith("beta_"):
        return Rotation.random(rng=rng).as_quat(scalar_first=True, canonical=True)
    if name.startswith("dcm_"):
        return Rotation.random(rng=rng).as_matrix()
    if (name in ("P", "process_noise") or name.startswith("P_")) and len(shape) == 2:
        root = rng.normal(size=shape)
        return root @ root.T + np.eye(shape[0])
    size = 7e6 if name.startswith("r_") else 7e3 if name.startswith("v_") else 0.01
    value = size * rng.uniform(0.2, 1.0, shape) * rng.choice([-1.0, 1.0], shape)
    if name.startswith("r_"):  # a position in orbit, above the ground
        value *= max(1.0, 7e6 / float(np.linalg.norm(value)))
    limits = dict(field.bound.limits) if field.bound else {}
    if limits:
        low = max(limits.get(">", -np.inf), limits.get(">=", -np.inf))
        high = min(limits.get("<", np.inf), limits.get("<=", np.inf))
        value = np.clip(np.abs(value), low if low > 0 else value * 0 + 1e-3, high)
    return value if shape else float(value)


def record(kind: type[Record], rng: np.random.Generator) -> Record:
    """A record of which only what has no default is made up."""
    if kind.__qualname__ in PARAMS:
        return PARAMS[kind.__qualname__]()
    needed = [f for f in fields_of(kind) if f.default is msgspec.NODEFAULT]
    return kind(**{f.name: plausible(f, rng) for f in needed})


def message(kind: type[Message], rng: np.random.Generator, t_ns: int) -> Message:
    """A message with every field made up; times, whose names end in ``_ns``, are now."""
    if kind.__qualname__ in MESSAGES:
        return MESSAGES[kind.__qualname__](rng, t_ns)
    return kind(**{f.name: t_ns if f.name.endswith("_ns") else plausible(f, rng) for f in fields_of(kind)})


class Rig:
    """One module with a source for each input."""

    def __init__(self, cls: type[KernelModule], seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        build: Any = cls
        self.module: KernelModule = build("module", record(cls.Params, self.rng), record(cls.State, self.rng))
        self.module.seed(lambda field: stream_words(seed, "module", field))
        self.sources: dict[str, OutPort[Any]] = {}
        owner = Module("sources")
        for name, declared in cls.ports.items():
            if isinstance(declared, In):
                self.sources[name] = OutPort(owner, name, declared.kind)
                self.sources[name].connect(vars(self.module)[name])

    def feed(self, t_ns: int) -> None:
        for source in self.sources.values():
            source.write(message(source.kind, self.rng, t_ns), t_ns)

    def inputs(self) -> list[bytes]:
        """Bytes of everything that a kernel must leave alone."""
        rows = self.module.kernel_rows()
        ports = type(self.module).ports
        read = [i + 2 for i, n in enumerate(self.module.kernel_ports) if isinstance(ports[n], In)]
        return [rows[i].tobytes() for i in (0, *read)]

    def written(self) -> list[Any]:
        """State and outputs."""
        return [r.copy() for r in self.module.rows()[1:]]

    def step(self, t_ns: int, compiled: bool) -> bool:
        """Run one step; False if it raised."""
        try:
            if compiled:
                self.module.step(t_ns)
            else:
                self.module.step_uncompiled(t_ns)
        except (RuntimeError, ValueError):
            return False
        return True


def leaves(row: Any) -> Iterator[tuple[str, F64]]:
    """Fields of a row, by name."""
    for name in row.dtype.names:
        yield name, row[name]


class ShortMsg(Message):
    """The beginning of the other."""

    x: Annotated[float, "m", "a number"]


class LongMsg(Message):
    """Begins like the other."""

    x: Annotated[float, "m", "a number"]
    y: Annotated[float, "m", "another number"]


class ShortWriter(KernelModule):
    """Writes the short message."""

    out = Out(ShortMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out: Row) -> None:
        """Write."""
        out.x = 1.0
        publish(out, t_ns)


class LongWriter(KernelModule):
    """Writes the long message."""

    out = Out(LongMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, out: Row) -> None:
        """Write."""
        out.x = 1.0
        out.y = 2.0
        publish(out, t_ns)


def test_messages_that_begin_alike() -> None:
    """numba takes the longer row for a kind of the shorter one; it must neither warn nor mix them up."""
    short, long = ShortWriter("short"), LongWriter("long")
    short.step(s(1))
    long.step(s(2))
    first, second = short.out.latest(), long.out.latest()
    assert first is not None
    assert second is not None
    assert (first.x, second.x, second.y) == (1.0, 1.0, 2.0)
    assert (short.out.t_ns, long.out.t_ns, short.out.seq, long.out.seq) == (s(1), s(2), 1, 1)


def test_modules_are_found() -> None:
    assert {"Spacecraft", "Gyro", "StarTracker", "AttitudeReadout", "MrpFeedback"} <= {c.__name__ for c in CLASSES}


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_inputs_and_parameters_stay(cls: type[KernelModule]) -> None:
    rig = Rig(cls, 1)
    for k in range(4):
        rig.feed(s(k))
        before = rig.inputs()
        rig.step(s(k), compiled=True)
        assert rig.inputs() == before


@pytest.mark.skipif(not COMPILE, reason="there is nothing to compare when compilation is off")
@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_compiled_and_plain_agree(cls: type[KernelModule]) -> None:
    fast, plain = Rig(cls, 2), Rig(cls, 2)
    for k in range(12):
        for rig in (fast, plain):
            rig.feed(s(k))
        assert fast.step(s(k), compiled=True)
        assert plain.step(s(k), compiled=False)
        for a, b in zip(fast.written(), plain.written(), strict=True):
            for (name, x), (_, y) in zip(leaves(a), leaves(b), strict=True):
                if x.dtype.kind == "f":
                    tolerance = ULPS * np.spacing(np.nanmax(np.abs(y), initial=0.0))
                    np.testing.assert_allclose(x, y, rtol=0, atol=float(tolerance), err_msg=name)
                else:
                    np.testing.assert_array_equal(x, y, err_msg=name)


def published_numbers(rig: Rig, seen: dict[str, int]) -> set[str]:
    """Fields with finite numbers in the outputs written since ``seen``, of those that do not say invalid.

    Lists are looked at as far as their ``count``.
    """
    good: set[str] = set()
    for name, declared in type(rig.module).ports.items():
        if isinstance(declared, Out) and vars(rig.module)[name].seq > seen[name]:
            row = vars(rig.module)[name].row
            if "valid" not in row.dtype.names or row["valid"][0]:
                held = slice(int(row["count"][0])) if "count" in row.dtype.names else slice(None)
                floats = {f: x[:, held] if x.ndim > 1 else x for f, x in leaves(row) if x.dtype.kind == "f"}
                good |= {f"{name}.{f}" for f, x in floats.items() if x.size and np.all(np.isfinite(x))}
    return good


def counts(rig: Rig) -> dict[str, int]:
    return {n: vars(rig.module)[n].seq for n, p in type(rig.module).ports.items() if isinstance(p, Out)}


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_never_written_inputs_give_nothing(cls: type[KernelModule], compiled: bool) -> None:
    """Without any input nothing is published, unless all inputs are optional."""
    rig = Rig(cls, 3)
    needed = [p for p in cls.ports.values() if isinstance(p, In) and not p.optional]
    if not needed:
        pytest.skip("every input is optional")
    before = counts(rig)
    for k in range(3):
        rig.step(s(k), compiled=compiled)
    if cls.__name__ in PREDICTED:
        assert published_numbers(rig, before) == PREDICTED[cls.__name__]
    else:
        assert counts(rig) == before


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "plain"])
@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_nan_input_is_not_passed_off_as_data(cls: type[KernelModule], compiled: bool) -> None:
    """All inputs NaN: the step raises, publishes nothing, publishes NaN, or says that the output is invalid.

    And the state keeps no NaN: once the inputs are good again, so are the outputs.
    """
    rig = Rig(cls, 4)
    if not rig.sources:
        pytest.skip("the module has no inputs")
    seen = counts(rig)
    for k in range(3):
        rig.feed(s(k))
        rig.step(s(k), compiled=compiled)
    expected = published_numbers(rig, seen)
    assert expected or not seen
    seen = counts(rig)
    rig.feed(s(3))
    for source in rig.sources.values():
        for name, values in leaves(source.row):
            if values.dtype.kind == "f":
                source.row[name] = np.nan
    rig.step(s(3), compiled=compiled)
    assert published_numbers(rig, seen) == PREDICTED.get(cls.__name__, set())
    for k in range(4, 7):
        seen = counts(rig)
        rig.feed(s(k))
        assert rig.step(s(k), compiled=compiled)
    assert published_numbers(rig, seen) == expected
