"""Test support for this package and for nodes that work with it.

- `fixtures`: pytest fixtures for launch-free tests of nodes: `ros_domain`, `ros`, `ros_process`
- `ros_context`: nodes, topics and services of one test; `ros_process`: nodes as processes
- `ros_domain`: exclusive ROS domains
- `lossy_transport`: drops, duplicates, delays and reorders messages of the exchange; needs no ROS
"""

from msg_bridge.testing.lossy_transport import LossyTransport

__all__ = ["LossyTransport"]
