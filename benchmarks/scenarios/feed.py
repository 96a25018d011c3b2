"""Modules outside of a simulation, fed by hand."""

from __future__ import annotations

from typing import Any

from fsw import Module, OutPort
from fsw.ports import In


def fed(module: Module) -> dict[str, OutPort[Any]]:
    """An output for each input of a module, by its name."""
    owner, made = Module("sources"), dict[str, OutPort[Any]]()
    for name, port in module.ports.items():
        if isinstance(port, In):
            made[name] = OutPort(owner, name, port.kind)
            made[name].connect(vars(module)[name])
    return made
