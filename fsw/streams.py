"""Random streams: one per run seed, module name and stream name, so that no module changes another's draws."""

from __future__ import annotations

import hashlib
import json

import numpy as np
from numpy.typing import NDArray


def stream_words(seed: int, module: str, stream: str) -> NDArray[np.uint64]:
    """The four 64-bit words that start a stream, the first digest bytes of SHA-256 over its three names.

    Args:
        seed: of the run. module: unique module name. stream: name of the `Stream` field.

    Returns:
        uint64 array (4,), never all zero (which xoshiro256++ forbids; its chance is 2^-256).
    """
    key = hashlib.sha256(json.dumps([seed, module, stream]).encode()).digest()
    return np.frombuffer(key, "<u8").astype(np.uint64)
