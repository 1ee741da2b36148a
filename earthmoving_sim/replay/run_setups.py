"""Parameters of all nodes of a run, as recorded or with changes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from earthmoving_sim.replay.node_parameters import (
    MachineNodeSetup,
    ParameterChange,
    SoilNodeSetup,
    check_changes,
    machine_node_setup,
    soil_node_setup,
)
from earthmoving_sim.replay.recorded.recorded_files import restore_files
from earthmoving_sim.replay.recorded.run_survey import RunSurvey, SessionId
from msg_bridge.bag.reader import BagReader

__all__ = ["RunConfigurations", "RunSetups"]


class RunSetups(NamedTuple):
    """Parameters of the nodes of a run.

    Attributes:
        soil: those of the soil node.
        machines: those of each process of a machine node, by its first session.
    """

    soil: SoilNodeSetup
    machines: dict[SessionId, MachineNodeSetup]


class RunConfigurations:
    """Configurations of the nodes of a run, with the files that the nodes have read."""

    def __init__(self, reader: BagReader, survey: RunSurvey, folder: Path) -> None:
        """
        Args:
            reader: the bag.
            survey: what it has of the run.
            folder: an empty folder for the files, which must exist as long as they are used.

        Raises:
            ReplayError: the bag lacks the configuration of a node.
            RecordedFileError: a file that the run depends on is missing.
        """
        survey.check_configurations(reader.path)
        self._survey = survey
        self._soil_files = restore_files(reader, survey.config, folder / "soil")
        self._machine_files = {
            session: restore_files(reader, begin.config, folder / f"machines_{k}")
            for k, (session, begin) in enumerate(survey.starts.items())
        }

    def setups(self, changes: Sequence[ParameterChange] = ()) -> RunSetups:
        """Return the parameters of all nodes.

        Args:
            changes: parameters with other values than recorded.

        Raises:
            ParameterError: a change is of no parameter, or has an invalid value.
            EarthmovingError: another invalid parameter or file.
        """
        soil = soil_node_setup(self._survey.config, self._soil_files, changes)
        machines = {
            session: machine_node_setup(
                begin.config, self._machine_files[session], begin.namespace, changes
            )
            for session, begin in self._survey.starts.items()
        }
        check_changes(changes, [soil, *machines.values()])
        return RunSetups(soil, machines)
