"""Access to the vectors in a block, a flat array of stretches with one slot per contact.

See `pair_block` and `plate_block` for the layout.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from msg_bridge.kernels import helper

__all__ = ["vector_access"]


def vector_access(block_size: int) -> tuple[Any, Any]:
    """Return the functions `load` and `store` for blocks with `block_size` slots.

    `load(block, quantity, s)` returns the vector `quantity` of slot `s`, and
    `store(block, quantity, s, vector)` writes it. Only kernels can call them. The block size is a
    constant in them, so that the compiler can prove that the stretches do not overlap.
    """
    stride = np.uint64(block_size)

    # The index is unsigned: the check for a negative one would keep loops from being vectorised.
    @helper(forceinline=True)
    def load(block, quantity, s):  # type: ignore[no-untyped-def]
        at = np.uint64(quantity + s)
        return block[at], block[at + stride], block[at + stride + stride]

    @helper(forceinline=True)
    def store(block, quantity, s, vector):  # type: ignore[no-untyped-def]
        at = np.uint64(quantity + s)
        block[at], block[at + stride], block[at + stride + stride] = vector

    return load, store
