"""The framework: typed ports, modules, compiled executive, recorder, graph check, command line."""

from fsw.graph import Graph, GraphError
from fsw.math.compiled import compiled
from fsw.module import KernelModule, Module, Row, publish
from fsw.ports import In, InPort, Out, OutPort, WiringError
from fsw.recorder import Recording, load, save
from fsw.simulation import ModuleError, Simulation, Snapshot, StaleError, StaleWarning, Task
from fsw.time import hours, hz, minutes, ms, s
from messages import base
from messages.base import *  # noqa: F403

__all__ = ["Graph", "GraphError", "In", "InPort", "KernelModule", "Module", "ModuleError", "Out", "OutPort"]
__all__ += ["Recording", "Row", "Simulation", "Snapshot", "StaleError", "StaleWarning", "Task", "WiringError"]
__all__ += ["compiled", "hours", "hz", "load", "minutes", "ms", "publish", "s", "save"]
__all__ += base.__all__
