"""Record all ROS topics into a bag.

Modules in the order of use:

- `params`: what is recorded, and where
- `background_writer`: writes the bag from a thread of its own
- `terrain_recording`: which terrain maps are recorded in full, and which as a difference
- `input_files`: adds the files that the nodes have read
- `recording`: writes messages, repeats transient-local ones, and counts losses; without ROS
- `recorder_node`: the node: receives all topics (`msg_bridge.raw_topics`) and publishes its status

Modules are imported by name: only the first three do without rclpy.
"""

__all__: list[str] = []
