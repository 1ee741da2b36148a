"""What the nodes of this package are made of; needs rclpy.

- `runtime`: runs one node as a process, from arguments to exit code
- `parameters`: parameter dataclasses as ROS parameters
- `diagnostics`: a node's counters and complaints on /diagnostics
- `lean_node`: a node whose endpoints cost nothing while nothing happens on them
- `inbox`: subscriptions that are emptied together; `unwaited`: such as wake nobody
- `wire`: messages of the exchange from their bytes
- `soil_carrier`, `machine_carrier`: the exchange over topics, at either end; `topics` names them
- `soil_topics`, `machine_topics`, `command_topics`: what is told to everybody, and what is heard
- `terrain_listener`: the terrain, followed by its public topics; `map_reader`: its maps
- `listeners`: whether those who are to miss nothing are listening
"""
