"""Soil as height volume: whole mm^3 in columns that are cut, filled and slip.

- `soil`: one tick of it, cut -> deposit -> slip; `params`: what it is made of
- `columns`: the terrain's state
- `sweeps`: which tools' rows are sound
- `cut`: swept cutting; `paint`: what a tool sweeps; `refined`: the columns a tool stands in
- `keypoints`: the 2014 reference's digging rule
- `landing`: landed particles become soil
- `slip`: soil steeper than its angle of repose moves
- `tiles`: running volume and state hash
- `terrain`: where terrain comes from, files and made ground

No ROS and nothing of the machines: they meet in `msg_bridge.contract`.
"""
