"""The two kinds of module, with one API: Python modules and kernel modules."""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from fsw.math.compiled import COMPILE, compiled, plain
from fsw.ports import In, InPort, Out, OutPort, blank_row, field_views
from fsw.streams import stream_words
from messages.base import ObjectMessage, Record, dtype_of, fields_of

if TYPE_CHECKING:
    from fsw.simulation import Simulation

Row: TypeAlias = Any
"""A row as a kernel sees it: fields are attributes, arrays are views, a message's row also has t_ns and seq."""


class NoFields(Record):
    """Parameters or state of a module that has none."""


@compiled
def publish(row: Row, t_ns: int) -> None:
    """Declare the row of an output written at ``t_ns``; a kernel calls it after it has set the fields."""
    row.t_ns = t_ns
    row.seq += 1


class Module:
    """A component with typed ports and a step, in plain Python. Abstract: derive, declare ports, write `step`.

    Attributes:
        name: unique in a simulation; random streams depend on it.
        params: the validated parameters.
    """

    Params: ClassVar[type[Record]] = NoFields
    shared: ClassVar[tuple[str, ...]] = ()
    """Names of attributes that are large and never change (a map, a model): `reset` and snapshots do not copy them."""
    ports: ClassVar[dict[str, In[Any] | Out[Any]]] = {}
    params: Any

    def __init_subclass__(cls) -> None:
        """Collect the ports, and refuse to derive from a concrete module."""
        for base in cls.__bases__:
            if issubclass(base, Module) and base.__module__ != __name__:
                raise TypeError(f"{cls.__name__}: {base.__name__} is final; to vary a module, wrap it or write another")
        cls.ports = {n: v for n, v in vars(cls).items() if isinstance(v, (In, Out))}

    def __init__(self, name: str, params: Record | None = None) -> None:
        """Make a module.

        Args:
            name: unique name, such as "star_tracker_1".
            params: an instance of the class's ``Params``; may be left out if every parameter has a default.

        Raises:
            TypeError: if ``params`` is of another class or a parameter without default is missing.
        """
        if not name or not name.isprintable() or "." in name:
            raise ValueError(f"{type(self).__name__}: a module name is printable and has no dot, got {name!r}")
        self.name = name
        self.params = self._record(self.Params, params, "params")
        self._simulation: Simulation | None = None
        self._initial: dict[str, Any] | None = None
        for port, declared in self.ports.items():
            made = InPort(self, port, declared) if isinstance(declared, In) else OutPort(self, port, declared.kind)
            self.__dict__[port] = made

    def _record(self, kind: type[Record], given: Record | None, what: str) -> Record:
        if given is None:
            missing = [f.name for f in fields_of(kind) if f.default is msgspec.NODEFAULT]
            if missing:
                text = f"{what} {', '.join(missing)} have no default; pass {kind.__qualname__}(...)"
                raise TypeError(f"{type(self).__name__} {self.name!r}: {text}")
            return kind()
        if type(given) is not kind:
            expected = f"expected {kind.__qualname__}, got {type(given).__qualname__}"
            raise TypeError(f"{type(self).__name__} {self.name!r}: {what}: {expected}")
        return given

    @property
    def inputs(self) -> list[InPort[Any]]:
        """Input ports in the order of declaration."""
        return [self.__dict__[n] for n, p in self.ports.items() if isinstance(p, In)]

    @property
    def outputs(self) -> list[OutPort[Any]]:
        """Output ports in the order of declaration."""
        return [self.__dict__[n] for n, p in self.ports.items() if isinstance(p, Out)]

    def step(self, t_ns: int) -> None:
        """Read the inputs, compute, write the outputs. Called by the executive at each period of the task."""
        raise NotImplementedError(f"{type(self).__name__} has no step")

    def rows(self) -> list[NDArray[Any]]:
        """The module's own rows, in a fixed order: what the arena of a simulation holds of it."""
        return [p.row for p in self.outputs]

    def bind(self, rows: list[NDArray[Any]]) -> None:
        """Move the module onto other rows, which hold the same values."""
        for port, row in zip(self.outputs, rows, strict=True):
            port.bind(row)

    def attach(self, simulation: Simulation | None) -> None:
        """Belong to a simulation, which wants to know when wiring changes."""
        self._simulation = simulation

    def rewired(self) -> None:
        """Tell the simulation that connections or recordings have changed."""
        if self._simulation is not None:
            self._simulation.rewired()

    def _changing(self) -> dict[str, Any]:
        fixed = {"name", "params", "_simulation", "_initial", *self.ports, *self.shared}
        return {k: v for k, v in vars(self).items() if k not in fixed and not k.startswith("_row")}

    def saved(self) -> dict[str, Any]:
        """A copy of all that a step can change and that lies outside the arena.

        Raises:
            TypeError: if an attribute cannot be copied.
        """
        attributes: dict[str, Any] = {}
        for key, value in self._changing().items():
            try:
                attributes[key] = copy.deepcopy(value)
            except Exception as error:
                advice = f"if it never changes, list it in {type(self).__name__}.shared"
                raise TypeError(f"{self.name}.{key} cannot be copied for a snapshot ({error}); {advice}") from error
        return {
            "attributes": attributes,
            "taken": [p.taken for p in self.inputs],
            "held": [p.held() for p in self.outputs],
        }

    def load(self, saved: dict[str, Any]) -> None:
        """Take over what `saved` returned."""
        for key in self._changing().keys() - saved["attributes"].keys():
            delattr(self, key)
        vars(self).update(copy.deepcopy(saved["attributes"]))
        for port, taken in zip(self.inputs, saved["taken"], strict=True):
            port.taken = taken
        for port, held in zip(self.outputs, saved["held"], strict=True):
            port.restore(held)

    def seed(self, stream: Callable[[str], NDArray[np.uint64]]) -> None:
        """Start random numbers. ``stream(field)`` gives the four words of a named stream of this module.

        A Python module that draws random numbers overrides this and makes its generator from the words.
        """

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"


