"""Subscribe to all topics of the ROS graph as bytes, for the recorder and the Foxglove server.

Modules in the order of use:

- `topic_selection`: regular expressions that select topics
- `received_message`: a message of any type as bytes; the newest messages of a transient-local topic
- `raw_subscriptions`: polled subscriptions that deliver messages of any type as bytes
- `graph_topics`: follows the graph: subscribes to new topics, and again where publishers changed
- `tf_from_transforms`: makes `/tf` from the transforms of the machines where tf2_msgs is missing
- `grid_map_from_terrain`: makes `/terrain/grid_map` from the terrain where grid_map_msgs is missing

Modules are imported by name: only the first two do without rclpy.
"""

__all__: list[str] = []
