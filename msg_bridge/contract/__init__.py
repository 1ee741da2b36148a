"""Definitions shared by soil and machines, without ROS and without physics.

- `grid`: the grid of soil columns and its coordinates
- `rows`: dtypes of the rows exchanged
- `messages`: headers, chunks of rows, requests, keyframes
- `map_updates`: applies changed cells to a keyframe
- `ledger`: the volume in each account at the end of a tick
- `topics`, `endpoint`, `interface`: names of all topics and services; their types, QoS and rates
- `loose_soil`, `cylinder_state`, `constants`: values that cross between soil and machines
- `parameters`, `suggestions`: parameter sets validated when built
- `loopback`, `printable`: addresses of servers; texts of others
- `errors`: error classes and their codes

Modules are imported by name.
"""

__all__: list[str] = []
