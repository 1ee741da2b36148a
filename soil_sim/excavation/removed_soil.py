"""Records of the soil that a tool removed from columns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["REMOVED_SOIL", "RemovedSoil"]

REMOVED_SOIL = np.dtype(
    [
        ("cell", np.int64),  # flat index of the column
        ("volume_mm3", np.int64),  # bank volume [mm^3], above 0
        ("x", np.float64),  # centroid [m], map frame
        ("y", np.float64),
        ("z", np.float64),
        ("soil", np.uint8),  # id of the kind: the firm soil's if most of the volume was firm
        ("moisture", np.uint8),  # [%], mean of loose and firm soil by volume
    ],
    align=True,
)

RemovedSoil = NDArray[np.void]
"""Records of dtype `REMOVED_SOIL`, shape (n,)."""
