"""Publish the messages of a bag on their topics.

Modules in the order of use:

- `params`: what is played, and how
- `map_updates`: the map updates that follow a terrain map
- `playback`: which message is due when: rate, pause, seek, loop, keyframes
- `keys`: keys of a terminal that control it
- `player_node`: the node: publishers with the recorded QoS, time, control and status

Modules are imported by name: all but the last do without rclpy.
"""

__all__: list[str] = []
