"""Record all ROS topics into a bag.

Modules in the order of use:

- `params`: what is recorded, and where
- `recording`: writes messages, repeats transient-local ones, and counts losses; without ROS
- `recorder_node`: the node: receives all topics (`msg_bridge.raw_topics`) and publishes its status

Modules are imported by name: only the first two do without rclpy.
"""

__all__: list[str] = []
