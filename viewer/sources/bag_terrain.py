"""BagTerrain: restores the terrain of a bag at any message.

It is that of the newest map before, and of the rows that follow it. Transient-local topics are
repeated in bags, so that the map is near.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from msg_bridge.bag.message_index import MessageIndex
from msg_bridge.codec.row_chunks import chunk_from_cdr, from_chunk_cloud
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import RowChunk, Stream
from viewer.scene.scene import Scene
from viewer.scene.terrain_surface import SurfaceMap

__all__ = ["MAP_TOPIC", "UPDATES_TOPIC", "BagTerrain"]

MAP_TOPIC, UPDATES_TOPIC = f"/{topics.TERRAIN_MAP}", f"/{topics.TERRAIN_MAP_UPDATES}"
"""Topics of the terrain, relative to the namespace of the simulation."""


class BagTerrain:
    """Maps and map updates of a bag."""

    def __init__(
        self,
        scene: Scene,
        index: MessageIndex,
        decode: Callable[[str, int], Any],
        decode_map: Callable[[Any], SurfaceMap],
        count_rejected: Callable[[], None],
    ) -> None:
        """
        Args:
            scene: scene whose terrain is restored.
            index: messages of the bag, with those of both topics.
            decode: returns the message of a topic and a number.
            decode_map: returns the surface in a map message.
            count_rejected: called for each message that cannot be used.
        """
        self._scene, self._index = scene, index
        self._decode, self._decode_map = decode, decode_map
        self._count_rejected = count_rejected
        self._references: dict[int, SurfaceMap] = {}

    def chunk(self, number: int) -> RowChunk:
        """Return the rows of a message on the topic of map updates.

        Raises:
            EarthmovingError: it cannot be decoded.
        """
        chunk = chunk_from_cdr(self._index.read(number), Stream.MAP_UPDATE)
        if chunk is None:  # of an earlier format
            return from_chunk_cloud(self._decode(UPDATES_TOPIC, number), Stream.MAP_UPDATE)
        return chunk

    def restore(self, end: int) -> None:
        """Set the terrain to that after the first `end` messages."""
        terrain = self._scene.terrain
        number = self._index.latest(MAP_TOPIC, end)
        surface = None if number is None else self._surface(number)
        is_of_run = surface is not None and terrain.run_id in (None, surface.run_id)
        reference = self._reference(surface.run_id) if surface is not None and is_of_run else None
        if surface is None or reference is None:
            with self._scene.lock:
                terrain.clear()
            return
        chunks = self._rows_after(surface, end)
        with self._scene.lock:
            terrain.restore(surface, reference)
            for chunk in chunks:
                terrain.receive_updates(chunk)
            self._scene.terrain_changed()

    def _surface(self, number: int) -> SurfaceMap | None:
        """Return the surface in a map message; None if it cannot be decoded."""
        try:
            return self._decode_map(self._decode(MAP_TOPIC, number))
        except EarthmovingError:
            self._count_rejected()
            return None

    def _reference(self, run_id: int) -> SurfaceMap | None:
        """Return the first map of a run."""
        if run_id not in self._references:
            for number in self._index.of_topic(MAP_TOPIC):
                surface = self._surface(int(number))
                if surface is not None:
                    self._references.setdefault(surface.run_id, surface)
                if run_id in self._references:
                    break
        return self._references.get(run_id)

    def _rows_after(self, surface: SurfaceMap, end: int) -> list[RowChunk]:
        """Return the chunks of rows before message `end` that follow a map, in order."""
        chunks: list[RowChunk] = []
        numbers = self._index.of_topic(UPDATES_TOPIC)
        for number in numbers[: np.searchsorted(numbers, end)][::-1]:
            try:
                chunk = self.chunk(int(number))
            except EarthmovingError:
                self._count_rejected()
                continue
            if chunk.run_id != surface.run_id or (
                int(chunk.rows["revision"][-1]) <= surface.revision
            ):
                break
            chunks.append(chunk)
        return chunks[::-1]
