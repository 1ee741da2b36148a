"""Contents of `soil_sim --help`."""

from __future__ import annotations

from msg_bridge.nodes.node_usage import NodeUsage
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import SiteParams
from soil_sim.soils.params import SoilParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Simulate the terrain: excavation by tools, deposition of particles, compaction and slope"
    " failure, with exact accounts of the volume.",
    parameters={"": SoilNodeParams, "site.": SiteParams, "soil.": SoilParams},
    subscriptions={
        "/soil/tool_sweeps, /soil/deposit_requests": "rows of all machines",
        "<machine>/soil_tick": "headers of each machine",
    },
    publications={
        "/clock": "simulation time",
        "/terrain/map, /terrain/elevation, /terrain/info, /terrain/grid_map": "terrain",
        "/terrain/map_updates": "changed cells of each tick",
        "/terrain/surface_tilt": "slopes by which loose soil leans (soil.surface_tilt_noise)",
        "/soil/conversions, /soil/forces, <machine>/conversion_backlog": "answers to the machines",
        "/soil/tick, /soil/join_rejections": "headers of the exchange, rejections",
        "/soil/ledger": "volume account of each tick",
        "/soil/cut_fill": "remaining cut and fill (site.design)",
        "/sim/config, /sim/paused, /soil/state_hash, /diagnostics": "parameters of the run, pause,"
        " hash of the state, condition of the node",
    },
    services={
        "/sim/pause, /sim/step, /sim/reset": "pause, single step, new run",
        "/soil/verify": "recount all volumes",
        "/soil/save": "write the terrain to a file",
        "/soil/release": "turn the soil of absent machines into terrain",
    },
)
