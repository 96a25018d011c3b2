"""The framework: typed ports, modules, compiled executive, recorder, graph check, command line."""

from fsw.graph import Graph, GraphError
from fsw.math.compiled import compiled
from fsw.module import KernelModule, Module, Row, publish
from fsw.ports import In, InPort, Out, OutPort, WiringError
from fsw.recorder import Recording, load, save
from fsw.simulation import ModuleError, Simulation, Snapshot, StaleError, StaleWarning, Task
from fsw.time import hours, hz, minutes, ms, s
from messages.base import (
    F64,
    I64,
    Bound,
    Mat3,
    Mat6,
    Message,
    NanOk,
    ObjectMessage,
    Record,
    Shape,
    Stream,
    Vec2,
    Vec3,
    Vec4,
    eye,
    unseeded,
    zeros,
)

__all__ = [
    "F64",
    "I64",
    "Bound",
    "Graph",
    "GraphError",
    "In",
    "InPort",
    "KernelModule",
    "Mat3",
    "Mat6",
    "Message",
    "Module",
    "ModuleError",
    "NanOk",
    "ObjectMessage",
    "Out",
    "OutPort",
    "Record",
    "Recording",
    "Row",
    "Shape",
    "Simulation",
    "Snapshot",
    "StaleError",
    "StaleWarning",
    "Stream",
    "Task",
    "Vec2",
    "Vec3",
    "Vec4",
    "WiringError",
    "compiled",
    "eye",
    "hours",
    "hz",
    "load",
    "minutes",
    "ms",
    "publish",
    "s",
    "save",
    "unseeded",
    "zeros",
]
