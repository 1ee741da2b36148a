"""Contents of `soil_sim --help`."""

from __future__ import annotations

from msg_bridge.nodes.node_usage import NodeUsage
from msg_bridge.recovery.params import RecoveryParams
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import SiteParams
from soil_sim.soils.params import SoilParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Simulate the terrain: excavation by tools, deposition of particles, compaction and slope"
    " failure, with exact accounts of the volume.",
    parameters={
        "": SoilNodeParams,
        "site.": SiteParams,
        "soil.": SoilParams,
        "recovery.": RecoveryParams,
    },
)
