"""Machines, and soil as particles.

- `core`: one tick of it, release -> drive, carry, spill, fall -> settle; `params`: how it steps
- `machine`: a machine from a data file, in pybullet
- `work`: what machines and soil do to each other by tools and tracks
- `particles`: contact dynamics of soil among tools and terrain; `cubes`: the 2014 way
- `ground`: the copy of the terrain that tracks and particles touch; `pressed`: by whom
- `sensors`: what they would say
- `commands`: who commands what; `operator`: scripts at the levers
- `side`: the same behind the exchange; `run`: when it steps, what is due to be told
- `node`: machines as a node; of each `unit` (what it is), `cab` (commands), `station` (topics)

No ROS and nothing of the soil side: they meet in `msg_bridge.contract`.
"""
