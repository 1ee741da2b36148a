"""The bags that clients may open: those of a folder, or one; each client has its own player."""

from __future__ import annotations

import threading
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from viewer.server.backend import Source
from viewer.server.encoding import SceneEncoder
from viewer.sources.bag_player import BagPlayer

__all__ = ["BagFolder", "UnknownBagError"]

_MAX_BAGS = 500
"""Maximum number of bags that are listed, the newest first."""


class UnknownBagError(EarthmovingError):
    """There is no such bag, or too many are shown already."""


class BagFolder:
    """Bags by name. A name is compared with the listed ones, so that no path can be given."""

    def __init__(self, folder: Path, max_players: int, *, only: str | None = None) -> None:
        """
        Args:
            folder: folder of the bags; need not exist yet.
            max_players: maximum number of players at a time.
            only: name of the only bag that is offered; None: all.
        """
        self._folder, self._only, self._max_players = folder, only, max_players
        self._lock = threading.Lock()
        self._num_players = 0

    @property
    def has_free_player(self) -> bool:
        """Whether another client may be shown a bag."""
        with self._lock:
            return self._num_players < self._max_players

    def names(self) -> list[str]:
        """Return the names of the bags, the newest first."""
        if self._only is not None:
            return [self._only]
        try:
            found = [path for path in self._folder.iterdir() if _is_bag(path)]
            found.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        except OSError:  # no folder yet, or a bag that is being removed
            return []
        return [path.name for path in found[:_MAX_BAGS]]

    def open(self, name: str) -> Source:
        """Return a player of its own for a bag.

        Raises:
            EarthmovingError: there is no such bag, it cannot be read, or too many are shown.
        """
        if name not in self.names():
            raise UnknownBagError(f"there is no bag {name[:100]!r}")
        with self._lock:
            if self._num_players >= self._max_players:
                raise UnknownBagError(
                    f"{self._num_players} clients are shown bags; set max_bag_players"
                )
            self._num_players += 1
        try:
            player = BagPlayer(self._folder / name, on_close=self._on_close)
        except BaseException:
            self._on_close()
            raise
        return Source(SceneEncoder(player.scene), name, player)

    def _on_close(self) -> None:
        with self._lock:
            self._num_players -= 1


def _is_bag(path: Path) -> bool:
    if path.is_dir():
        return any(path.glob("*.mcap"))
    return path.suffix == ".mcap"
