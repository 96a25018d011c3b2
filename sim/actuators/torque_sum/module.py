"""TorqueSum: the torque of several actuators as one."""

from __future__ import annotations

from fsw import In, KernelModule, Out, Row, publish
from fsw.math.compiled import compiled
from fsw.math.vectors import V3, add, store3, vec3
from messages.control import CmdTorqueBodyMsg


@compiled
def part(row: Row) -> V3:
    """The torque of an input, none if it was never written."""
    return vec3(row.torque_B) if row.seq > 0 else (0.0, 0.0, 0.0)


class TorqueSum(KernelModule):
    """Adds up to four torques. See SPEC.md."""

    in_a = In(CmdTorqueBodyMsg, optional=True)
    in_b = In(CmdTorqueBodyMsg, optional=True)
    in_c = In(CmdTorqueBodyMsg, optional=True)
    in_d = In(CmdTorqueBodyMsg, optional=True)
    out_torque = Out(CmdTorqueBodyMsg)

    @staticmethod
    def kernel(t_ns: int, params: Row, state: Row, in_a: Row, in_b: Row, in_c: Row, in_d: Row, out_torque: Row) -> None:
        """Add the newest torques."""
        if in_a.seq + in_b.seq + in_c.seq + in_d.seq == 0:
            return
        store3(out_torque.torque_B, add(add(part(in_a), part(in_b)), add(part(in_c), part(in_d))))
        publish(out_torque, t_ns)
