"""Parameters of crash recovery, the same for soil and machine nodes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["RecoveryParams"]


@dataclass(frozen=True)
class RecoveryParams(Parameters):
    """Where a node writes what it needs to continue its run after a crash, and how often."""

    path: str = parameter(
        "",
        "folder in which the node journals its inputs and writes checkpoints, so that it continues"
        " the run if it is restarted after a crash; nodes may share it; empty: nothing is written",
    )
    checkpoint_period: float = parameter(
        5.0,
        "wall clock time between two checkpoints of all state; a restarted node computes the ticks"
        " after the last one again",
        unit="s", low=0.1, high=3600.0,
    )  # fmt: skip
    resume: bool = parameter(
        True,
        "whether a restarted node continues the run that it finds in `path`; false: it begins"
        " another one",
    )

    def folder(self, node_name: str) -> Path | None:
        """Return the folder of a node; None without recovery.

        Args:
            node_name: fully qualified name of the node.
        """
        return Path(self.path) / node_name.strip("/") if self.path else None
