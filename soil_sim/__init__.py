"""Soil as height volume: whole mm^3 in columns that are cut, filled and slip.

- `soil`: one tick of it, resist -> cut, press -> deposit -> slip; `params`: what it is made of
- `columns`: the terrain's state
- `sweeps`: which tools' rows are sound
- `cut`: swept cutting; `paint`: what a tool sweeps; `refined`: the columns a tool stands in
- `keypoints`: the 2014 reference's digging rule
- `press`: tracks pack loose soil
- `landing`: landed particles become soil
- `slip`: soil steeper than its angle of repose moves
- `force`: what tools feel of it
- `changes`: what a tick did; `answers`: it in rows; `tiles`: running volume and state hash
- `soils`: kinds of soil; `design`: cut and fill against what the ground shall become
- `terrain`: where terrain comes from, files and made ground
- `vec3`: vectors of three numbers, for kernels

No ROS and nothing of the machines: they meet in `msg_bridge.contract`.
"""
