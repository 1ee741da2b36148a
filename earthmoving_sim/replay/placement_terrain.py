"""The terrain on which the processes of machine nodes placed their machines."""

from __future__ import annotations

from collections.abc import Callable

from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.recorded.run_survey import NodeStart, RunSurvey
from msg_bridge.contract.messages import Keyframe

__all__ = ["PlacementTerrain"]


class PlacementTerrain:
    """Copies of the terrain by its recorded revision; with other parameters it has another one."""

    def __init__(self, survey: RunSurvey) -> None:
        """
        Args:
            survey: what a bag has of the run.
        """
        self._wanted = {start.terrain_revision for start in survey.starts.values()}
        self._keyframes: dict[int, Keyframe] = {}

    def keep(self, revision: int, keyframe: Callable[[], Keyframe]) -> None:
        """Keep the present terrain if machines are placed on it.

        Args:
            revision: its revision in the recording.
            keyframe: returns a copy of it.
        """
        if revision in self._wanted and revision not in self._keyframes:
            self._keyframes[revision] = keyframe()

    def of(self, start: NodeStart) -> Keyframe:
        """Return the terrain on which a process placed its machines.

        Raises:
            ReplayError: the run has not had it yet.
        """
        keyframe = self._keyframes.get(start.terrain_revision)
        if keyframe is None:
            raise ReplayError(
                f"{start.namespace} was placed on revision {start.terrain_revision} of the terrain,"
                " which it did not have then; the bag is incomplete, or of an older version"
            )
        return keyframe