class KernelModule(Module):
    """A module whose step is a pure function over rows, compiled once per class.

    Derive, declare ``Params``, ``State`` and ports, and write the static method ``kernel(t_ns, params, state, <every
    port by name>)``. It may write ``state`` and outputs only, and declares an output written with `publish`.
    """

    State: ClassVar[type[Record]] = NoFields
    kernel: ClassVar[Callable[..., None]]
    kernel_ports: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        """Check that the kernel's arguments and the declared ports agree."""
        super().__init_subclass__()
        kernel: Any = vars(cls).get("kernel")
        if not isinstance(kernel, staticmethod):
            raise TypeError(f"{cls.__name__}: write a @staticmethod named kernel")
        names = list(inspect.signature(cls.kernel).parameters)
        cls.kernel_ports = tuple(names[3:])
        if names[:3] != ["t_ns", "params", "state"] or set(names[3:]) != set(cls.ports):
            wanted = ", ".join(["t_ns", "params", "state", *cls.ports])
            raise TypeError(f"{cls.__name__}.kernel: expected arguments ({wanted}), got ({', '.join(names)})")
        for port, declared in cls.ports.items():
            if issubclass(declared.kind, ObjectMessage):
                reason = "an object message is for Python modules; a kernel reads rows"
                raise TypeError(f"{cls.__name__}.{port}: {declared.kind.__name__}: {reason}")

    def __init__(self, name: str, params: Record | None = None, state: Record | None = None) -> None:
        """Make a module; ``state`` is the initial state, an instance of the class's ``State``."""
        super().__init__(name, params)
        self._row_params = _row_of(self.params)
        self._row_state = _row_of(self._record(self.State, state, "state"))
        self.seed(lambda stream: stream_words(0, name, stream))  # a simulation seeds it anew
        self._row_null = {n: blank_row(p.kind) for n, p in self.ports.items() if isinstance(p, In)}

    @property
    def state(self) -> Row:
        """The state as it is now; fields are attributes, and arrays are views of it."""
        return self._row_state.view(np.recarray)[0]

    def rows(self) -> list[NDArray[Any]]:
        """Parameters, state, outputs."""
        return [self._row_params, self._row_state, *super().rows()]

    def bind(self, rows: list[NDArray[Any]]) -> None:
        """Move the module onto other rows, which hold the same values."""
        self._row_params, self._row_state = rows[:2]
        super().bind(rows[2:])

    def kernel_rows(self) -> list[NDArray[Any]]:
        """The rows that the kernel works on, in the order of its arguments; an unconnected input reads a blank row."""
        rows = [self._row_params, self._row_state]
        for name in self.kernel_ports:
            port: InPort[Any] | OutPort[Any] = self.__dict__[name]
            source = port.source if isinstance(port, InPort) else port
            rows.append(self._row_null[name] if source is None else source.row)
        return rows

    def step(self, t_ns: int) -> None:
        """One step outside a simulation, compiled unless compilation is off."""
        if COMPILE:
            from fsw.compiler import entry_of

            entry, rows = entry_of(type(self)), self.kernel_rows()
            pointers = entry.pointers(rows)
            if entry.function(t_ns, pointers.ctypes.data) == 0:
                return
            entry.undo(pointers, rows)
        self.step_uncompiled(t_ns)

    def step_uncompiled(self, t_ns: int) -> None:
        """One step as plain Python. If it raises, all rows are as before."""
        rows = self.kernel_rows()
        before = [row.copy() for row in rows]
        try:
            with np.errstate(all="ignore"):
                plain(type(self).kernel)(t_ns, *[row.view(np.recarray)[0] for row in rows])
        except BaseException:
            for row, old in zip(rows, before, strict=True):
                row[:] = old
            raise

    def seed(self, stream: Callable[[str], NDArray[np.uint64]]) -> None:
        """Seed every `Stream` field of the state."""
        for field in fields_of(self.State):
            if field.kind == "stream":
                self._row_state[field.name][0] = stream(field.name)


def _row_of(record: Record) -> NDArray[Any]:
    row = np.zeros(1, dtype_of(type(record)))
    for name, view in field_views(type(record), row):
        view[...] = getattr(record, name)
    return row
