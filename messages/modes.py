"""Messages of modes: what a system is doing."""

from __future__ import annotations

from typing import Annotated

from messages.base import Bound, Message


class ModeMsg(Message):
    """The mode that a system has changed to."""

    mode: Annotated[int, "-", "number of the mode, in the order of their declaration", Bound(ge=0)]
    previous: Annotated[int, "-", "number of the mode before; -1 at the start"]
    transition: Annotated[int, "-", "number of the transition that was taken; -1 at the start"]
    entered_ns: Annotated[int, "ns", "time of the change"]
