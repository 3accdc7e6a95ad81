"""Numbers over time in few bytes, which the page takes apart again (`unpack.js`).

They are rounded to steps, each instant is told by its difference from the one before, and bytes of
the same weight lie together: so they compress well.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from jaxtyping import Float

_LEVEL = 6  # of compression: more takes longer and gains little


class Pack:
    """Arrays one after the other."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(
        self, values: Float[np.ndarray, "time ..."], step: float, low: float | None = None
    ) -> dict[str, Any]:
        """Add an array of finite numbers, rounded to whole steps, and say where it is.

        Steps count from ``low``, or from the lowest value.
        """
        least = float(values.min()) if low is None else low
        step = max(step, (float(values.max(initial=least)) - least) / 2**31)
        whole = np.rint((values - least) / step).reshape(len(values), -1)
        most = float(whole.max(initial=0.0))
        wide = next(size for size in (1, 2, 4) if most < 256**size)
        kind = np.dtype(f"<u{wide}")
        numbers = np.clip(whole, 0.0, 256.0**wide - 1).astype(kind)
        changes = np.diff(numbers, axis=0, prepend=np.zeros_like(numbers[:1]))
        planes = changes.ravel().view(np.uint8).reshape(-1, wide).T
        said = {
            "at": self._size,
            "count": int(numbers.size),
            "row": int(numbers.shape[1]),
            "wide": wide,
            "low": least,
            "step": step,
        }
        self._parts.append(planes.tobytes())
        self._size += planes.size
        return said

    def text(self) -> str:
        """Return all of them, compressed and in letters."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), _LEVEL)).decode("ascii")
