"""TorqueSum: what was written is added, what was not is none."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fsw import Module, Out
from messages.control import CmdTorqueBodyMsg
from sim.actuators.torque_sum import TorqueSum


class Sources(Module):
    """Three torques."""

    out_a = Out(CmdTorqueBodyMsg)
    out_b = Out(CmdTorqueBodyMsg)
    out_c = Out(CmdTorqueBodyMsg)


def test_sum(criterion: Callable[[str, float], None]) -> None:
    sources, total = Sources("sources"), TorqueSum("total")
    ports = [(sources.out_a, total.in_a), (sources.out_b, total.in_c), (sources.out_c, total.in_d)]
    for k, (out, reader) in enumerate(ports):
        out.connect(reader)
        total.step(k)
        out.write(CmdTorqueBodyMsg(torque_B=np.array([1.0, 2.0, -4.0]) * 2.0**k), k)
    assert total.out_torque.seq == 2, "nothing was published before the first torque"
    total.step(3)
    message = total.out_torque.latest()
    assert message is not None
    criterion("SUM-1", float(np.max(np.abs(message.torque_B - [7.0, 14.0, -28.0]))))
