"""Building blocks of the nodes; needs rclpy.

- `process_main`: runs one node as a process, from arguments to exit code
- `node_usage`: its help text
- `sim_node`: base class of the nodes
- `ros_parameters`: parameter dataclasses as ROS parameters
- `parameter_files`: parameter files of which no section is for the node
- `diagnostics`: counters, rejected inputs and problems of a node
- `subscription_poller`, `polled_group`: subscriptions that are taken together
- `subscriber_matching`: required subscribers that are not matched yet
- `wait_log`: log and diagnostics on what a node waits for
- `duplicate_node`: detection of another node on the same topics, at the start
- `endpoint_monitor`: publishers of other nodes that disturb a node, or are not received
- `message_decoding`: messages of the exchange from CDR bytes
- `terrain_subscriber`: the terrain by its public topics; `map_decoder`: its maps
"""
