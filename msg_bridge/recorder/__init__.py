"""Record all ROS topics into a bag.

Modules in the order of use:

- `params`: what is recorded, and where
- `raw_subscriptions`: subscriptions that deliver messages of any type as bytes
- `recording`: writes messages, repeats transient-local ones, and counts losses; without ROS
- `recorder_node`: the node: finds topics, polls the subscriptions and publishes its status

Modules are imported by name: only the first and third do without rclpy.
"""

__all__: list[str] = []
