"""Ranges of numbered rows, by which a header commits to its rows."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from msg_bridge.contract.quick_init import quick_init
from msg_bridge.contract.rows import Rows

__all__ = ["NumberedRows", "RowRange", "SentRange", "bytes_digest"]

_DIGEST_SIZE = 8
"""Length of a digest [bytes]: headers are arrays of int64."""

_MAX_KEPT_BYTES = 2**15
"""Maximum size of rows whose memory is kept for their digest: headers are kept longer than rows."""


def bytes_digest(memory: bytes) -> int:
    """Return the SHA-256 digest of the memory of one or more rows, cut to an int64."""
    digest = hashlib.sha256(memory).digest()
    return int.from_bytes(digest[:_DIGEST_SIZE], "little", signed=True)


@quick_init
@dataclass(frozen=True)
class RowRange:
    """`count` rows of a stream, from sequence number `first` on.

    Attributes:
        first: sequence number of the first row.
        count: number of rows.
        digest: in a header, digest of the rows, see `exchange.row_digest`; not compared.
    """

    first: int = 1
    count: int = 0
    digest: int = field(default=0, compare=False)

    def __eq__(self, other: object) -> bool:
        """Return whether the other is a range of the same rows."""
        if not isinstance(other, RowRange):
            return NotImplemented
        return self.first == other.first and self.count == other.count

    @cached_property  # read many times in a tick
    def last(self) -> int:
        """Sequence number of the last row; first - 1 if the range is empty."""
        return self.first + self.count - 1


class SentRange(RowRange):
    """Range of rows that this process sends. Its digest is computed when it is first read.

    That is when its header is written to a topic or a file; a receiver in this process compares
    `memory` instead.
    """

    memory: bytes
    """Memory of the rows; empty if it is large, and the digest was computed at once."""

    @staticmethod
    def of(first: int, count: int, memory: bytes) -> SentRange:
        """Return the range of one or more rows with their memory."""
        span = SentRange.__new__(SentRange)
        values = vars(span)
        values["first"], values["count"], values["last"] = first, count, first + count - 1
        if len(memory) <= _MAX_KEPT_BYTES:
            values["memory"] = memory
        else:
            values["memory"], values["digest"] = b"", bytes_digest(memory)
        return span

    @cached_property
    def digest(self) -> int:
        """Digest of the rows."""
        return bytes_digest(self.memory)

    def __reduce__(self) -> tuple[type[RowRange], tuple[int, int, int]]:
        """Pickle a range with its digest: a saved state has the rows themselves once at most."""
        return RowRange, (self.first, self.count, self.digest)


class NumberedRows(NamedTuple):
    """Rows as they are sent, with what is known of them.

    A receiver in the process of the sender gets this object with the rows. It need not look at each
    row, but compares their memory before it uses them.

    Attributes:
        rows: the rows, which must not be modified.
        span: their numbers and digest.
        machine_id: machine whose id all of them have; 0: they are of any machines.
    """

    rows: Rows
    span: RowRange
    machine_id: int = 0
