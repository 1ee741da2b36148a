"""The soil's headers of a run as arrays over ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msg_bridge.audit.collect import RunData
from msg_bridge.audit.numbered_rows import Numbers, Spans
from msg_bridge.contract.messages import SoilHeader, Stream

__all__ = ["SoilTicks"]


@dataclass(frozen=True)
class SoilTicks:
    """The soil's headers in the order of their ticks.

    Attributes:
        headers: the headers.
        ticks: their ticks, shape (n,).
        revisions: revision of the terrain after each, modulo 2**32, shape (n,).
        spans: the rows that each counts, by stream.
    """

    headers: tuple[SoilHeader, ...]
    ticks: Numbers
    revisions: Numbers
    spans: dict[Stream, Spans]

    @classmethod
    def of(cls, data: RunData) -> SoilTicks:
        """Build from a run with at least one soil header."""
        headers = tuple(data.soil[tick] for tick in sorted(data.soil))
        ticks = [header.tick for header in headers]
        return cls(
            headers,
            np.array(ticks, dtype=np.int64),
            np.array([header.revision % 2**32 for header in headers], dtype=np.int64),
            {
                stream: Spans.of(ticks, [header.spans[stream] for header in headers])
                for stream in (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)
            },
        )

    @property
    def from_start(self) -> bool:
        """Whether the first tick of the run is recorded."""
        return int(self.ticks[0]) == 0

    def missing(self) -> list[tuple[int, int]]:
        """Return (first, last) tick of each gap in the headers."""
        before = np.flatnonzero(np.diff(self.ticks) > 1)
        return [(int(self.ticks[k]) + 1, int(self.ticks[k + 1]) - 1) for k in before]
