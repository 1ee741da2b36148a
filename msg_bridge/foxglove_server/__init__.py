"""Serve all topics to Foxglove and Lichtblick while the simulation runs, by foxglove-sdk.

Modules in the order of use:

- `params`, `usage`: what is served, where, and what clients may do
- `sdk`: imports foxglove-sdk, which is optional
- `live_channels`: channels of the server and the newest messages of states
- `client_messages`: commands that clients publish
- `service_calls`: services of the simulation that clients call
- `node`: the node: receives all topics and passes them on

Modules are imported by name; `node` and the last two need rclpy.
"""

__all__: list[str] = []
