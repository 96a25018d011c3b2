"""Which features of two images belong together."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

CV: Any = cv2


def mutual_matches(a: NDArray[Any], b: NDArray[Any], ratio: float) -> NDArray[np.int64]:
    """Index pairs (n, 2) of descriptors that are each other's nearest, and clearly so.

    Args:
        a: (n, d) descriptors, float32 (compared by distance) or uint8 (by the number of differing bits).
        b: (m, d), of the same kind.
        ratio: the nearest must be nearer than this times the second nearest, from a to b (Lowe 2004, sec. 7.1).
    """
    if len(a) < 2 or len(b) < 2:
        return np.empty((0, 2), np.int64)
    matcher = CV.BFMatcher(cv2.NORM_HAMMING if a.dtype == np.uint8 else cv2.NORM_L2)
    back = {m.queryIdx: m.trainIdx for (m,) in matcher.knnMatch(b, a, k=1)}
    pairs = [
        (best.queryIdx, best.trainIdx)
        for best, second in matcher.knnMatch(a, b, k=2)
        if best.distance < ratio * second.distance and back.get(best.trainIdx) == best.queryIdx
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)
