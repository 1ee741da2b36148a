"""Soil as columns of firm and loose soil: whole mm^3 that are excavated, deposited, and slide.

In the order of a tick (`soil`):

- `tool_sweeps`: validation of the tools' rows
- `tool_force/`: force that the soil exerts on each tool
- `excavation/`: soil that tools remove
- `compaction`: loose soil that plates pack
- `deposition`: particles that came to rest become loose soil
- `slope_failure/`: soil steeper than its angle of repose slides
- `columns/`: state of the terrain, its changes in a tick, volume and state hash
- `row_output`: the result of the tick in rows

Around it:

- `soils/`: kinds of soil and their parameters
- `terrain/`, `site/`: initial terrain from files, and the design to compare it with
- `endpoint`: the soil behind the exchange; `soil_inventory`: soil that machines hold;
  `sweep_limits`: limits of the motion that machines report
- `split_terrain/`: prototype of a terrain that several soils divide among them
- `node/`: the ROS 2 node
- `warm_up`: compilation of all kernels; `vec3`: vectors in kernels; `errors`

Apart from the node, the package depends neither on ROS nor on the machines: soil and machines share
`msg_bridge.contract`.
"""
