"""Messages of fault injection: what was done to a connection."""

from __future__ import annotations

from typing import Annotated

from messages.base import Bound, Message


class FaultActionMsg(Message):
    """What the faults of a connection did in a step; written when one acts, and once more when none does any longer."""

    acting: Annotated[int, "-", "bit i is set if the i-th fault changed, held back or repeated a message", Bound(ge=0)]
    taken: Annotated[int, "-", "messages that came from the source in this step", Bound(ge=0)]
    delivered: Annotated[int, "-", "messages that went to the reader in this step", Bound(ge=0)]
    written_ns: Annotated[int, "ns", "time of the newest message that the reader sees; -1 for none"]
